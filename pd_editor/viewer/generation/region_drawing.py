"""The mode in which a drag on the road draws the region that is resampled."""

from typing import Final

import numpy as np

from pd_editor.base.errors import GenerationError
from pd_editor.scene.generation import Region
from pd_editor.viewer.overlay.messages import RegionEvent, RegionState
from pd_editor.viewer.scene.picking import point_of
from pd_editor.viewer.tab.mode import Mode
from pd_editor.viewer.tab.ui_context import UiContext

LEAST_SIDE_M: Final = 10.0
"""Least side; a smaller square has no room for an agent and its leader."""


class RegionDrawing(Mode):
    """A square of the road, drawn by a drag from corner to corner.

    It belongs to the tab and not to the scenario: undo leaves it, a page that is loaded
    again takes it over, and it enters a recipe only with the traffic that is sampled in
    it. The page draws it; it moves with the picture.
    """

    name = "region"

    def __init__(self, ui: UiContext) -> None:
        """Make the mode, without a region."""
        super().__init__(ui)
        self._is_shown = False
        self.region: Region | None = None
        ui.model.scene_left.subscribe(self.clear)

    def toggle(self) -> None:
        """Begin to draw a region, or stop."""
        self._set_active(not self.is_active)

    def take(self, region: Region) -> None:
        """Take the region of the page before, while this page is built."""
        self.region = region

    def clear(self) -> None:
        """Remove the region and end the mode."""
        if self.region is None and not self.is_active:
            return
        self.region, self.is_active = None, False
        self._changed()

    def set_shown(self, is_shown: bool) -> None:
        """Draw the region, or hide it while it is not what is resampled."""
        if is_shown != self._is_shown:
            self._is_shown = is_shown
            self._show()

    def _sentence(self) -> str:
        return (
            "Drawing a region, a square along the map's axes: press on the road and "
            "drag."
        )

    def _show(self) -> None:
        region = self.region if self._is_shown else None
        square = None
        if region is not None:
            x, y = region.center_m
            square = round(x, 3), round(y, 3), region.half_side_m
        state = RegionState(
            is_active=self.is_active, least_m=LEAST_SIDE_M, square=square
        )
        self._overlay.show(state)

    def _heard(self, event: RegionEvent) -> None:
        """Handle a pointer event; late events of another mode are ignored."""
        if event.kind == "clear":
            self.clear()
            return
        start, end = point_of(event.start), point_of(event.end)
        if not self.is_active or start is None or end is None:
            return
        self.region, self.is_active = square_between(start, end), False
        self._changed()


def square_between(start_m: np.ndarray, end_m: np.ndarray) -> Region:
    """The square with a corner at the start of a drag, as large as the drag is long.

    Raises:
        GenerationError: it is too small, or leaves the scene.
    """
    drag = end_m - start_m
    side = float(np.abs(drag).max())
    if side < LEAST_SIDE_M:
        raise GenerationError(
            f"The region would be {side:.1f} m wide; drag over at least "
            f"{LEAST_SIDE_M:g} m."
        )
    half = round(side / 2, 2)
    center = start_m + half * np.where(drag < 0, -1.0, 1.0)
    return Region(
        center_m=(round(float(center[0]), 2), round(float(center[1]), 2)),
        half_side_m=half,
    )
