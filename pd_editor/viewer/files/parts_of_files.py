"""What asks for a part of a file that is not opened whole: a moment of a recording, a square of a map."""

from typing import Any, Final

import shapely

from pd_editor.base.errors import InputError
from pd_editor.scene.formats.file_scene import FileScene
from pd_editor.scene.map_window import densest_windows, window_of
from pd_editor.scene.road_map import Lane
from pd_editor.scene.scene_limits import MAX_STEPS
from pd_editor.scene.time_axis import TimeAxis
from pd_editor.scene.time_cut import FUTURE_S
from pd_editor.viewer.overlay.messages import MapWindowEvent, MapWindowState
from pd_editor.viewer.tab.panel_style import plain
from pd_editor.viewer.tab.ui_context import UiContext

_MOST_S: Final = MAX_STEPS * TimeAxis().step_s


class MomentDialog:
    """A dialog over the page, open while a part of a recording is chosen."""

    def __init__(self, ui: UiContext) -> None:
        """Show nothing yet."""
        self._ui = ui
        self._dialog: Any = None

    def ask(self, scene: FileScene) -> None:
        """Ask for a moment of a recording; the file's own one is chosen at first."""
        self._close()
        gui, length_s = self._ui.client.gui, round(scene.duration_s, 1)
        now_s = min(round(scene.observed_s, 1), length_s)
        self._dialog = gui.add_modal("Choose a part of the recording")
        with self._dialog:
            gui.add_markdown(
                f"{plain(scene.name)} lasts {length_s:g} s; at most {_MOST_S:g} s are "
                "opened. Choose the moment that becomes t = 0, and until when after it "
                "the recording is kept."
            )
            current = gui.add_number(
                "Current moment (s)", now_s, min=0.1, max=length_s, step=0.1
            )
            # The past is kept as well.
            most_s = _MOST_S - TimeAxis().duration_s
            until = gui.add_number("Until (s)", FUTURE_S, min=0.1, max=most_s, step=0.1)
            chosen = gui.add_button("Open this part")
            cancel = gui.add_button("Cancel", color="gray")
        self._ui.on_click(
            chosen, lambda: self._open(float(current.value), float(until.value))
        )
        self._ui.on_click(cancel, self._close)

    def _open(self, current_s: float, until_s: float) -> None:
        self._ui.commit_gesture()
        self._ui.workspace.open_moment(current_s, until_s)
        self._close()

    def _close(self) -> None:
        if self._dialog is not None:
            self._dialog.close()
            self._dialog = None


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
            # Details smaller than this share of the map's extent are left out.
            for one in shapely.simplify(lines, span / 1500)
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

    def _heard(self, event: MapWindowEvent) -> None:
        self._overlay.show(MapWindowState())
        if event.kind != "open":
            return
        if event.square is None:
            raise InputError("The page named no square of the map.")
        x, y, radius = (round(one, 1) for one in event.square)
        window = window_of((x, y), radius)
        assert window is not None, "it is around a place"
        self._ui.commit_gesture()
        self._ui.workspace.open_window(window)
