"""Draws stop lines in the colours of their signals at the playhead."""

from typing import Final

import numpy as np
import viser

from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.palette import Palette
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import SignalState, states_at
from pd_editor.viewer.meshes.colors import shown_exactly
from pd_editor.viewer.meshes.flat_mesh import Primitive, glb_of, ribbons

WIDTH_M: Final = 0.8
HEIGHT_M: Final = 0.06
"""Above all parts of the road; stop is on top, then caution, go and unknown."""


class SignalsView:
    """Node of one browser for the stop lines of all signals."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._client = client
        self._palette = palette
        self._node: viser.GlbHandle | None = None
        self._drawn: tuple[object, ...] = ()

    def set_palette(self, palette: Palette) -> None:
        """Draw in another theme from the next frame on."""
        self._palette = palette

    def show(self, scenario: Scenario, step: float) -> None:
        """Draw the states at a fractional step; nothing is sent while none changes."""
        states = [int(one.states[int(step)]) for one in scenario.signals]
        wanted = (scenario.signals, scenario.road_map, self._palette, states)
        if wanted == self._drawn or not (scenario.signals or self._node):
            return
        self._drawn = wanted
        lines = scenario.stop_lines_m()
        codes = np.array([*states_at(scenario.signals, int(step)).values()], int)
        data = glb_of(
            [
                Primitive(
                    points_m=mesh.points_m,
                    faces=mesh.faces,
                    height_m=HEIGHT_M - 0.002 * ((state - 1) % len(SignalState)),
                    color=shown_exactly(color),
                )
                for state, color in self._palette.signals.items()
                if (codes == state).any()
                for mesh in [ribbons(Lines.of([*lines[codes == state]]), WIDTH_M)]
            ]
        )
        if self._node is None:
            self._node = self._client.scene.add_glb(
                "/signals", data, cast_shadow=False, receive_shadow=False
            )
        else:
            self._node.glb_data = data
