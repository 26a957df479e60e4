"""The card with the outline of a map, of which a part is chosen and opened."""

from collections.abc import Mapping
from typing import Any, Final

import shapely

from pd_editor.base.errors import InputError
from pd_editor.scene.map_window import densest_windows, window_of
from pd_editor.scene.road_map import Lane
from pd_editor.viewer.overlay.messages import MapWindowState
from pd_editor.viewer.tab.ui_context import UiContext

_FINEST: Final = 1500
"""Details smaller than this share of the map's extent are left out."""


class MapWindowCard:
    """A card over the picture, open while a part of a map is chosen."""

    def __init__(self, ui: UiContext) -> None:
        """Show nothing yet."""
        self._ui = ui
        self._overlay = ui.overlay
        self._overlay.on("mapWindow", self._heard)

    def ask(self, lanes: tuple[Lane, ...], about: str) -> None:
        """Show the lanes, in the file's frame; the fullest square is chosen at first."""
        lines = [shapely.LineString(one.centerline_m) for one in lanes]
        west, south, east, north = shapely.total_bounds(lines)
        span = max(east - west, north - south)
        margin = 0.02 * span
        (first,) = densest_windows(lanes, 1)
        road = "".join(
            "M" + "L".join(f"{x:.1f} {-y:.1f}" for x, y in shapely.get_coordinates(one))
            for one in shapely.simplify(lines, span / _FINEST)
        )
        view = west - margin, -north - margin, east - west, north - south
        state = MapWindowState(
            title=f"{about} has {len(lanes)} lanes: drag a square, or click its "
            "middle.",
            road=road,
            square=(first.x_m, first.y_m, first.radius_m),
            view="{:.1f} {:.1f}".format(*view[:2])
            + "".join(f" {side + 2 * margin:.1f}" for side in view[2:]),
        )
        self._overlay.show(state)

    def _heard(self, event: Mapping[str, Any]) -> None:
        self._overlay.show(MapWindowState())
        if event.get("kind") != "open":
            return
        try:
            x, y, radius = (round(float(one), 1) for one in event["square"])
        except (KeyError, TypeError, ValueError):
            raise InputError("The page named no square of the map.") from None
        window = window_of((x, y), radius)
        assert window is not None, "it is around a place"
        self._ui.commit_gesture()
        self._ui.workspace.open_window(window)
