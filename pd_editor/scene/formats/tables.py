"""Plain tables of a scene, for statistics: tracks, lanes and areas as CSV and Parquet."""

import io
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from pd_editor.scene.formats.scene_format import SceneFormat, WrittenScene, losses_of
from pd_editor.scene.scenario import Scenario

_SIDES: Final = (("center", "centerline"), ("left", "left"), ("right", "right"))
_KEEPS: Final = frozenset(
    {"signal names", "shared signals", "oncoming", "lane kinds", "junctions"}
    | {"heights", "paved", "now", "static kinds", "made up"}
)


def write(scenario: Scenario) -> WrittenScene:
    """``tracks`` has a row for each agent and step, the others one for each point.

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
    lanes = [(one, side) for one in scenario.road_map.lanes for side in _SIDES]
    areas = scenario.road_map.drivable_areas
    tables = {
        "tracks": tracks,
        "lanes": _points(
            scenario,
            [getattr(lane, field) for lane, (_, field) in lanes],
            lane=[lane.lane_id for lane, _ in lanes],
            line=[name for _, (name, _) in lanes],
            kind=[lane.kind.value for lane, _ in lanes],
            is_intersection=[lane.is_intersection for lane, _ in lanes],
            num_successors=[len(lane.successors) for lane, _ in lanes],
        ),
        "areas": _points(
            scenario,
            [area.boundary for area in areas],
            area=[area.area_id for area in areas],
        ),
    }
    files = [_both(name, columns) for name, columns in tables.items()]
    return WrittenScene(
        files={name: data for one in files for name, data in one.items()},
        losses=losses_of(scenario, keeps=_KEEPS),
    )


def _points(
    scenario: Scenario, lines: Sequence[np.ndarray], **about: list[Any]
) -> dict[str, np.ndarray]:
    """A row for each point of lines, with what is told of each line."""
    counts = np.array([len(line) for line in lines], int)
    points = np.concatenate([np.zeros((0, 3)), *lines])
    x, y = (points[:, :2] + scenario.origin_city_m).T
    columns = {name: np.repeat(values, counts) for name, values in about.items()}
    return {**columns, "x_m": x, "y_m": y, "z_m": points[:, 2]}


def _both(name: str, columns: dict[str, Any]) -> dict[str, bytes]:
    """A table in both forms."""
    table = pa.table(columns)
    text, binary = io.BytesIO(), io.BytesIO()
    pa_csv.write_csv(table, text)
    pq.write_table(table, binary)
    return {f"{name}.csv": text.getvalue(), f"{name}.parquet": binary.getvalue()}


TABLES: Final = SceneFormat(name="tables", title="Tables (CSV, Parquet)", write=write)
