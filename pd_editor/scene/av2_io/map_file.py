"""Reader and writer of Argoverse 2 vector maps (JSON)."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.base.plain_text import is_plain
from pd_editor.scene.av2_io.json_fields import JsonObject, parse_json_object
from pd_editor.scene.geometry.polyline import midline
from pd_editor.scene.road_map import (
    Crosswalk,
    DrivableArea,
    Lane,
    LaneKind,
    LaneMark,
    RoadMap,
)
from pd_editor.scene.scene_limits import (
    MAX_AREAS,
    MAX_CROSSWALKS,
    MAX_LANES,
    road_excess,
)
from pd_editor.scene.signals import Signal, SignalState

WRITTEN_DECIMALS: Final = 4
"""Coordinates are written to 0.1 mm; official files have 1 cm."""

_LANE_FIELDS: Final = frozenset(
    {
        "id",
        "is_intersection",
        "lane_type",
        "centerline",
        "left_lane_boundary",
        "right_lane_boundary",
        "left_lane_mark_type",
        "right_lane_mark_type",
        "left_neighbor_id",
        "right_neighbor_id",
        "predecessors",
        "successors",
    }
)
_CROSSWALK_FIELDS: Final = frozenset({"id", "edge1", "edge2"})
_AREA_FIELDS: Final = frozenset({"id", "area_boundary"})
_SIGNALS: Final = "pd_editor_signals"
_SECTIONS: Final = {
    "lane_segments": MAX_LANES,
    "pedestrian_crossings": MAX_CROSSWALKS,
    "drivable_areas": MAX_AREAS,
}
"""Sections of a map, and how many entries each may have."""


def read_map(
    data: bytes, file_name: str, origin_city_m: Float[np.ndarray, "2"]
) -> RoadMap:
    """Read a map from a JSON file's bytes into the scene frame with the given origin.

    Lanes without a centre line (maps of sensor logs) get the line midway between
    their boundaries. Links may name lanes outside the map.

    Raises:
        MapFileError: the file is damaged, not an Argoverse 2 map, or too large.
    """
    archive = parse_json_object(data, file_name)
    lanes, crossings, areas = (
        archive.section(name, most) for name, most in _SECTIONS.items()
    )
    if not lanes:
        raise archive.error("it has no 'lane_segments'; expected an Argoverse 2 map.")
    _check_ids(archive, lanes, crossings, areas)
    road_map = RoadMap(
        lanes=tuple(_lane(entry, origin_city_m) for entry in lanes),
        crosswalks=tuple(_crosswalk(entry, origin_city_m) for entry in crossings),
        drivable_areas=tuple(_drivable_area(entry, origin_city_m) for entry in areas),
        source_fields=archive.others(frozenset(_SECTIONS)),
    )
    excess = road_excess(road_map)
    if excess is not None:
        raise archive.error(excess)
    return road_map


def _check_ids(archive: JsonObject, *sections: list[JsonObject]) -> None:
    for entries, name in zip(sections, _SECTIONS, strict=True):
        seen: set[int] = set()
        for entry in entries:
            number = entry.integer("id")
            if number in seen:
                raise archive.error(f"{name} has id {number} twice.")
            seen.add(number)


def _lane(entry: JsonObject, origin: Float[np.ndarray, "2"]) -> Lane:
    left = entry.points("left_lane_boundary", 2, origin)
    right = entry.points("right_lane_boundary", 2, origin)
    if "centerline" in entry.fields:
        centerline = entry.points("centerline", 2, origin)
    else:
        centerline = midline(left, right)
    return Lane(
        lane_id=entry.integer("id"),
        kind=entry.choice("lane_type", LaneKind),
        is_intersection=entry.flag("is_intersection"),
        centerline=centerline,
        left=left,
        right=right,
        left_mark=entry.choice("left_lane_mark_type", LaneMark),
        right_mark=entry.choice("right_lane_mark_type", LaneMark),
        successors=entry.integers("successors"),
        predecessors=entry.integers("predecessors"),
        left_neighbor=entry.optional_integer("left_neighbor_id"),
        right_neighbor=entry.optional_integer("right_neighbor_id"),
        source_fields=entry.others(_LANE_FIELDS),
    )


def _crosswalk(entry: JsonObject, origin: Float[np.ndarray, "2"]) -> Crosswalk:
    return Crosswalk(
        crosswalk_id=entry.integer("id"),
        edge1=entry.points("edge1", 2, origin),
        edge2=entry.points("edge2", 2, origin),
        source_fields=entry.others(_CROSSWALK_FIELDS),
    )


def _drivable_area(entry: JsonObject, origin: Float[np.ndarray, "2"]) -> DrivableArea:
    return DrivableArea(
        area_id=entry.integer("id"),
        boundary=entry.points("area_boundary", 3, origin),
        source_fields=entry.others(_AREA_FIELDS),
    )


def signals_of_map(
    road_map: RoadMap, num_steps: int, file_name: str
) -> tuple[RoadMap, tuple[Signal, ...]]:
    """The signals of a map that was read, and the map without their field.

    Raises:
        MapFileError: they do not fit the map or the steps.
    """
    archive = JsonObject(place=file_name, fields=road_map.source_fields)
    entries = archive.section(_SIGNALS, MAX_LANES)
    if not entries:
        return road_map, ()
    left = archive.others(frozenset({_SIGNALS}))
    free = set(road_map.lane_of)
    signals = tuple(_signal(entry, num_steps, free) for entry in entries)
    return replace(road_map, source_fields=left), signals


def _signal(entry: JsonObject, num_steps: int, free: set[int]) -> Signal:
    name, share = entry.get("id"), entry.get("stop_share")
    lanes, states = entry.integers("lane_ids"), entry.integers("states")
    if not isinstance(name, str) or not is_plain(name):
        raise entry.error("field 'id' is no text of one line.")
    if len(set(lanes)) < len(lanes) or not free.issuperset(lanes):
        raise entry.error(
            "field 'lane_ids' names a lane that is not there, or twice, or has another "
            "signal."
        )
    free.difference_update(lanes)
    if (
        not isinstance(share, list)
        or len(share) != len(lanes)
        or not all(type(one) in (int, float) and 0 <= one <= 1 for one in share)
    ):
        raise entry.error("field 'stop_share' is not a number of 0 to 1 for each lane.")
    if len(states) != num_steps or not set(states) <= set(SignalState):
        raise entry.error(
            f"field 'states' is not a number of 0 to 3 for each of {num_steps} steps."
        )
    return Signal(
        signal_id=name,
        lane_ids=lanes,
        stop_share=np.array(share, float),
        states=np.array(states, np.int8),
    )


def map_bytes(
    road_map: RoadMap,
    origin_city_m: Float[np.ndarray, "2"],
    signals: Sequence[Signal] = (),
) -> bytes:
    """Write a map as a JSON file's bytes, in the city frame.

    Argoverse 2 has no signals: they are a section of our own, which ``av2`` ignores.
    """

    def points(line: Float[np.ndarray, "N 3"]) -> list[dict[str, float]]:
        city = line + np.array([*origin_city_m, 0.0])
        rows = np.round(city, WRITTEN_DECIMALS).tolist()
        return [{"x": x, "y": y, "z": z} for x, y, z in rows]

    lanes = {
        str(lane.lane_id): {**_lane_fields(lane, points), **lane.source_fields}
        for lane in road_map.lanes
    }
    crossings = {
        str(crosswalk.crosswalk_id): {
            "edge1": points(crosswalk.edge1),
            "edge2": points(crosswalk.edge2),
            "id": crosswalk.crosswalk_id,
            **crosswalk.source_fields,
        }
        for crosswalk in road_map.crosswalks
    }
    areas = {
        str(area.area_id): {
            "area_boundary": points(area.boundary),
            "id": area.area_id,
            **area.source_fields,
        }
        for area in road_map.drivable_areas
    }
    archive: dict[str, Any] = {
        "drivable_areas": areas,
        "lane_segments": lanes,
        "pedestrian_crossings": crossings,
        **road_map.source_fields,
    }
    if signals:
        archive[_SIGNALS] = {
            str(number): {
                "id": one.signal_id,
                "lane_ids": list(one.lane_ids),
                "stop_share": one.stop_share.clip(0, 1).tolist(),
                "states": one.states.tolist(),
            }
            for number, one in enumerate(signals)
        }
    return json.dumps(archive).encode()


def _lane_fields(
    lane: Lane, points: Callable[[Float[np.ndarray, "_ 3"]], list[dict[str, float]]]
) -> dict[str, Any]:
    return {
        "centerline": points(lane.centerline),
        "id": lane.lane_id,
        "is_intersection": lane.is_intersection,
        "lane_type": lane.kind.value,
        "left_lane_boundary": points(lane.left),
        "left_lane_mark_type": lane.left_mark.value,
        "left_neighbor_id": lane.left_neighbor,
        "predecessors": list(lane.predecessors),
        "right_lane_boundary": points(lane.right),
        "right_lane_mark_type": lane.right_mark.value,
        "right_neighbor_id": lane.right_neighbor,
        "successors": list(lane.successors),
    }
