"""Running a sampler step by step: without gradients, and on as many threads as pay."""

from collections.abc import Generator
from typing import Final, TypeVar

import torch

_Step = TypeVar("_Step")
_Result = TypeVar("_Result")

_FEW_ROWS: Final = 1000
"""Agents, times samples, at which one thread is about as fast as all of them."""


def drawing_steps(
    steps: Generator[_Step, None, _Result], num_rows: int
) -> Generator[_Step, None, _Result]:
    """The same steps; between them the caller finds torch as it was.

    With few rows operations are short, and a second thread gains a fifth at best: but
    where another program keeps a core busy, each operation waits for it, and what takes
    milliseconds takes seconds.
    """
    threads = torch.get_num_threads()
    while True:
        caller_threads = torch.get_num_threads()
        torch.set_num_threads(1 if num_rows <= _FEW_ROWS else threads)
        try:
            with torch.inference_mode():
                step = next(steps)
        except StopIteration as stop:
            return stop.value
        finally:
            torch.set_num_threads(caller_threads)
        yield step
