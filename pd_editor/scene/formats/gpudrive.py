"""GPUDrive (Nocturne) scenes: JSON files of the Waymo Open Motion Dataset."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import FormatError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.file_scene import NO_HEADINGS, FileScene, FileTrack
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
    distinct_points,
    lane_numbers,
    lanes_of,
    made_of,
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


class _Asked(msgspec.Struct):
    track_index: int


class _About(msgspec.Struct):
    sdc_track_index: int | None = None
    tracks_to_predict: list[_Asked] | None = None


class _Point(msgspec.Struct):
    x: float | None
    y: float | None


class _Object(msgspec.Struct):
    type: str
    position: list[_Point]
    valid: list[bool | int]
    length: float | list[float | None]
    width: float | list[float | None]
    heading: list[float | None] | None = None
    velocity: list[_Point] | None = None
    id: Any = None


class _Road(msgspec.Struct):
    type: str
    geometry: list[_Point]
    id: Any = None


class _Light(msgspec.Struct):
    state: list[Any]
    time_index: list[float]
    x: list[float | None]
    y: list[float | None]


class _File(msgspec.Struct):
    """What is used of a file; the rest of it may be anything."""

    objects: list[_Object]
    roads: list[_Road]
    metadata: _About | None = None
    tl_states: dict[str, _Light] | None = None
    scenario_id: Any = None


def read(path: Path) -> Scenario:
    """Read a scene: tracks with sizes, lanes as centre lines, crosswalks, signals.

    Lanes lead on where they end, and their boundaries are 3.5 m apart, since the file
    tells neither. The current step is the last that Waymo observes.

    Raises:
        FormatError: the file is damaged, or of something else.
    """
    content, data = read_unpacked(path)
    with read_as(path, "GPUDrive scene"):
        scene = _scene(path, _decoded(path, content))
    return scene.scenario(data)


def _scene(path: Path, found: _File) -> FileScene:
    objects, about = found.objects, found.metadata or _About()
    step_s = TimeAxis().step_s
    # Nocturne, and GPUDrive at first, tell degrees.
    is_in_degrees = any(
        there and abs(told or 0.0) > 2.5 * np.pi
        for one in objects
        for there, told in zip(one.valid, one.heading or (), strict=False)
    )
    turn = np.pi / 180 if is_in_degrees else 1.0
    tracks = [
        made_of(path, "object", _track, row, one, step_s, turn)
        for row, one in enumerate(objects)
    ]
    roads = [
        (row, one.type, distinct_points(_table(one.geometry)))
        for row, one in enumerate(found.roads)
    ]
    asked, told = about.tracks_to_predict, about.sdc_track_index
    number = max((len(one.position) for one in objects), default=0)
    row_of = {_name(row, one): str(row) for row, one in enumerate(found.roads)}
    lanes = [
        CenterLane(key=str(row), line=line)
        for row, kind, line in roads
        if kind == "lane"
    ]
    numbers = lane_numbers(lanes)
    states = found.tl_states or {}
    signals = [
        _signal(key, one, numbers.get(row_of.get(key, "")), step_s)
        for key, one in states.items()
    ]
    areas = [one for one in roads if len(one[2]) > 2]
    return FileScene(
        path=path,
        name=str(found.scenario_id or stem_of(path)),
        lanes=made_of(path, "map", lanes_of, lanes),
        crosswalks=crosswalks_of(
            (10**6 + row, line) for row, kind, line in areas if kind == "crosswalk"
        ),
        more_paved=[valid_area(line) for _, kind, line in areas if kind == "driveway"],
        tracks=tuple(one for one in tracks if one is not None),
        signals=tuple(signals),
        current_s=step_s * min(WAYMO_CURRENT_STEP, max(number - 2, 0)),
        ego_id=_id_of(objects, -1 if told is None else told),
        focal_id=_id_of(objects, asked[0].track_index if asked else -1),
        city="waymo",
        notes=(NO_HEADINGS,) * any(one.heading is None for one in objects),
        attribution="Recorded by the Waymo Open Motion Dataset, under its own licence.",
    )


def _decoded(path: Path, data: bytes) -> _File:
    """A JSON value, in which numbers may be NaN, as Python writes what is unknown."""
    try:
        try:
            return msgspec.json.decode(data, type=_File)
        except msgspec.ValidationError:
            raise
        except msgspec.DecodeError:
            return msgspec.convert(json.loads(data), _File)
    except msgspec.ValidationError as error:
        raise FormatError(f"{path}: is no valid GPUDrive scene: {error}.") from error
    except json.JSONDecodeError as error:
        raise FormatError(f"{path}: is no valid JSON ({error}).") from error
    except (UnicodeDecodeError, RecursionError) as error:
        raise FormatError(
            f"{path}: is no valid JSON; expected a text in UTF-8, not nested deeply."
        ) from error


def _id_of(objects: Sequence[_Object], row: int) -> str:
    return _name(row, objects[row]) if 0 <= row < len(objects) else ""


def _name(row: int, one: _Object | _Road) -> str:
    return str(row if one.id is None else one.id)


def _track(row: int, one: _Object, step_s: float, turn: float) -> FileTrack | None:
    """A track where it is valid; None if it never is. Headings are in turns of radians."""
    position = _table(one.position)
    for field in ("valid", "heading", "velocity"):
        values = getattr(one, field)
        if values is not None and len(values) != len(position):
            raise FormatError(
                f"its object {_name(row, one)[:40]!r} has {len(values)} values of "
                f"{field!r}; expected {len(position)}, one for each position."
            )
    is_valid = np.array(one.valid, bool) & np.isfinite(position).all(axis=1)
    if not is_valid.any():
        return None
    told = np.array(one.heading or [None] * len(position), float)[is_valid]
    length, width = (
        float(np.median(np.array(side, float))) for side in (one.length, one.width)
    )
    return FileTrack(
        track_id=_name(row, one),
        kind=_KINDS.get(one.type, AgentKind.UNKNOWN),
        size_m=(length, width) if min(length, width) > 0 else None,
        time_s=step_s * np.flatnonzero(is_valid),
        position_m=position[is_valid],
        heading_rad=told * turn,
        velocity_mps=_table(one.velocity)[is_valid] if one.velocity else None,
    )


def _signal(key: str, found: _Light, lane: int | None, step_s: float) -> FileSignal:
    """The signal of a lane; its states tell at which steps they are."""
    stop = np.array([(found.x or [None])[0], (found.y or [None])[0]], float)
    return FileSignal(
        signal_id=key,
        stop_m={} if lane is None else {lane: stop},
        begins_s=[step_s * one for one in found.time_index],
        words=found.state,
        holds_s=step_s,
    )


def _table(points: Sequence[_Point]) -> Float[np.ndarray, "N 2"]:
    return np.array([(one.x, one.y) for one in points], float).reshape(-1, 2)


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
