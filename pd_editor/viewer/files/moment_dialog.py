"""The dialog that asks for a moment of a recording that is too long to be opened whole."""

from typing import Any, Final

from pd_editor.scene.formats.file_scene import FileScene
from pd_editor.scene.scene_limits import MAX_STEPS
from pd_editor.scene.time_axis import TimeAxis
from pd_editor.scene.time_cut import FUTURE_S
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
