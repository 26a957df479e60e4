"""Plain tables of a scene, for statistics: tracks and lanes as CSV and Parquet."""

import io
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from pd_editor.scene.formats.scene_format import SceneFormat, WrittenScene, losses_of
from pd_editor.scene.scenario import Scenario


def write(scenario: Scenario) -> WrittenScene:
    """``tracks`` has a row for each agent and step, ``lanes`` one for each point.

    Coordinates are those of the city in metres, angles radians, times 0 at the current
    step.
    """
    agents, origin = scenario.agents, scenario.origin_city_m
    row, step = np.nonzero(agents.is_valid)
    x, y = (agents.position_m[row, step] + origin).T
    vx, vy = agents.velocity_mps[row, step].T
    ids, kinds = np.array(agents.ids, object), [one.value for one in agents.kinds]
    tracks = {
        "agent": ids[row],
        "kind": np.array(kinds, object)[row],
        "length_m": agents.size_m[row, 0],
        "width_m": agents.size_m[row, 1],
        "step": step,
        "time_s": np.round(scenario.time_axis.times_s()[step], 6),
        "x_m": x,
        "y_m": y,
        "heading_rad": agents.heading_rad[row, step],
        "vx_mps": vx,
        "vy_mps": vy,
        "is_made_up": agents.has_made_up_past[row] & (step < scenario.current_step),
    }
    lines = [
        (lane, side, line)
        for lane in scenario.road_map.lanes
        for side, line in (
            ("center", lane.centerline),
            ("left", lane.left),
            ("right", lane.right),
        )
    ]
    counts = [len(line) for _, _, line in lines]
    points = (
        np.concatenate([line for _, _, line in lines]) if lines else np.zeros((0, 3))
    )
    lanes = {
        "lane": np.repeat([lane.lane_id for lane, _, _ in lines], counts),
        "line": np.repeat([side for _, side, _ in lines], counts),
        "kind": np.repeat([lane.kind.value for lane, _, _ in lines], counts),
        "is_intersection": np.repeat(
            [one.is_intersection for one, _, _ in lines], counts
        ),
        "x_m": points[:, 0] + origin[0],
        "y_m": points[:, 1] + origin[1],
        "z_m": points[:, 2],
    }
    return WrittenScene(
        files={**_both("tracks", tracks), **_both("lanes", lanes)},
        losses=losses_of(
            scenario, "Links of lanes, crosswalks, drivable areas, and the focal agent."
        ),
    )


def _both(name: str, columns: dict[str, Any]) -> dict[str, bytes]:
    """A table in both forms."""
    table = pa.table(columns)
    text, binary = io.BytesIO(), io.BytesIO()
    pa_csv.write_csv(table, text)
    pq.write_table(table, binary)
    return {f"{name}.csv": text.getvalue(), f"{name}.parquet": binary.getvalue()}


def _recognises(path: Path) -> bool:
    del path
    return False


TABLES: Final = SceneFormat(
    name="tables",
    title="Tables (CSV, Parquet)",
    endings=(),
    recognises=_recognises,
    write=write,
)
