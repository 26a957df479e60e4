"""The environment that CommonRoad's collision checker lives in, made once and kept."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
REQUIREMENTS = HERE / "requirements.txt"
INSTALL_LIMIT_S = 300
ANSWER_LIMIT_S = 120

Boxes = list[list[float]]


class NoEnvironmentError(Exception):
    """The packages cannot be installed here."""


def commonroad_python(cache: Path) -> Path:
    """Interpreter of the environment under ``cache``, which is made if need be.

    Raises:
        NoEnvironmentError: it could not be made; the message says why.
    """
    made_of = REQUIREMENTS.read_bytes() + sys.version.encode()
    folder = cache / hashlib.sha256(made_of).hexdigest()[:12]
    python, complete = folder / "bin" / "python", folder / "complete"
    if complete.is_file() and python.exists():
        return python
    _run([sys.executable, "-m", "venv", "--clear", str(folder)])
    pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check"]
    _run([*pip, "install", "--retries", "1", "-r", str(REQUIREMENTS)])
    complete.touch()
    return python


def pairs_by_commonroad(
    python: Path, scenes: list[list[Boxes]]
) -> list[list[list[list[int]]]]:
    """Colliding pairs per scene and step, as ``colliding_pairs.py`` says them."""
    done = subprocess.run(
        [python, "-I", HERE / "colliding_pairs.py"],
        input=json.dumps(scenes),
        capture_output=True,
        text=True,
        timeout=ANSWER_LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


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
        raise NoEnvironmentError(str(error)) from error
    if done.returncode:
        said = (done.stderr + done.stdout).strip().splitlines()
        errors = [line for line in said if line.startswith("ERROR")]
        raise NoEnvironmentError((errors or said or ["no reason given"])[-1])
