"""The shell command, called in this process or in one of its own."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from pd_editor.cli.main import main

ROOT = Path(__file__).parents[2]
JUNCTION = "signalised-junction"


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        return self.out.splitlines()


class Shell:
    """Runs commands in this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def run(self, *arguments: object) -> Result:
        self._capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        captured = self._capsys.readouterr()
        return Result(code, captured.out, captured.err)

    def refused(self, *arguments: object) -> str:
        """The one sentence that a command answers to bad input."""
        result = self.run(*arguments)
        assert (result.code, result.out) == (2, ""), result
        assert result.err.startswith("pd-editor: "), result.err
        assert result.err.endswith(".\n") or result.err.endswith(".)\n"), result.err
        assert result.err.count("\n") == 1, result.err
        return result.err.removeprefix("pd-editor: ").strip()


def run_in_process(
    *arguments: str, cwd: Path | None = None, env: dict[str, str] | None = None
) -> Result:
    """A command in a Python process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "pd_editor", *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT), **(env or {})},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return Result(done.returncode, done.stdout, done.stderr)


def files_of(folder: Path) -> dict[str, bytes]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
