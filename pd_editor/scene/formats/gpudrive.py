"""GPUDrive (Nocturne) scenes: JSON files of the Waymo Open Motion Dataset."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import FormatError
from pd_editor.base.plain_text import csv_file
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, AgentKind
from pd_editor.scene.formats.file_scene import (
    NO_HEADINGS,
    FileScene,
    FileTrack,
    states_at,
)
from pd_editor.scene.formats.file_signal import ON_GRID_S, FileSignal
from pd_editor.scene.formats.packed_file import (
    ending_of,
    head_of,
    read_unpacked,
    stem_of,
)
from pd_editor.scene.formats.recorded_map import (
    KINDS,
    TYPES,
    CenterLane,
    distinct_points,
    ego_losses,
    ego_of,
    lane_numbers,
    lights_of,
    made_of,
    map_of,
    read_as,
)
from pd_editor.scene.formats.scene_format import (
    IDS_NAME,
    SceneFormat,
    WrittenScene,
    losses_of,
)
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.time_axis import TimeAxis

WAYMO_STEPS: Final = 91
WAYMO_CURRENT_STEP: Final = 10
"""Waymo's motion prediction: 1.1 s are observed, 8 s follow."""
UNKNOWN_M: Final = -10_000.0
"""Waymo's place of agents that are not there."""
_ELEMENTS: Final = {"lane": 2, "road_line": 6, "road_edge": 15, "crosswalk": 18}
"""Waymo's numbers of the types of map elements."""
_LOSSES: Final = (
    "Steps: all but 10 before the current one and 80 after it.",
    "Kinds of agents: vehicles, pedestrians, cyclists and others.",
    "Boundaries of lanes; drivable areas are edges of the road.",
    "Ids: objects are numbered; ids.csv has both.",
)
_KEEPS: Final = frozenset(
    {"signals", "oncoming", "crosswalks", "paved", "city", "now", "focal"}
)


class _Asked(msgspec.Struct):
    track_index: int


class _About(msgspec.Struct):
    sdc_track_index: int | None = None
    tracks_to_predict: list[_Asked] | None = None
    city: str = "waymo"
    attribution: str = (
        "Recorded by the Waymo Open Motion Dataset, under its own licence."
    )
    """Exports tell who recorded them, and where; other files are Waymo's."""


class _Point(msgspec.Struct):
    x: float | None
    y: float | None


_Place = _Point | list[float | None]


class _Object(msgspec.Struct):
    type: str
    position: list[_Place]
    valid: list[bool | int]
    length: float | list[float | None] | None = None
    width: float | list[float | None] | None = None
    heading: list[float | None] | None = None
    velocity: list[_Place] | None = None
    id: Any = None


class _Road(msgspec.Struct):
    type: str
    geometry: list[_Place] | _Point | None
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
    tl_states: dict[str, _Light] | list[_Light] | None = None
    """Lists, as makers of maps write, are empty: nobody knows whose lights these are."""
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
        (row, one.type.lower(), distinct_points(_table(one.geometry)))
        for row, one in enumerate(found.roads)
        if isinstance(one.geometry, list)
    ]
    asked, told = about.tracks_to_predict, about.sdc_track_index
    number = max((len(one.position) for one in objects), default=0)
    row_of = {_name(row, one): str(row) for row, one in enumerate(found.roads)}
    lanes = [
        CenterLane(key=str(row), line=line)
        for row, kind, line in roads
        if kind == "lane"
    ]
    areas = ((10**6 + row, kind, line) for row, kind, line in roads)
    numbers = lane_numbers(lanes)
    states = found.tl_states if isinstance(found.tl_states, dict) else {}
    signals = [
        _signal(key, one, numbers.get(row_of.get(key, "")), step_s)
        for key, one in states.items()
    ]
    return FileScene(
        path=path,
        name=str(found.scenario_id or stem_of(path)),
        **map_of(path, lanes, areas),
        tracks=tuple(one for one in tracks if one is not None),
        signals=tuple(signals),
        current_s=step_s * min(WAYMO_CURRENT_STEP, max(number - 2, 0)),
        ego_id=_id_of(objects, -1 if told is None else told),
        focal_id=_id_of(objects, asked[0].track_index if asked else -1),
        city=about.city,
        notes=(NO_HEADINGS,) * any(one.heading is None for one in objects),
        attribution=about.attribution,
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
        kind=KINDS.get(one.type.upper(), AgentKind.UNKNOWN),
        size_m=(length, width) if min(length, width) > 0 else None,
        time_s=step_s * np.flatnonzero(is_valid),
        position_m=position[is_valid],
        heading_rad=told * turn,
        velocity_mps=_table(one.velocity)[is_valid] if one.velocity else None,
        longest_gap_s=1.5 * step_s,
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


def _table(points: Sequence[_Place]) -> Float[np.ndarray, "N 2"]:
    pairs = [one[:2] if isinstance(one, list) else (one.x, one.y) for one in points]
    return np.array(pairs, float).reshape(-1, 2)


def _recognises(path: Path) -> bool:
    if ending_of(path) != ".json":
        return False
    head = head_of(path)
    return b'"objects"' in head or b'"roads"' in head


def write(scenario: Scenario) -> WrittenScene:
    """File of a GPUDrive scene: Waymo's 91 steps around the current one.

    Coordinates are those of the city.

    Raises:
        ExportError: there is neither ego nor focal agent at the current step.
    """
    ego = ego_of(scenario)
    scenario, known = _at_waymos_steps(scenario)
    agents = scenario.agents
    rows = np.flatnonzero(agents.is_valid.any(axis=1)).tolist()
    place = agents.position_m + scenario.origin_city_m
    objects = [
        _object(scenario, row, number, place[row]) for number, row in enumerate(rows)
    ]
    index, focal = {agents.ids[row]: n for n, row in enumerate(rows)}, scenario.focal_id
    rank = {lane: number for number, lane in enumerate(scenario.road_map.lane_of)}
    content = {
        "name": f"{scenario.scenario_id}.json",
        "scenario_id": scenario.scenario_id,
        "objects": objects,
        "roads": _roads(scenario),
        "tl_states": {
            str(rank[lane]): {
                "state": [words[step] for step in known],
                "x": [float(stop[0])] * len(known),
                "y": [float(stop[1])] * len(known),
                "z": [0.0] * len(known),
                "time_index": known,
            }
            for lane, stop, words in lights_of(scenario)
        },
        "metadata": {
            "city": scenario.city,
            "attribution": scenario.provenance.attribution or "",
            "sdc_track_index": index[ego],
            "objects_of_interest": [],
            "tracks_to_predict": (
                [{"track_index": index[focal], "difficulty": 0}]
                if focal in index
                else []
            ),
        },
    }
    return WrittenScene(
        files={
            f"{scenario.scenario_id}.json": msgspec.json.encode(content),
            IDS_NAME: csv_file([("agent", "object"), *index.items()]),
        },
        losses=losses_of(scenario, *_LOSSES, *ego_losses(ego), keeps=_KEEPS),
        renamed={name: str(row) for name, row in index.items()} | {ego: EGO_ID},
    )


def _at_waymos_steps(scenario: Scenario) -> tuple[Scenario, list[int]]:
    """The scene at Waymo's steps, and which of these it has; between its own it is mixed."""
    agents, axis = scenario.agents, scenario.time_axis
    new = TimeAxis(num_steps=WAYMO_STEPS, current_step=WAYMO_CURRENT_STEP)
    at = axis.current_step + new.times_s() / axis.step_s + ON_GRID_S
    known = (at >= 0) & (at < axis.num_steps)
    column = np.clip(at, 0, axis.num_steps - 1).astype(int)
    found = [
        states_at(
            FileTrack(
                track_id=name,
                kind=agents.kinds[row],
                size_m=None,
                time_s=axis.times_s()[there],
                position_m=agents.position_m[row, there],
                heading_rad=agents.heading_rad[row, there],
                velocity_mps=agents.velocity_mps[row, there],
                longest_gap_s=1.5 * axis.step_s,
            ),
            new.times_s(),
        )
        for row, name in enumerate(agents.ids)
        if (there := agents.is_valid[row]).any()
    ]
    rows = np.flatnonzero(agents.is_valid.any(axis=1))
    position, heading, velocity, is_valid = map(np.stack, zip(*found, strict=True))
    agents = replace(
        agents.taken(rows),
        position_m=position,
        heading_rad=heading,
        velocity_mps=velocity,
        is_valid=is_valid,
        observed=is_valid & new.is_past,
    )
    signals = tuple(replace(one, states=one.states[column]) for one in scenario.signals)
    sampled = replace(scenario, agents=agents, time_axis=new, signals=signals)
    return sampled, np.flatnonzero(known).tolist()


def _object(
    scenario: Scenario, row: int, number: int, place: Float[np.ndarray, "T 2"]
) -> dict[str, Any]:
    """An agent, which may not be there at some steps."""
    agents = scenario.agents
    there = agents.is_valid[row]
    x, y = place[np.flatnonzero(there)[-1]].tolist()
    kind = TYPES.get(agents.kinds[row], "other").lower()
    heading = np.where(there, agents.heading_rad[row], UNKNOWN_M)
    return {
        "position": _points(place, there),
        "width": float(agents.size_m[row, 1]),
        "length": float(agents.size_m[row, 0]),
        "height": DEFAULT_HEIGHT_M[agents.kinds[row]],
        "heading": heading.tolist(),
        "velocity": _points(agents.velocity_mps[row], there, False),
        "valid": there.tolist(),
        "goalPosition": {"x": x, "y": y, "z": 0.0},
        "type": kind if kind in ("vehicle", "pedestrian", "cyclist") else "other",
        "id": number,
        "mark_as_expert": False,
    }


def _roads(scenario: Scenario) -> list[dict[str, Any]]:
    origin, road_map = scenario.origin_city_m, scenario.road_map
    lines = [("lane", lane.centerline_m) for lane in road_map.lanes]
    lines += [("crosswalk", walk.outline_m()) for walk in road_map.crosswalks]
    for area in road_map.drivable_areas:
        ring = area.boundary[:, :2]
        lines.append(("road_edge", np.concatenate([ring, ring[:1]])))
    everywhere = np.ones(max(len(line) for _, line in lines), bool)
    return [
        {
            "geometry": _points(line + origin, everywhere[: len(line)]),
            "type": kind,
            "map_element_id": _ELEMENTS[kind],
            "id": number,
        }
        for number, (kind, line) in enumerate(lines)
    ]


def _points(
    table: Float[np.ndarray, "N 2"], there: np.ndarray, has_height: bool = True
) -> list[dict[str, float]]:
    known = np.where(there[:, None], table, UNKNOWN_M).tolist()
    more = {"z": 0.0} if has_height else {}
    return [{"x": x, "y": y, **more} for x, y in known]


GPUDRIVE: Final = SceneFormat(
    name="gpudrive",
    title="GPUDrive",
    endings=(".json",),
    recognises=_recognises,
    read=read,
    write=write,
)
