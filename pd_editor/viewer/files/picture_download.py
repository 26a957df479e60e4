"""Films and figures of a scene for the browser, drawn beside the work."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import viser

from pd_editor.base.errors import ExportError, InputError, PdEditorError
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.commands.command import shortened
from pd_editor.scene.formats.figure import FigureLook
from pd_editor.scene.formats.film import FilmLook
from pd_editor.scene.formats.pictures import picture
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.tab.ui_context import UiContext


class PictureDownload:
    """Draws one picture at a time, tells how far it is, and sends it."""

    def __init__(self, ui: UiContext) -> None:
        """Draw for a tab."""
        self._ui = ui
        self._job: _Drawing | None = None
        self._notice: viser.NotificationHandle | None = None

    def start(
        self, scenario: Scenario, ending: str, look: FilmLook | FigureLook
    ) -> None:
        """Begin to draw, about the selected agent if there is one.

        Raises:
            InputError: another one is being drawn.
        """
        if self._notice is not None:
            raise InputError("Another picture is being drawn; wait until it is here.")
        selection = self._ui.session.selection
        follow = selection[0] if len(selection) == 1 else ""
        whom = f"following {shortened(follow)}" if follow else "about the focal agent"
        title = f"Drawing {scenario.scenario_id}.{ending}, {whom}"
        self._notice = self._ui.notify(title, stays=True)
        look = replace(look, follow=follow)
        self._job = _Drawing(self, self._ui.post, scenario, ending, look)
        self._job.start()

    def close(self) -> None:
        """Stop what is being drawn."""
        if self._job is not None:
            self._job.cancel()

    def tell(self, done: int, count: int) -> None:
        """Show how far it is."""
        if self._notice is not None:
            self._notice.body = f"{done} of {count} frames"

    def send(self, name: str, content: bytes) -> None:
        """Send what is drawn."""
        self._end()
        self._ui.client.send_file_download(name, content, save_immediately=True)

    def fail(self, error: PdEditorError) -> None:
        """Tell why there is none."""
        self._end()
        self._ui.report(error)

    def _end(self) -> None:
        if self._notice is not None:
            self._notice.remove()
            self._notice = None


class _Drawing(BackgroundJob[bytes]):
    """Draws a picture; all that it tells goes to the tab's own thread."""

    def __init__(
        self,
        to: PictureDownload,
        post: Callable[..., None],
        scenario: Scenario,
        ending: str,
        look: FilmLook | FigureLook,
    ) -> None:
        name = f"{scenario.scenario_id}.{ending}"
        super().__init__(
            f"draw-{ending}",
            lambda content: post(partial(to.send, name, content)),
            lambda error: post(partial(to.fail, error)),
        )
        self._tell = lambda *now: post(partial(to.tell, *now), merge_key="frames")
        self._draw = partial(picture, scenario, ending, look)

    def _result(self) -> bytes:
        return self._draw(self._drawn)

    def _drawn(self, done: int, count: int) -> None:
        self.check_cancelled()
        self._tell(done, count)

    def _fault(self) -> PdEditorError:
        return ExportError("The picture failed by a fault of its own; see the log.")
