"""Map tokens: pieces of about 10 m of lanes, crosswalks and boundaries, and their signals."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.road import drivable_ground
from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.geometry.lines import numbered
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.road_map import Crosswalk, LaneKind, RoadMap, once_per_map
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import SignalState, states_at

PIECE_LENGTH_M: Final = 10.0
PIECE_KINDS: Final = (LaneKind.VEHICLE, LaneKind.BIKE, LaneKind.BUS)
"""Lane kinds by ``piece_kind``; crosswalks come after them."""
CROSSWALK_KIND: Final = len(PIECE_KINDS)
NUM_PIECE_KINDS: Final = CROSSWALK_KIND + 1

PIECE_SHAPE: Final = (
    "length",
    "turn_before",
    "turn",
    "turn_after",
    "left_width",
    "right_width",
    "has_left",
    "has_right",
    "is_intersection",
    "has_successor",
    "has_predecessor",
    "branches",
)
"""Features of each piece, scaled to about one.

Length in tens of metres; turns of the previous piece, of the piece itself and of the
next one in radians, positive to the left; distances to both boundaries in units of 2 m;
whether there are neighbouring lanes in the same direction on each side; whether the lane
is in an intersection; whether the piece has a successor, a predecessor, and several
successors.
"""
MIRRORED_SHAPE: Final = (0, 1, 2, 3, 5, 4, 7, 6, 8, 9, 10, 11)
"""Index of the feature that replaces each one of ``PIECE_SHAPE`` in a mirrored scene."""
MIRRORED_SHAPE_SIGNS: Final = (1, -1, -1, -1, 1, 1, 1, 1, 1, 1, 1, 1)

_WIDTH_UNIT_M: Final = 2.0
_WIDEST_M: Final = 8.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LanePieces:
    """P pieces of lanes and crosswalks; poses in the scene frame.

    Lanes come first, in the order of the map, each divided into pieces of equal length;
    then crosswalks, each as one piece per direction.
    """

    pose: Float[np.ndarray, "P 3"]
    """Midpoint of each piece, and direction from its start to its end."""
    shape: Float[np.ndarray, "P F"]
    """Features named by ``PIECE_SHAPE``."""
    kind: Int[np.ndarray, "P"]
    lane: Int[np.ndarray, "P"]
    """Row of each piece's lane in the map's ``LaneGraph``; -1 for crosswalks."""
    middle: Float[np.ndarray, "P"]
    """Place of the midpoint on the lane, from 0 at its start to 1."""


@once_per_map
def lane_pieces(road_map: RoadMap) -> LanePieces:
    """Pieces of the lanes and crosswalks of a map."""
    lanes = _pieces_of_lanes(road_map, lane_graph(road_map))
    return _joined(lanes, _crossings(road_map.crosswalks))


@dataclass(frozen=True, kw_only=True, eq=False)
class _DividedLanes:
    """Assignment of pieces to the L lanes of a graph."""

    lane: Int[np.ndarray, "P"]
    first: Int[np.ndarray, "L"]
    last: Int[np.ndarray, "L"]
    part: Float[np.ndarray, "P 3"]
    """Start, midpoint and end of each piece as fractions of its lane's length."""

    @classmethod
    def of(cls, graph: LaneGraph) -> "_DividedLanes":
        counts = np.maximum(np.rint(graph.lengths_m / PIECE_LENGTH_M), 1).astype(int)
        ends = np.cumsum(counts)
        lane, index = numbered(counts)
        part = (index[:, None] + np.array([0.0, 0.5, 1.0])) / counts[lane, None]
        return cls(lane=lane, first=ends - counts, last=ends - 1, part=part)


def _pieces_of_lanes(road_map: RoadMap, graph: LaneGraph) -> LanePieces:
    if not graph.lane_ids:
        return _no_pieces()
    cut = _DividedLanes.of(graph)
    lanes = [road_map.lane_of[lane_id] for lane_id in graph.lane_ids]
    start, middle, end = _points_at(graph.centerlines_m, cut.lane, cut.part)
    chord = end - start
    heading = heading_of(chord)
    turn = 2 * wrap_angle(heading_of(end - middle) - heading_of(middle - start))
    turn = np.clip(turn, -np.pi, np.pi)
    after, before, num_after = _links(graph, cut)
    lengths = graph.lengths_m / (cut.last - cut.first + 1) / PIECE_LENGTH_M
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    columns = {
        "length": lengths[cut.lane],
        "turn_before": np.where(before >= 0, turn[before], 0.0),
        "turn": turn,
        "turn_after": np.where(after >= 0, turn[after], 0.0),
        "left_width": _width([lane.left_m for lane in lanes], cut, middle, left),
        "right_width": _width([lane.right_m for lane in lanes], cut, middle, -left),
        "has_left": _is_beside(graph, [one.left_neighbor for one in lanes])[cut.lane],
        "has_right": _is_beside(graph, [one.right_neighbor for one in lanes])[cut.lane],
        "is_intersection": np.array([one.is_intersection for one in lanes])[cut.lane],
        "has_successor": after >= 0,
        "has_predecessor": before >= 0,
        "branches": num_after > 1,
    }
    kinds = np.array([PIECE_KINDS.index(lane.kind) for lane in lanes])
    return LanePieces(
        pose=np.column_stack([middle, heading]),
        shape=np.stack([columns[name] for name in PIECE_SHAPE], axis=1).astype(float),
        kind=kinds[cut.lane],
        lane=cut.lane,
        middle=cut.part[:, 1],
    )


def _is_beside(
    graph: LaneGraph, neighbors: Sequence[int | None]
) -> Bool[np.ndarray, "L"]:
    """Whether each lane has a neighbour in the map with the same direction.

    Argoverse 2's neighbours include oncoming lanes.
    """
    chords = np.array([line[-1] - line[0] for line in graph.centerlines_m])
    rows = [graph.row_of.get(-1 if one is None else one, -1) for one in neighbors]
    beside = np.array(rows, int)
    return (beside >= 0) & ((chords * chords[beside]).sum(axis=1) > 0)


def _links(
    graph: LaneGraph, cut: _DividedLanes
) -> tuple[Int[np.ndarray, "P"], Int[np.ndarray, "P"], Int[np.ndarray, "P"]]:
    """Next and previous piece of each piece (-1: none), and its number of successors.

    Of several successors or predecessors the straightest is used.
    """
    count = len(cut.lane)
    after = np.arange(1, count + 1)
    before = np.arange(-1, count - 1)
    after[cut.last] = -1
    before[cut.first] = -1
    num_after = np.ones(count, int)
    num_after[cut.last] = [len(rows) for rows in graph.successors]
    linked = [(row, rows[0]) for row, rows in enumerate(graph.successors) if rows]
    if linked:
        here, there = np.array(linked).T
        after[cut.last[here]] = cut.first[there]
    links = [
        (rank, row, other)
        for row, rows in enumerate(graph.successors)
        for rank, other in enumerate(rows)
    ]
    if links:
        _, here, there = np.array(sorted(links, reverse=True)).T
        before[cut.first[there]] = cut.last[here]
    return after, before, num_after


def _points_at(
    lines_m: tuple[np.ndarray, ...] | list[np.ndarray],
    line: Int[np.ndarray, "P"],
    part: Float[np.ndarray, "P N"],
) -> Float[np.ndarray, "N P 2"]:
    """Points at fractions of the length of lines, in one pass."""
    counts = np.array([len(one) for one in lines_m])
    points = np.concatenate(lines_m)
    step = np.diff(points, axis=0)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
    ends = np.cumsum(counts)
    low, high = along[ends - counts][line], along[ends - 1][line]
    # Stay strictly inside each line, so that ends are not interpolated with the next.
    wanted = low[:, None] + part * (high - low)[:, None]
    inner = 1e-9 * (high - low)[:, None]
    wanted = np.clip(wanted, low[:, None] + inner, high[:, None] - inner)
    return np.stack(
        [np.interp(wanted.T, along, points[:, axis]) for axis in (0, 1)], axis=-1
    )


def _width(
    boundaries_m: list[np.ndarray],
    cut: _DividedLanes,
    middle_m: Float[np.ndarray, "P 2"],
    outward: Float[np.ndarray, "P 2"],
) -> Float[np.ndarray, "P"]:
    """Distance from the midpoint of each piece to a boundary, in units of 2 m."""
    usable = np.array([len(b) > 0 and np.isfinite(b).all() for b in boundaries_m])
    lines = [
        line if is_usable else np.zeros((1, 2))
        for line, is_usable in zip(boundaries_m, usable, strict=True)
    ]
    (beside,) = _points_at(lines, cut.lane, cut.part[:, 1:2])
    width = np.clip(((beside - middle_m) * outward).sum(-1), 0.0, _WIDEST_M)
    # Assumed distance to a boundary without length.
    return np.where(usable[cut.lane], width, 1.75) / _WIDTH_UNIT_M


def _crossings(crosswalks: tuple[Crosswalk, ...]) -> LanePieces:
    """Pieces of crosswalks, one per direction."""
    ends = np.array([_ends(one) for one in crosswalks]).reshape(-1, 2, 2, 2)
    ends = ends[np.isfinite(ends).all(axis=(1, 2, 3))]
    middle_line = ends.mean(axis=1)
    chord = middle_line[:, 1] - middle_line[:, 0]
    length = np.hypot(chord[:, 0], chord[:, 1])
    ends, middle_line = ends[length > 0], middle_line[length > 0]
    chord, length = chord[length > 0], length[length > 0]
    if not len(length):
        return _no_pieces()
    apart = (ends[:, 1] - ends[:, 0]).mean(axis=1)
    width = np.abs(chord[:, 0] * apart[:, 1] - chord[:, 1] * apart[:, 0]) / length / 2
    heading = heading_of(chord)
    shape = np.zeros((len(length), len(PIECE_SHAPE)))
    shape[:, PIECE_SHAPE.index("length")] = length / PIECE_LENGTH_M
    for side in ("left_width", "right_width"):
        shape[:, PIECE_SHAPE.index(side)] = np.minimum(width, _WIDEST_M) / _WIDTH_UNIT_M
    there = np.column_stack([middle_line.mean(axis=1), heading])
    back = np.column_stack([middle_line.mean(axis=1), wrap_angle(heading + np.pi)])
    return LanePieces(
        pose=np.stack([there, back], axis=1).reshape(-1, 3),
        shape=np.repeat(shape, 2, axis=0),
        kind=np.full(2 * len(length), CROSSWALK_KIND),
        lane=np.full(2 * len(length), -1),
        middle=np.full(2 * len(length), 0.5),
    )


def _ends(crosswalk: Crosswalk) -> list[list[np.ndarray]]:
    """First and last points of both edges, oriented alike."""
    one, two = crosswalk.edge1[:, :2], crosswalk.edge2[:, :2]
    if np.linalg.norm(one[-1] - two[-1]) > np.linalg.norm(one[-1] - two[0]):
        two = two[::-1]
    return [[one[0], one[-1]], [two[0], two[-1]]]


def _no_pieces() -> LanePieces:
    return LanePieces(
        pose=np.zeros((0, 3)),
        shape=np.zeros((0, len(PIECE_SHAPE))),
        kind=np.zeros(0, int),
        lane=np.zeros(0, int),
        middle=np.zeros(0),
    )


def _joined(one: LanePieces, other: LanePieces) -> LanePieces:
    return LanePieces(
        pose=np.concatenate([one.pose, other.pose]),
        shape=np.concatenate([one.shape, other.shape]),
        kind=np.concatenate([one.kind, other.kind]),
        lane=np.concatenate([one.lane, other.lane]),
        middle=np.concatenate([one.middle, other.middle]),
    )


PIECE_SIGNAL: Final = ("stop", "go")
"""What the signal ahead says, 0 without one; both are a half where it says caution.

Through a junction both are those of the movement; on the way to it the mean over the
movements, times a factor that falls from 1 at the stop line to 0 ``REACH_M`` before it.
"""
REACH_M: Final = 80.0
"""Distance from a stop line at which its signal is out of sight."""
_SAYS: Final = {
    SignalState.STOP: (1.0, 0.0),
    SignalState.CAUTION: (0.5, 0.5),
    SignalState.GO: (0.0, 1.0),
}


def piece_signals(scenario: Scenario, pieces: LanePieces) -> Float[np.ndarray, "P 2"]:
    """Signals of the pieces of a scenario's map at the current step."""
    found = np.zeros((len(pieces.kind), len(PIECE_SIGNAL)))
    graph = lane_graph(scenario.road_map)
    says, stop_m, is_own = _own_signals(scenario, graph)
    if not is_own.any():
        return found
    says, stop_m = _seen_ahead(scenario, graph, says, stop_m, is_own)
    is_lane = pieces.lane >= 0
    lane = pieces.lane[is_lane]
    gap = stop_m[lane] - pieces.middle[is_lane] * graph.lengths_m[lane]
    nearness = np.clip(1 - np.maximum(gap, 0.0) / REACH_M, 0.0, 1.0)
    found[is_lane] = says[lane] * nearness[:, None]
    return found


def _own_signals(
    scenario: Scenario, graph: LaneGraph
) -> tuple[Float[np.ndarray, "L 2"], Float[np.ndarray, "L"], np.ndarray]:
    """What each lane's own signal says, where its stop line is, and whether it has one."""
    says = np.zeros((len(graph.lane_ids), len(PIECE_SIGNAL)))
    stop_m = np.full(len(says), np.inf)
    shares = [share for one in scenario.signals for share in one.stop_share]
    states = states_at(scenario.signals, scenario.current_step)
    for (lane_id, state), share in zip(states.items(), shares, strict=True):
        row = graph.row_of.get(lane_id)
        if row is not None and state in _SAYS:
            says[row] = _SAYS[state]
            stop_m[row] = share * graph.lengths_m[row]
    return says, stop_m, np.isfinite(stop_m)


def _seen_ahead(
    scenario: Scenario,
    graph: LaneGraph,
    says: Float[np.ndarray, "L 2"],
    stop_m: Float[np.ndarray, "L"],
    is_own: np.ndarray,
) -> tuple[Float[np.ndarray, "L 2"], Float[np.ndarray, "L"]]:
    """What the signals ahead of each lane say, and how far from its start they are."""
    links = [
        (row, other) for row, after in enumerate(graph.successors) for other in after
    ]
    if not links:
        return says, stop_m
    here, there = np.array(links).T
    inside = np.array(
        [scenario.road_map.lane_of[one].is_intersection for one in graph.lane_ids]
    )
    says, stop_m = says.copy(), stop_m.copy()
    # A lane through the junction obeys the signal at the end of the lane before it.
    follows = is_own[here] & ~inside[here] & inside[there] & ~is_own[there]
    says[there[follows]], stop_m[there[follows]] = says[here[follows]], 0.0
    is_open = ~is_own & ~inside
    while True:
        seen = is_open[here] & (stop_m[there] < REACH_M)
        if not seen.any():
            return says, stop_m
        count = np.bincount(here[seen], minlength=len(says))
        total, nearest = np.zeros_like(says), np.full(len(says), np.inf)
        np.add.at(total, here[seen], says[there[seen]])
        np.minimum.at(nearest, here[seen], stop_m[there[seen]])
        told = count > 0
        says[told] = total[told] / count[told, None]
        stop_m[told] = nearest[told] + graph.lengths_m[told]
        is_open &= ~told


BOUNDARY_LENGTH_M: Final = 10.0
BOUNDARY_SHAPE: Final = ("length", "turn_before", "turn", "turn_after")
"""Length in tens of metres; turns of the previous piece, of the piece itself and of the
next one, in radians, positive to the left."""
MIRRORED_BOUNDARY: Final = (0, 3, 2, 1)
"""Index of the feature that replaces each one of ``BOUNDARY_SHAPE`` in a mirrored scene,
where pieces run the other way, since the drivable area stays on their left."""

_CLOSED_GAP_M: Final = 0.3
"""Areas nearer to each other than twice this are merged: maps have gaps between them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundaryPieces:
    """E pieces of the drivable area's boundary, with the area on their left."""

    pose: Float[np.ndarray, "E 3"]
    """Midpoint of each piece in the scene frame, and its direction."""
    shape: Float[np.ndarray, "E 4"]
    """Features named by ``BOUNDARY_SHAPE``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _DividedBoundary:
    """Start, midpoint and end of each piece, with the previous and next pieces."""

    points_m: Float[np.ndarray, "E 3 2"]
    before: Int[np.ndarray, "E"]
    after: Int[np.ndarray, "E"]


def boundary_pieces(scenario: Scenario) -> BoundaryPieces:
    """Pieces of a scenario's road; under a warp, the warped pieces of the original road."""
    cut = _cut(scenario.original_road_map)
    points = cut.points_m
    if scenario.applied_warp is not None and len(points):
        points = scenario.applied_warp.warp.apply(points)
    start, middle, end = points[:, 0], points[:, 1], points[:, 2]
    first, last = middle - start, end - middle
    turn = np.clip(2 * wrap_angle(heading_of(last) - heading_of(first)), -np.pi, np.pi)
    length = np.hypot(*first.T) + np.hypot(*last.T)
    return BoundaryPieces(
        pose=np.column_stack([middle, heading_of(end - start)]),
        shape=np.column_stack(
            [length / BOUNDARY_LENGTH_M, turn[cut.before], turn, turn[cut.after]]
        ),
    )


@lru_cache(maxsize=16)
def _cut(road_map: RoadMap) -> _DividedBoundary:
    """Divide the boundary of a map's drivable area; cached as long as the map is in use."""
    points: list[np.ndarray] = [np.zeros((0, 3, 2))]
    before: list[np.ndarray] = [np.zeros(0, int)]
    after: list[np.ndarray] = [np.zeros(0, int)]
    count = 0
    for ring in _rings(road_map):
        step = np.diff(ring, axis=0)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*step.T))])
        number = max(round(along[-1] / BOUNDARY_LENGTH_M), 2)
        at = (np.arange(number)[:, None] + np.array([0.0, 0.5, 1.0])) / number
        at *= along[-1]
        points.append(
            np.stack([np.interp(at, along, ring[:, axis]) for axis in (0, 1)], axis=-1)
        )
        index = count + np.arange(number)
        before.append(np.roll(index, 1))
        after.append(np.roll(index, -1))
        count += number
    return _DividedBoundary(
        points_m=np.concatenate(points),
        before=np.concatenate(before),
        after=np.concatenate(after),
    )


def _rings(road_map: RoadMap) -> list[Float[np.ndarray, "N 2"]]:
    """Closed rings around the drivable area, and reversed rings around its holes."""
    ground = drivable_ground(road_map)
    closed = shapely.buffer(ground, _CLOSED_GAP_M, join_style="mitre")
    closed = shapely.buffer(closed, -_CLOSED_GAP_M, join_style="mitre")
    rings: list[np.ndarray] = []
    for part in shapely.get_parts(closed):
        # Small parts and holes are left out.
        if part.area < 20.0:
            continue
        ground_left = shapely.geometry.polygon.orient(part)
        holes = [
            one for one in ground_left.interiors if shapely.Polygon(one).area >= 4.0
        ]
        rings += [
            np.asarray(one.coords)[:, :2] for one in (ground_left.exterior, *holes)
        ]
    return rings
