"""ScenarioNet (MetaDrive) scenario descriptions: recordings of Waymo, nuPlan, nuScenes."""

import pickle
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import FormatError
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, AgentKind
from pd_editor.scene.formats.file_scene import (
    NO_HEADINGS,
    FileScene,
    FileTrack,
    usual_now_s,
)
from pd_editor.scene.formats.file_signal import FileSignal
from pd_editor.scene.formats.packed_file import ending_of, stem_of
from pd_editor.scene.formats.plain_pickle import read_plain_pickle
from pd_editor.scene.formats.recorded_map import (
    KINDS,
    TYPES,
    CenterLane,
    ego_losses,
    ego_of,
    lane_numbers,
    lights_of,
    made_of,
    map_of,
    numbers_of,
    points_of,
    read_as,
)
from pd_editor.scene.formats.scene_format import (
    SceneFormat,
    WrittenScene,
    losses_of,
)
from pd_editor.scene.geometry.polyline import at_height_zero
from pd_editor.scene.road_map import LaneKind, LaneMark, RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.time_axis import TimeAxis

DATASET: Final = "pd-editor"
VERSION: Final = "1.0"
_FINER_KINDS: Final = {"motorcycle": AgentKind.MOTORCYCLIST, "bus": AgentKind.BUS}
"""Parts of the names that data sets give to kinds."""
_LANE_KINDS: Final = {"LANE_BIKE_LANE": LaneKind.BIKE, "LANE_BUS_LANE": LaneKind.BUS}
_LANE_TYPES: Final = {LaneKind.BIKE: "LANE_BIKE_LANE"}
"""Types of lanes; others are ``LANE_SURFACE_STREET``."""
_LINES: Final = {
    LaneMark.SOLID_WHITE: "ROAD_LINE_SOLID_SINGLE_WHITE",
    LaneMark.DASHED_WHITE: "ROAD_LINE_BROKEN_SINGLE_WHITE",
    LaneMark.DOUBLE_SOLID_WHITE: "ROAD_LINE_SOLID_DOUBLE_WHITE",
    LaneMark.SOLID_YELLOW: "ROAD_LINE_SOLID_SINGLE_YELLOW",
    LaneMark.DASHED_YELLOW: "ROAD_LINE_BROKEN_SINGLE_YELLOW",
    LaneMark.DOUBLE_SOLID_YELLOW: "ROAD_LINE_SOLID_DOUBLE_YELLOW",
}
_OWN_KINDS: Final = {one.value: one for one in AgentKind}
_KEEPS: Final = frozenset(
    {"signals", "links", "neighbors", "lane kinds", "junctions", "marks", "crosswalks"}
    | {"paved", "city", "now", "focal", "static kinds"}
)
_SUMMARIES: Final = frozenset({"dataset_summary.pkl", "dataset_mapping.pkl"})


def read(path: Path) -> Scenario:
    """Read a scenario description: tracks with sizes, lanes, crosswalks, signals.

    Lanes get boundaries at the width that the map tells, else 3.5 m apart.

    Raises:
        FormatError: the file is damaged, or names something that would be called.
    """
    found, data = read_plain_pickle(path)
    found = found if isinstance(found, dict) else {}
    tables = {"dynamic_map_states": found.get("dynamic_map_states") or {}}
    tables |= {one: found.get(one) for one in ("metadata", "tracks", "map_features")}
    wrong = [name for name, one in tables.items() if not isinstance(one, dict)]
    if wrong:
        raise FormatError(
            f"{path}: is no scenario description; expected dicts: {', '.join(wrong)}."
        )
    with read_as(path, "scenario description"):
        scene = _scene(path, found)
    return scene.scenario(data)


def _scene(path: Path, found: Mapping[str, Any]) -> FileScene:
    about, features = found["metadata"], found["map_features"]
    time_s = made_of(path, "metadata", _times_s, "ts", found)
    tracks = [
        track
        for name, one in found["tracks"].items()
        if (track := made_of(path, "track", _track, str(name), one, time_s))
    ]
    made = [
        made_of(path, "map feature", _feature, str(key), one)
        for key, one in features.items()
    ]
    lanes = [one for one in made if isinstance(one, CenterLane)]
    areas = ((n, *one) for n, one in enumerate(made, 10**6) if isinstance(one, tuple))
    numbers = lane_numbers(lanes)
    states = found.get("dynamic_map_states") or {}
    signals = [
        made_of(path, "signal", _signal, str(key), one, numbers, time_s)
        for key, one in states.items()
    ]
    now = made_of(path, "metadata", _now, "current_time_index", about)
    # Whole recordings name no current step, or the first one, which is so in files made here.
    is_named = now > 0 or about.get("dataset") == DATASET
    usual_s = usual_now_s(float(time_s[0]), float(time_s[-1]))
    asked = made_of(path, "metadata", _asked, "tracks_to_predict", about)
    no_heading = any(
        one["state"].get("heading") is None for one in found["tracks"].values()
    )
    return FileScene(
        path=path,
        name=str(found.get("id") or stem_of(path)),
        **map_of(path, lanes, areas),
        tracks=tuple(tracks),
        signals=tuple(signals),
        current_s=float(time_s[now]) if is_named and now < len(time_s) else usual_s,
        ego_id=str(about.get("sdc_id", "")),
        focal_id=asked,
        city=str(about.get("map") or about.get("dataset") or ""),
        notes=(*(NO_HEADINGS,) * no_heading, *_beside_notes(features)),
        attribution=_attribution(about),
    )


def _attribution(about: Mapping[str, Any]) -> str:
    """Who recorded it; exports only pass on what their source told."""
    if about.get("dataset") == DATASET:
        return str(about.get("attribution") or "")
    source = " ".join(str(about.get(name, "")) for name in ("dataset", "map")).strip()
    return f"Recorded by {source}, under its own licence." if source else ""


def _beside_notes(features: Mapping[str, Any]) -> Iterator[str]:
    number = sum(
        len(one.get(side) or ()) > 1 and isinstance(one[side][0], dict)
        for one in features.values()
        for side in ("left_neighbor", "right_neighbor")
    )
    if number:
        yield f"Lanes have several neighbours on {number} sides, of which the longest is kept."


def _now(name: str, about: Mapping[str, Any]) -> int:
    return int(about.get(name) or 0)


def _asked(name: str, about: Mapping[str, Any]) -> str:
    first = next(iter(about.get(name) or ()), "")
    return str(first.get("track_id", "") if isinstance(first, dict) else first)


def _times_s(name: str, found: Mapping[str, Any]) -> np.ndarray:
    about = found["metadata"]
    if about.get(name) is None:
        return TimeAxis().step_s * np.arange(int(found["length"]))
    return numbers_of(about, name, 0)


def _track(name: str, found: Mapping[str, Any], time_s: np.ndarray) -> FileTrack | None:
    """A track where it is valid; None if it never is."""
    state = found["state"]
    number = len(time_s)
    position = numbers_of(state, "position", 0, 2)[:, :2]
    if len(position) != number:
        raise FormatError(
            f"its track {name[:40]!r} has {len(position)} positions; expected {number}, "
            "one for each time."
        )
    is_valid = numbers_of(state, "valid", number) > 0
    is_valid &= np.isfinite(position).all(axis=1)
    if not is_valid.any():
        return None
    sizes = [
        float(np.median(numbers_of(state, side, number)[is_valid]))
        if state.get(side) is not None
        else 0.0
        for side in ("length", "width")
    ]
    told = (
        numbers_of(state, "heading", number)[is_valid]
        if state.get("heading") is not None
        else np.full(is_valid.sum(), np.nan)
    )
    about = found.get("metadata") or {}
    finer = str(about.get("type", "")).lower()
    kind = next(
        (kind for part, kind in _FINER_KINDS.items() if part in finer),
        KINDS.get(str(found["type"]), AgentKind.UNKNOWN),
    )
    if about.get("dataset") == DATASET:
        kind = _OWN_KINDS.get(str(about.get("original_type")), kind)
    if kind in (AgentKind.VEHICLE, AgentKind.BUS):
        # That of nuScenes's own car is the other way round.
        sizes.sort(reverse=True)
    return FileTrack(
        track_id=name,
        kind=kind,
        size_m=(sizes[0], sizes[1]) if min(sizes) > 0 else None,
        time_s=time_s[is_valid],
        position_m=position[is_valid],
        heading_rad=told,
        velocity_mps=numbers_of(state, "velocity", number, 2)[is_valid, :2]
        if state.get("velocity") is not None
        else None,
        longest_gap_s=1.5 * float(np.median(np.diff(time_s))) if number > 1 else 0.0,
    )


def _signal(
    key: str, found: Mapping[str, Any], numbers: Mapping[str, int], time_s: np.ndarray
) -> FileSignal:
    number = numbers.get(str(found.get("lane", key)))
    place = found.get("stop_point")
    stop = None if place is None else np.array(place, float).ravel()[:2]
    return FileSignal(
        signal_id=key,
        stop_m={} if number is None else {number: stop},
        begins_s=time_s.tolist(),
        words=list(found["state"]["object_state"]),
        holds_s=float(np.diff(time_s).max(initial=0.0)),
    )


def _feature(
    key: str, found: Mapping[str, Any]
) -> CenterLane | tuple[str, np.ndarray] | None:
    """A lane, or an area with its kind; None is neither."""
    kind = str(found["type"])
    if kind in ("CROSSWALK", "DRIVEWAY"):
        return kind, points_of(found, "polygon")
    return _lane(key, found) if kind.startswith("LANE_") else None


def _lane(key: str, found: Mapping[str, Any]) -> CenterLane:
    line = points_of(found, "polyline")
    half = None
    if found.get("width") is not None:
        table = numbers_of(found, "width", 0, 2)[:, :2]
        middle = [
            np.median(side[side > 0]) if (side > 0).any() else 0 for side in table.T
        ]
        half = (float(middle[0]), float(middle[1])) if min(middle) > 0 else None
    exits = found.get("exit_lanes")
    return CenterLane(
        key=key,
        line=line,
        kind=_LANE_KINDS.get(str(found["type"]), LaneKind.VEHICLE),
        half_width_m=half,
        polygon=points_of(found, "polygon")
        if found.get("polygon") is not None
        else None,
        successors=None if exits is None else [str(one) for one in exits],
        is_intersection=bool(found.get("interpolating")),
        left_neighbor=_neighbor(found.get("left_neighbor"), -1),
        right_neighbor=_neighbor(found.get("right_neighbor"), 0),
    )


def _neighbor(found: Any, row: int) -> str | None:
    """The longest of those that Waymo has along a lane, the next of all of MetaDrive's."""
    found = found or [""]
    if not isinstance(found[0], dict):
        return str(found[row]) or None
    beside = max(found, key=_length_of_neighbor)
    return str(beside["feature_id"]) or None


def _length_of_neighbor(found: Mapping[str, Any]) -> int:
    """Along how many of a lane's points it has a neighbour."""
    first, last = (found.get(f"self_{one}_index") for one in ("start", "end"))
    return int(last or 0) - int(first or 0)


def _recognises(path: Path) -> bool:
    return ending_of(path) == ".pkl" and path.name not in _SUMMARIES


def write(scenario: Scenario) -> WrittenScene:
    """Files of a ScenarioNet data set of one scene, with its summary and mapping.

    The ego, or without one the focal agent, is the car that drives itself, with whose first
    step the file begins: replays begin with it. Coordinates are those of the city.

    Raises:
        ExportError: there is neither of them at the current step.
    """
    ego = ego_of(scenario)
    first = int(scenario.agents.is_valid[scenario.agents.row_of[ego]].argmax())
    scenario = _since(scenario, first) if first else scenario
    agents, axis = scenario.agents, scenario.time_axis
    place = agents.position_m + scenario.origin_city_m
    tracks = {
        name: _written_track(scenario, row, name, place[row])
        for row, name in enumerate(agents.ids)
    }
    about = _about(scenario, ego, tracks)
    name = f"sd_{DATASET}_{VERSION}_{scenario.scenario_id}.pkl"
    content = {
        "id": scenario.scenario_id,
        "version": VERSION,
        "length": axis.num_steps,
        "metadata": about,
        "tracks": tracks,
        "dynamic_map_states": {
            str(lane): _light(str(lane), place, words)
            for lane, place, words in lights_of(scenario)
        },
        "map_features": _map_features(scenario),
    }
    files = {
        name: content,
        "dataset_summary.pkl": {name: about},
        "dataset_mapping.pkl": {name: ""},
    }
    return WrittenScene(
        files={name: pickle.dumps(one, protocol=4) for name, one in files.items()},
        losses=losses_of(
            scenario,
            "Kinds: buses are vehicles, motorcyclists cyclists, bus lanes those of streets; "
            "only this editor reads the others.",
            "Boundaries of lanes: a lane has its polygon and half widths; drivable areas "
            "and markings, but for those of two kinds in one, are lines of no lane.",
            *ego_losses(ego),
            *(
                f"The first {n} steps, when the ego is not there."
                for n in (first,)
                if n
            ),
            keeps=_KEEPS,
        ),
        renamed={ego: EGO_ID},
    )


def _about(
    scenario: Scenario, ego: str, tracks: Mapping[str, dict[str, Any]]
) -> dict[str, Any]:
    """What a ScenarioNet description and the summary of its data set tell of a scene."""
    agents, axis, focal = scenario.agents, scenario.time_axis, scenario.focal_id
    return {
        "id": scenario.scenario_id,
        "scenario_id": scenario.scenario_id,
        "dataset": DATASET,
        "attribution": scenario.provenance.attribution or "",
        "map": scenario.city,
        "coordinate": "right-handed",
        "metadrive_processed": False,
        "sample_rate": axis.step_s,
        "ts": axis.step_s * np.arange(axis.num_steps),
        "sdc_id": ego,
        "current_time_index": axis.current_step,
        "tracks_to_predict": (
            {focal: {"track_id": focal, "track_index": agents.row_of[focal]}}
            if focal in agents.row_of
            else {}
        ),
        "object_summary": {name: _summary(one) for name, one in tracks.items()},
        "number_summary": {
            "num_objects": len(agents),
            "object_types": sorted({one["type"] for one in tracks.values()}),
        },
    }


def _since(scenario: Scenario, first: int) -> Scenario:
    """A scenario from a step on, without agents that are only there before."""
    agents, axis = scenario.agents.cut_to(slice(first, None)), scenario.time_axis
    num_steps, now = axis.num_steps - first, axis.current_step - first
    return replace(
        scenario,
        agents=agents.taken(np.flatnonzero(agents.is_valid.any(axis=1))),
        time_axis=replace(axis, num_steps=num_steps, current_step=now),
        signals=tuple(
            replace(one, states=one.states[first:]) for one in scenario.signals
        ),
    )


def _light(
    lane: str, stop_m: Float[np.ndarray, "2"], words: list[str]
) -> dict[str, Any]:
    about = {"type": "TRAFFIC_LIGHT", "object_id": lane, "dataset": DATASET}
    return {
        "type": about["type"],
        "state": {"object_state": [f"LANE_STATE_{one.upper()}" for one in words]},
        "lane": lane,
        "stop_point": np.append(stop_m, 0.0),
        "metadata": about | {"track_length": len(words)},
    }


def _written_track(
    scenario: Scenario, row: int, name: str, place: Float[np.ndarray, "T 2"]
) -> dict[str, Any]:
    agents = scenario.agents
    there, count = agents.is_valid[row], agents.num_steps
    kind = TYPES.get(agents.kinds[row], "OTHER")
    length, width = agents.size_m[row]
    return {
        "type": kind,
        "state": {
            "position": np.column_stack([place * there[:, None], np.zeros(count)]),
            "heading": agents.heading_rad[row] * there,
            "velocity": agents.velocity_mps[row] * there[:, None],
            "valid": there.copy(),
            "length": np.full(count, length),
            "width": np.full(count, width),
            "height": np.full(count, DEFAULT_HEIGHT_M[agents.kinds[row]]),
        },
        "metadata": {
            "track_length": count,
            "type": kind,
            "object_id": name,
            "dataset": DATASET,
            "original_type": str(agents.kinds[row].value),
        },
    }


def _summary(track: dict[str, Any]) -> dict[str, Any]:
    state = track["state"]
    there = state["valid"]
    place = state["position"][there][:, :2]
    way = float(np.linalg.norm(np.diff(place, axis=0), axis=1).sum())
    return {
        "type": track["type"],
        "object_id": track["metadata"]["object_id"],
        "track_length": len(there),
        "moving_distance": way,
        "valid_length": int(there.sum()),
        "continuous_valid_length": int(there.sum()),
    }


def _map_features(scenario: Scenario) -> dict[str, dict[str, Any]]:
    origin, road_map = scenario.origin_city_m, scenario.road_map
    found = {str(n): _lane_feature(road_map, n, origin) for n in road_map.lane_of}
    for lane in road_map.lanes:
        for side, mark, line in (
            ("left", lane.left_mark, lane.left_m),
            ("right", lane.right_mark, lane.right_m),
        ):
            if mark in _LINES:
                found[f"{lane.lane_id}-{side}"] = {
                    "type": _LINES[mark],
                    "polyline": at_height_zero(line + origin),
                }
    for walk in road_map.crosswalks:
        found[f"crosswalk-{walk.crosswalk_id}"] = {
            "type": "CROSSWALK",
            "polygon": at_height_zero(walk.outline_m() + origin),
        }
    for area in road_map.drivable_areas:
        ring = area.boundary[:, :2] + origin
        found[f"edge-{area.area_id}"] = {
            "type": "ROAD_EDGE_BOUNDARY",
            "polyline": at_height_zero(np.concatenate([ring, ring[:1]])),
        }
    return found


def _lane_feature(
    road_map: RoadMap, number: int, origin: Float[np.ndarray, "2"]
) -> dict[str, Any]:
    lane = road_map.lane_of[number]
    line = lane.centerline_m
    sides = [
        np.linalg.norm(line[:, None] - side[None], axis=-1).min(axis=1)
        for side in (_fine(lane.left_m), _fine(lane.right_m))
    ]
    return {
        "type": _LANE_TYPES.get(lane.kind, "LANE_SURFACE_STREET"),
        "polyline": at_height_zero(line + origin),
        "polygon": lane.outline_m() + origin,
        "width": np.stack(sides, axis=-1),
        "interpolating": lane.is_intersection,
        "entry_lanes": [str(one) for one in lane.predecessors],
        "exit_lanes": [str(one) for one in lane.successors],
        "left_neighbor": _neighbors(road_map, number, lane.left_neighbor),
        "right_neighbor": _neighbors(road_map, number, lane.right_neighbor),
    }


def _neighbors(
    road_map: RoadMap, number: int, beside: int | None
) -> list[dict[str, str]]:
    """That beside a lane if it leads the same way; Waymo has no others."""
    is_one = beside is not None and (number, beside) not in road_map.oncoming
    return [{"feature_id": str(beside)}] if is_one else []


def _fine(line: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "M 2"]:
    """Points at most a few centimetres of offset from the line's nearest point."""
    share = np.linspace(0.0, 1.0, 20, endpoint=False)[:, None, None]
    parts = line[None, :-1] + share * (line[None, 1:] - line[None, :-1])
    return np.concatenate([parts.reshape(-1, 2), line[-1:]])


SCENARIONET: Final = SceneFormat(
    name="scenarionet",
    title="ScenarioNet",
    endings=(".pkl",),
    recognises=_recognises,
    read=read,
    write=write,
)
