"""Ctrl-C as a request to stop after the current step."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def stop_requests() -> Iterator[Callable[[], bool]]:
    """Context with a function that tells whether Ctrl-C was pressed.

    The second Ctrl-C interrupts at once. Outside the main thread there are no requests.
    """
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked.is_set
        return
    earlier: dict[signal.Signals, Any] = {
        one: signal.getsignal(one) for one in _SIGNALS
    }

    def restore() -> None:
        for one, handler in earlier.items():
            signal.signal(one, handler)

    def ask(*_: object) -> None:
        asked.set()
        restore()

    for one in _SIGNALS:
        signal.signal(one, ask)
    try:
        yield asked.is_set
    finally:
        restore()
