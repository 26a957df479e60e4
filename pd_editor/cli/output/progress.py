"""Progress display on stderr."""

import sys
import time
from collections.abc import Callable, Generator
from functools import cache
from typing import Final

from pd_editor.experiments.work_engine.work_engine import WorkProgress, progress_line
from pd_editor.scene.generation import GenerationProgress, Made, run_to_end

_SECONDS_BETWEEN_LINES: Final = 30.0
_WIDTH: Final = 78


class ProgressLine:
    """One line that a terminal writes over; elsewhere a line every 30 seconds."""

    def __init__(self) -> None:
        """Begin; the first line elsewhere comes after 30 seconds."""
        self.began = self._last = time.monotonic()
        self._written = ""
        self.is_watched = sys.stderr.isatty()

    def show(self, line: str, *, is_over: bool = False) -> None:
        """Write how far the work is, if that is news; ``is_over`` ends a terminal's line."""
        now = time.monotonic()
        if line == self._written:
            return
        if self.is_watched:
            sys.stderr.write(f"\r{line:<{_WIDTH}}" + "\n" * is_over)
            self._written = line
        elif now - self._last >= _SECONDS_BETWEEN_LINES:
            sys.stderr.write(f"{line}\n")
            self._last, self._written = now, line
        sys.stderr.flush()

    def clear(self) -> None:
        """Remove the line from a terminal."""
        if self.is_watched:
            sys.stderr.write("\r" + " " * _WIDTH + "\r")


def preparation_shown() -> Callable[[WorkProgress], None]:
    """A function that shows the progress of the preparation of scenes."""
    line = ProgressLine()

    def show(progress: WorkProgress) -> None:
        done, num = progress.num_done, progress.num_items
        line.show(f"Preparing scenes: {done} of {num} parts", is_over=done == num)

    return show


def run_showing_progress(
    steps: Generator[GenerationProgress, None, Made], name: str = ""
) -> Made:
    """Run a generation and show how far it is, or what has been made of a name."""

    def told(progress: GenerationProgress) -> str:
        before = f"{name}:" if name else f"{100 * progress.fraction:3.0f} %"
        return f"{before} {progress.message}"

    line = ProgressLine()
    try:
        return run_to_end(steps, lambda progress: line.show(told(progress)))
    finally:
        line.clear()


def work_shown(noun: str) -> Callable[[WorkProgress], None]:
    """Display of progress of work on many items."""
    line = ProgressLine()

    # Also called while nothing is done, when the rate of what is done would only age.
    @cache
    def text_of(progress: WorkProgress) -> str:
        return progress_line(progress, time.monotonic() - line.began, noun)

    def show(progress: WorkProgress) -> None:
        is_over = progress.num_done == progress.num_items
        line.show(text_of(progress), is_over=is_over)

    return show
