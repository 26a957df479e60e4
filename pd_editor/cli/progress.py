"""Progress of long work, shown where somebody watches."""

import sys
import time
from collections.abc import Callable, Generator
from typing import Final

from pd_editor.generation import GeneratedTraffic, GenerationProgress
from pd_editor.work_engine.work_engine import WorkProgress

_SECONDS_BETWEEN_LINES: Final = 30.0


def run_showing_progress(
    steps: Generator[GenerationProgress, None, GeneratedTraffic],
) -> GeneratedTraffic:
    """The result of a generation; a terminal sees one line that is written over."""
    is_watched = sys.stderr.isatty()
    try:
        while True:
            progress = next(steps)
            if is_watched:
                line = f"{100 * progress.fraction:3.0f} % {progress.message}"
                sys.stderr.write(f"\r{line:<78}")
                sys.stderr.flush()
    except StopIteration as stop:
        return stop.value
    finally:
        if is_watched:
            sys.stderr.write("\r" + " " * 78 + "\r")


def progress_shown(noun: str) -> Callable[[WorkProgress], None]:
    """Progress on stderr: one line that is written over, or one now and then."""
    began = time.monotonic()
    is_watched, last = sys.stderr.isatty(), began

    def show(progress: WorkProgress) -> None:
        nonlocal last
        now = time.monotonic()
        is_over = progress.num_done == progress.num_items
        if not is_watched and now - last < _SECONDS_BETWEEN_LINES:
            return
        last = now
        line = progress_line(progress, now - began, noun)
        if is_watched:
            sys.stderr.write(f"\r{line:<78}" + ("\n" if is_over else ""))
        else:
            sys.stderr.write(f"{line}\n")
        sys.stderr.flush()

    return show


def progress_line(progress: WorkProgress, elapsed_s: float, noun: str) -> str:
    """How far a run is and how long it will still take."""
    done, num = progress.num_done, progress.num_items
    words = f"{done} of {num} {noun}"
    if progress.num_failed:
        words += f", {progress.num_failed} failed"
    if 0 < done < num:
        left = round(elapsed_s / done * (num - done))
        words += f", {left // 60}:{left % 60:02d} left"
    return words
