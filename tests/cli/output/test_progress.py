import io
import sys

import pytest

from pd_editor.cli.output.progress import run_showing_progress
from pd_editor.generation import GeneratedTraffic, GenerationProgress

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
