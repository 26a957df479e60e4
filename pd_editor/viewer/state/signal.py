"""Signals: who changes something emits one, and whoever shows it has subscribed."""

import logging
import threading
from collections.abc import Callable
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
