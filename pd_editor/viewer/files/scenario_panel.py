"""The scenario panel: shows the open scenario, and opens demos, folders and uploads."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import shapely
import viser

from pd_editor.base.errors import ArchiveError, InputError
from pd_editor.base.regular_file import read_regular
from pd_editor.editor.recipe import is_recipe
from pd_editor.editor.scenario_store import is_foreign
from pd_editor.scene.av2_io.upload import MAX_UPLOAD_BYTES
from pd_editor.scene.formats.file_scene import FileScene
from pd_editor.scene.formats.registry import formats
from pd_editor.scene.road_map import Lane
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_cut import FUTURE_S, densest_windows, is_long, window_of
from pd_editor.scene.scene_limits import MAX_STEPS
from pd_editor.scene.time_axis import TimeAxis
from pd_editor.viewer.files.start_page import StartPage
from pd_editor.viewer.overlay.messages import MapWindowEvent, MapWindowState
from pd_editor.viewer.server.server_guard import limit_uploads
from pd_editor.viewer.state.workspace import zip_of_several
from pd_editor.viewer.tab.panel_style import FixedText, plain
from pd_editor.viewer.tab.ui_context import UiContext, set_property

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
            title=f"{about} has {len(lanes)} lanes: drag a square, click its middle, or "
            "move it by arrow keys.",
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


UPLOAD_TYPES: Final = ".zip,.parquet,.json,.xml,.xodr,.xodrz,.xosc,.osm,.gz,.pkl,application/zip,application/json"
"""Endings of what can be uploaded, and types for browsers that go by them."""


class ScenarioPanel:
    """Shows the open scenario, and opens others."""

    def __init__(self, ui: UiContext, start: StartPage) -> None:
        """Build it into the current tab."""
        self._ui, self._start = ui, start
        self._workspace = ui.workspace
        self._uploads: dict[str, bytes] = {}
        self._base: Scenario | None = None
        self._dialog: Any = None
        gui = ui.client.gui
        self._card = FixedText(gui, 3)
        self._cut = gui.add_button("", color="gray", visible=False)
        ui.on_click(self._cut, self._workspace.open_cut)
        self.map_window, self.moment = MapWindowCard(ui), MomentDialog(ui)
        self._part = gui.add_button(
            "Choose a part of the map", color="gray", icon=viser.Icon.MARQUEE_2
        )
        ui.on_click(self._part, self._choose_part)
        with gui.add_folder("Open"):
            show_all = gui.add_button(
                "All scenarios",
                icon=viser.Icon.LAYOUT_GRID,
                hint="Demos, dataset, library and unfinished work as pictures (N)",
            )
            upload = gui.add_upload_button(
                "Upload files",
                mime_type=UPLOAD_TYPES,
                color="gray",
                icon=viser.Icon.UPLOAD,
                hint="A zip, or a parquet with its map; OpenDRIVE, Lanelet2, SUMO, CommonRoad, "
                "ScenarioNet and GPUDrive files; downloaded edits (.recipe.json)",
            )
            with gui.add_folder("From a folder", expand_by_default=False):
                self._folder = gui.add_text(
                    "Folder", "", hint="Of a scenario, or a file of another format"
                )
                open_folder = gui.add_button("Open folder", color="gray")
        ui.model.shown.subscribe(self.show)
        ui.on_click(show_all, start.toggle)
        ui.on_click(open_folder, self._open_folder)

        limit_uploads(ui.client, MAX_UPLOAD_BYTES, self._upload_refused)

        @upload.on_upload
        async def _(event: viser.GuiEvent[Any]) -> None:
            uploaded = event.target.value
            ui.post(
                lambda: self._uploaded(uploaded.name, uploaded.content),
                failure=f"Not opened: {uploaded.name[:60]}",
            )

    def show(self) -> None:
        """Show the open scenario."""
        scenario = self._ui.session.scenario
        if self._base is not self._ui.session.base:
            self._base = self._ui.session.base
            self._ui.post(self._offer_continuation)
            self._offer_cut(self._base)
            set_property(self._part, "visible", self._workspace.can_open_again)
        agents, road = scenario.agents, scenario.road_map
        has_future = bool(agents.is_valid[:, scenario.current_step + 1 :].any())
        origin = scenario.provenance
        parts = (
            origin.file_format,
            scenario.city,
            f"{len(agents)} agents",
            f"{len(road.lanes)} lanes",
        )
        size = " · ".join(part for part in parts if part)
        if not has_future:
            size += " · no logged future"
        # The newest first; the tooltip has the rest.
        notes = [*filter(None, [origin.attribution]), *reversed(origin.notes)]
        card = (scenario.scenario_id, size, *notes)
        self._card.show(card[0], size, " · ".join(notes), tooltip="\n".join(card))

    def _choose_part(self) -> None:
        self.map_window.ask(self._workspace.lanes_of_file(), "The map")

    def _offer_cut(self, base: Scenario) -> None:
        """A button for recordings that are longer than models sample."""
        whole = f"Keep {FUTURE_S:g} s after t = 0"
        label = whole if is_long(base) else "Open the whole recording"
        set_property(self._cut, "label", label)
        set_property(self._cut, "visible", self._workspace.can_cut)
        if is_long(base):
            self._ui.notify(
                "A long recording",
                f"Models sample {FUTURE_S:g} s; '{whole}' under Scene leaves out the rest.",
            )

    def _offer_continuation(self) -> None:
        """If an opened export's base is available, let the user choose between both."""
        offered = self._workspace.continuation
        self._close_dialog()
        if offered is None:
            return
        gui = self._ui.client.gui
        count = len(offered.recipe.commands)
        edits = "its edit" if count == 1 else f"its {count} edits"
        self._dialog = gui.add_modal("This is an export of the editor")
        with self._dialog:
            gui.add_markdown(
                f"{plain(offered.recipe.result_id)} was made from "
                f"{plain(offered.recipe.base.scenario_id)}, which is here as well."
            )
            go_on = gui.add_button(f"Continue with {edits}")
            as_it_is = gui.add_button("Open as it is", color="gray")
        self._ui.on_click(
            go_on, lambda: self._answered(self._workspace.continue_export)
        )
        self._ui.on_click(as_it_is, lambda: self._answered(self._decline))

    def _answered(self, action: Callable[[], None]) -> None:
        self._close_dialog()
        action()

    def _decline(self) -> None:
        self._workspace.continuation = None

    def _open_folder(self) -> None:
        path = str(self._folder.value).strip()
        if not path:
            raise InputError("Type the path of a scenario folder first.")
        folder = self._workspace.folders.named(path)
        if any(folder.glob("*/*.parquet")) or any(folder.glob("*/*/*.parquet")):
            raise InputError(
                f"{folder} holds scenario folders: type one of them, or start the editor "
                "with --data and this folder to get their list."
            )
        if folder.is_file() and folder.suffix.lower() == ".zip":
            content = read_regular(folder, max_bytes=MAX_UPLOAD_BYTES)
            if self._lists_several({folder.name: content}):
                return
        self._ui.commit_gesture()
        self._workspace.open_reference(str(folder))

    def _uploaded(self, name: str, content: bytes) -> None:
        """Open an upload; a parquet and a map may come one after the other."""
        if is_recipe(content):
            self._ui.commit_gesture()
            self._workspace.open_edits(content)
            return
        if name.lower().endswith(".zip") or is_foreign(name, content):
            files = {name: content}
        else:
            suffix = Path(name).suffix.lower()
            if suffix not in (".parquet", ".json"):
                readable = [one.title for one in formats().values() if one.endings]
                in_words = " or ".join([", ".join(readable[:-1]), readable[-1]])
                raise InputError(
                    f"{name}: expected a .zip, a .parquet and the .json of its map, or a "
                    f"file of {in_words}."
                )
            kept = {
                n: c for n, c in self._uploads.items() if not n.lower().endswith(suffix)
            }
            files = {**kept, name: content}
            if len(files) < 2:
                self._uploads = files
                missing = "map JSON" if suffix == ".parquet" else "parquet"
                self._ui.notify(
                    f"{name} received", f"Now upload the {missing} that belongs to it."
                )
                return
        self._uploads = {}
        if not self._lists_several(files):
            self._ui.commit_gesture()
            self._workspace.open_upload(files)

    def _lists_several(self, files: Mapping[str, bytes]) -> bool:
        """Whether these are a zip of several scenarios, which the start page then shows."""
        several = zip_of_several(files)
        if several is not None:
            self._workspace.uploaded_zip = several
            # What was looked for elsewhere would hide what is in it.
            self._start.open("zip", line="")
        return several is not None

    def _close_dialog(self) -> None:
        if self._dialog is not None:
            self._dialog.close()
            self._dialog = None

    def _upload_refused(self, name: str, size_bytes: int) -> None:
        limit, size = MAX_UPLOAD_BYTES >> 20, size_bytes / 2**20
        error = ArchiveError(
            f"{name} has {size:.0f} MiB; at most {limit} MiB are taken."
        )
        self._ui.post(lambda: self._ui.report(error))
