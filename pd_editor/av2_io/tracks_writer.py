"""Writer of Argoverse 2 motion forecasting tracks (parquet).

Files have additional columns that ``av2`` ignores: ``length_m``, ``width_m`` and
``has_known_size`` always, ``activity`` where that of any agent is known,
``is_made_up`` where any past is, and ``current_step`` where it does not follow from the
rows.
"""

import io
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pd_editor.av2_io.tracks_file import ACTIVITY_NAMES, default_current_step
from pd_editor.scene.activity import Activity
from pd_editor.scene.scenario import Scenario


def tracks_bytes(scenario: Scenario) -> bytes:
    """Write a scenario's tracks as a parquet file's bytes."""
    agents, axis = scenario.agents, scenario.time_axis
    row, step = np.nonzero(agents.is_valid)
    position = agents.position_m[row, step] + scenario.origin_city_m
    velocity = agents.velocity_mps[row, step]
    observed = agents.observed[row, step]
    kinds = pa.array([kind.value for kind in agents.kinds], pa.string())
    columns: dict[str, pa.Array] = {
        "observed": pa.array(observed),
        "track_id": pa.array(agents.ids, pa.string()).take(pa.array(row)),
        "object_type": kinds.take(pa.array(row)),
        "object_category": pa.array(np.array(agents.categories, np.int64)[row]),
        "timestep": pa.array(step.astype(np.int64)),
        "position_x": pa.array(position[:, 0]),
        "position_y": pa.array(position[:, 1]),
        "heading": pa.array(agents.heading_rad[row, step]),
        "velocity_x": pa.array(velocity[:, 0]),
        "velocity_y": pa.array(velocity[:, 1]),
    }
    same: dict[str, pa.Scalar] = {
        "scenario_id": pa.scalar(scenario.scenario_id),
        "start_timestamp": _source_scalar(axis.start_timestamp_ns),
        "end_timestamp": _source_scalar(axis.end_timestamp_ns),
        "num_timestamps": pa.scalar(axis.num_steps, pa.int64()),
        "focal_track_id": pa.scalar(scenario.focal_id),
        "city": pa.scalar(scenario.city),
    }
    if default_current_step(step, observed, axis.step_s) != axis.current_step:
        same["current_step"] = pa.scalar(axis.current_step, pa.int64())
    for name, value in scenario.source_fields.items():
        same.setdefault(name, _source_scalar(value))
    columns |= {name: pa.repeat(value, len(row)) for name, value in same.items()}
    columns["length_m"] = pa.array(agents.size_m[row, 0])
    columns["width_m"] = pa.array(agents.size_m[row, 1])
    columns["has_known_size"] = pa.array(agents.has_known_size[row])
    if agents.activity.any():
        names = [ACTIVITY_NAMES[Activity(int(one))] for one in agents.activity]
        columns["activity"] = pa.array(names, pa.string()).take(pa.array(row))
    if agents.has_made_up_past.any():
        is_made_up = agents.has_made_up_past[row] & (step < axis.current_step)
        columns["is_made_up"] = pa.array(is_made_up)
    sink = io.BytesIO()
    pq.write_table(pa.table(columns), sink)
    return sink.getvalue()


def _source_scalar(value: Any) -> pa.Scalar:
    if isinstance(value, int) and value >= 2**63:
        return pa.scalar(value, pa.uint64())
    return pa.scalar(value)
