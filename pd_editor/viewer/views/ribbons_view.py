"""Draws past and future of all agents, fading with time."""

from typing import Final

import numpy as np
import viser

from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.meshes.colors import Palette, inverse_aces, srgb_to_linear
from pd_editor.viewer.meshes.flat_mesh import glb_of
from pd_editor.viewer.meshes.ribbons import path_ribbons
from pd_editor.viewer.views.agents_view import agent_color

STRIDE: Final = 2
"""Every second step is drawn; at 10 Hz that is still under 6 m at 30 m/s."""
FUTURE_HEIGHT_M: Final = 0.07
PAST_HEIGHT_M: Final = 0.065


class RibbonsView:
    """One node of one browser with the ribbons of all agents."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._client = client
        self._palette = palette
        self._handle: viser.GlbHandle | None = None
        self._drawn: tuple[AgentTracks, str, Palette] | None = None
        self._is_visible = True
        self._is_muted = False
        self._scenario: Scenario | None = None

    def show(self, scenario: Scenario) -> None:
        """Bring the ribbons up to a scenario."""
        self._scenario = scenario
        wanted = (scenario.agents, scenario.focal_id, self._palette)
        is_current = self._drawn is not None and all(
            shown is asked for shown, asked in zip(self._drawn, wanted, strict=True)
        )
        if is_current or not self._is_visible:
            return
        self._drawn = wanted
        data = glb_of(ribbon_primitives(scenario, self._palette))
        if self._handle is None:
            self._handle = self._client.scene.add_glb(
                "/ribbons", data, cast_shadow=False, receive_shadow=False
            )
        else:
            self._handle.glb_data = data

    def set_palette(self, palette: Palette) -> None:
        """Redraw in another theme."""
        self._palette = palette
        if self._scenario is not None:
            self.show(self._scenario)

    def set_muted(self, is_muted: bool) -> None:
        """Step back while something else is shown, whatever the user's wish."""
        self._is_muted = is_muted
        self._apply_visibility()

    def _apply_visibility(self) -> None:
        if self._handle is not None:
            self._handle.visible = self._is_visible and not self._is_muted

    def set_visible(self, is_visible: bool) -> None:
        """Show or hide all ribbons."""
        self._is_visible = is_visible
        self._apply_visibility()
        if is_visible and self._scenario is not None:
            self.show(self._scenario)


def ribbon_primitives(scenario: Scenario, palette: Palette) -> list:
    """Past and future of every agent as transparent meshes."""
    agents, current = scenario.agents, scenario.current_step
    num_agents = len(agents)
    if not num_agents:
        return []
    past = np.unique(np.r_[current % STRIDE : current : STRIDE, current])
    future = np.unique(np.r_[current : agents.num_steps : STRIDE, agents.num_steps - 1])
    own = [agent_color(scenario, row) for row in range(num_agents)]
    own_color = inverse_aces(srgb_to_linear(np.array(own) / 255.0))
    past_color = inverse_aces(srgb_to_linear(np.array(palette.past) / 255.0))
    # Tracks of things that cannot move are noise.
    moves = agents.kind_mask(ROAD_USER_KINDS)[:, None]
    half_width = np.clip(agents.size_m[:, 1:], 0.4, 1.4) * 0.5

    def along(steps: np.ndarray, start: float, end: float) -> np.ndarray:
        fade = np.linspace(start, end, len(steps))
        return np.broadcast_to(fade, (num_agents, len(steps)))

    return [
        path_ribbons(
            agents.position_m[:, past],
            agents.is_valid[:, past] & moves,
            color=np.broadcast_to(past_color, (num_agents, 3)),
            opacity=along(past, 0.0, 0.55),
            width_m=half_width * along(past, 0.5, 0.8),
            height_m=PAST_HEIGHT_M,
        ),
        path_ribbons(
            agents.position_m[:, future],
            agents.is_valid[:, future] & moves,
            color=own_color,
            opacity=along(future, 0.75, 0.06),
            width_m=half_width * along(future, 1.0, 0.7),
            height_m=FUTURE_HEIGHT_M,
        ),
    ]
