"""SUMO's command line tools, run with a time limit, and its speed limits in curves."""

import shutil
import subprocess
import sysconfig
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import SynthesisError
from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.geometry.polyline import (
    arc_length,
    point_at,
    resample,
    without_repeats,
)

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


LATERAL_MPS2: Final = 2.5
"""Lateral acceleration at a curve's speed limit."""

REACH: Final = 3
"""Length of road, in metres, over which curvature is measured."""

LEAST_SPEED_MPS: Final = 2.5


def curve_speed_mps(
    shape_m: Float[np.ndarray, "N 2"], lateral_mps2: float = LATERAL_MPS2
) -> float:
    """Speed at which the sharpest bend of a line asks for a lateral acceleration."""
    line = without_repeats(shape_m, 0.05)
    if len(line) < 3:
        return np.inf
    length = float(arc_length(line)[-1])
    line = resample(line, max(int(np.ceil(length)), 2) + 1)
    heading = heading_of(np.diff(line, axis=0))
    reach = min(REACH, len(heading) - 1)
    turn = np.abs(wrap_angle(heading[reach:] - heading[:-reach]))
    curvature = float(turn.max()) / (reach * length / (len(line) - 1))
    return max(float(np.sqrt(lateral_mps2 / max(curvature, 1e-9))), LEAST_SPEED_MPS)


def write_with_curve_speeds(net_file: Path, copy: Path) -> None:
    """Write a copy of a SUMO network with speed limits in curves.

    Junction lanes are measured together with the ends of the lanes that they join.

    Raises:
        SynthesisError: the file is missing or no SUMO network.
    """
    try:
        tree = ElementTree.parse(net_file)
        _limit_speeds(tree.getroot())
    except (OSError, ElementTree.ParseError, KeyError, ValueError) as error:
        raise SynthesisError(
            f"{net_file} is not a readable SUMO network ({error})."
        ) from error
    tree.write(copy, encoding="utf-8")


def _limit_speeds(root: ElementTree.Element) -> None:
    lanes = {
        lane.attrib["id"]: lane
        for edge in root.iter("edge")
        if edge.get("function") not in ("crossing", "walkingarea")
        for lane in edge.iter("lane")
    }
    shapes = {name: _shape(lane) for name, lane in lanes.items()}
    before: dict[str, str] = {}
    after: dict[str, str] = {}
    for link in root.iter("connection"):
        start = f"{link.attrib['from']}_{link.attrib['fromLane']}"
        end = link.get("via", f"{link.attrib['to']}_{link.attrib['toLane']}")
        if start in lanes and end in lanes:
            before[end], after[start] = start, end
    for name, lane in lanes.items():
        shape = shapes[name]
        if name.startswith(":"):
            parts = [shape]
            if name in before:
                parts.insert(0, _near_end(shapes[before[name]][::-1])[::-1])
            if name in after:
                parts.append(_near_end(shapes[after[name]]))
            shape = np.concatenate(parts)
        speed = min(float(lane.attrib["speed"]), curve_speed_mps(shape))
        lane.set("speed", f"{speed:.2f}")


def _shape(lane: ElementTree.Element) -> Float[np.ndarray, "N 2"]:
    points = lane.attrib["shape"].split()
    return np.array([[float(v) for v in point.split(",")[:2]] for point in points])


def _near_end(shape_m: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "3 2"]:
    """First metres of a line."""
    return point_at(shape_m, np.linspace(0.0, REACH, 3))
