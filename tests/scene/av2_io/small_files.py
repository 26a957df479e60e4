"""Files of a tiny scenario, and ways to spoil them."""

import io
import json
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pd_editor.scene.av2_io.map_file import map_bytes
from pd_editor.scene.av2_io.write import tracks_bytes
from tests.builders import two_agents_that_collide

SCENARIO = two_agents_that_collide()
TRACKS = tracks_bytes(SCENARIO)
MAP = map_bytes(SCENARIO.road_map, SCENARIO.origin_city_m)
OFFICIAL_COLUMNS = (
    "observed",
    "track_id",
    "object_type",
    "object_category",
    "timestep",
    "position_x",
    "position_y",
    "heading",
    "velocity_x",
    "velocity_y",
    "scenario_id",
    "start_timestamp",
    "end_timestamp",
    "num_timestamps",
    "focal_track_id",
    "city",
)


def parquet(table: pa.Table) -> bytes:
    sink = io.BytesIO()
    pq.write_table(table, sink)
    return sink.getvalue()


def table(data: bytes = TRACKS) -> pa.Table:
    return pq.read_table(pa.BufferReader(data))


def with_column(name: str, values: Any, source: bytes = TRACKS) -> bytes:
    """The track file with a column replaced or added."""
    old = table(source)
    column = values if isinstance(values, pa.Array) else pa.array(values)
    if name in old.column_names:
        return parquet(old.set_column(old.column_names.index(name), name, column))
    return parquet(old.append_column(name, column))


def with_cell(name: str, row: int, value: Any) -> bytes:
    """The track file with one cell changed."""
    values = table()[name].to_pylist()
    values[row] = value
    return with_column(name, values)


def without_column(name: str) -> bytes:
    return parquet(table().drop_columns([name]))


def rows(indices: Any) -> bytes:
    """The track file with only some rows, or some of them twice."""
    return parquet(table().take(pa.array(np.asarray(indices, np.int64))))


def changed_map(change: Any) -> bytes:
    """The map after a change of its parsed JSON in place."""
    archive = json.loads(MAP)
    change(archive)
    return json.dumps(archive).encode()
