"""Writes scenes as ScenarioNet descriptions and as GPUDrive scenes."""

import pickle
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import msgspec
import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.base.errors import ExportError
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, AgentKind
from pd_editor.scene.formats.file_signal import WORDS
from pd_editor.scene.formats.scene_format import WrittenScene
from pd_editor.scene.geometry.polyline import at_height_zero
from pd_editor.scene.road_map import Lane, LaneKind, LaneMark
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.signals import SignalState

DATASET: Final = "pd-editor"
VERSION: Final = "1.0"
WAYMO_STEPS: Final = 91
WAYMO_CURRENT_STEP: Final = 10
"""Waymo's motion prediction: 1.1 s are observed, 8 s follow."""
UNKNOWN_M: Final = -10_000.0
"""Waymo's place of agents that are not there."""
_TYPES: Final = {
    AgentKind.VEHICLE: "VEHICLE",
    AgentKind.BUS: "VEHICLE",
    AgentKind.MOTORCYCLIST: "CYCLIST",
    AgentKind.CYCLIST: "CYCLIST",
    AgentKind.PEDESTRIAN: "PEDESTRIAN",
    AgentKind.CONSTRUCTION: "TRAFFIC_CONE",
    AgentKind.STATIC: "TRAFFIC_BARRIER",
}
_LANE_TYPES: Final = {
    LaneKind.VEHICLE: "LANE_SURFACE_STREET",
    LaneKind.BIKE: "LANE_BIKE_LANE",
    LaneKind.BUS: "LANE_SURFACE_STREET",
}
_LINES: Final = {
    LaneMark.SOLID_WHITE: "ROAD_LINE_SOLID_SINGLE_WHITE",
    LaneMark.DASHED_WHITE: "ROAD_LINE_BROKEN_SINGLE_WHITE",
    LaneMark.DOUBLE_SOLID_WHITE: "ROAD_LINE_SOLID_DOUBLE_WHITE",
    LaneMark.SOLID_YELLOW: "ROAD_LINE_SOLID_SINGLE_YELLOW",
    LaneMark.DASHED_YELLOW: "ROAD_LINE_BROKEN_SINGLE_YELLOW",
    LaneMark.DOUBLE_SOLID_YELLOW: "ROAD_LINE_SOLID_DOUBLE_YELLOW",
}
_ELEMENTS: Final = {"lane": 2, "road_line": 6, "road_edge": 15, "crosswalk": 18}
"""Waymo's numbers of the types of map elements."""


def scenarionet_files(scenario: Scenario) -> WrittenScene:
    """Files of a ScenarioNet data set of one scene, with its summary and mapping.

    The ego, or without one the focal agent, is the car that drives itself, with whose first
    step the file begins: replays begin with it. Coordinates are those of the city.

    Raises:
        ExportError: there is neither of them at the current step.
    """
    ego = _ego(scenario)
    first = int(scenario.agents.is_valid[scenario.agents.row_of[ego]].argmax())
    scenario = _since(scenario, first) if first else scenario
    agents, axis = scenario.agents, scenario.time_axis
    place = agents.position_m + scenario.origin_city_m
    tracks = {
        name: _track(scenario, row, name, place[row])
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
            for lane, place, words in _lights(scenario)
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
        losses=(
            "Kinds: buses are vehicles, motorcyclists are cyclists.",
            "Bus lanes are lanes of streets; markings of two kinds in one have none.",
            "Boundaries of lanes: a lane has its polygon and half widths.",
            "Benchmark categories and made-up pasts.",
            *(
                f"The first {n} steps, when the ego is not there."
                for n in (first,)
                if n
            ),
        ),
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


def gpudrive_files(scenario: Scenario) -> WrittenScene:
    """File of a GPUDrive scene: Waymo's 91 steps around the current one.

    Coordinates are those of the city.

    Raises:
        ExportError: there is neither ego nor focal agent at the current step.
    """
    agents, ego = scenario.agents, _ego(scenario)
    steps = scenario.current_step + np.arange(WAYMO_STEPS) - WAYMO_CURRENT_STEP
    known = (steps >= 0) & (steps < agents.num_steps)
    column = np.clip(steps, 0, agents.num_steps - 1)
    is_valid = agents.is_valid[:, column] & known
    rows = np.flatnonzero(is_valid.any(axis=1)).tolist()
    place = agents.position_m + scenario.origin_city_m
    objects = [
        _object(scenario, row, number, place[row], column, is_valid[row])
        for number, row in enumerate(rows)
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
                "state": [words[step] for step in column[known]],
                "x": [float(stop[0])] * int(known.sum()),
                "y": [float(stop[1])] * int(known.sum()),
                "z": [0.0] * int(known.sum()),
                "time_index": np.flatnonzero(known).tolist(),
            }
            for lane, stop, words in _lights(scenario)
        },
        "metadata": {
            "sdc_track_index": index[ego],
            "objects_of_interest": [],
            "tracks_to_predict": (
                [{"track_index": index[focal], "difficulty": 0}]
                if focal in index
                else []
            ),
        },
    }
    table = "".join(f"{name},{number}\n" for name, number in index.items())
    return WrittenScene(
        files={
            f"{scenario.scenario_id}.json": msgspec.json.encode(content),
            "ids.csv": f"agent,object\n{table}".encode(),
        },
        losses=(
            f"Steps: {WAYMO_CURRENT_STEP} before the current one and "
            f"{WAYMO_STEPS - WAYMO_CURRENT_STEP - 1} after it.",
            "Kinds: vehicles, pedestrians, cyclists and others.",
            "Links, neighbours, kinds and markings of lanes.",
            "Ids: objects are numbered; ids.csv has both.",
        ),
    )


def _object(
    scenario: Scenario,
    row: int,
    number: int,
    place: Float[np.ndarray, "T 2"],
    column: Int[np.ndarray, "S"],
    there: Bool[np.ndarray, "S"],
) -> dict[str, Any]:
    """An agent at some steps, at which it may not be there."""
    agents = scenario.agents
    x, y = place[column[np.flatnonzero(there)[-1]]].tolist()
    kind = _TYPES.get(agents.kinds[row], "other").lower()
    heading = np.where(there, agents.heading_rad[row, column], UNKNOWN_M)
    return {
        "position": _points(place[column], there),
        "width": float(agents.size_m[row, 1]),
        "length": float(agents.size_m[row, 0]),
        "height": DEFAULT_HEIGHT_M[agents.kinds[row]],
        "heading": heading.tolist(),
        "velocity": _points(agents.velocity_mps[row, column], there, False),
        "valid": there.tolist(),
        "goalPosition": {"x": x, "y": y, "z": 0.0},
        "type": kind if kind in ("vehicle", "pedestrian", "cyclist") else "other",
        "id": number,
        "mark_as_expert": False,
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


def _ego(scenario: Scenario) -> str:
    agents, now = scenario.agents, scenario.current_step
    for name in (EGO_ID, scenario.focal_id):
        if name in agents.row_of and agents.is_valid[agents.row_of[name], now]:
            return name
    raise ExportError(
        f"Scenario {scenario.scenario_id} has neither ego nor focal agent at the "
        "current step; the format needs one as the car that drives itself (place agents, "
        "or fill it by pd-editor generate --num-agents fit)."
    )


def _lights(
    scenario: Scenario,
) -> Iterator[tuple[int, Float[np.ndarray, "2"], list[str]]]:
    """Id, place of the stop line and Waymo's words of each lane that obeys a signal."""
    stops = iter(scenario.stop_lines_m()[:, 1] + scenario.origin_city_m)
    for signal in scenario.signals:
        words = [WORDS[SignalState(one)][0] for one in signal.states]
        for lane in signal.lane_ids:
            yield lane, next(stops), words


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


def _track(
    scenario: Scenario, row: int, name: str, place: Float[np.ndarray, "T 2"]
) -> dict[str, Any]:
    agents = scenario.agents
    there, count = agents.is_valid[row], agents.num_steps
    kind = _TYPES.get(agents.kinds[row], "OTHER")
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
    found = {str(lane.lane_id): _lane_feature(lane, origin) for lane in road_map.lanes}
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


def _lane_feature(lane: Lane, origin: Float[np.ndarray, "2"]) -> dict[str, Any]:
    line = lane.centerline_m
    sides = [
        np.linalg.norm(line[:, None] - side[None], axis=-1).min(axis=1)
        for side in (_fine(lane.left_m), _fine(lane.right_m))
    ]
    return {
        "type": _LANE_TYPES[lane.kind],
        "polyline": at_height_zero(line + origin),
        "polygon": lane.outline_m() + origin,
        "width": np.stack(sides, axis=-1),
        "interpolating": lane.is_intersection,
        "entry_lanes": [str(one) for one in lane.predecessors],
        "exit_lanes": [str(one) for one in lane.successors],
        "left_neighbor": _neighbor(lane.left_neighbor),
        "right_neighbor": _neighbor(lane.right_neighbor),
    }


def _neighbor(number: int | None) -> list[dict[str, str]]:
    return [] if number is None else [{"feature_id": str(number)}]


def _fine(line: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "M 2"]:
    """Points at most a few centimetres of offset from the line's nearest point."""
    share = np.linspace(0.0, 1.0, 20, endpoint=False)[:, None, None]
    parts = line[None, :-1] + share * (line[None, 1:] - line[None, :-1])
    return np.concatenate([parts.reshape(-1, 2), line[-1:]])


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
