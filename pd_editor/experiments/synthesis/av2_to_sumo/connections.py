"""Links through junctions between lanes of roads, and the junctions that they form."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
import shapely

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.av2_to_sumo.edges import (
    LaneInterval,
    LaneLines,
    Road,
    middle_split,
    roads_of,
)

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
    for road, lanes in enumerate(road.lanes for road in roads):
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
    first = roads[start[0]].lanes[start[1]].end_m
    last = roads[end[0]].lanes[end[1]].start_m
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
    num_roads = len(roads)
    parent = list(range(2 * num_roads))

    def root(end: int) -> int:
        while parent[end] != end:
            parent[end] = parent[parent[end]]
            end = parent[end]
        return end

    for link in links:
        parent[root(num_roads + link.start[0])] = root(link.end[0])
    ways = [shapely.LineString(lines.line(link.lane_intervals)) for link in links]
    if ways:
        for one, other in shapely.STRtree(ways).query(ways, predicate="crosses").T:
            parent[root(links[one].end[0])] = root(links[other].end[0])
    numbers: dict[int, int] = {}
    ends = [numbers.setdefault(root(end), len(numbers)) for end in range(2 * num_roads)]
    return _without_loops(
        LaneRoads(
            roads=roads,
            links=links,
            start_junction=tuple(ends[:num_roads]),
            end_junction=tuple(ends[num_roads:]),
            num_junctions=len(numbers),
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
            Link(
                start=(new, link.start[1]),
                end=link.end,
                lane_intervals=link.lane_intervals,
            )
            if link.start[0] == index
            else link
            for link in links
        ]
        for place, (one, two) in enumerate(zip(first.lanes, second.lanes, strict=True)):
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
        for interval in road.lanes:
            line = lines.line((interval,))
            total[network.start_junction[index]] += (*line[0], 1)
            total[network.end_junction[index]] += (*line[-1], 1)
    if not len(total):
        raise SynthesisError("The map has no lanes to drive on.")
    return total[:, :2] / total[:, 2:]
