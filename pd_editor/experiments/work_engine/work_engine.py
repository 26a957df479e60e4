"""Interface of work engines, which run a function on many items, and their results."""

import ctypes
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from traceback import format_exception
from typing import Final, Generic, Protocol, TypeVar, runtime_checkable

from pd_editor.base.errors import GenerationError, PdEditorError

Item = TypeVar("Item")
Value = TypeVar("Value")

WAIT_S: Final = 0.25
"""Longest time between two calls of ``on_wait``."""


@dataclass(frozen=True, kw_only=True)
class WorkFailure:
    """Reason why an item has no value; text only, so that it can always be pickled."""

    error: str
    """Name of the exception's class; ``ProcessDied`` if its process was lost."""
    message: str
    traceback: str = ""
    """The worker's traceback, for a log."""
    is_users: bool = False
    """Whether the error is a ``PdEditorError``, which users can cause, not a bug."""

    @property
    def reason(self) -> str:
        """For the user: the message, after the name of the error if it is a bug's."""
        return self.message if self.is_users else f"{self.error}: {self.message}"


def failure_of(error: BaseException) -> WorkFailure:
    """Convert an exception to a failure."""
    return WorkFailure(
        error=type(error).__name__,
        message=str(error),
        traceback="".join(format_exception(error)),
        is_users=isinstance(error, PdEditorError),
    )


@dataclass(frozen=True, kw_only=True)
class WorkResult(Generic[Value]):
    """Result of one item: a value or a failure."""

    key: str
    value: Value | None = None
    failure: WorkFailure | None = None


def result_of(
    function: Callable[[Item], Value], key: str, item: Item
) -> WorkResult[Value]:
    """Run one item in a worker; exceptions become failures."""
    try:
        return WorkResult(key=key, value=function(item))
    except (Exception, SystemExit) as error:  # noqa: BLE001  (one must not stop the rest)
        return WorkResult(key=key, failure=failure_of(error))


@dataclass(frozen=True, kw_only=True)
class WorkProgress:
    """Progress of a run; items finished in an earlier run do not count."""

    num_done: int
    num_failed: int
    num_items: int

    @property
    def fraction(self) -> float:
        """Share of the items that are done."""
        return self.num_done / max(self.num_items, 1)


def rate_in_words(per_s: float, noun: str = "") -> str:
    """Rate of work, as in "2.5 a second" or "12 variants a minute"."""
    what = f" {noun}" if noun else ""
    if per_s >= 1:
        return f"{per_s:.3g}{what} a second"
    return f"{60 * per_s:.2g}{what} a minute"


def minutes_left(left_s: float) -> str:
    """Time that work still takes, as in "2:05 left"."""
    left = round(left_s)
    return f"{left // 60}:{left % 60:02d} left"


def progress_line(
    progress: WorkProgress, elapsed_s: float, noun: str, variants_per_item: float = 0.0
) -> str:
    """Describe the progress of a run and its remaining time.

    ``variants_per_item`` makes its rate one of variants instead of items.
    """
    done, num = progress.num_done, progress.num_items
    words = f"{done} of {num} {noun}"
    if progress.num_failed:
        words += f", {progress.num_failed} failed"
    if done > 0 and elapsed_s > 0:
        per_s, counted = done / elapsed_s, "variants" if variants_per_item else ""
        words += f", {rate_in_words(per_s * (variants_per_item or 1), counted)}"
        if done < num:
            words += f", {minutes_left(elapsed_s / done * (num - done))}"
    return words


@runtime_checkable
class WorkEngine(Protocol):
    """Interface of engines that call a function on many items."""

    def run(
        self,
        function: Callable[[Item], Value],
        items: Mapping[str, Item],
        *,
        on_result: Callable[[WorkResult[Value]], None],
        on_wait: Callable[[], None] = lambda: None,
    ) -> None:
        """Call ``function`` on every item and pass each result to ``on_result``.

        Function, items and values must be picklable; keys name the items. Results
        arrive in any order, in the caller's thread. An item that raises gives a
        failure and does not stop the others. ``on_wait`` is called from time to time
        while items run. If a callback raises, or on KeyboardInterrupt, running items
        are stopped and the exception is raised.
        """
        ...


class InThisProcess:
    """Work engine that calls the function here, item by item."""

    def run(
        self,
        function: Callable[[Item], Value],
        items: Mapping[str, Item],
        *,
        on_result: Callable[[WorkResult[Value]], None],
        on_wait: Callable[[], None] = lambda: None,
    ) -> None:
        """Call ``function`` on every item; see ``WorkEngine.run``."""
        for key, item in items.items():
            on_wait()
            on_result(result_of(function, key, item))


def run_items(
    engine: WorkEngine,
    function: Callable[[Item], Value],
    items: Mapping[str, Item],
    *,
    on_value: Callable[[str, Value], None],
    on_progress: Callable[[WorkProgress], None] | None = None,
    done: Collection[str] = (),
    harmless: str = "",
) -> dict[str, WorkFailure]:
    """Run the items whose keys are not in ``done``; returns the failures by key.

    Progress does not count those that a ``harmless`` error has ended.

    To resume, a caller stores each value in ``on_value`` and gives the stored keys
    next time. ``on_progress`` is called once before the first result, after each, and
    from time to time while items run, so that it can end the run by an exception.
    """
    left = {key: item for key, item in items.items() if key not in done}
    failures: dict[str, WorkFailure] = {}
    num_done = num_failed = 0

    def tell() -> None:
        if on_progress is not None:
            on_progress(
                WorkProgress(
                    num_done=num_done, num_failed=num_failed, num_items=len(left)
                )
            )

    def take(result: WorkResult[Value]) -> None:
        nonlocal num_done, num_failed
        if result.failure is not None:
            failures[result.key] = result.failure
            num_failed += result.failure.error != harmless
        elif result.value is not None:
            on_value(result.key, result.value)
        num_done += 1
        tell()

    tell()
    engine.run(function, left, on_result=take, on_wait=tell)
    return failures


WORKER_MARK: Final = "PD_EDITOR_WORKER"
"""Environment variable of workers that are not children of this process."""


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
    watchdog = threading.Timer(limit_s + max(0.5 * limit_s, 5.0), os._exit, (1,))
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
    try:
        timer.start()  # A busy machine may be at the limit before the block begins.
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
