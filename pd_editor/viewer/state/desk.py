"""What every panel and pointer handler of one browser tab works with."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal
from weakref import ref

import viser

from pd_editor.editor.commands import Command
from pd_editor.editor.session import EditorSession
from pd_editor.errors import PdEditorError
from pd_editor.viewer.state.inbox import Inbox
from pd_editor.viewer.state.workspace import Workspace

_LOG = logging.getLogger(__name__)
GESTURE_PAUSE_S: Final = 1.0
"""An input that rests this long has finished its gesture (viser tells no end)."""
LONGEST_REST_S: Final = 60.0
"""A slider that the pointer holds may rest this long, should its end never be told."""
LAST_VALUE_S: Final = 0.3
"""The last value of a slider may come so long after the pointer has let go of it."""
NOTICE_S: Final = 5.0
"""How long a notice stays that leaves by itself."""
_NOT_DONE: Final = "Not done"

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


class Desk:
    """A browser's session, its inbox, and how to speak to its user."""

    def __init__(
        self, client: viser.ClientHandle, workspace: Workspace, inbox: Inbox
    ) -> None:
        """Join the three."""
        self.client = client
        self.workspace = workspace
        self.session: EditorSession = workspace.session
        self.inbox = inbox
        self.on_playhead_moved: Callable[[], None] = lambda: None
        """Called when an edit has moved the playhead; the tab shows it."""
        self.hotkeys: list[Hotkey] = []
        """All that ``hotkey`` has registered, in that order."""
        self._gesture: str | None = None
        self._gesture_deadline: float | None = None
        self._is_slider_held = False
        self._failure = _NOT_DONE

    def post(
        self,
        action: Callable[[], None],
        merge_key: str | None = None,
        *,
        failure: str | None = None,
    ) -> None:
        """Run an action on the session's worker.

        ``failure`` says what did not happen if the action is refused.
        """
        if failure is not None:
            action = self._told(failure, action)
        self.inbox.post(action, merge_key)

    def on_click(
        self,
        button: viser.GuiButtonHandle,
        action: Callable[[], None],
        *,
        failure: str | None = None,
    ) -> None:
        """Run an action when a button is clicked.

        ``failure`` says what did not happen if the action is refused.
        """

        @button.on_click
        async def _(_event: viser.GuiEvent[Any]) -> None:
            self.post(self._told(failure or f"{_NOT_DONE}: {button.label}", action))

    def on_option(
        self, group: viser.GuiButtonGroupHandle, action: Callable[[str], None]
    ) -> None:
        """Run an action with the option that is clicked in a row of buttons."""

        @group.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            option = str(event.target.value)
            self.post(self._told(f"{_NOT_DONE}: {option}", lambda: action(option)))

    def on_change(
        self,
        handle: Any,
        action: Callable[[Any], None],
        *,
        merge_key: str | None = None,
        failure: str | None = None,
    ) -> None:
        """Run an action with the new value when the user changes an input.

        ``merge_key`` lets only the newest of several values in a row count.
        """

        def take(change: object, value: Any) -> None:
            if _waiting.get(id(handle), (None, None))[1] is change:
                del _waiting[id(handle)]
            action(value)

        # Of one input only: another one's value must not drop out of the queue.
        key = None if merge_key is None else f"{merge_key} of {id(handle)}"

        @handle.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is None:
                return
            value, change = event.target.value, object()
            _waiting[id(handle)] = ref(handle), change
            told = failure or f"{_NOT_DONE}: {handle.label}"
            self.post(self._told(told, lambda: take(change, value)), key)

    def hotkey(
        self,
        label: str,
        action: Callable[[], None],
        key: Any = None,
        modifier: Any = None,
        *,
        failure: str | None = None,
    ) -> None:
        """Offer an action in the command palette, with a hot key."""
        command = self.client.gui.add_command(label, hotkey=key, modifier=modifier)
        self.hotkeys.append(Hotkey(label=label, key=key, modifier=modifier))

        @command.on_trigger
        async def _(_event: Any) -> None:
            self.post(self._told(failure or f"{_NOT_DONE}: {label}", action))

    def _told(self, failure: str, action: Callable[[], None]) -> Callable[[], None]:
        """The action; if it raises, ``report`` says what did not happen."""

        def told() -> None:
            self._failure = failure
            action()
            self._failure = _NOT_DONE

        return told

    def apply(self, command: Command) -> None:
        """Apply one command as one undo step."""
        self.commit_gesture()
        if command.edits_current_state:
            self.show_current_step()
        self.session.apply(command)

    def show_current_step(self) -> bool:
        """Stop the picture at t = 0, where edits of states act; whether it moved.

        Whoever edits sees what is edited: neither playback nor the playhead shows
        another time meanwhile.
        """
        playback = self.workspace.playback
        current = float(playback.axis.current_step)
        if playback.step == current and not playback.is_playing:
            return False
        playback.pause()
        playback.seek(current)
        self.notify("Now at t = 0 s", "Edits act at t = 0 s: the playhead went there.")
        self.on_playhead_moved()
        return True

    def preview(self, owner: str, command: Command, *, has_end: bool = False) -> None:
        """Show a command as part of a gesture.

        Args:
            owner: who makes the gesture; another owner's gesture is committed first.
            command: the gesture so far, applied to the state it started from.
            has_end: whether the owner will say when the gesture is over; otherwise
                it is over when it rests.
        """
        if self._gesture != owner:
            self.commit_gesture()
            self.session.begin_gesture()
            self._gesture = owner
        pause_s = LONGEST_REST_S if self._is_slider_held else GESTURE_PAUSE_S
        self._gesture_deadline = None if has_end else time.monotonic() + pause_s
        if command.edits_current_state:
            self.show_current_step()
        self.session.preview(command)

    def hold_slider(self) -> None:
        """The pointer has taken a slider: a gesture of its own begins."""
        self._is_slider_held = True
        if self._gesture_deadline is not None:
            self.commit_gesture()

    def release_slider(self) -> None:
        """The pointer has let go of a slider: its gesture ends with its last value."""
        self._is_slider_held = False
        if self._gesture_deadline is not None:
            self._gesture_deadline = time.monotonic() + LAST_VALUE_S

    @property
    def gesture(self) -> str | None:
        """Who makes the gesture under way; inputs that do must not be set meanwhile."""
        return self._gesture

    def commit_gesture(self) -> None:
        """End the gesture under way, if any, as one undo step."""
        self._gesture, self._gesture_deadline = None, None
        self.session.commit_gesture()

    def abort_gesture(self) -> None:
        """End the gesture under way and take back what it showed."""
        self._gesture, self._gesture_deadline = None, None
        self.session.abort_gesture()

    def tick(self) -> bool:
        """Commit a gesture that has come to rest; whether one has."""
        deadline = self._gesture_deadline
        if deadline is None or time.monotonic() < deadline:
            return False
        self.commit_gesture()
        return True

    def notify(
        self, title: str, body: str = "", tone: Tone = "info", *, stays: bool = False
    ) -> None:
        """Tell the user something; the page shows texts as they are, never as HTML.

        Args:
            title: a few words.
            body: a sentence.
            tone: its colour.
            stays: whether it waits to be closed; otherwise it leaves by itself.
        """
        self.client.add_notification(
            title,
            body,
            color=_TONE_COLOR[tone],
            auto_close_seconds=None if stays else NOTICE_S,
        )

    def report(self, error: Exception) -> None:
        """Show an error: as it is if the user caused it, else as a bug with a log."""
        failure, self._failure = self._failure, _NOT_DONE
        if isinstance(error, PdEditorError):
            self.notify(failure, str(error), "error")
            return
        _LOG.error("A bug in the editor", exc_info=error)
        self.notify(
            "A bug in the editor",
            f"{type(error).__name__}: {error}. Your work is kept; the log has details.",
            "error",
        )


_waiting: dict[int, tuple["ref[Any]", object]] = {}
"""Inputs that the user has changed, by id, and the change that a session has yet to take.

viser's handles cannot be hashed; a closed tab leaves at most a dead reference here.
"""


def set_value(handle: Any, value: Any) -> None:
    """Set an input's value unless it shows it already; NaN shows an empty field.

    A value that the user has just typed, and that the session has not taken yet, stays:
    its turn comes.
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
