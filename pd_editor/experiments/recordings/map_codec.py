"""Codec of road maps: JSON values and quantised points."""

import itertools
from typing import Any, Final

import numpy as np
from jaxtyping import Int

from pd_editor.experiments.recordings.integer_codec import coded, decoded
from pd_editor.scene.road_map import (
    Crosswalk,
    DrivableArea,
    Lane,
    LaneKind,
    LaneMark,
    RoadMap,
)

MAP_STEP_M: Final = 0.001
"""Quantisation step of points."""
_AXES: Final = 3


def coded_map(road_map: RoadMap) -> tuple[dict[str, Any], bytes]:
    """Encode a map as a description without points, and its points.

    Unknown fields of the source file are not kept.
    """
    about = {
        "lanes": [
            [
                lane.lane_id,
                lane.kind.value,
                lane.is_intersection,
                lane.left_mark.value,
                lane.right_mark.value,
                lane.successors,
                lane.predecessors,
                lane.left_neighbor,
                lane.right_neighbor,
            ]
            for lane in road_map.lanes
        ],
        "crosswalks": [one.crosswalk_id for one in road_map.crosswalks],
        "drivable_areas": [one.area_id for one in road_map.drivable_areas],
        "counts": [len(line) for line in road_map.polylines],
    }
    points = np.concatenate([np.zeros((0, _AXES)), *road_map.polylines])
    numbers = np.rint(points / MAP_STEP_M).astype(np.int64)
    first_row = _first_row(about["counts"])
    return about, b"".join(coded(axis, first_row) for axis in numbers.T)


def decoded_map(about: dict[str, Any], data: bytes) -> RoadMap:
    """Decode a map; inverse of ``coded_map`` up to rounding.

    Raises:
        KeyError, TypeError, ValueError: the values are not those of a map.
    """
    first_row = _first_row(about["counts"])
    if len(data) % _AXES:
        raise ValueError("points lack a coordinate")
    size = len(data) // _AXES
    axes = [
        decoded(data[axis * size : (axis + 1) * size], first_row)
        for axis in range(_AXES)
    ]
    points = np.stack(axes, axis=-1) * MAP_STEP_M
    lines = [points[a:b] for a, b in itertools.pairwise(first_row)]
    num_lanes, num_crosswalks = len(about["lanes"]), len(about["crosswalks"])
    split = 3 * num_lanes + 2 * num_crosswalks
    if len(lines) != split + len(about["drivable_areas"]):
        raise ValueError("lines do not belong to the lanes")
    crossings = lines[3 * num_lanes : split]
    return RoadMap(
        lanes=tuple(
            _lane(values, *lines[3 * row : 3 * row + 3])
            for row, values in enumerate(about["lanes"])
        ),
        crosswalks=tuple(
            Crosswalk(
                crosswalk_id=number,
                edge1=crossings[2 * row],
                edge2=crossings[2 * row + 1],
            )
            for row, number in enumerate(about["crosswalks"])
        ),
        drivable_areas=tuple(
            DrivableArea(area_id=number, boundary=line)
            for number, line in zip(about["drivable_areas"], lines[split:], strict=True)
        ),
    )


def _lane(
    values: list[Any], centerline: np.ndarray, left: np.ndarray, right: np.ndarray
) -> Lane:
    number, kind, is_intersection, left_mark, right_mark, *links = values
    successors, predecessors, left_neighbor, right_neighbor = links
    return Lane(
        lane_id=number,
        kind=LaneKind(kind),
        is_intersection=is_intersection,
        centerline=centerline,
        left=left,
        right=right,
        left_mark=LaneMark(left_mark),
        right_mark=LaneMark(right_mark),
        successors=tuple(successors),
        predecessors=tuple(predecessors),
        left_neighbor=left_neighbor,
        right_neighbor=right_neighbor,
    )


def _first_row(counts: list[int]) -> Int[np.ndarray, "S_plus_1"]:
    lengths = np.array(counts, np.int64).reshape(-1)
    if (lengths < 0).any():
        raise ValueError("a line has fewer than no points")
    return np.concatenate([[0], np.cumsum(lengths)])
