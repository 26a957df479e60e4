"""The scenario panel: open a demo, a folder, an upload; export the result."""

from pathlib import Path
from typing import Any, Final

import viser

from pd_editor.av2_io.upload import MAX_UPLOAD_BYTES
from pd_editor.errors import ArchiveError, InputError
from pd_editor.installed_files import demo_names, demo_sentence
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.server.server_guard import limit_uploads
from pd_editor.viewer.state.desk import Desk, set_property
from pd_editor.viewer.state.page_text import plain

MAX_NOTES: Final = 3
UPLOAD_TYPES: Final = ".zip,.parquet,.json,application/zip,application/json"


class ScenarioPanel:
    """What is open, what else could be, and where it goes."""

    def __init__(self, desk: Desk) -> None:
        """Build it into the current tab."""
        self._desk = desk
        self._workspace = desk.workspace
        self._uploads: dict[str, bytes] = {}
        gui = desk.client.gui
        self._card = gui.add_markdown("")
        with gui.add_folder("Open"):
            self._demo = gui.add_dropdown("Demo", demo_names() or ("-",))
            self._shows = gui.add_markdown(_shows(str(self._demo.value)))
            open_demo = gui.add_button("Open demo", icon=viser.Icon.FOLDER_OPEN)
            self._folder = gui.add_text(
                "Folder", "", hint="A scenario folder: parquet and map JSON."
            )
            open_folder = gui.add_button("Open folder", color="gray")
            upload = gui.add_upload_button(
                "Upload zip, or parquet and map",
                mime_type=UPLOAD_TYPES,
                color="gray",
                icon=viser.Icon.UPLOAD,
            )
        with gui.add_folder("Export"):
            download = gui.add_button(
                "Download zip",
                icon=viser.Icon.DOWNLOAD,
                hint="Argoverse 2 parquet and map, with recipe.json",
            )
            self._out = gui.add_text(
                "Into folder", "", hint="A folder on the server's machine."
            )
            write = gui.add_button("Write to folder", color="gray")
        desk.on_change(self._demo, self._tell_demo)
        desk.on_click(open_demo, self._open_demo)
        desk.on_click(open_folder, self._open_folder)
        desk.on_click(download, self._download)
        desk.on_click(write, self._write)

        limit_uploads(desk.client, MAX_UPLOAD_BYTES, self._upload_refused)

        @upload.on_upload
        async def _(event: viser.GuiEvent[Any]) -> None:
            uploaded = event.target.value
            desk.post(lambda: self._uploaded(uploaded.name, uploaded.content))

    def show(self, scenario: Scenario) -> None:
        """Show what is open."""
        agents, road = scenario.agents, scenario.road_map
        has_future = bool(agents.is_valid[:, scenario.current_step + 1 :].any())
        lines = [
            f"**{plain(scenario.scenario_id)}**",
            f"{plain(scenario.city)} · {len(agents)} agents · "
            f"{len(road.lanes)} lanes" + ("" if has_future else " · no logged future"),
        ]
        notes = scenario.provenance.notes[-MAX_NOTES:]
        lines += [f"*{plain(note)}*" for note in notes]
        set_property(self._card, "content", "  \n".join(lines))

    def _tell_demo(self, name: str) -> None:
        set_property(self._shows, "content", _shows(name))

    def _open_demo(self) -> None:
        self._desk.commit_gesture()
        self._workspace.open_reference(str(self._demo.value))

    def _open_folder(self) -> None:
        path = str(self._folder.value).strip()
        if not path:
            raise InputError("Type the path of a scenario folder first.")
        self._workspace.refuse_remote()
        self._desk.commit_gesture()
        self._workspace.open_reference(path)

    def _uploaded(self, name: str, content: bytes) -> None:
        """Open an upload; a parquet and a map may come one after the other."""
        if name.lower().endswith(".zip"):
            files = {name: content}
        else:
            suffix = Path(name).suffix.lower()
            if suffix not in (".parquet", ".json"):
                raise InputError(
                    f"{name}: expected a .zip, or a .parquet and the .json of its map."
                )
            kept = {
                n: c for n, c in self._uploads.items() if not n.lower().endswith(suffix)
            }
            files = {**kept, name: content}
            if len(files) < 2:
                self._uploads = files
                missing = "map JSON" if suffix == ".parquet" else "parquet"
                self._desk.notify(
                    f"{name} received", f"Now upload the {missing} that belongs to it."
                )
                return
        self._uploads = {}
        self._desk.commit_gesture()
        self._workspace.open_upload(files)

    def _upload_refused(self, name: str, size_bytes: int) -> None:
        limit, size = MAX_UPLOAD_BYTES >> 20, size_bytes / 2**20
        error = ArchiveError(
            f"{name} has {size:.0f} MiB; at most {limit} MiB are taken."
        )
        self._desk.post(lambda: self._desk.report(error))

    def _download(self) -> None:
        self._desk.commit_gesture()
        name, content = self._workspace.exported_zip()
        self._desk.client.send_file_download(name, content, save_immediately=True)

    def _write(self) -> None:
        path = str(self._out.value).strip()
        if not path:
            raise InputError("Type the folder to write into first.")
        self._workspace.refuse_remote()
        self._desk.commit_gesture()
        written = self._workspace.export_into(Path(path).expanduser())
        self._desk.notify("Exported", str(written), "success")


def _shows(name: str) -> str:
    """What a demo shows, to be read before it is opened."""
    sentence = demo_sentence(name)
    return f"*{plain(sentence[:1].upper() + sentence[1:])}.*" if sentence else ""
