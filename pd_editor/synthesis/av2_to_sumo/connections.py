"""The ways through junctions, from each road's lane to the next, and who meets where."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
import shapely

from pd_editor.errors import SynthesisError
from pd_editor.synthesis.av2_to_sumo.edges import (
    LaneLines,
    Road,
    Stretch,
    middle_split,
    roads_of,
)

_MAX_CHAIN = 6
"""Lanes of a junction driven one after another; longer chains become roads."""


@dataclass(frozen=True, kw_only=True)
class Link:
    """A way from a lane of a road, by index, to one of another through a junction."""

    start: tuple[int, int]
    """Road and lane."""
    end: tuple[int, int]
    stretches: tuple[Stretch, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneRoads:
    """Roads, links, and the junctions where roads begin and end."""

    roads: tuple[Road, ...]
    links: tuple[Link, ...]
    start_junction: tuple[int, ...]
    end_junction: tuple[int, ...]
    num_junctions: int


def lane_roads(lines: LaneLines) -> LaneRoads:
    """Every lane as a road, or as a part of ways through a junction.

    Raises:
        SynthesisError: the lanes of a junction cannot be told apart.
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
    """All ways through junctions, and lanes that had better be roads."""
    begins: dict[int, tuple[int, int]] = {}
    ends: dict[int, tuple[int, int]] = {}
    for road, lanes in enumerate(road.lanes for road in roads):
        for index, stretch in enumerate(lanes):
            if stretch.lane_id not in crossing or not stretch.start_m:
                ends[stretch.lane_id] = (road, index)
            if stretch.lane_id not in crossing or stretch.start_m:
                begins[stretch.lane_id] = (road, index)
    links: list[Link] = []
    to_road: set[int] = set()
    for lane_id, start in ends.items():
        for chain in _chains(lines, lane_id, set(begins), crossing):
            if len(chain) > _MAX_CHAIN or len(set(chain)) < len(chain):
                to_road.add(chain[len(chain) // 2])
                continue
            end = begins[chain[-1]]
            stretches = _along(lines, roads, chain, start, end)
            links.append(Link(start=start, end=end, stretches=stretches))
    count = Counter((link.start, link.end) for link in links)
    for link in links:
        inside = [s.lane_id for s in link.stretches if s.lane_id in crossing]
        if count[(link.start, link.end)] > 1 and inside:
            to_road.add(inside[len(inside) // 2])
    return tuple(links), frozenset(to_road & crossing)


def _chains(
    lines: LaneLines, lane_id: int, begins: set[int], crossing: frozenset[int]
) -> list[tuple[int, ...]]:
    """Ways from a road's lane on to lanes with a road, through a junction's lanes."""
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
) -> tuple[Stretch, ...]:
    first = roads[start[0]].lanes[start[1]].end_m
    last = roads[end[0]].lanes[end[1]].start_m
    stretches = []
    for place, lane_id in enumerate(chain):
        stretches.append(
            Stretch(
                lane_id=lane_id,
                start_m=first if place == 0 else 0.0,
                end_m=last if place == len(chain) - 1 else lines.length_m[lane_id],
            )
        )
    return tuple(stretches)


def _joined(
    lines: LaneLines, roads: tuple[Road, ...], links: tuple[Link, ...]
) -> LaneRoads:
    """Junctions: ends of roads that a link joins, or whose links cross."""
    num_roads = len(roads)
    parent = list(range(2 * num_roads))

    def root(end: int) -> int:
        while parent[end] != end:
            parent[end] = parent[parent[end]]
            end = parent[end]
        return end

    for link in links:
        parent[root(num_roads + link.start[0])] = root(link.end[0])
    ways = [shapely.LineString(lines.line(link.stretches)) for link in links]
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
    """Roads that end where they begin become two, as SUMO has no loops."""
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
            Link(start=(new, link.start[1]), end=link.end, stretches=link.stretches)
            if link.start[0] == index
            else link
            for link in links
        ]
        for place, (one, two) in enumerate(zip(first.lanes, second.lanes, strict=True)):
            gap = Stretch(lane_id=one.lane_id, start_m=one.end_m, end_m=two.start_m)
            links.append(Link(start=(index, place), end=(new, place), stretches=(gap,)))
    return LaneRoads(
        roads=tuple(roads),
        links=tuple(links),
        start_junction=tuple(starts),
        end_junction=tuple(ends),
        num_junctions=junctions,
    )


def junction_points(lines: LaneLines, network: LaneRoads) -> np.ndarray:
    """Middle of the ends of roads at each junction, shape [J 2]."""
    total = np.zeros((network.num_junctions, 3))
    for index, road in enumerate(network.roads):
        for stretch in road.lanes:
            line = lines.line((stretch,))
            total[network.start_junction[index]] += (*line[0], 1)
            total[network.end_junction[index]] += (*line[-1], 1)
    if not len(total):
        raise SynthesisError("The map has no lanes to drive on.")
    return total[:, :2] / total[:, 2:]
