"""How parts of a tab hear of each other: signals on its own thread, and the inbox of that thread."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVarTuple

_LOG = logging.getLogger(__name__)
Values = TypeVarTuple("Values")


class Signal(Generic[*Values]):
    """One kind of change in a browser tab, told on the tab's own thread alone."""

    def __init__(self) -> None:
        """Without subscribers; the first one's thread is the tab's."""
        self._subscribers: list[Callable[[*Values], object]] = []
        self._thread: threading.Thread | None = None

    def subscribe(self, *subscribers: Callable[[*Values], object]) -> None:
        """Call these at each change, after those that have subscribed before."""
        self._thread = self._thread or threading.current_thread()
        self._subscribers += subscribers

    def emit(self, *values: *Values) -> None:
        """Call all subscribers; the first error is raised after the last call."""
        self._check_thread()
        errors: list[Exception] = []
        for call in self._subscribers:
            try:
                call(*values)
            except Exception as error:  # noqa: BLE001  (the others must hear of it, too)
                errors.append(error)
        for further in errors[1:]:
            _LOG.error("A further error after the same change", exc_info=further)
        if errors:
            raise errors[0]

    def offer(self, *values: *Values) -> bool:
        """Ask subscribers until one takes the values; returns whether one does."""
        self._check_thread()
        return any(take(*values) for take in self._subscribers)

    def _check_thread(self) -> None:
        owner = self._thread
        # Whoever closes the tab may tell the last changes, when its thread has ended.
        is_own = owner in (None, threading.current_thread()) or not owner.is_alive()
        assert is_own, "signals belong to the thread of their tab"


_SLOWEST_POLL_S = 0.25
_LONGEST_MESSAGE_S = 10.0


@dataclass(frozen=True, kw_only=True)
class Message:
    """An action for the worker thread."""

    action: Callable[[], None]
    merge_key: str | None
    """Among neighbours of equal key only the newest is kept (drags, sliders)."""


class Inbox:
    """A queue whose worker also ticks, as often as ``tick`` asks for."""

    def __init__(
        self, *, tick: Callable[[], float | None], on_error: Callable[[Exception], None]
    ) -> None:
        """Create the queue; ``start`` runs its worker.

        Args:
            tick: called after messages and when due; returns the seconds until the next
                call, or None.
            on_error: called with every exception that a message raised.
        """
        self._tick = tick
        self._on_error = on_error
        self._messages: deque[Message] = deque()
        self._changed = threading.Condition()
        self._is_closed = False
        self._thread = threading.Thread(target=self._work, daemon=True, name="session")

    def start(self) -> None:
        """Start working."""
        self._thread.start()

    def post(self, action: Callable[[], None], merge_key: str | None = None) -> None:
        """Queue an action; safe from any thread."""
        with self._changed:
            if self._is_closed:
                return
            last = self._messages[-1] if self._messages else None
            if merge_key is not None and last and last.merge_key == merge_key:
                self._messages.pop()
            self._messages.append(Message(action=action, merge_key=merge_key))
            self._changed.notify()

    def close(self) -> None:
        """Drop what is queued, and wait until the worker has ended."""
        with self._changed:
            self._is_closed = True
            self._messages.clear()
            self._changed.notify()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(_LONGEST_MESSAGE_S)

    def _work(self) -> None:
        next_tick = time.monotonic()
        while True:
            with self._changed:
                wait_s = max(next_tick - time.monotonic(), 0.0)
                if not self._messages and not self._is_closed and wait_s > 0:
                    self._changed.wait(wait_s)
                if self._is_closed:
                    return
                message = self._messages.popleft() if self._messages else None
            if message is not None:
                self._guarded(message.action)
            if message is None or time.monotonic() >= next_tick:
                pause_s: float | None = None

                def ticked() -> None:
                    nonlocal pause_s
                    pause_s = self._tick()

                self._guarded(ticked)
                next_tick = time.monotonic() + (
                    _SLOWEST_POLL_S if pause_s is None else pause_s
                )

    def _guarded(self, action: Callable[[], None]) -> None:
        try:
            action()
        except Exception as error:  # noqa: BLE001  (the worker must outlive any bug)
            try:
                self._on_error(error)
            except Exception:  # noqa: BLE001  (likewise)
                _LOG.exception("An error could not be shown: %s", error)
