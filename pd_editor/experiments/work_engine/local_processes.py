"""Runs work items on processes of this machine."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final, TypeVar

from pd_editor.base.errors import InputError
from pd_editor.experiments.work_engine.work_engine import (
    WAIT_S,
    WorkFailure,
    WorkResult,
    failure_of,
    result_of,
)

Item = TypeVar("Item")
Value = TypeVar("Value")

ONE_THREAD: Final[dict[str, str]] = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMEXPR_NUM_THREADS",
    ),
    "1",
)
"""Read by NumPy's libraries and by torch when they are first imported."""
_UNGUARDED_CODE: Final = 97
"""Exit code of a worker that runs the caller's script instead of its work."""
PROCESS_DIED: Final = WorkFailure(
    error="ProcessDied",
    message="The process that worked on it died; it may have run out of memory.",
)


@dataclass(frozen=True, kw_only=True)
class LocalProcesses:
    """Work engine with a pool of new processes, each with one compute thread."""

    num_workers: int | None = None
    """Number of processes; None: number of cores that this process may use."""

    def __post_init__(self) -> None:
        assert self.num_workers is None or self.num_workers >= 1

    def run(
        self,
        function: Callable[[Item], Value],
        items: Mapping[str, Item],
        *,
        on_result: Callable[[WorkResult[Value]], None],
        on_wait: Callable[[], None] = lambda: None,
    ) -> None:
        """Call ``function`` on every item; see ``WorkEngine.run``.

        If a process dies (killed, out of memory), the running items are repeated one by
        one, so that only the item that kills its process fails.

        Raises:
            InputError: the caller's script cannot be run by workers.
        """
        end_unguarded_worker()
        file = getattr(sys.modules["__main__"], "__file__", None)
        if file is not None and not os.path.exists(file):
            raise InputError(f"{file}: workers run it as well; save it as a file.")
        left = dict(items)
        while left:
            suspects = self._run_together(function, left, on_result, on_wait)
            for key in suspects:
                left.pop(key)
            for key, item in suspects.items():
                alone = {key: item}
                if LocalProcesses(num_workers=1)._run_together(
                    function, alone, on_result, on_wait
                ):
                    on_result(WorkResult(key=key, failure=PROCESS_DIED))

    def _run_together(
        self,
        function: Callable[[Item], Value],
        left: dict[str, Item],
        on_result: Callable[[WorkResult[Value]], None],
        on_wait: Callable[[], None],
    ) -> dict[str, Item]:
        """Run until all items are done or a process dies; returns the running items.

        Finished items are removed from ``left``.
        """
        waiting = iter(list(left))
        num_workers = min(self.num_workers or available_cores(), max(len(left), 1))
        running: dict[Future[WorkResult[Value]], str] = {}
        with _pool(num_workers) as pool:
            while True:
                try:
                    # Items queued per worker, so that no worker waits for the caller.
                    while len(running) < num_workers * 2:
                        key = next(waiting, None)
                        if key is None:
                            break
                        future = pool.submit(result_of, function, key, left[key])
                        running[future] = key
                    if not running:
                        return {}
                    finished, _ = wait(running, WAIT_S, FIRST_COMPLETED)
                    if not finished:
                        on_wait()
                    for future in sorted(finished, key=lambda one: running[one]):
                        result = _result_of(future, running[future])
                        del running[future]
                        on_result(result)
                        del left[result.key]
                except BrokenProcessPool as error:
                    processes = list((pool._processes or {}).values())
                    # Its thread reaps them as well; whoever comes second has no code.
                    pool.shutdown(wait=True, cancel_futures=True)
                    if _UNGUARDED_CODE in [one.exitcode for one in processes]:
                        raise InputError(
                            "Workers run the calling script from its beginning, so that "
                            "it would call itself again; put what it does below "
                            'if __name__ == "__main__":.'
                        ) from error
                    return {key: left[key] for key in running.values() if key in left}


def end_unguarded_worker() -> None:
    """End a worker that is about to begin the work of its caller once more."""
    # What multiprocessing asks as well, but only after the folder of the results.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        os._exit(_UNGUARDED_CODE)


def available_cores() -> int:
    """Number of cores that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _pool(num_workers: int) -> Iterator[ProcessPoolExecutor]:
    """Process pool whose processes end with the context."""
    with _environment(ONE_THREAD):
        pool = ProcessPoolExecutor(
            num_workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
        )
        try:
            yield pool
        except BaseException:
            for process in list((pool._processes or {}).values()):
                process.terminate()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables that spawned processes inherit within the context."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _start_worker() -> None:
    """Ignore Ctrl-C, which the parent handles, and end if the parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when its parent dies; otherwise it would wait forever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _result_of(future: Future[WorkResult[Value]], key: str) -> WorkResult[Value]:
    """Result of a worker, or a failure if item or value could not be pickled."""
    try:
        return future.result()
    except BrokenProcessPool:
        raise
    except Exception as error:  # noqa: BLE001  (pickling raises errors of any class)
        return WorkResult(key=key, failure=failure_of(error))
