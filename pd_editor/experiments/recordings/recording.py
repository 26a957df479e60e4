"""Recordings of simulated traffic on a map over several minutes, windows, and their codec.

Encoded numbers are series of integers. A smooth series has small differences. Those are
mapped to non-negative numbers (0, -1, 1, -2, ... to 0, 1, 2, 3, ...) and written byte plane
by byte plane, the lowest first, so that the higher planes are mostly zeros and compress
well.
"""

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.road_map import (
    Crosswalk,
    DrivableArea,
    Lane,
    LaneKind,
    LaneMark,
    RoadMap,
)
from pd_editor.scene.signals import Signal


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficTracks:
    """Tracks of A road users; P states of all of them, one user after another."""

    ids: tuple[str, ...]
    kinds: tuple[AgentKind, ...]
    size_m: Float[np.ndarray, "A 2"]
    """True length and width."""
    first_step: Int[np.ndarray, "A"]
    """Step of the first state of each."""
    first_row: Int[np.ndarray, "A_plus_1"]
    """Agent a has the rows from ``first_row[a]`` to before ``first_row[a + 1]``."""
    position_m: Float[np.ndarray, "P 2"]
    """Box centres."""
    heading_rad: Float[np.ndarray, "P"]
    """Where vehicles point."""
    velocity_mps: Float[np.ndarray, "P 2"]
    """Rates of change of the positions."""

    def __post_init__(self) -> None:
        count = len(self.ids)
        assert len(self.kinds) == len(self.size_m) == len(self.first_step) == count
        assert len(self.first_row) == count + 1
        assert self.first_row[-1] == len(self.position_m) == len(self.heading_rad)

    @cached_property
    def end_step(self) -> Int[np.ndarray, "A"]:
        """Step after the last state of each road user."""
        return self.first_step + np.diff(self.first_row)

    def row_at(self, agents: Int[np.ndarray, "N"], step: int) -> Int[np.ndarray, "N"]:
        """Rows of the states of some road users, who are there, at a step."""
        return self.first_row[agents] + step - self.first_step[agents]

    @cached_property
    def agent(self) -> Int[np.ndarray, "P"]:
        """Index of the road user of each state."""
        return np.repeat(np.arange(len(self.ids)), np.diff(self.first_row))

    @cached_property
    def step(self) -> Int[np.ndarray, "P"]:
        """Step of each state."""
        row = np.arange(len(self.position_m))
        return self.first_step[self.agent] + row - self.first_row[self.agent]

    def taken(self, wanted: Bool[np.ndarray, "A"]) -> "TrafficTracks":
        """Select road users by a mask."""
        rows = wanted[self.agent]
        kept = np.flatnonzero(wanted)
        counts = np.diff(self.first_row)[kept]
        return TrafficTracks(
            ids=tuple(self.ids[agent] for agent in kept),
            kinds=tuple(self.kinds[agent] for agent in kept),
            size_m=self.size_m[kept],
            first_step=self.first_step[kept],
            first_row=np.concatenate([[0], np.cumsum(counts)]).astype(int),
            position_m=self.position_m[rows],
            heading_rad=self.heading_rad[rows],
            velocity_mps=self.velocity_mps[rows],
        )

    def joined(self, other: "TrafficTracks") -> "TrafficTracks":
        """Concatenate: these road users, then others of the same recording."""
        return TrafficTracks(
            ids=(*self.ids, *other.ids),
            kinds=(*self.kinds, *other.kinds),
            size_m=np.concatenate([self.size_m, other.size_m]),
            first_step=np.concatenate([self.first_step, other.first_step]),
            first_row=np.concatenate(
                [self.first_row, self.first_row[-1] + other.first_row[1:]]
            ),
            position_m=np.concatenate([self.position_m, other.position_m]),
            heading_rad=np.concatenate([self.heading_rad, other.heading_rad]),
            velocity_mps=np.concatenate([self.velocity_mps, other.velocity_mps]),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording(TrafficTracks):
    """Simulated tracks, in the frame of a road map."""

    name: str
    """Unique name in a dataset, such as ``roundabout-00017``."""
    road_map: RoadMap
    city: str
    """City name in scenario files; for procedural roads their family."""
    origin_city_m: Float[np.ndarray, "2"]
    """Origin of the recording's frame in city coordinates."""
    step_s: float
    num_steps: int
    is_parked: Bool[np.ndarray, "A"]
    """Whether an agent is parked for the whole recording."""
    signals: tuple[Signal, ...] = ()
    """Traffic signals, with their states at all steps."""

    @cached_property
    def extent_m(self) -> Float[np.ndarray, "2 A 2"]:
        """Least and greatest coordinates of each agent."""
        if not self.ids:
            return np.zeros((2, 0, 2))
        starts = self.first_row[:-1]
        least = np.minimum.reduceat(self.position_m, starts, axis=0)
        return np.stack([least, np.maximum.reduceat(self.position_m, starts, axis=0)])


@dataclass(frozen=True, kw_only=True)
class Window:
    """Place and time of a clip in a recording."""

    current_step: int
    """Step of the recording that becomes the scenario's current one."""
    center_m: tuple[float, float]
    """Centre of the clip's square."""
    focal_id: str
    seed: int
    """Seed of all random choices when the clip is extracted."""


POSITION_STEP_M: Final = 0.01
HEADING_STEP_RAD: Final = 0.001
VELOCITY_STEP_MPS: Final = 0.02
SIZE_STEP_M: Final = 0.01
_STEPS: Final = np.array(
    [POSITION_STEP_M] * 2 + [HEADING_STEP_RAD] + [VELOCITY_STEP_MPS] * 2
)
_KIND_OF: Final = {kind.value: kind for kind in AgentKind}


def coded_recording(recording: Recording) -> tuple[dict[str, Any], bytes, bytes]:
    """Encode a recording as a description, its states, and its map's points."""
    map_about, points = coded_map(recording.road_map)
    about = {
        "name": recording.name,
        "city": recording.city,
        "origin_city_m": recording.origin_city_m.tolist(),
        "step_s": recording.step_s,
        "num_steps": recording.num_steps,
        "ids": recording.ids,
        "kinds": [kind.value for kind in recording.kinds],
        "size": np.rint(recording.size_m / SIZE_STEP_M).astype(int).tolist(),
        "parked": np.flatnonzero(recording.is_parked).tolist(),
        "first_step": recording.first_step.tolist(),
        "counts": np.diff(recording.first_row).tolist(),
        "map": map_about,
        "signals": [_coded_signal(one) for one in recording.signals],
    }
    columns = np.column_stack(
        [
            recording.position_m,
            _unwrapped(recording.heading_rad, recording.first_row),
            recording.velocity_mps,
        ]
    )
    numbers = np.rint(columns / _STEPS).astype(np.int64)
    is_still = _is_still(numbers, recording.first_row)
    about["still"] = np.flatnonzero(is_still).tolist()
    numbers = numbers[_is_coded(recording.first_row, is_still)]
    first_row = _coded_first_row(np.diff(recording.first_row), is_still)
    return about, coded(numbers, first_row), points


def _is_still(
    numbers: Int[np.ndarray, "P C"], first_row: Int[np.ndarray, "A_plus_1"]
) -> Bool[np.ndarray, "A"]:
    """Whether all states of an agent are equal; then only the first one is encoded."""
    first = np.repeat(numbers[first_row[:-1]], np.diff(first_row), axis=0)
    is_other = np.concatenate([[0], np.cumsum((numbers != first).any(axis=1))])
    return is_other[first_row[1:]] == is_other[first_row[:-1]]


def _is_coded(
    first_row: Int[np.ndarray, "A_plus_1"], is_still: Bool[np.ndarray, "A"]
) -> Bool[np.ndarray, "P"]:
    keep = ~np.repeat(is_still, np.diff(first_row))
    keep[first_row[:-1]] = True
    return keep


def _coded_first_row(
    counts: Int[np.ndarray, "A"], is_still: Bool[np.ndarray, "A"]
) -> Int[np.ndarray, "A_plus_1"]:
    return np.concatenate([[0], np.cumsum(np.where(is_still, 1, counts))])


def decoded_recording(about: dict[str, Any], rows: bytes, points: bytes) -> Recording:
    """Decode a recording; inverse of ``coded_recording`` up to rounding.

    Raises:
        KeyError, TypeError, ValueError: the values are not those of a recording.
    """
    counts = np.array(about["counts"], np.int64).reshape(-1)
    first_step = np.array(about["first_step"], np.int64).reshape(-1)
    ends = first_step + counts
    if (counts < 1).any() or (first_step < 0).any() or len(counts) != len(first_step):
        raise ValueError("an agent has no steps")
    if (ends > about["num_steps"]).any():
        raise ValueError("an agent has steps after the last")
    first_row = np.concatenate([[0], np.cumsum(counts)])
    is_parked, is_still = np.zeros((2, len(counts)), bool)
    is_parked[np.array(about["parked"], int)] = True
    is_still[np.array(about["still"], int)] = True
    coded_first_row = _coded_first_row(counts, is_still)
    times = np.ones(coded_first_row[-1], int)
    times[coded_first_row[:-1][is_still]] = counts[is_still]
    numbers = decoded(rows, coded_first_row, len(_STEPS))
    states = np.repeat(numbers * _STEPS, times, axis=0)
    return Recording(
        name=about["name"],
        road_map=decoded_map(about["map"], points),
        city=about["city"],
        origin_city_m=np.array(about["origin_city_m"], float),
        step_s=about["step_s"],
        num_steps=about["num_steps"],
        ids=tuple(about["ids"]),
        kinds=tuple(_KIND_OF[name] for name in about["kinds"]),
        size_m=np.array(about["size"], float).reshape(-1, 2) * SIZE_STEP_M,
        is_parked=is_parked,
        first_step=first_step,
        first_row=first_row,
        position_m=states[:, :2],
        heading_rad=wrap_angle(states[:, 2]),
        velocity_mps=states[:, 3:],
        signals=tuple(
            _decoded_signal(one, about["num_steps"]) for one in about.get("signals", ())
        ),
    )


def _coded_signal(signal: Signal) -> list[Any]:
    """Name, lanes, places of stop lines, and the steps from which states hold."""
    begins = np.flatnonzero(np.diff(signal.states, prepend=-1))
    share = signal.stop_share.round(3).tolist()
    states = signal.states[begins].tolist()
    return [signal.signal_id, signal.lane_ids, share, begins.tolist(), states]


def _decoded_signal(values: list[Any], num_steps: int) -> Signal:
    name, lanes, share, begins, states = values
    times = np.diff([*begins, num_steps])
    return Signal(
        signal_id=name,
        lane_ids=tuple(lanes),
        stop_share=np.array(share, float).reshape(-1),
        states=np.repeat(np.array(states, np.int8), times),
    )


def _unwrapped(
    heading: Float[np.ndarray, "P"], first_row: Int[np.ndarray, "A_plus_1"]
) -> Float[np.ndarray, "P"]:
    """Headings, unwrapped within each agent."""
    turns = wrap_angle(np.diff(heading, prepend=0.0))
    starts = first_row[:-1]
    turns[starts] = heading[starts]
    total = np.cumsum(turns)
    before = np.concatenate([[0.0], total])[starts]
    return total - np.repeat(before, np.diff(first_row))


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
    return about, coded(numbers, first_row)


def decoded_map(about: dict[str, Any], data: bytes) -> RoadMap:
    """Decode a map; inverse of ``coded_map`` up to rounding.

    Raises:
        KeyError, TypeError, ValueError: the values are not those of a map.
    """
    first_row = _first_row(about["counts"])
    points = decoded(data, first_row, _AXES) * MAP_STEP_M
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


MAX_MAGNITUDE: Final = 2**31 - 1
_PLANES: Final = 4
_ORDER: Final = 2
"""How often differences are taken."""


def coded(
    values: Int[np.ndarray, "P C"], first_row: Int[np.ndarray, "S_plus_1"]
) -> bytes:
    """Encode columns of series s, the rows from ``first_row[s]`` to before that of s + 1."""
    assert np.abs(values, dtype=np.int64).max(initial=0) < MAX_MAGNITUDE // 4**_ORDER
    numbers = values.astype(np.int64)
    starts = first_row[:-1][np.diff(first_row) > 0]
    for _ in range(_ORDER):
        before = np.concatenate([numbers[:1], numbers[:-1]])
        before[starts] = 0
        numbers = numbers - before
    folded = np.where(numbers < 0, -2 * numbers - 1, 2 * numbers).astype("<u4")
    planes = np.ascontiguousarray(folded).view(np.uint8)
    return planes.reshape(*folded.shape, _PLANES).transpose(1, 2, 0).tobytes()


def decoded(
    data: bytes, first_row: Int[np.ndarray, "S_plus_1"], num_columns: int
) -> Int[np.ndarray, "P C"]:
    """Decode series; inverse of ``coded``.

    Raises:
        ValueError: the number of bytes is not that of the series.
    """
    shape = (num_columns, _PLANES, int(first_row[-1]))
    if len(data) != np.prod(shape):
        raise ValueError(
            f"{len(data)} bytes do not hold {num_columns} columns of {shape[-1]} numbers"
        )
    planes = np.frombuffer(data, np.uint8).reshape(shape).transpose(2, 0, 1)
    folded = np.ascontiguousarray(planes).view("<u4")[..., 0].astype(np.int64)
    numbers = np.where(folded & 1, -(folded + 1) // 2, folded // 2)
    lengths = np.diff(first_row)
    for _ in range(_ORDER):
        total = np.cumsum(numbers, axis=0)
        before = np.concatenate([np.zeros((1, num_columns), int), total])[
            first_row[:-1]
        ]
        numbers = total - np.repeat(before, lengths, axis=0)
    return numbers
