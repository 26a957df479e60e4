"""Loaders and checkers that are not ours, each in an environment of its own.

``NAME.txt`` beside this module lists the packages of environment NAME, which is made once
in ``build/oracles/NAME``. A script of this folder runs in it: it reads a question as JSON
from standard input, and writes its answer as JSON.
"""

import hashlib
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock

HERE = Path(__file__).parent
BUILD = HERE.parents[1] / "build" / "oracles"
INSTALL_LIMIT_S = 600
ANSWER_LIMIT_S = 300


class NoOracleError(Exception):
    """The packages of an environment cannot be installed here."""


@dataclass(frozen=True)
class Oracle:
    """An environment that answers."""

    python: Path

    def ask(
        self, script: str, question: Any, *, limit_s: float = ANSWER_LIMIT_S
    ) -> Any:
        """The answer of a script of this folder, such as ``commonroad_pairs.py``."""
        done = subprocess.run(
            [self.python, "-I", HERE / script],
            input=json.dumps(question),
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-4000:]
        return json.loads(done.stdout)


def oracle(name: str) -> Oracle:
    """The environment of a name, which is made if need be.

    Raises:
        NoOracleError: it could not be made; the message says why.
    """
    listed = HERE / f"{name}.txt"
    made_of = hashlib.sha256(listed.read_bytes() + sys.version.encode()).hexdigest()
    folder = BUILD / name
    python, complete = folder / "bin" / "python", folder / "complete"
    BUILD.mkdir(parents=True, exist_ok=True)
    with FileLock(BUILD / f"{name}.lock"):
        if complete.is_file() and complete.read_text() == made_of and python.exists():
            return Oracle(python)
        _run([sys.executable, "-m", "venv", "--clear", str(folder)])
        pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check"]
        _run([*pip, "install", "--retries", "1", "-r", str(listed)])
        complete.write_text(made_of)
    return Oracle(python)


def _run(command: list[str]) -> None:
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=INSTALL_LIMIT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoOracleError(str(error)) from error
    if done.returncode:
        said = (done.stderr + done.stdout).strip().splitlines()
        errors = [line for line in said if line.startswith("ERROR")]
        raise NoOracleError((errors or said or ["no reason given"])[-1])
