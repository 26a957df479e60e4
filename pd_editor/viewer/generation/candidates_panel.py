"""The candidates panel: trajectories that a selected agent could take."""

from typing import Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.analysis.metrics.box_overlaps import PathCollision, first_collisions
from pd_editor.base.errors import EditError
from pd_editor.editor.commands import AdoptTrajectory
from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.palette import Palette
from pd_editor.scene.paths.motion_primitives import (
    CandidateSet,
    candidate_texts,
    candidates,
)
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.guidance.guiding import Guiding
from pd_editor.viewer.meshes.colors import inverse_aces, shown_exactly, srgb_to_linear
from pd_editor.viewer.meshes.flat_mesh import MeshNode, Primitive, ribbons
from pd_editor.viewer.meshes.ribbons import path_heights, path_ribbons
from pd_editor.viewer.overlay.messages import FanEvent, FanState
from pd_editor.viewer.overlay.overlay import OFFER
from pd_editor.viewer.scene.picking import point_of
from pd_editor.viewer.tab.panel_style import FixedText
from pd_editor.viewer.tab.ui_context import UiContext, set_property, set_value

HEIGHT_M: Final = 0.085
LANE_WIDTH_M: Final = 0.12
PATH_WIDTH_M: Final = 0.4
HIGHLIGHTED_WIDTH_M: Final = 0.8
RIM_M: Final = 0.12
"""Each path has a rim in the road's colour, which sets it off from those below."""
PICK_DISTANCE_M: Final = 1.5
FAST_MPS: Final = 15.0
"""Speed from which a candidate has the full colour of a fast one."""


class CandidatesView:
    """One node of one browser with the candidates of one agent."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._palette = palette
        self._node = MeshNode(client, "/candidates")
        self._road_map: RoadMap | None = None
        self._highlighted: int | None = None
        self.shown: CandidateSet | None = None

    def show(
        self,
        candidates: CandidateSet | None,
        road_map: RoadMap | None = None,
        highlighted: int | None = None,
    ) -> None:
        """Draw the candidates of the first agent of a set, or nothing.

        Their reference lanes are drawn under them, as thin lines of ``road_map``.
        """
        self.shown, self._road_map = candidates, road_map
        self._highlighted = highlighted
        if candidates is None:
            self._node.set_visible(False)
            return
        parts = [_fan(candidates, highlighted, self._palette)]
        if road_map is not None:
            parts.insert(0, _reference_lanes(candidates, road_map, self._palette))
        self._node.draw(parts)
        self._node.set_visible(True)

    def set_palette(self, palette: Palette) -> None:
        """Redraw in another theme."""
        self._palette = palette
        if self.shown is not None:
            self.show(self.shown, self._road_map, self._highlighted)

    def candidate_near(self, point_m: Float[np.ndarray, "2"]) -> int | None:
        """Index of the candidate whose path is nearest to a point on the ground."""
        if self.shown is None:
            return None
        gap = np.linalg.norm(self.shown.position_m[0] - point_m, axis=-1).min(axis=-1)
        gap = np.where(self.shown.is_valid[0], gap, np.inf)
        nearest = int(gap.argmin())
        return nearest if gap[nearest] <= PICK_DISTANCE_M else None


def _reference_lanes(
    candidates: CandidateSet, road_map: RoadMap, palette: Palette
) -> Primitive:
    routes = candidates.lane_ids[0]
    lanes = dict.fromkeys(lane_id for route in routes for lane_id in route)
    lines = Lines.of(
        [
            road_map.lane_of[lane_id].centerline_m
            for lane_id in lanes
            if lane_id in road_map.lane_of
        ]
    )
    lines = ribbons(lines.without_repeats(), LANE_WIDTH_M)
    return Primitive(
        points_m=lines.points_m,
        faces=lines.faces,
        height_m=0.06,
        color=shown_exactly(palette.candidate),
        opacity=0.6,
    )


def _fan(
    candidates: CandidateSet, highlighted: int | None, palette: Palette
) -> Primitive:
    """Mesh of all paths; shorter ones are drawn over longer ones."""
    position = candidates.position_m[0]
    count, num_points = position.shape[:2]
    length = np.linalg.norm(np.diff(position, axis=1), axis=-1).sum(axis=1)
    opacity, width = np.full(count, 0.9), np.full(count, PATH_WIDTH_M)
    if highlighted is not None:
        opacity[:] = 0.3
        opacity[highlighted], width[highlighted] = 1.0, HIGHLIGHTED_WIDTH_M
        length[highlighted] = -1.0
    order = np.argsort(-length, kind="stable")
    order = order[candidates.is_valid[0][order]]
    speed = np.clip(candidates.target_speed_mps[0, order] / FAST_MPS, 0.0, 1.0)
    stops = np.array(palette.candidate_speeds, float)
    at = [np.interp(speed, [0.0, 0.5, 1.0], channel) for channel in stops.T]
    shown = np.stack(
        [
            np.broadcast_to(np.array(palette.lane, float), (len(order), 3)),
            np.stack(at, axis=-1),
        ],
        axis=1,
    )
    # Every path twice: its rim, and itself on that.
    twice = np.repeat(order, 2)
    is_rim = np.tile([True, False], len(order))
    along = (len(twice), num_points)
    thick = width[twice] + 2 * RIM_M * is_rim
    return path_ribbons(
        position[twice],
        np.ones(along, bool),
        color=inverse_aces(srgb_to_linear(shown.reshape(-1, 3) / 255.0)),
        opacity=np.broadcast_to(opacity[twice, None], along),
        width_m=np.broadcast_to(thick[:, None], along),
        height_m=path_heights(HEIGHT_M, np.arange(len(twice))),
    )


NO_CANDIDATE: Final[str] = "none"
_NO_CHOICE: Final[list[str]] = [NO_CANDIDATE]
SHOW: Final = "Show possible trajectories"
HIDE: Final = "Hide possible trajectories"
SELECT_ONE: Final = "Select one agent to see its possible trajectories."


class CandidatesPanel:
    """Shows an agent's candidates, one of which can be adopted."""

    def __init__(self, ui: UiContext, guiding: Guiding) -> None:
        """Build it into the tab; an agent can be guided along a candidate as well."""
        self._ui = ui
        self._model = ui.model
        self._guiding = guiding
        self.view = CandidatesView(ui.client, self._model.palette)
        self._agent_id: str | None = None
        self._base: Scenario | None = None
        self._collisions: tuple[PathCollision | None, ...] = ()
        self._pointed: int | None = None
        gui = ui.client.gui
        self._show = gui.add_button(SHOW, color="gray", hint="G")
        self._folder = gui.add_folder("Possible trajectories")
        with self._folder:
            self._choice: viser.GuiDropdownHandle[str] = gui.add_dropdown(
                "Trajectory", _NO_CHOICE
            )
            self._note = FixedText(gui, 2)
            self._legend = gui.add_html("")
            self._adopt = gui.add_button("Use this trajectory", disabled=True)
            self._guide = gui.add_button(
                "Guide along this trajectory",
                color="gray",
                disabled=True,
                hint="The model follows its path at a speed of its own",
            )
        self._ui.on_click(self._show, self.toggle_candidates)
        self._ui.on_click(
            self._adopt, self._adopt_chosen, failure="Trajectory not used"
        )
        self._ui.on_click(self._guide, self._guide_along, failure="Path not set")
        self._ui.on_change(self._choice, lambda _value: self._highlight())
        ui.overlay.on("fan", self._pointer_moved)
        self._model.ground_clicked.subscribe(self.adopt_near)
        self._model.shown.subscribe(self.show)
        self._model.theme_changed.subscribe(self._follow_theme)

    @property
    def shows_candidates(self) -> bool:
        """Whether the fan is drawn."""
        return self.view.shown is not None

    def show(self) -> None:
        """Follow the session: hide the fan of an agent that changed or was removed."""
        scenario, selection = self._ui.session.scenario, self._ui.session.selection
        set_property(self._show, "visible", len(selection) == 1)
        set_property(self._legend, "content", _legend(self._model.palette))
        if self._agent_id is None:
            set_property(self._folder, "visible", False)
            return
        if selection != (self._agent_id,):
            self.hide_candidates()
        elif scenario is not self._base:
            self._draw_candidates(scenario)

    def toggle_candidates(self) -> None:
        """Show the possible trajectories of the selected agent, or hide them.

        Raises:
            EditError: not exactly one agent is selected, or it is not there now.
        """
        if self.shows_candidates:
            self.hide_candidates()
            return
        selection = self._ui.session.selection
        if len(selection) != 1:
            raise EditError(SELECT_ONE)
        self._agent_id = selection[0]
        self._draw_candidates(self._ui.session.scenario)

    def hide_candidates(self) -> None:
        """Hide the fan of candidates."""
        self._agent_id, self._base, self._pointed = None, None, None
        self._show_fan(None)
        set_property(self._show, "label", SHOW)
        self._offer((NO_CANDIDATE,))
        set_property(self._folder, "visible", False)

    def point_at(self, point_m: np.ndarray | None) -> bool:
        """Highlight the candidate under the pointer; whether there is one."""
        if self.view.shown is None:
            return False
        index = None if point_m is None else self.view.candidate_near(point_m)
        if index != self._pointed:
            self._pointed = index
            self._highlight()
        return index is not None

    def adopt_near(self, point_m: np.ndarray) -> bool:
        """Adopt the candidate that was clicked; False if none was hit."""
        index = self.view.candidate_near(point_m)
        if index is None:
            return False
        self._adopt_candidate(index)
        return True

    def _draw_candidates(self, scenario: Scenario) -> None:
        assert self._agent_id is not None
        rows = scenario.agents.rows([self._agent_id])
        if not scenario.agents.is_valid[rows[0], scenario.current_step]:
            agent_id = self._agent_id
            self.hide_candidates()
            raise EditError(f"Agent {agent_id} is not there at t = 0.")
        found = candidates(scenario, rows)
        self._base, self._pointed = scenario, None
        self._collisions = first_collisions(
            scenario,
            int(rows[0]),
            found.position_m[0],
            found.heading_rad[0],
            found.is_valid[0],
        )
        self._show_fan(found)
        self._offer((NO_CANDIDATE, *candidate_labels(found, scenario)))
        set_property(self._folder, "visible", True)
        set_property(self._show, "label", HIDE)
        self._highlight()

    def _show_fan(
        self, found: CandidateSet | None, highlighted: int | None = None
    ) -> None:
        """Draw the fan or none; other elements are muted, and clicks are explained."""
        scenario, is_shown = self._ui.session.scenario, found is not None
        self.view.show(found, scenario.road_map, highlighted)
        self._model.fan_shown.emit(is_shown)
        self._ui.overlay.show(FanState(is_shown=is_shown))
        if not is_shown or len(self._ui.session.selection) != 1:
            self._ui.banner.hide("candidates")
            return
        (agent_id,) = self._ui.session.selection
        kind = scenario.agents.kinds[scenario.agents.row_of[agent_id]].in_words
        self._ui.banner.show(
            "candidates",
            f"Possible trajectories of {kind} {agent_id}: click one to use it.",
            buttons={"Done (Esc)": self.hide_candidates},
            priority=OFFER,
        )

    def _pointer_moved(self, event: FanEvent) -> None:
        """Highlight the possible trajectory under the pointer."""
        self.point_at(point_of(event.point))

    def _follow_theme(self) -> None:
        self.view.set_palette(self._model.palette)

    def _offer(self, options: tuple[str, ...]) -> None:
        if tuple(self._choice.options) != options:
            self._choice.options = options
        set_value(self._choice, NO_CANDIDATE)

    def _chosen_index(self) -> int | None:
        """Index of the chosen candidate among all, the invalid ones included."""
        value, shown = self._choice.value, self.view.shown
        if value == NO_CANDIDATE or shown is None:
            return None
        place = tuple(self._choice.options).index(value) - 1
        return int(np.flatnonzero(shown.is_valid[0])[place])

    def _highlight(self) -> None:
        """Highlight the candidate under the pointer, or else the chosen one."""
        shown = self.view.shown
        if shown is None:
            return
        chosen = self._chosen_index()
        index = chosen if self._pointed is None else self._pointed
        self._show_fan(shown, index)
        for button in (self._adopt, self._guide):
            set_property(button, "disabled", chosen is None)
        if index is None:
            self._note.show("", "Choose one here, or click one on the road.")
            return
        place = int(shown.is_valid[0, :index].sum()) + 1
        self._note.show("", self._choice.options[place], self._collision_text(index))

    def _collision_text(self, index: int) -> str:
        scenario = self._ui.session.scenario
        return collision_in_words(scenario, self._collisions[index])

    def _adopt_chosen(self) -> None:
        self._adopt_candidate(self._needed_index())

    def _guide_along(self) -> None:
        """Guide the agent along the path of the chosen candidate."""
        index, found, agent_id = self._needed_index(), self.view.shown, self._agent_id
        assert found is not None
        assert agent_id is not None
        self.hide_candidates()
        path_m = found.position_m[0, index]
        self._guiding.put(FollowPath.kind, agent_id, path_m)

    def _needed_index(self) -> int:
        """Index of the chosen candidate."""
        index = self._chosen_index()
        if index is None:
            raise EditError(
                "Choose a trajectory in the list, or click one on the road."
            )
        return index

    def _adopt_candidate(self, index: int) -> None:
        found, agent_id = self.view.shown, self._agent_id
        assert found is not None
        assert agent_id is not None
        self.hide_candidates()
        self._ui.apply(
            AdoptTrajectory.of_arrays(
                agent_id=agent_id,
                position_m=found.position_m[0, index],
                heading_rad=found.heading_rad[0, index],
                velocity_mps=found.velocity_mps[0, index],
            )
        )


def candidate_labels(found: CandidateSet, scenario: Scenario) -> tuple[str, ...]:
    """A short unique text for each valid candidate of the first agent."""
    return tuple(
        f"{number}. {text}"
        for number, text in enumerate(candidate_texts(found, scenario.road_map), 1)
    )


def collision_in_words(scenario: Scenario, collision: PathCollision | None) -> str:
    """Describe the first collision of a trajectory, if any."""
    if collision is None:
        return "No collision with the other agents as they move now."
    kind = scenario.agents.kinds[scenario.agents.row_of[collision.agent_id]]
    seconds = (collision.step - scenario.current_step) * scenario.time_axis.step_s
    name = f"{kind.value.replace('_', ' ')} {collision.agent_id}"
    return f"Collides with {name} in {seconds:.1f} s."


def _legend(palette: Palette) -> str:
    """Legend of the fan's colours."""
    colors = ",".join(f"rgb{color}" for color in palette.candidate_speeds)
    return (
        '<div style="display:flex;align-items:center;gap:0.5em;height:20px;'
        'margin:0 0.75em 0.6em;font-size:12.5px"><span>0 m/s</span>'
        '<span style="flex:1;height:8px;border-radius:4px;background:'
        f'linear-gradient(90deg,{colors})"></span>'
        f"<span>{FAST_MPS:.0f} m/s and more</span></div>"
    )
