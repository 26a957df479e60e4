"""The mode in which clicks place new agents on the road."""

from typing import Final

import numpy as np

from pd_editor.editor.commands import PlaceAgent, new_agent_id
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, AgentKind, sampled_sizes_m
from pd_editor.scene.paths.suggested_state import (
    SUGGESTED_SPEED_MPS,
    suggested_heading,
    suggested_state,
)
from pd_editor.viewer.overlay.messages import PlacingEvent, PlacingState
from pd_editor.viewer.scene.picking import point_of
from pd_editor.viewer.tab.mode import Mode
from pd_editor.viewer.tab.ui_context import UiContext

KEY_KINDS: Final = tuple(SUGGESTED_SPEED_MPS)
"""Kinds that the keys 1, 2, ... choose: the road users."""


class PlacingMode(Mode):
    """Mode in which clicks place agents: state, kind, and ghost under the pointer.

    The page draws the ghost at the pointer, and requests the heading that the road
    suggests there; a dragged press sets the heading.
    """

    name = "placing"

    def __init__(self, ui: UiContext) -> None:
        """Make the mode, switched off."""
        super().__init__(ui)
        self._heading_rad = 0.0
        self.kind = AgentKind.VEHICLE
        self.with_past = True
        ui.model.ground_clicked.subscribe(self._place_clicked)

    def toggle(self) -> None:
        """Start the mode, at t = 0 where new agents appear, or end it."""
        if self.is_active:
            self.stop()
            return
        self._ui.show_current_step()
        self._set_active(True)

    def stop(self) -> None:
        """End the mode, and show what was placed."""
        was_active = self.is_active
        super().stop()
        if was_active and self._ui.session.selection:
            self._model.agent_clicked.emit()

    def choose(self, kind: AgentKind) -> None:
        """Place agents of another kind from now on."""
        self.kind = kind
        self._changed()

    def place(self, point_m: np.ndarray, heading_rad: float | None = None) -> None:
        """Place an agent of the chosen kind; without a heading as its lane suggests."""
        scenario = self._ui.session.scenario
        state = suggested_state(scenario, point_m, self.kind, heading_rad)
        command = PlaceAgent(
            agent_id=new_agent_id(scenario),
            kind=self.kind,
            x_m=state.x_m,
            y_m=state.y_m,
            heading_rad=state.heading_rad,
            speed_mps=state.speed_mps,
            back_cast=self.with_past,
            size_m=self._size_m(),
        )
        self._ui.apply(command)

    def _place_clicked(self, point_m: np.ndarray) -> bool:
        """Place an agent where the ground was clicked, if the mode is active."""
        if self.is_active:
            self.place(point_m)
        return self.is_active

    def _sentence(self) -> str:
        return (
            f"Placing a {str(self.kind).replace('_', ' ')}: click the road; press "
            f"and drag to turn; keys 1 to {len(KEY_KINDS)} choose the kind."
        )

    def _size_m(self) -> tuple[float, float]:
        """Size of the next agent, drawn anew for each."""
        random = np.random.default_rng(len(self._ui.session.scenario.agents))
        ((length, width),) = sampled_sizes_m((self.kind,), random)
        return float(length), float(width)

    def _show(self) -> None:
        length, width = self._size_m()
        palette = self._model.palette
        state = PlacingState(
            is_active=self.is_active,
            size_m=(length, width, DEFAULT_HEIGHT_M[self.kind]),
            heading_rad=round(self._heading_rad, 3),
            color="rgb({}, {}, {})".format(*palette.kinds[self.kind]),
            num_kinds=len(KEY_KINDS),
        )
        self._overlay.show(state)

    def _heard(self, event: PlacingEvent) -> None:
        """Handle a pointer event; late events of another mode are ignored."""
        if not self.is_active:
            return
        if event.kind == "kind":
            if 1 <= event.number <= len(KEY_KINDS):
                self.choose(KEY_KINDS[event.number - 1])
        elif (point := point_of(event.point)) is None:
            return
        elif event.kind == "point":
            road_map = self._ui.session.scenario.road_map
            self._heading_rad = suggested_heading(road_map, point, self.kind)
            self._show()
        else:
            self.place(point, event.heading_rad)
