"""Progress of a generation, shown where somebody watches."""

import sys
from collections.abc import Generator

from pd_editor.generation import GeneratedTraffic, GenerationProgress


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
