"""Roads (SUMO edges) from a lane graph, links between them through junctions, and the junctions."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.base.errors import SynthesisError
from pd_editor.scene.geometry.polyline import arc_length, point_at
from pd_editor.scene.road_map import Lane, RoadMap

CUT_M: Final = 1.0
"""Length by which a lane is shortened at a junction."""
MAX_CUT_M: Final = 25.0
MAX_CUT_SHARE: Final = 0.4
"""Largest fraction of a lane by which each end is shortened."""


@dataclass(frozen=True, kw_only=True)
class LaneInterval:
    """Interval of a lane's centre line, given by two arc lengths."""

    lane_id: int
    start_m: float
    end_m: float


Road = tuple[LaneInterval, ...]
"""Adjacent lane intervals, from right to left: an edge of SUMO."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneLines:
    """Lanes of a map with their links and centre lines."""

    road_map: RoadMap

    @cached_property
    def successors(self) -> dict[int, tuple[int, ...]]:
        """Lanes of the map that follow each lane."""
        known = self.road_map.lane_of
        return {
            lane.lane_id: tuple(n for n in dict.fromkeys(lane.successors) if n in known)
            for lane in self.road_map.lanes
        }

    @cached_property
    def predecessors(self) -> dict[int, tuple[int, ...]]:
        """Lanes of the map that lead to each lane."""
        found: dict[int, tuple[int, ...]] = dict.fromkeys(self.successors, ())
        for lane_id, following in self.successors.items():
            for other in following:
                found[other] = (*found[other], lane_id)
        return found

    @cached_property
    def length_m(self) -> dict[int, float]:
        """Length of each centre line."""
        lanes = self.road_map.lanes
        return {n.lane_id: float(arc_length(n.centerline_m)[-1]) for n in lanes}

    def lane(self, lane_id: int) -> Lane:
        """The lane with an id."""
        return self.road_map.lane_of[lane_id]

    def line(
        self, lane_intervals: tuple[LaneInterval, ...]
    ) -> Float[np.ndarray, "N 2"]:
        """Centre line along intervals, with all vertices of the lanes."""
        points = [
            _part(self.lane(s.lane_id).centerline_m, s.start_m, s.end_m)
            for s in lane_intervals
        ]
        joined = np.concatenate(points)
        step = np.linalg.norm(np.diff(joined, axis=0), axis=1)
        keep = np.concatenate([[True], step > 1e-3])
        keep[-1] = True
        return joined[keep]


def _part(
    line: Float[np.ndarray, "N 2"], start_m: float, end_m: float
) -> Float[np.ndarray, "M 2"]:
    along = arc_length(line)
    inside = (along > start_m + 1e-6) & (along < end_m - 1e-6)
    ends = point_at(line, np.array([start_m, end_m]))
    return np.concatenate([ends[:1], line[inside], ends[1:]])


def roads_of(lines: LaneLines, crossing: frozenset[int]) -> tuple[Road, ...]:
    """Roads of all lanes; lanes in ``crossing`` only where the map ends.

    Lanes in ``crossing`` belong to a junction.
    """
    roads = [
        _shortened(lines, group)
        for group in lines.road_map.lane_groups
        for group in _without(group, crossing)
    ]
    for lane_id in sorted(crossing):
        length = lines.length_m[lane_id]
        # Length of the road made of a junction lane that begins or ends at the map's
        # edge.
        stub = min(8.0, MAX_CUT_SHARE * length)
        begins, ends = not lines.predecessors[lane_id], not lines.successors[lane_id]
        if begins:
            roads.append((LaneInterval(lane_id=lane_id, start_m=0.0, end_m=stub),))
        if ends:
            part = LaneInterval(lane_id=lane_id, start_m=length - stub, end_m=length)
            roads.append((part,))
    return tuple(roads)


def _without(group: tuple[int, ...], crossing: frozenset[int]) -> list[list[int]]:
    """Split a group at lanes that belong to junctions."""
    runs: list[list[int]] = [[]]
    for lane_id in group:
        if lane_id in crossing:
            runs.append([])
        else:
            runs[-1].append(lane_id)
    return [run for run in runs if run]


def _shortened(lines: LaneLines, group: list[int]) -> Road:
    """Road of a lane group, shortened by the same lengths for all lanes."""
    shortest = min(lines.length_m[lane_id] for lane_id in group)
    begin = max(_cut(lines, lane_id, group, 1) for lane_id in group)
    end = max(_cut(lines, lane_id, group, -1) for lane_id in group)
    limit = min(MAX_CUT_M, MAX_CUT_SHARE * shortest)
    begin, end = min(begin, limit), min(end, limit)
    return tuple(
        LaneInterval(
            lane_id=lane_id, start_m=begin, end_m=lines.length_m[lane_id] - end
        )
        for lane_id in group
    )


def _cut(
    lines: LaneLines, lane_id: int, group: list[int], way: Literal[1, -1]
) -> float:
    """Length over which a lane overlaps others that begin (1) or end (-1) as it does."""
    linked, back = lines.predecessors, lines.successors
    if way == -1:
        linked, back = back, linked
    if not linked[lane_id]:
        return 0.0
    rivals = {n for lane in linked[lane_id] for n in back[lane]} - set(group)
    others = [lines.lane(n).centerline_m[::way] for n in sorted(rivals)]
    return _shared(lines.lane(lane_id).centerline_m[::way], others)


def _shared(
    line: Float[np.ndarray, "N 2"], others: list[Float[np.ndarray, "_ 2"]]
) -> float:
    if not others:
        return CUT_M
    length = min(float(arc_length(line)[-1]), MAX_CUT_M)
    along = np.arange(CUT_M, length, 0.5)
    points = shapely.points(point_at(line, along))
    near = np.zeros(len(along))
    for other in others:
        # Centre lines further apart than this carry traffic side by side.
        near = np.maximum(
            near, shapely.distance(shapely.LineString(other), points) < 2.4
        )
    apart = np.flatnonzero(near == 0)
    return float(along[apart[0]]) if len(apart) else length


def middle_split(road: Road) -> tuple[Road, Road]:
    """Split a road into two, with a short gap for the link between them."""

    def part(first: float, second: float) -> Road:
        return tuple(
            LaneInterval(
                lane_id=s.lane_id,
                start_m=s.start_m + first * (s.end_m - s.start_m),
                end_m=s.start_m + second * (s.end_m - s.start_m),
            )
            for s in road
        )

    return part(0.0, 0.45), part(0.55, 1.0)


_MAX_CHAIN = 6
"""Longest chain of lanes in a junction; longer chains become roads."""


@dataclass(frozen=True, kw_only=True)
class Link:
    """Connection through a junction from a lane of one road to a lane of another."""

    start: tuple[int, int]
    """Indices of the road and of its lane."""
    end: tuple[int, int]
    lane_intervals: tuple[LaneInterval, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneRoads:
    """Roads, links between them, and the junctions at their ends."""

    roads: tuple[Road, ...]
    links: tuple[Link, ...]
    start_junction: tuple[int, ...]
    end_junction: tuple[int, ...]
    num_junctions: int


def lane_roads(lines: LaneLines) -> LaneRoads:
    """Convert every lane to a road or to a part of links through a junction.

    Raises:
        SynthesisError: the lanes of a junction cannot be assigned.
    """
    crossing = frozenset(n.lane_id for n in lines.road_map.lanes if n.is_intersection)
    while True:
        roads = roads_of(lines, crossing)
        links, to_road = _links(lines, roads, crossing)
        if not to_road:
            break
        crossing -= to_road
    return _joined(lines, roads, links)


def _links(
    lines: LaneLines, roads: tuple[Road, ...], crossing: frozenset[int]
) -> tuple[tuple[Link, ...], frozenset[int]]:
    """All links through junctions, and the junction lanes that must become roads."""
    begins: dict[int, tuple[int, int]] = {}
    ends: dict[int, tuple[int, int]] = {}
    for road, lanes in enumerate(roads):
        for index, interval in enumerate(lanes):
            if interval.lane_id not in crossing or not interval.start_m:
                ends[interval.lane_id] = (road, index)
            if interval.lane_id not in crossing or interval.start_m:
                begins[interval.lane_id] = (road, index)
    links: list[Link] = []
    to_road: set[int] = set()
    for lane_id, start in ends.items():
        for chain in _chains(lines, lane_id, set(begins), crossing):
            if len(chain) > _MAX_CHAIN or len(set(chain)) < len(chain):
                to_road.add(chain[len(chain) // 2])
                continue
            end = begins[chain[-1]]
            lane_intervals = _along(lines, roads, chain, start, end)
            links.append(Link(start=start, end=end, lane_intervals=lane_intervals))
    count = Counter((link.start, link.end) for link in links)
    for link in links:
        inside = [s.lane_id for s in link.lane_intervals if s.lane_id in crossing]
        if count[(link.start, link.end)] > 1 and inside:
            to_road.add(inside[len(inside) // 2])
    return tuple(links), frozenset(to_road & crossing)


def _chains(
    lines: LaneLines, lane_id: int, begins: set[int], crossing: frozenset[int]
) -> list[tuple[int, ...]]:
    """Chains of junction lanes from a road's lane to lanes of other roads."""
    if lane_id in crossing and lane_id in begins:
        return [(lane_id,)]
    done = []
    open_chains = [(lane_id, following) for following in lines.successors[lane_id]]
    while open_chains:
        chain = open_chains.pop()
        if chain[-1] in begins or len(chain) > _MAX_CHAIN + 1:
            done.append(chain)
        else:
            open_chains += [(*chain, n) for n in lines.successors[chain[-1]]]
    return done


def _along(
    lines: LaneLines,
    roads: tuple[Road, ...],
    chain: tuple[int, ...],
    start: tuple[int, int],
    end: tuple[int, int],
) -> tuple[LaneInterval, ...]:
    first = roads[start[0]][start[1]].end_m
    last = roads[end[0]][end[1]].start_m
    lane_intervals = []
    for place, lane_id in enumerate(chain):
        lane_intervals.append(
            LaneInterval(
                lane_id=lane_id,
                start_m=first if place == 0 else 0.0,
                end_m=last if place == len(chain) - 1 else lines.length_m[lane_id],
            )
        )
    return tuple(lane_intervals)


def _joined(
    lines: LaneLines, roads: tuple[Road, ...], links: tuple[Link, ...]
) -> LaneRoads:
    """Form junctions from ends of roads that are linked or whose links cross."""
    from scipy.sparse import coo_array, csgraph

    num_roads = len(roads)
    meet = [(num_roads + link.start[0], link.end[0]) for link in links]
    ways = [shapely.LineString(lines.line(link.lane_intervals)) for link in links]
    if ways:
        for one, other in shapely.STRtree(ways).query(ways, predicate="crosses").T:
            meet.append((links[one].end[0], links[other].end[0]))
    one, other = np.reshape(meet, (-1, 2)).astype(int).T
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(2 * num_roads,) * 2)
    count, junction = csgraph.connected_components(graph, directed=False)
    ends = junction.tolist()
    return _without_loops(
        LaneRoads(
            roads=roads,
            links=links,
            start_junction=tuple(ends[:num_roads]),
            end_junction=tuple(ends[num_roads:]),
            num_junctions=count,
        ),
    )


def _without_loops(network: LaneRoads) -> LaneRoads:
    """Split roads that end at their own start, because SUMO has no loops."""
    roads, links = list(network.roads), list(network.links)
    starts, ends = list(network.start_junction), list(network.end_junction)
    junctions = network.num_junctions
    for index, road in enumerate(network.roads):
        if starts[index] != ends[index]:
            continue
        first, second = middle_split(road)
        new = len(roads)
        roads[index] = first
        roads.append(second)
        starts.append(junctions)
        ends.append(ends[index])
        ends[index] = junctions
        junctions += 1
        links = [
            replace(link, start=(new, link.start[1]))
            if link.start[0] == index
            else link
            for link in links
        ]
        for place, (one, two) in enumerate(zip(first, second, strict=True)):
            gap = LaneInterval(
                lane_id=one.lane_id, start_m=one.end_m, end_m=two.start_m
            )
            links.append(
                Link(start=(index, place), end=(new, place), lane_intervals=(gap,))
            )
    return LaneRoads(
        roads=tuple(roads),
        links=tuple(links),
        start_junction=tuple(starts),
        end_junction=tuple(ends),
        num_junctions=junctions,
    )


def junction_points(lines: LaneLines, network: LaneRoads) -> np.ndarray:
    """Centre of the ends of roads at each junction, shape [J 2]."""
    total = np.zeros((network.num_junctions, 3))
    for index, road in enumerate(network.roads):
        for interval in road:
            line = lines.line((interval,))
            total[network.start_junction[index]] += (*line[0], 1)
            total[network.end_junction[index]] += (*line[-1], 1)
    if not len(total):
        raise SynthesisError("The map has no lanes to drive on.")
    return total[:, :2] / total[:, 2:]
