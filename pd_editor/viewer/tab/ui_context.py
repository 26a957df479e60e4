"""User interface context of one browser tab, shared by all of its elements."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal
from weakref import ref

import viser

from pd_editor.base.errors import PdEditorError
from pd_editor.editor.commands import Command
from pd_editor.editor.live_regeneration import LiveRegeneration
from pd_editor.editor.session import EditorSession
from pd_editor.viewer.overlay.overlay import Banner, Overlay
from pd_editor.viewer.state.events import Inbox
from pd_editor.viewer.state.workspace import Workspace
from pd_editor.viewer.tab.tab_model import TabModel

_LOG = logging.getLogger(__name__)
GESTURE_PAUSE_S: Final = 1.0
"""Pause after which an input's gesture is finished (viser reports no end)."""
LAST_VALUE_S: Final = 0.3
"""Time in which the last value of a slider may arrive after the pointer is released."""
NOT_DONE: Final = "Not possible"
_REFINING: Final = "refining"
"""Owner of a gesture that has ended, and whose final trajectories are awaited."""

Tone = Literal["info", "success", "warning", "error"]
_TONE_COLOR: Final[dict[Tone, Literal["blue", "green", "orange", "red"]]] = {
    "info": "blue",
    "success": "green",
    "warning": "orange",
    "error": "red",
}


@dataclass(frozen=True, kw_only=True)
class Hotkey:
    """An action of the command palette and the key that triggers it, if any."""

    label: str
    key: str | None
    modifier: str | None
    arms: bool = False
    """Whether it may begin or end a mode in which clicks mean something else."""


class UiContext:
    """Page, model, message queue, gestures and notices of a browser tab."""

    def __init__(
        self, client: viser.ClientHandle, workspace: Workspace, inbox: Inbox
    ) -> None:
        """Make the context of a tab, whose script starts in the page."""
        self.client = client
        self.workspace = workspace
        self.session: EditorSession = workspace.session
        self.inbox = inbox
        self.model = TabModel(workspace)
        self.overlay = Overlay(client, self.post)
        self.banner = Banner(self.overlay)
        self.live: LiveRegeneration | None = None
        """Regenerates traffic during gestures; None until the page is built."""
        self.hotkeys: list[Hotkey] = []
        """Registered hot keys, in order of registration."""
        self._gesture: str | None = None
        self._gesture_deadline: float | None = None
        self._is_slider_held = False
        self._failure = NOT_DONE
        self._refusal: tuple[tuple[str, str], viser.NotificationHandle] | None = None

    def post(
        self,
        action: Callable[[], None],
        merge_key: str | None = None,
        *,
        failure: str | None = None,
    ) -> None:
        """Run an action on the session's worker.

        ``failure`` is the title of the notice if the action raises an error.
        """
        if failure is not None:
            action = self.reporting(failure, action)
        self.inbox.post(action, merge_key)

    def on_click(
        self,
        button: viser.GuiButtonHandle,
        action: Callable[[], None],
        *,
        failure: str | None = None,
    ) -> None:
        """Run an action when a button is clicked.

        ``failure`` is the title of the notice if the action raises an error.
        """

        @button.on_click
        async def _(_event: viser.GuiEvent[Any]) -> None:
            self.post(self.reporting(failure or f"{NOT_DONE}: {button.label}", action))

    def on_option(
        self, group: viser.GuiButtonGroupHandle, action: Callable[[str], None]
    ) -> None:
        """Run an action with the option that is clicked in a row of buttons."""

        @group.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            option = str(event.target.value)
            self.post(self.reporting(f"{NOT_DONE}: {option}", lambda: action(option)))

    def on_change(
        self,
        handle: Any,
        action: Callable[[Any], None],
        *,
        merge_key: str | None = None,
        failure: str | None = None,
    ) -> None:
        """Run an action with the new value when the user changes an input.

        With ``merge_key`` only the newest of consecutive values is processed.
        """

        def take(change: object, value: Any) -> None:
            if _waiting.get(id(handle), (None, None))[1] is change:
                del _waiting[id(handle)]
            action(value)

        # Per input, so that values of another input are not dropped from the queue.
        key = None if merge_key is None else f"{merge_key} of {id(handle)}"

        @handle.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is None:
                return
            value, change = event.target.value, object()
            _waiting[id(handle)] = ref(handle), change
            title = failure or f"{NOT_DONE}: {handle.label}"
            self.post(self.reporting(title, lambda: take(change, value)), key)

    def hotkey(
        self,
        label: str,
        action: Callable[[], None],
        key: Any = None,
        modifier: Any = None,
        *,
        failure: str | None = None,
        arms: bool = False,
    ) -> None:
        """Offer an action in the command palette, with a hot key.

        With ``arms``, a press on the picture that follows waits for its effect.
        """
        command = self.client.gui.add_command(label, hotkey=key, modifier=modifier)
        self.hotkeys.append(Hotkey(label=label, key=key, modifier=modifier, arms=arms))

        @command.on_trigger
        async def _(_event: Any) -> None:
            self.post(self.reporting(failure or f"{NOT_DONE}: {label}", action))

    def reporting(self, failure: str, action: Callable[[], None]) -> Callable[[], None]:
        """Wrap an action so that its errors are reported with a title."""

        def reporting() -> None:
            self._failure = failure
            action()
            self._failure = NOT_DONE

        return reporting

    def apply(self, command: Command) -> None:
        """Apply one command as one undo step."""
        self.commit_gesture()
        if command.edits_current_state:
            self.show_current_step()
        self.session.apply(command)

    def show_current_step(self) -> bool:
        """Move the playhead to t = 0, where edits of states act; returns whether it moved.

        The user therefore sees the states that are edited: playback stops as well.
        """
        playback = self.workspace.playback
        current = float(playback.axis.current_step)
        if playback.step == current and not playback.is_playing:
            return False
        playback.pause()
        playback.seek(current)
        self.notify("Now at t = 0 s", "Edits act at t = 0 s: the playhead went there.")
        self.model.playhead_moved.emit()
        return True

    def preview(self, owner: str, command: Command) -> None:
        """Show a command of a drag, applied to the state at the start of the drag.

        Another owner's gesture is committed first. The owner tells the end.

        Raises:
            EditError: the command is not valid; what was shown before stays.
        """
        self._hold(owner, None)
        self._show_preview(command)

    def preview_value(self, owner: str, make: Callable[[], Command]) -> None:
        """Show the command of an input's value; a pause ends the gesture.

        Nothing of a refused value stays, for the values before it may be the beginnings
        of a number that was typed.

        Raises:
            EditError: the command is not valid; the state is that at the gesture's start.
        """
        # Longest pause of a slider that the pointer holds, if its end is never
        # reported.
        pause_s = 60.0 if self._is_slider_held else GESTURE_PAUSE_S
        self._hold(owner, time.monotonic() + pause_s)
        try:
            self._show_preview(make())
        except PdEditorError:
            if self.live is not None:
                self.live.drop()
            self.session.abort_gesture()
            self.session.begin_gesture()
            raise

    def _hold(self, owner: str, deadline: float | None) -> None:
        """Go on with the owner's gesture until a time, or begin it."""
        if self._gesture != owner:
            if self.live is not None:
                self.live.drop()
            # Before the former gesture is committed, for panels are shown then, and the
            # owner's inputs have the values of the new one already.
            self._gesture = owner
            self.session.begin_gesture()
        self._gesture_deadline = deadline

    def _show_preview(self, command: Command) -> None:
        if command.edits_current_state:
            self.show_current_step()
        if self.live is None:
            self.session.preview(command)
        else:
            self.live.preview(command)

    def hold_slider(self) -> None:
        """The pointer has taken a slider: a gesture of its own begins."""
        self._is_slider_held = True
        if self._gesture_deadline is not None:
            self.commit_gesture()

    def release_slider(self) -> None:
        """The pointer has let go of a slider: its gesture ends with its last value."""
        self._is_slider_held = False
        if self._gesture_deadline is not None and self._gesture != _REFINING:
            self._gesture_deadline = time.monotonic() + LAST_VALUE_S

    @property
    def gesture(self) -> str | None:
        """Owner of the active gesture, whose inputs must not be set meanwhile."""
        if self._gesture == _REFINING and not (self.live and self.live.is_refining):
            # The session has committed it, for example because the selection changed.
            return None
        return self._gesture

    def end_gesture(self) -> None:
        """End the active gesture, as the pointer does when it lets go.

        It is committed as one undo step: now, or with the final trajectories of the
        agents that react to it.
        """
        if self.live is not None and self.live.finish():
            self._gesture = _REFINING
            # Time after which an edit is committed without its final trajectories.
            self._gesture_deadline = time.monotonic() + 8.0
        else:
            self.commit_gesture()

    def commit_gesture(self) -> None:
        """Commit the active gesture, if any, as one undo step."""
        self.gesture_was_committed()
        if self.live is not None:
            self.live.drop()
        self.session.commit_gesture()

    def gesture_was_committed(self) -> None:
        """Forget the active gesture, which the session has committed."""
        self._gesture, self._gesture_deadline = None, None

    def abort_gesture(self) -> None:
        """Abort the active gesture and restore the state at its start.

        An edit whose final trajectories are awaited is over: it is committed without them.
        """
        if self._gesture == _REFINING:
            self.commit_gesture()
            return
        self._gesture, self._gesture_deadline = None, None
        if self.live is not None:
            self.live.drop()
        self.session.abort_gesture()

    def tick(self) -> bool:
        """End a gesture after its pause; returns whether it was committed."""
        deadline = self._gesture_deadline
        if deadline is None or time.monotonic() < deadline:
            return False
        if self._gesture == _REFINING:
            self.commit_gesture()
        else:
            self.end_gesture()
        return self._gesture is None

    def send_now(self) -> None:
        """Let viser's thread send queued messages; it needs the interpreter lock."""
        self.client.flush()
        time.sleep(1e-3)

    def notify(
        self, title: str, body: str = "", tone: Tone = "info", *, stays: bool = False
    ) -> viser.NotificationHandle:
        """Show a notice; its texts are never interpreted as HTML.

        It closes by itself unless it ``stays``. The handle removes it.
        """
        return self.client.add_notification(
            title,
            body,
            color=_TONE_COLOR[tone],
            # Duration of a notice that closes by itself.
            auto_close_seconds=None if stays else 5.0,
        )

    def report(self, error: Exception) -> None:
        """Show an error: its message if the user caused it, else a bug with a log entry."""
        failure, self._failure = self._failure, NOT_DONE
        if isinstance(error, PdEditorError):
            texts = failure, str(error)
            if self._refusal is not None and self._refusal[0] == texts:
                self._refusal[1].remove()  # said once, however often a key is pressed
            self._refusal = texts, self.notify(*texts, "error")
            return
        _LOG.error("A bug in the editor", exc_info=error)
        self.notify(
            "A bug in the editor",
            f"{type(error).__name__}: {error}. Your work is kept; the log has details.",
            "error",
        )


_waiting: dict[int, tuple["ref[Any]", object]] = {}
"""Inputs that the user has changed, by id, with the change that is not processed yet.

viser's handles cannot be hashed; a closed tab leaves at most a dead reference here.
"""


def set_value(handle: Any, value: Any) -> None:
    """Set an input's value unless it shows it already; NaN shows an empty field.

    A value that the user has just typed, and that is not processed yet, is kept.
    """
    waiting = _waiting.get(id(handle))
    is_waiting = waiting is not None and waiting[0]() is handle
    if not is_waiting and not _same(handle.value, value):
        handle.value = value


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other) or (one != one and other != other)


def set_property(handle: Any, name: str, value: Any) -> None:
    """Set a property of an element unless it has it already."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)
