"""Writer of the two files of an Argoverse 2 scenario folder."""

# Not in every environment: av2 has no build for Python 3.13.
# pyright: reportMissingImports=false

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pd_editor.base.errors import ExportError
from pd_editor.scene.agent_kind import Activity, AgentCategory
from pd_editor.scene.av2_io.file_names import (
    MAP_PREFIX,
    TRACKS_PREFIX,
    is_scenario_id,
    map_name,
    tracks_name,
)
from pd_editor.scene.av2_io.map_file import map_bytes
from pd_editor.scene.av2_io.tracks_file import ACTIVITY_NAMES, default_current_step
from pd_editor.scene.geometry.angles import wrap_outside
from pd_editor.scene.scenario import Scenario


def scenario_files(scenario: Scenario) -> dict[str, bytes]:
    """Names and contents of a scenario's files: tracks (parquet), then map (JSON).

    Raises:
        ExportError: no agent exists at any step, or the id cannot be a file's name.
    """
    if not scenario.agents.is_valid.any():
        raise ExportError(
            "A scenario without agents cannot be written as Argoverse 2 files; "
            "place at least one."
        )
    scenario_id = scenario.scenario_id
    if not is_scenario_id(scenario_id):
        raise ExportError(
            f"The scenario id {scenario_id[:60]!r} cannot be part of a file's name."
        )
    try:
        map_json = map_bytes(
            scenario.road_map, scenario.origin_city_m, scenario.signals
        )
    except RecursionError as error:
        raise ExportError(
            f"Scenario {scenario_id}: a field of its map is nested too deeply to write."
        ) from error
    return {
        tracks_name(scenario_id): tracks_bytes(scenario),
        map_name(scenario_id): map_json,
    }


def tracks_bytes(scenario: Scenario) -> bytes:
    """Write a scenario's tracks as a parquet file's bytes."""
    agents, axis = scenario.agents, scenario.time_axis
    row, step = np.nonzero(agents.is_valid)
    position = agents.position_m[row, step] + scenario.origin_city_m
    velocity = agents.velocity_mps[row, step]
    observed = agents.observed[row, step]
    kinds = _texts([kind.value for kind in agents.kinds])
    columns: dict[str, pa.Array] = {
        "observed": _values(observed),
        "track_id": _texts(agents.ids).take(_values(row)),
        "object_type": kinds.take(_values(row)),
        "object_category": _values(np.array(agents.categories, np.int64)[row]),
        "timestep": _values(step.astype(np.int64)),
        "position_x": _values(position[:, 0]),
        "position_y": _values(position[:, 1]),
        "heading": _values(wrap_outside(agents.heading_rad[row, step])),
        "velocity_x": _values(velocity[:, 0]),
        "velocity_y": _values(velocity[:, 1]),
    }
    same: dict[str, Any] = {
        "scenario_id": scenario.scenario_id,
        "start_timestamp": axis.start_timestamp_ns,
        "end_timestamp": axis.end_timestamp_ns,
        "num_timestamps": axis.num_steps,
        "focal_track_id": scenario.focal_id,
        "city": scenario.city,
    }
    if default_current_step(step, observed, axis.step_s) != axis.current_step:
        same["current_step"] = axis.current_step
    for name, value in {**same, **scenario.source_fields, **same}.items():
        if isinstance(value, str):
            columns[name] = _texts([value]).take(_values(np.zeros_like(row)))
        else:
            columns[name] = _values(np.full(len(row), value))
    columns["length_m"] = _values(agents.size_m[row, 0])
    columns["width_m"] = _values(agents.size_m[row, 1])
    columns["has_known_size"] = _values(agents.has_known_size[row])
    if agents.activity.any():
        names = [ACTIVITY_NAMES[Activity(int(one))] for one in agents.activity]
        columns["activity"] = _texts(names).take(_values(row))
    if agents.has_made_up_past.any():
        is_made_up = agents.has_made_up_past[row] & (step < axis.current_step)
        columns["is_made_up"] = _values(is_made_up)
    sink = io.BytesIO()
    pq.write_table(pa.table(columns), sink)
    return sink.getvalue()


def _values(values: np.ndarray) -> pa.Array:
    """Array of numbers or booleans; ``pyarrow.array`` would import pandas."""
    if values.dtype == bool:
        return _values(values.view(np.uint8)).cast(pa.bool_())
    buffer = pa.py_buffer(np.ascontiguousarray(values))
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, len(values), [None, buffer])


def _texts(texts: Sequence[str]) -> pa.Array:
    encoded = [text.encode() for text in texts]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    buffers = [None, pa.py_buffer(ends), pa.py_buffer(b"".join(encoded))]
    return pa.Array.from_buffers(pa.string(), len(texts), buffers)


def check_with_official_loaders(folder: Path) -> frozenset[str]:
    """Load a scenario folder with the package ``av2``.

    Returns the ids of the tracks that have a state at the last observed step: loaders of
    predictors keep these.

    Raises:
        ExportError: the folder lacks a file, av2 refuses one, or there is not exactly
            one focal track, of category 3.
    """
    from av2.datasets.motion_forecasting.scenario_serialization import (
        load_argoverse_scenario_parquet,
    )
    from av2.map.map_api import ArgoverseStaticMap

    tracks = sorted(folder.glob(f"{TRACKS_PREFIX}*.parquet"))
    maps = sorted(folder.glob(f"{MAP_PREFIX}*.json"))
    if len(tracks) != 1 or len(maps) != 1:
        raise ExportError(
            f"{folder}: found {len(tracks)} track files and {len(maps)} maps; "
            "expected one of each."
        )
    try:
        scenario = load_argoverse_scenario_parquet(tracks[0])
        road_map = ArgoverseStaticMap.from_json(maps[0])
        num_lanes = len(road_map.get_scenario_lane_segments())
    # The loaders document no errors, so whatever they raise is their refusal.
    except Exception as error:
        raise ExportError(
            f"{folder}: av2's own loader refused it ({type(error).__name__}: {error})."
        ) from error
    if not scenario.tracks or not num_lanes:
        raise ExportError(f"{folder}: av2's own loader found no tracks or no lanes.")
    focal = [
        track.track_id
        for track in scenario.tracks
        if track.category.value == AgentCategory.FOCAL
    ]
    if focal != [scenario.focal_track_id]:
        raise ExportError(
            f"{folder}: focal_track_id is {scenario.focal_track_id!r}, and tracks of"
            f" category 3 are {', '.join(map(repr, focal)) or 'none'}; expected exactly"
            " one track of category 3, the focal one."
        )
    seen = {
        track.track_id: max(
            (one.timestep for one in track.object_states if one.observed), default=-1
        )
        for track in scenario.tracks
    }
    last = max(seen.values())
    return frozenset(name for name, step in seen.items() if step == last >= 0)
