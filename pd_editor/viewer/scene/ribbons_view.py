"""Draws paths of agents as ribbons, and what policies planned as thin lines."""

from typing import Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.palette import Palette, Rgb, agent_color
from pd_editor.scene.policy import plans_at
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.meshes.colors import inverse_aces, srgb_to_linear
from pd_editor.viewer.meshes.flat_mesh import MeshNode, Primitive
from pd_editor.viewer.meshes.ribbons import (
    MIN_MOTION_M,
    dotted,
    motion_m,
    path_heights,
    path_ribbons,
)
from pd_editor.viewer.scene.original_view import DASH_HEIGHT_M, DASH_WIDTH_M
from pd_editor.viewer.tab.ui_context import UiContext

STRIDE: Final = 2
"""Every second step is drawn; at 10 Hz that is still under 6 m at 30 m/s."""
HEIGHT_M: Final = 0.065
DOT_WIDTH_M: Final = 0.22


class RibbonsView:
    """One node of one browser with the ribbons of all agents."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._palette = palette
        self._node = MeshNode(client, "/ribbons")
        self._drawn: tuple[AgentTracks, str, Palette] | None = None
        self._is_visible = True
        self._is_muted = False
        self._scenario: Scenario | None = None

    def show(self, scenario: Scenario) -> None:
        """Show the ribbons of a scenario."""
        self._scenario = scenario
        wanted = (scenario.agents, scenario.focal_id, self._palette)
        is_current = self._drawn is not None and all(
            shown is asked for shown, asked in zip(self._drawn, wanted, strict=True)
        )
        if is_current or not self._is_visible:
            return
        self._drawn = wanted
        self._node.draw(ribbon_primitives(scenario, self._palette))

    def set_palette(self, palette: Palette) -> None:
        """Redraw in another theme."""
        self._palette = palette
        if self._scenario is not None:
            self.show(self._scenario)

    def set_muted(self, is_muted: bool) -> None:
        """Mute the ribbons while other elements are shown."""
        self._is_muted = is_muted
        self._apply_visibility()

    def _apply_visibility(self) -> None:
        self._node.set_visible(self._is_visible and not self._is_muted)

    def set_visible(self, is_visible: bool) -> None:
        """Show or hide all ribbons."""
        self._is_visible = is_visible
        self._apply_visibility()
        if is_visible and self._scenario is not None:
            self.show(self._scenario)


def ribbon_primitives(scenario: Scenario, palette: Palette) -> list[Primitive]:
    """Past and future of every agent as transparent meshes.

    Tracks of agents that are not there at the current step are thin and dotted. Every
    agent has a height of its own; the ego lies above the others, the focal agent on top.
    """
    agents, current = scenario.agents, scenario.current_step
    if not len(agents):
        return []
    past = np.unique(np.r_[current % STRIDE : current : STRIDE, current])
    future = np.unique(np.r_[current : agents.num_steps : STRIDE, agents.num_steps - 1])
    is_there = agents.is_valid[:, current]
    order = _bottom_up(scenario)
    # Tracks of static objects are noise.
    order = order[agents.kind_mask(ROAD_USER_KINDS)[order]]
    height = path_heights(HEIGHT_M, np.arange(len(order)))
    own_color = _linear([agent_color(scenario, palette, int(row)) for row in order])
    past_color = np.broadcast_to(_linear([palette.past]), (len(order), 3))
    half_width = np.clip(agents.size_m[order, 1], 0.4, 1.4) * 0.5
    # Paths that end within the agent's own box are left out.
    least = np.clip(agents.size_m[order, 0] / 2, MIN_MOTION_M, 2.5)

    def band(
        steps: np.ndarray,
        color: np.ndarray,
        opacity: tuple[float, float],
        taper: tuple[float, float],
    ) -> list[Primitive]:
        points = agents.position_m[order][:, steps]
        is_valid = agents.is_valid[order][:, steps]
        moves = motion_m(points, is_valid) >= least
        solid, thin = moves & is_there[order], moves & ~is_there[order]
        dots, is_dot = dotted(points[thin], is_valid[thin])
        count, length = int(solid.sum()), len(steps)
        return [
            path_ribbons(
                dots,
                is_dot,
                color=color[thin],
                opacity=np.full(is_dot.shape, 0.6),
                width_m=np.full(is_dot.shape, DOT_WIDTH_M),
                height_m=height[thin],
            ),
            path_ribbons(
                points[solid],
                is_valid[solid],
                color=color[solid],
                opacity=_along(opacity, count, length),
                width_m=half_width[solid, None] * _along(taper, count, length),
                height_m=height[solid],
            ),
        ]

    return [
        *band(past, past_color, (0.0, 0.55), (0.5, 0.8)),
        *band(future, own_color, (0.75, 0.12), (1.0, 0.7)),
    ]


def _bottom_up(scenario: Scenario) -> np.ndarray:
    """Rows in the order in which they are drawn: the ego and the focal agent last."""
    rank = np.zeros(len(scenario.agents), int)
    for place, agent_id in enumerate((EGO_ID, scenario.focal_id), start=1):
        row = scenario.agents.row_of.get(agent_id)
        if row is not None:
            rank[row] = place
    return np.argsort(rank, kind="stable")


def _linear(colors: list[Rgb]) -> np.ndarray:
    shown = np.array(colors, float).reshape(-1, 3)
    return inverse_aces(srgb_to_linear(shown / 255.0))


def _along(ends: tuple[float, float], num_paths: int, num_points: int) -> np.ndarray:
    return np.broadcast_to(np.linspace(*ends, num_points), (num_paths, num_points))


class PlansView:
    """One node of one browser with the plans of driven agents."""

    def __init__(self, ui: UiContext) -> None:
        """Draw nothing yet."""
        self._ui = ui
        self._node = MeshNode(ui.client, "/plans")
        self._palette: Palette | None = None
        self.shown: list[Float[np.ndarray, "F 2"]] = []
        """The plans that are drawn."""
        for signal in (ui.model.poses_drawn, ui.model.run_changed):
            signal.subscribe(self.show)

    def show(self) -> None:
        """Show the plans that were in force at the playhead."""
        plans, palette = self._plans(), self._ui.model.palette
        is_drawn = list(map(id, plans)) == list(map(id, self.shown))
        if is_drawn and palette is self._palette:
            return
        self.shown, self._palette = plans, palette
        self._node.set_visible(bool(plans))
        if plans:
            self._node.draw([_lines(plans, palette)])

    def _plans(self) -> list[Float[np.ndarray, "F 2"]]:
        """The latest plans of the agents that are there."""
        workspace, agents = self._ui.workspace, self._ui.session.scenario.agents
        step = int(workspace.playback.step)
        return plans_at(workspace.plans_in_force, agents, step)


def _lines(plans: list[Float[np.ndarray, "F 2"]], palette: Palette) -> Primitive:
    """Each plan twice: its rim, and itself on that."""
    longest, count = max(map(len, plans)), 2 * len(plans)
    along = np.arange(longest)
    points = np.stack([one[along.clip(max=len(one) - 1)] for one in plans])
    lengths = np.array([len(one) for one in plans])
    colors = np.array([palette.lane, palette.plan]) / 255.0
    # The rim sets a line off from the ribbon below.
    widths = np.tile((2 * DASH_WIDTH_M, DASH_WIDTH_M), len(plans))
    return path_ribbons(
        np.repeat(points, 2, axis=0),
        along < np.repeat(lengths, 2)[:, None],
        color=np.tile(inverse_aces(srgb_to_linear(colors)), (len(plans), 1)),
        opacity=np.ones((count, longest)),
        width_m=np.broadcast_to(widths[:, None], (count, longest)),
        height_m=path_heights(DASH_HEIGHT_M, np.arange(count)),
    )
