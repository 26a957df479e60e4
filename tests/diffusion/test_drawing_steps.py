import os
from collections.abc import Generator

import pytest
import torch

from pd_editor.diffusion import drawing_steps as module
from pd_editor.diffusion.drawing_steps import drawing_steps, num_idle_cores


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
