"""A time limit for code that is not ours, in a worker process."""

import ctypes
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from pd_editor.base.errors import GenerationError

WORKER_MARK: Final = "PD_EDITOR_WORKER"
"""Environment variable of workers that are not children of this process."""
_GRACE_SHARE: Final = 0.5
_LEAST_GRACE_S: Final = 5.0


class TimeLimitError(GenerationError):
    """Code ran longer than it may."""


@contextmanager
def time_limit(limit_s: float | None) -> Iterator[None]:
    """Stop what runs in the block after a time.

    Python code is stopped by an exception. Code of a library that does not come back
    to Python in time ends the worker process, whose other items run again elsewhere;
    outside a main thread, and where the system has no timers, it is waited for.

    Raises:
        TimeLimitError: the time is over.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if limit_s is None:
        yield
        return

    def stop(*_: object) -> None:
        raise TimeLimitError(f"It gave no answer within {limit_s:g} s.")

    if not is_main or not hasattr(signal, "setitimer"):
        with _raised_in_this_thread(limit_s, stop):
            yield
        return

    before = signal.signal(signal.SIGALRM, stop)
    watchdog = threading.Timer(
        limit_s + max(_GRACE_SHARE * limit_s, _LEAST_GRACE_S), os._exit, (1,)
    )
    watchdog.daemon = True
    if multiprocessing.parent_process() is not None or WORKER_MARK in os.environ:
        watchdog.start()
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        watchdog.cancel()


@contextmanager
def _raised_in_this_thread(limit_s: float, stop: Callable[[], None]) -> Iterator[None]:
    """Raise what ``stop`` raises in the block, once Python code runs after a time."""
    thread, lock, is_over = ctypes.c_ulong(threading.get_ident()), threading.Lock(), []

    def interrupt() -> None:
        with lock:
            if not is_over:
                error = ctypes.py_object(_Interrupted)
                ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, error)

    timer = threading.Timer(limit_s, interrupt)
    timer.daemon = True
    timer.start()
    try:
        yield
    except _Interrupted:
        stop()
    finally:
        timer.cancel()
        with lock:
            is_over.append(True)
            ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, None)


class _Interrupted(BaseException):
    """Raised in a thread by another one."""
