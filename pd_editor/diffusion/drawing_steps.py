"""Running a sampler step by step: without gradients, on as many threads as are free."""

import os
from collections.abc import Generator
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
    """
    most = min(torch.get_num_threads(), 1 + num_rows // _ROWS_PER_THREAD)
    threads = max(min(most, num_idle_cores() + 1), 1)
    while True:
        if threads > 1 and num_idle_cores() < 0:
            threads = 1
        caller_threads = torch.get_num_threads()
        torch.set_num_threads(threads)
        try:
            with torch.inference_mode():
                step = next(steps)
        except StopIteration as stop:
            return stop.value
        finally:
            torch.set_num_threads(caller_threads)
        yield step


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
