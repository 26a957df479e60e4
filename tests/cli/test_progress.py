import io
import sys

import pytest

from pd_editor.cli.output import run_showing_progress, work_shown
from pd_editor.experiments.work_engine.work_engine import WorkProgress
from pd_editor.scene.generation import GeneratedTraffic, GenerationProgress

DONE = GeneratedTraffic(samples=(), generator="fake")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def steps():
    for fraction in (0.0, 0.5):
        yield GenerationProgress(fraction=fraction, message="Sample 1 of 1")
    return DONE


def test_a_terminal_sees_one_line_that_is_wiped(monkeypatch: pytest.MonkeyPatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert run_showing_progress(steps()) is DONE
    shown = [line.rstrip() for line in terminal.getvalue().split("\r")]
    assert shown == ["", "  0 % Sample 1 of 1", " 50 % Sample 1 of 1", "", ""]
    assert "\n" not in terminal.getvalue()


def test_a_file_sees_nothing(monkeypatch: pytest.MonkeyPatch):
    log = io.StringIO()
    monkeypatch.setattr(sys, "stderr", log)
    assert run_showing_progress(steps()) is DONE
    assert log.getvalue() == ""


def test_a_line_is_written_only_when_it_is_news(monkeypatch: pytest.MonkeyPatch):
    """While nothing finished, the same line was written four times a second."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    show = work_shown("scenes")
    for done in (0, 0, 1, 1, 2, 2):
        show(WorkProgress(num_done=done, num_failed=0, num_items=2))
    shown = [line.split(",")[0].rstrip(" ") for line in terminal.getvalue().split("\r")]
    assert shown == ["", "0 of 2 scenes", "1 of 2 scenes", "2 of 2 scenes"]
    assert terminal.getvalue().endswith("\n")
