"""Running a sampler step by step: without gradients, on as many threads as are free."""

import contextlib
import functools
import os
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Final, TypeVar

import torch

_Step = TypeVar("_Step")
_Result = TypeVar("_Result")

_ROWS_PER_THREAD: Final = 32
"""Agents, times samples, for which another thread pays."""


def drawing_steps(
    steps: Generator[_Step, None, _Result], num_rows: int
) -> Generator[_Step, None, _Result]:
    """The same steps; between them the caller finds torch as it was.

    Where another program keeps a core busy, each of the many short operations would
    wait for the thread on that core, and what takes milliseconds would take seconds. So
    only idle cores are used, and no second one any more once there are too few.

    A caller's autocast does not reach the steps: sines of large angles need float32.
    """
    usual = _usual_threads()
    most = min(usual, 1 + num_rows // _ROWS_PER_THREAD)
    threads = max(min(most, num_idle_cores() + 1), 1)
    while True:
        if threads > 1 and num_idle_cores() < 0:
            threads = 1
        torch.set_num_threads(threads)
        try:
            with torch.inference_mode(), _without_autocast():
                step = next(steps)
        except StopIteration as stop:
            return stop.value
        finally:
            torch.set_num_threads(usual)
        yield step


@functools.cache
def _usual_threads() -> int:
    """Threads of torch when the first drawing of the process began.

    Later on it may say what a step has set that runs in another thread meanwhile.
    """
    return torch.get_num_threads()


@contextlib.contextmanager
def _without_autocast() -> Iterator[None]:
    """Switch it off where it is on."""
    with contextlib.ExitStack() as stack:
        for device in ("cpu", "cuda"):
            if torch.is_autocast_enabled(device):
                stack.enter_context(torch.autocast(device, enabled=False))
        yield


def num_idle_cores() -> int:
    """Cores on which nothing runs now; below 0 if more want to run than there are.

    0 where the system does not tell.
    """
    try:
        text = Path("/proc/loadavg").read_text(encoding="ascii")
        running = int(text.split()[3].partition("/")[0])
        return len(os.sched_getaffinity(0)) - running
    except (OSError, AttributeError, ValueError, IndexError):
        return 0
