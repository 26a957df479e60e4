import os
import threading
from collections.abc import Generator, Iterator

import pytest
import torch

from pd_editor.diffusion.core import drawing_steps as module
from pd_editor.diffusion.core.drawing_steps import drawing_steps, num_idle_cores


@pytest.fixture(autouse=True)
def _fresh_process() -> Iterator[None]:
    """As if nothing had been drawn yet."""
    module._usual_threads.cache_clear()
    yield
    module._usual_threads.cache_clear()


def seen_by_steps(closed: list[bool]) -> Generator[tuple[bool, int], None, str]:
    try:
        for _ in range(3):
            yield torch.is_inference_mode_enabled(), torch.get_num_threads()
    finally:
        closed.append(True)
    return "done"


@pytest.mark.parametrize(
    ("idle", "num_rows", "threads"),
    [
        ([1] * 9, 100, [2, 2, 2]),
        ([1] * 9, 10, [1, 1, 1]),
        ([0] * 9, 100, [1, 1, 1]),
        ([1, 0, -1, 0, 0], 100, [2, 1, 1]),
    ],
)
def test_only_idle_cores_are_used_and_the_caller_keeps_its_threads(
    idle: list[int], num_rows: int, threads: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = iter(idle)
    monkeypatch.setattr(module, "num_idle_cores", lambda: next(said))
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        found = []
        for is_inference, number in drawing_steps(seen_by_steps([]), num_rows):
            assert is_inference
            found.append(number)
            assert torch.get_num_threads() == 2
            assert not torch.is_inference_mode_enabled()
        assert found == threads
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_the_result_is_that_of_the_steps() -> None:
    steps = drawing_steps(seen_by_steps([]), 1)
    for _ in range(3):
        next(steps)
    with pytest.raises(StopIteration) as stop:
        next(steps)
    assert stop.value.value == "done"


def test_who_stops_early_stops_what_is_run() -> None:
    closed: list[bool] = []
    steps = drawing_steps(seen_by_steps(closed), 1)
    next(steps)
    steps.close()
    del steps
    assert closed == [True]


def test_a_process_that_runs_leaves_no_more_than_the_other_cores() -> None:
    assert num_idle_cores() < (os.cpu_count() or 1)


def test_drawings_that_overlap_leave_later_threads_theirs() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    is_inside, may_end = threading.Event(), threading.Event()

    def slow_step() -> Generator[None, None, None]:
        is_inside.set()
        assert may_end.wait(10)
        yield

    def slow() -> None:
        next(drawing_steps(slow_step(), 1))

    def quick() -> None:
        next(drawing_steps(seen_by_steps([]), 1))

    found: list[int] = []
    try:
        first = threading.Thread(target=slow)
        first.start()
        assert is_inside.wait(10)
        second = threading.Thread(target=quick)
        second.start()
        second.join()
        may_end.set()
        first.join()
        later = threading.Thread(target=lambda: found.append(torch.get_num_threads()))
        later.start()
        later.join()
    finally:
        torch.set_num_threads(before)
    assert found == [2]


def test_a_callers_autocast_does_not_reach_the_steps() -> None:
    def is_autocast() -> Generator[bool, None, None]:
        yield torch.is_autocast_enabled("cpu")

    with torch.autocast("cpu", torch.bfloat16):
        assert not next(drawing_steps(is_autocast(), 1))
        assert torch.is_autocast_enabled("cpu")
