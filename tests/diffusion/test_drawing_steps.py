from collections.abc import Generator

import pytest
import torch

from pd_editor.diffusion.drawing_steps import drawing_steps


def seen_by_steps(closed: list[bool]) -> Generator[tuple[bool, int], None, str]:
    try:
        for _ in range(3):
            yield torch.is_inference_mode_enabled(), torch.get_num_threads()
    finally:
        closed.append(True)
    return "done"


def test_few_rows_take_one_thread_and_the_caller_keeps_its_own() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        for num_rows, threads in ((10, 1), (100_000, 2)):
            for found in drawing_steps(seen_by_steps([]), num_rows):
                assert found == (True, threads)
                assert torch.get_num_threads() == 2
                assert not torch.is_inference_mode_enabled()
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
