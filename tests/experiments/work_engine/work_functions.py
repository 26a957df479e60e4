"""Functions that worker processes import."""

import os
import signal
import threading
import time
from pathlib import Path

from pd_editor.base.errors import MapFileError


def square(number: int) -> int:
    return number * number


def square_of_odd(number: int) -> int:
    if number % 2 == 0:
        raise ValueError(f"{number} is even")
    return number * number


def fails_for_the_user(number: int) -> int:
    raise MapFileError("The map has no lanes.")


def dies_on_three(number: int) -> int:
    if number == 3:
        os._exit(1)
    return number


def cannot_travel_back(number: int) -> object:
    return threading.Lock() if number else number


def process_id(number: int) -> int:
    time.sleep(0.2)
    return os.getpid()


def working_folder(number: int) -> str:
    return os.getcwd()


def threads(number: int) -> tuple[str, int]:
    import torch

    return os.environ["OMP_NUM_THREADS"], torch.get_num_threads()


def sleep(seconds: float) -> None:
    time.sleep(seconds)


def kills_its_first_worker(place: tuple[Path, int]) -> int:
    """The first call of number 3 kills its process; later calls give the number."""
    folder, number = place
    mark = folder / "killed"
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number
