"""A scenario read, written and read again, compared with what av2 and pyarrow see."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from pd_editor.scene.av2_io.file_names import map_name, tracks_name
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files

POSITIONS = ("position_x", "position_y")
DTYPES = {"observed": bool, "timestep": int}
"""Columns that some official files hold as floats."""


@dataclass(frozen=True, kw_only=True)
class RoundTrip:
    """Differences between a scenario folder and its copy."""

    differing_columns: tuple[str, ...]
    """Track columns other than positions that are not equal in every row."""
    differing_map_fields: tuple[str, ...]
    """Map fields other than coordinates that are not equal."""
    position_error_m: float
    map_error_m: float
    num_rows: int
    num_lanes: int


def copy_scenario(folder: Path, out: Path) -> Path:
    """Read a folder and write it below ``out``."""
    scenario = read_scenario(folder)
    target = out / scenario.scenario_id
    write_files(scenario_files(scenario), target, forbidden=folder)
    return target


def compare(folder: Path, copy: Path) -> RoundTrip:
    """Compare the files themselves, without the code under test."""
    scenario_id = folder.name
    one, two = (
        pq.read_table(place / tracks_name(scenario_id)) for place in (folder, copy)
    )
    differing, position_error = [], 0.0
    for name in one.column_names:
        a, b = (np.array(table[name].to_pylist()) for table in (one, two))
        if name in POSITIONS:
            position_error = max(position_error, float(np.abs(a - b).max()))
        elif not np.array_equal(a.astype(DTYPES.get(name, a.dtype)), b):
            differing.append(name)
    maps = [
        json.loads((place / map_name(scenario_id)).read_bytes())
        for place in (folder, copy)
    ]
    plain, points = zip(*(_split(archive) for archive in maps), strict=True)
    fields = sorted({*plain[0], *plain[1]})
    return RoundTrip(
        differing_columns=tuple(differing),
        differing_map_fields=tuple(
            name for name in fields if plain[0].get(name) != plain[1].get(name)
        ),
        position_error_m=position_error,
        map_error_m=float(np.abs(np.subtract(*points)).max()),
        num_rows=one.num_rows,
        num_lanes=len(maps[0]["lane_segments"]),
    )


def _split(archive: dict[str, Any]) -> tuple[dict[str, Any], np.ndarray]:
    """Values by path, with coordinates told apart."""
    plain: dict[str, Any] = {}
    points: list[tuple[str, float]] = []

    def visit(path: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():
                visit(f"{path}/{key}", inner)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            plain[f"{path}/length"] = len(value)
            for index, inner in enumerate(value):
                visit(f"{path}/{index:06d}", inner)
        elif path[-2:] in ("/x", "/y", "/z"):
            points.append((path, value))
        else:
            plain[path] = value

    visit("", archive)
    return plain, np.array([value for _, value in sorted(points)])
