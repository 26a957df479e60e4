"""The export panel: name, tags and note of the result, and where it goes."""

import datetime
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import viser

from pd_editor.analysis.findings.finding import problems_in_words
from pd_editor.base.errors import ExportError, InputError, PdEditorError
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.commands.command import shortened
from pd_editor.editor.variant import name_from_text, tags_from_text
from pd_editor.scene.formats.argoverse2 import ARGOVERSE2
from pd_editor.scene.formats.figure import FigureLook
from pd_editor.scene.formats.film import FilmLook
from pd_editor.scene.formats.pictures import LOOKS, picture
from pd_editor.scene.formats.player import PLAYER, player_page
from pd_editor.scene.formats.registry import formats
from pd_editor.scene.formats.scene_format import SceneFormat
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.tab.panel_style import FixedText
from pd_editor.viewer.tab.ui_context import UiContext, set_property, set_value


class PictureDownload:
    """Draws one picture at a time, tells how far it is, and sends it."""

    def __init__(self, ui: UiContext, changed: Callable[[], None]) -> None:
        """Draw for a tab; ``changed`` is called when it begins or ends."""
        self._ui, self._changed = ui, changed
        self._job: BackgroundJob[bytes] | None = None
        self._notice: viser.NotificationHandle | None = None

    def start(
        self, scenario: Scenario, ending: str, look: FilmLook | FigureLook
    ) -> None:
        """Begin to draw, about the selected agent if there is one.

        Raises:
            InputError: another one is being drawn.
        """
        if self.is_busy:
            raise InputError(
                "Another picture is being drawn; wait until it is here, or cancel it."
            )
        selection = self._ui.session.selection
        follow = selection[0] if len(selection) == 1 else ""
        whom = f"following {shortened(follow)}" if follow else "about the focal agent"
        title = f"Drawing {scenario.scenario_id}.{ending}, {whom}"
        self._notice = self._ui.notify(title, stays=True)
        self._changed()
        look = replace(look, follow=follow)
        post, name = self._ui.post, f"{scenario.scenario_id}.{ending}"

        def draw(job: BackgroundJob[Any]) -> bytes:
            def drawn(done: int, count: int) -> None:
                job.check_cancelled()
                post(partial(self._tell, done, count), merge_key="frames")

            return picture(scenario, ending, look, drawn)

        self._job = BackgroundJob(
            f"draw-{ending}",
            draw,
            lambda content: post(partial(self._send, name, content)),
            lambda error: post(partial(self._fail, error)),
            subject="The picture",
        )
        self._job.start()

    @property
    def is_busy(self) -> bool:
        """Whether one is being drawn."""
        return self._notice is not None

    def close(self) -> None:
        """Stop what is being drawn; its notice goes with the page."""
        if self._job is not None:
            self._job.cancel()

    def cancel(self) -> None:
        """Stop what is being drawn, so that another one can be."""
        self.close()
        self._end()

    def _tell(self, done: int, count: int) -> None:
        """Show how far it is."""
        if self._notice is not None:
            self._notice.body = f"{done} of {count} frames"

    def _send(self, name: str, content: bytes) -> None:
        """Send what is drawn, unless it was cancelled meanwhile."""
        if not self.is_busy:
            return
        self._end()
        self._ui.client.send_file_download(name, content, save_immediately=True)

    def _fail(self, error: PdEditorError) -> None:
        """Tell why there is none."""
        self._end()
        self._ui.report(error)

    def _end(self) -> None:
        if self._notice is not None:
            self._notice.remove()
            self._notice = None
            self._changed()


OTHER_WAYS: Final = "Film, figure, player, folder, edits"
_ALONE: Final = (PLAYER.name, *LOOKS)
"""Formats whose files are downloaded alone, to be shown."""
_SHOWN: Final = {"Player": PLAYER.name, "Film": "mp4", "Figure": "pdf"}
"""The usual ones of them."""


class ExportPanel:
    """Names and writes the current scenario, and shows what it lacks."""

    def __init__(self, ui: UiContext) -> None:
        """Build it into the current tab."""
        self._ui = ui
        self._model, self._workspace = ui.model, ui.workspace
        self._typed: str | None = None
        self._base = ui.session.base
        self._dialog: Any = None
        self._told_of: Scenario | None = None  # whose losses are shown
        gui = ui.client.gui
        with gui.add_folder("Export"):
            self._preflight = FixedText(gui, 1)
            self._format = gui.add_dropdown(
                "Format",
                tuple(one.title for one in formats().values() if one.write),
            )
            self._losses = FixedText(gui, 5, grows=True)
            set_property(self._losses.element, "visible", False)
            self._moments = gui.add_text(
                "Moments",
                "0",
                hint="Of the figure, side by side: seconds after t = 0, such as 0, 2, 4",
                visible=False,
            )
            self._compares = gui.add_checkbox(
                "Original above",
                False,
                hint="The scene before its road was warped, above the figure",
                visible=False,
            )
            self._download = gui.add_button(
                "Download zip",
                icon=viser.Icon.DOWNLOAD,
                hint="Files of the format above, with recipe.json; a player, film or figure alone",
            )
            self._save = gui.add_button(
                "Save to library",
                icon=viser.Icon.STAR,
                color="gray",
                hint="S: keeps this state among all scenarios (N)",
            )
            self._name = gui.add_text(
                "Name",
                "",
                hint="Id of the exported scenario: letters, digits, hyphens, underscores",
            )
            self._tags = gui.add_text("Tags", "", hint="Separated by commas")
            self._note = gui.add_text("Note", "")
            with gui.add_folder(OTHER_WAYS, expand_by_default=False):
                self._shows = gui.add_button_group("Download", tuple(_SHOWN))
                self._out = gui.add_text("Into folder", "", hint="On the server")
                write = gui.add_button("Write to folder", color="gray")
                edits = gui.add_button(
                    "Download the edits alone",
                    color="gray",
                    hint="pd-editor replay applies them again",
                )
        self._pictures = PictureDownload(ui, self._name_download)
        ui.on_click(write, self._write)
        ui.on_click(edits, self._download_edits)
        self._connect()

    def _connect(self) -> None:
        ui = self._ui
        ui.on_click(self._download, self._download_or_cancel)
        ui.on_change(self._format, self._format_chosen)
        ui.on_click(self._save, self._model.save_requested.emit)
        ui.on_change(self._name, self._name_typed, merge_key="variant name")
        for handle in (self._tags, self._note):
            ui.on_change(handle, lambda _text: self._describe(), merge_key="variant")
        ui.on_option(self._shows, self._show_as)
        for word in _SHOWN:
            ui.hotkey(f"Download a {word.lower()}", partial(self._show_as, word))
        self._model.shown.subscribe(self.show)
        self._model.checked.subscribe(self._show_preflight)

    def show(self) -> None:
        """Show name, tags, note, and what the result lacks."""
        session = self._ui.session
        variant = session.variant
        is_other_base, self._base = session.base is not self._base, session.base
        if is_other_base or name_from_text(self._typed or "") != variant.name:
            self._typed = None
        if self._typed is None:
            set_value(self._name, session.name)
        if tags_from_text(str(self._tags.value)) != variant.tags:
            set_value(self._tags, ", ".join(variant.tags))
        set_value(self._note, variant.note)
        self._show_losses()
        self._show_preflight()

    def written(self) -> None:
        """Show the name under which the state was written, whatever was typed."""
        self._typed = None
        self.show()

    def _show_preflight(self) -> None:
        """One line: a focal agent or ego that lacks, new problems."""
        scenario = self._ui.session.scenario
        wanted = {"focal agent": scenario.focal_id, "ego": EGO_ID}
        there = scenario.agents.row_of
        lacking = [f"no {what}" for what, name in wanted.items() if name not in there]
        counts = Counter(one.kind for one in self._model.findings.new)
        line = " · ".join([*lacking, problems_in_words(counts)])
        # In bold where the export lacks something.
        line = line[:1].upper() + line[1:]
        self._preflight.show(*((line,) if lacking or counts else ("", line)))

    def close(self) -> None:
        """Stop what is being drawn."""
        self._pictures.close()

    def download(self) -> None:
        """Send the scenario to the browser: as a zip, or alone if it is only to be shown.

        Raises:
            InputError: the typed name has no letter or digit.
        """
        self.refuse_empty_name()
        self._ui.commit_gesture()
        session, chosen = self._ui.session, self._chosen()
        scenario = session.scenario
        look = self._look(chosen.name) if chosen.name in LOOKS else None
        if chosen is PLAYER or (isinstance(look, FigureLook) and look.compares):
            try:
                scenario = self._workspace.with_original()
            except ExportError as error:
                if chosen is not PLAYER:
                    raise
                self._ui.notify("Without the original", str(error), "warning")
        named = replace(scenario, scenario_id=session.name)
        if look is not None:
            self._pictures.start(named, chosen.name, look)
            return
        if chosen is PLAYER:
            name, content = f"{session.name}.html", player_page([named])
        else:
            name, content = self._workspace.exported_zip(chosen.name)
            self.written()
        self._ui.client.send_file_download(name, content, save_immediately=True)

    def _look(self, ending: str) -> FilmLook | FigureLook:
        """How a film or figure is to look.

        Raises:
            InputError: a moment is no number.
        """
        look = LOOKS[ending]
        if isinstance(look, FilmLook):
            return replace(look, plans=self._workspace.plans_in_force)
        moments = re.split(r"[,;\s]+", str(self._moments.value).strip(" ,;") or "0")
        try:
            at_s = tuple(map(float, moments))
        except ValueError:
            raise InputError(
                f"Moments: {', '.join(moments)[:40]} are no seconds; expected numbers such as"
                " 0, 2, 4."
            ) from None
        return replace(look, at_s=at_s, compares=bool(self._compares.value))

    def format_name(self) -> str:
        """Name of the chosen format.

        Raises:
            InputError: its files take too long to be waited for.
        """
        chosen = self._chosen()
        if isinstance(LOOKS.get(chosen.name), FilmLook):
            raise InputError(
                f"{chosen.title} is only downloaded, one at a time; pd-editor convert and "
                "pd-editor library export write many."
            )
        return chosen.name

    def _chosen(self) -> SceneFormat:
        return next(
            one for one in formats().values() if one.title == self._format.value
        )

    def _show_as(self, word: str) -> None:
        set_value(self._format, formats()[_SHOWN[word]].title)
        self._format_chosen("")
        self.download()

    def _format_chosen(self, _title: str) -> None:
        chosen = self._chosen()
        is_figure = isinstance(LOOKS.get(chosen.name), FigureLook)
        for handle in (self._moments, self._compares):
            set_property(handle, "visible", is_figure)
        self._name_download()
        self._told_of = None
        self._show_losses()

    def _name_download(self) -> None:
        chosen = self._chosen()
        kind = "HTML" if chosen is PLAYER else chosen.name.upper()
        label = f"Download {kind if chosen.name in _ALONE else 'zip'}"
        is_drawn = self._pictures.is_busy and chosen.name in LOOKS
        set_property(self._download, "label", "Cancel drawing" if is_drawn else label)

    def _download_or_cancel(self) -> None:
        if self._pictures.is_busy and self._chosen().name in LOOKS:
            self._pictures.cancel()
        else:
            self.download()

    def _show_losses(self) -> None:
        """Tell what the chosen format cannot say of the scene, as losses.txt will."""
        scenario, chosen = self._ui.session.committed_scenario, self._chosen()
        if scenario is self._told_of:
            return
        self._told_of, title, losses = scenario, "Not kept (all in losses.txt)", ()
        try:
            if chosen.write and chosen.name not in (*_ALONE, ARGOVERSE2.name):
                losses = chosen.write(scenario).losses
        except ExportError as error:
            title, losses = "Cannot be written", (str(error),)
        self._losses.show(
            title if losses else "", " ".join(losses), tooltip="\n".join(losses)
        )
        set_property(self._losses.element, "visible", bool(losses))

    def _download_edits(self) -> None:
        self._ui.commit_gesture()
        name, content = self._workspace.recipe_text()
        self._ui.client.send_file_download(name, content, save_immediately=True)

    def _name_typed(self, text: str) -> None:
        self._typed = text
        self._ui.session.take_name_back()
        self._describe()

    def refuse_empty_name(self) -> None:
        """Raise InputError if nothing of the typed name can be one."""
        typed = (self._typed or "").strip()
        if typed and not name_from_text(typed):
            raise InputError(
                f"Name: {typed[:40]} has no letter or digit; type another name, or none "
                "for the proposed one."
            )

    def _describe(self) -> None:
        session = self._ui.session
        typed = session.variant.name if self._typed is None else self._typed
        session.describe(
            replace(
                session.variant,
                name=name_from_text(typed),
                tags=tags_from_text(str(self._tags.value)),
                note=str(self._note.value).strip(),
            )
        )

    def _write(self) -> None:
        path = str(self._out.value).strip()
        if not path:
            raise InputError("Type the folder to write into first.")
        out = self._workspace.folders.named(path)
        self.refuse_empty_name()
        self._ui.commit_gesture()
        earlier = self._workspace.earlier_export(out)
        if earlier is None:
            self._write_into(out)
        else:
            self._ask(out, earlier)

    def _ask(self, out: Path, earlier: float) -> None:
        """Let the user choose between a new name and replacing."""
        self._close_dialog()
        free = self._workspace.free_name_in(out)
        gui = self._ui.client.gui
        self._dialog = gui.add_modal("There is an export of this name")
        with self._dialog:
            beside = gui.add_button(f"Write as {free}")
            overwrite = gui.add_button(
                f"Replace the export of {_moment(earlier)}", color="red"
            )
            cancel = gui.add_button("Cancel", color="gray")
        self._ui.on_click(beside, lambda: self._write_into(out))
        self._ui.on_click(overwrite, lambda: self._write_into(out, replaces=True))
        self._ui.on_click(cancel, self._close_dialog)

    def _write_into(self, out: Path, *, replaces: bool = False) -> None:
        self._close_dialog()
        written = self._workspace.export_into(
            out, replaces=replaces, format_name=self.format_name()
        )
        title = "Replaced the earlier export" if replaces else "Exported"
        self.written()
        self._ui.notify(title, str(written), "success")

    def _close_dialog(self) -> None:
        if self._dialog is not None:
            self._dialog.close()
            self._dialog = None


def _moment(time_s: float) -> str:
    moment = datetime.datetime.fromtimestamp(time_s)
    is_today = moment.date() == datetime.datetime.now().date()
    return f"{moment:%H:%M}" if is_today else f"{moment:%d %b %H:%M}"
