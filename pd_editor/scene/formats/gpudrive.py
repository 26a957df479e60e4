"""GPUDrive (Nocturne) scenes: JSON files of the Waymo Open Motion Dataset."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.file_scene import (
    NO_HEADINGS,
    FileScene,
    FileTrack,
)
from pd_editor.scene.formats.file_signal import FileSignal
from pd_editor.scene.formats.packed_file import (
    ending_of,
    head_of,
    read_unpacked,
    stem_of,
)
from pd_editor.scene.formats.recorded_map import (
    CenterLane,
    crosswalks_of,
    lane_numbers,
    lanes_of,
    made_of,
    points_of,
    read_as,
)
from pd_editor.scene.formats.recording_writers import WAYMO_CURRENT_STEP, gpudrive_files
from pd_editor.scene.formats.scene_format import SceneFormat
from pd_editor.scene.geometry.paved_area import valid_area
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis

_KINDS: Final = {
    "vehicle": AgentKind.VEHICLE,
    "pedestrian": AgentKind.PEDESTRIAN,
    "cyclist": AgentKind.CYCLIST,
}


def read(path: Path) -> Scenario:
    """Read a scene: tracks with sizes, lanes as centre lines, crosswalks, signals.

    Lanes lead on where they end, and their boundaries are 3.5 m apart, since the file
    tells neither. The current step is the last that Waymo observes.

    Raises:
        FormatError: the file is damaged, or of something else.
    """
    content, data = read_unpacked(path)
    with read_as(path, "GPUDrive scene"):
        scene = _scene(path, _decoded(content))
    return scene.scenario(data)


def _scene(path: Path, found: Mapping[str, Any]) -> FileScene:
    objects, about = found["objects"], found.get("metadata") or {}
    step_s = TimeAxis().step_s
    tracks = (
        made_of(path, "object", _track, row, one, step_s)
        for row, one in enumerate(objects)
    )
    roads = [
        (row, *made_of(path, "road", _road, row, one))
        for row, one in enumerate(found["roads"])
    ]
    asked = [int(one["track_index"]) for one in about.get("tracks_to_predict") or ()]
    told = about.get("sdc_track_index")
    number = max((len(one["position"]) for one in objects), default=0)
    row_of = {
        str(one.get("id", row)): str(row) for row, one in enumerate(found["roads"])
    }
    lanes = [
        CenterLane(key=str(row), line=line)
        for row, kind, line in roads
        if kind == "lane"
    ]
    numbers = lane_numbers(lanes)
    states = found.get("tl_states") or {}
    signals = [
        made_of(
            path, "signal", _signal, key, one, numbers.get(row_of.get(key, "")), step_s
        )
        for key, one in states.items()
    ]
    areas = [one for one in roads if len(one[2]) > 2]
    return FileScene(
        path=path,
        name=str(found.get("scenario_id") or stem_of(path)),
        lanes=made_of(path, "map", lanes_of, lanes),
        crosswalks=crosswalks_of(
            (10**6 + row, line) for row, kind, line in areas if kind == "crosswalk"
        ),
        more_paved=[valid_area(line) for _, kind, line in areas if kind == "driveway"],
        tracks=tuple(one for one in tracks if one is not None),
        signals=tuple(signals),
        current_s=step_s * min(WAYMO_CURRENT_STEP, max(number - 2, 0)),
        ego_id=_id_of(objects, -1 if told is None else int(told)),
        focal_id=_id_of(objects, asked[0] if asked else -1),
        city="waymo",
        notes=(NO_HEADINGS,) * any("heading" not in one for one in objects),
        attribution="Recorded by the Waymo Open Motion Dataset, under its own licence.",
    )


def _decoded(data: bytes) -> Any:
    """A JSON value, in which numbers may be NaN, as Python writes what is unknown."""
    try:
        return msgspec.json.decode(data)
    except msgspec.DecodeError:
        return json.loads(data)


def _id_of(objects: list[Mapping[str, Any]], row: int) -> str:
    return _name(row, objects[row]) if 0 <= row < len(objects) else ""


def _name(row: int, one: Mapping[str, Any]) -> str:
    return str(one.get("id", row))


def _track(row: int, one: Mapping[str, Any], step_s: float) -> FileTrack | None:
    """A track where it is valid; None if it never is."""
    position = _table(one["position"])
    is_valid = np.array(one["valid"], bool) & np.isfinite(position).all(axis=1)
    if not is_valid.any():
        return None
    told = np.array(one.get("heading", [np.nan] * len(position)), float)[is_valid]
    time_s = step_s * np.flatnonzero(is_valid)
    size = float(np.median(one["length"])), float(np.median(one["width"]))
    return FileTrack(
        track_id=_name(row, one),
        kind=_KINDS.get(str(one["type"]), AgentKind.UNKNOWN),
        size_m=size if min(size) > 0 else None,
        time_s=time_s,
        position_m=position[is_valid],
        heading_rad=told,
        velocity_mps=_table(one["velocity"])[is_valid] if "velocity" in one else None,
    )


def _signal(
    key: str, found: Mapping[str, Any], lane: int | None, step_s: float
) -> FileSignal:
    """The signal of a lane; its states tell at which steps they are."""
    stop = np.array([(found["x"] or [np.nan])[0], (found["y"] or [np.nan])[0]], float)
    return FileSignal(
        signal_id=key,
        stop_m={} if lane is None else {lane: stop},
        begins_s=[step_s * float(one) for one in found["time_index"]],
        words=list(found["state"]),
        holds_s=step_s,
    )


def _table(points: list[Mapping[str, float]]) -> np.ndarray:
    return np.array([(one["x"], one["y"]) for one in points], float).reshape(-1, 2)


def _road(row: int, one: Mapping[str, Any]) -> tuple[str, np.ndarray]:
    del row
    return str(one["type"]), points_of(_table(one["geometry"]))


def _recognises(path: Path) -> bool:
    if ending_of(path) != ".json":
        return False
    head = head_of(path)
    return b'"objects"' in head or b'"roads"' in head


GPUDRIVE: Final = SceneFormat(
    name="gpudrive",
    title="GPUDrive",
    endings=(".json",),
    recognises=_recognises,
    read=read,
    write=gpudrive_files,
)
