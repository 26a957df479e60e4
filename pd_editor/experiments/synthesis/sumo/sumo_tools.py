"""Finds SUMO's command line tools, and runs them with a time limit."""

import shutil
import subprocess
import sysconfig
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from pd_editor.base.errors import SynthesisError

TIME_LIMIT_S: Final = 60.0
"""Default time limit; a network takes well under a second."""
SIMULATION_LIMIT_S: Final = 900.0
"""Time limit of a simulation. Dense traffic takes up to half a minute of a core, which
many processes may share, and results must not depend on the load."""


def sumo_tool(name: str) -> Path:
    """Path of a SUMO tool, such as ``netconvert``.

    Raises:
        SynthesisError: SUMO is not installed.
    """
    folders = [Path(sysconfig.get_path("scripts"))]
    package = find_spec("sumo")
    if package is not None and package.submodule_search_locations:
        folders += [Path(path) / "bin" for path in package.submodule_search_locations]
    for folder in folders:
        found = shutil.which(name, path=str(folder))
        if found is not None:
            return Path(found)
    found = shutil.which(name)
    if found is None:
        raise SynthesisError(
            f"SUMO's {name} is not installed; "
            "expected it from pip install 'pd-editor[synth]'."
        )
    return Path(found)


def run_sumo_tool(
    name: str, arguments: list[str], folder: Path, *, limit_s: float | None = None
) -> None:
    """Run a SUMO tool in a folder, by default for a minute at most.

    Raises:
        SynthesisError: SUMO is not installed, the tool failed, or took too long.
    """
    command = [str(sumo_tool(name)), *arguments]
    limit_s = TIME_LIMIT_S if limit_s is None else limit_s
    try:
        result = subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise SynthesisError(
            f"{folder}: {name} did not finish within {limit_s:.0f} s."
        ) from error
    if result.returncode != 0:
        errors = [line for line in result.stderr.splitlines() if "Error" in line]
        reason = errors[0] if errors else f"exit status {result.returncode}"
        raise SynthesisError(f"{folder}: {name} refused the network ({reason}).")
