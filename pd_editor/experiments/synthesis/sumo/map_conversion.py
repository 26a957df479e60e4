"""Conversion of a SUMO net to an Argoverse 2 map."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely

from pd_editor.experiments.synthesis.sumo.lane_chains import (
    LaneChain,
    LaneChains,
    chain_lines,
    lane_chains,
)
from pd_editor.experiments.synthesis.sumo.parking_bays import (
    BAY_SHARE,
    ParkingBay,
    sample_parking_bays,
)
from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet
from pd_editor.scene.geometry.paved_area import paved_rings, valid_area
from pd_editor.scene.geometry.polyline import (
    arc_length,
    at_height_zero,
    offset_line,
    resample,
    without_repeats,
)
from pd_editor.scene.geometry.wide_line import WideLine, borders_m, pieces
from pd_editor.scene.road_map import (
    DrivableArea,
    Lane,
    LaneKind,
    LaneMark,
    RoadMap,
    areas_of,
)

_SHARES: Final[Mapping[str, Mapping[LaneMark, float]]] = {
    "two-way": {
        LaneMark.DOUBLE_SOLID_YELLOW: 0.8,
        LaneMark.SOLID_YELLOW: 0.08,
        LaneMark.NONE: 0.12,
    },
    "median": {LaneMark.SOLID_YELLOW: 0.6, LaneMark.NONE: 0.4},
    "one-way": {LaneMark.SOLID_YELLOW: 0.5, LaneMark.NONE: 0.5},
    "kerb": {LaneMark.SOLID_WHITE: 0.55, LaneMark.NONE: 0.45},
}
"""Shares of markings between the directions of a road, beside a median, on the left of a
one-way street, and on the right."""
_WIDEST_MEDIAN_M: Final = 8.0
"""Widest median between the directions of one road."""
_SPACING_M: Final = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneMarkings:
    """Lane markings of a net."""

    net: SumoNet
    middle_of: Mapping[str, LaneMark]
    """Marking on the left of each edge."""
    kerb_of: Mapping[str, LaneMark]
    """Marking on the right of each edge."""
    stops: frozenset[str]
    """Edges that end at an intersection."""

    def marks(self, chain: LaneChain, *, at_end: bool) -> tuple[LaneMark, LaneMark]:
        """Left and right markings of a lane segment, at the end of its road or before."""
        lane = chain.main
        if lane.is_internal:
            return LaneMark.NONE, LaneMark.NONE
        beside = {other.index: other for other in self.net.lanes_of_edge[lane.edge]}
        solid = at_end and lane.edge in self.stops
        left, right = beside.get(lane.index + 1), beside.get(lane.index - 1)
        return (
            _between(lane, left, solid=solid)
            if left is not None
            else self.middle_of[lane.edge],
            _between(lane, right, solid=solid)
            if right is not None and right.kind is not None
            else self.kerb_of[lane.edge],
        )


def sample_lane_markings(
    net: SumoNet, chains: LaneChains, random: np.random.Generator
) -> LaneMarkings:
    """Sample markings for each road; both directions share the middle one."""
    middle: dict[str, LaneMark] = {}
    kerb: dict[str, LaneMark] = {}
    for edge, (other, gap_m) in _opposites(net).items():
        if gap_m < 1.0:
            middle[edge] = middle.get(other) or _sampled("two-way", random)
        else:
            beside = "median" if gap_m < _WIDEST_MEDIAN_M else "one-way"
            middle[edge] = _sampled(beside, random)
        kerb[edge] = _sampled("kerb", random)
    stops = frozenset(
        chains.chains[n].main.edge
        for n, following in chains.next_of.items()
        if any(chains.chains[after].is_intersection for after in following)
    )
    return LaneMarkings(net=net, middle_of=middle, kerb_of=kerb, stops=stops)


def _opposites(net: SumoNet) -> dict[str, tuple[str, float]]:
    """Opposite edge on the left of each edge, and its distance."""
    lines, ways, owners = [], [], []
    edges = list(net.junction_of)
    for edge in edges:
        lane = net.lanes_of_edge[edge][-1]
        left = offset_line(without_repeats(lane.shape_m, 1e-3), lane.width_m / 2)
        count = max(int(arc_length(left)[-1] / _SPACING_M), 3)
        line = resample(left, count)
        lines.append(line)
        ways.append(np.gradient(line, axis=0))
        owners.append(np.full(count, len(owners)))
    points, way, owner = (np.concatenate(parts) for parts in (lines, ways, owners))
    result = {}
    for number, edge in enumerate(edges):
        half = len(lines[number]) // 2
        distance = np.linalg.norm(points - lines[number][half], axis=-1)
        is_opposite = (way @ ways[number][half] < 0.0) & (owner != number)
        distance = np.where(is_opposite, distance, np.inf)
        nearest = int(np.argmin(distance))
        gap_m = max(float(distance[nearest]) - _SPACING_M / 2, 0.0)
        result[edge] = edges[owner[nearest]], gap_m
    return result


def _sampled(place: str, random: np.random.Generator) -> LaneMark:
    shares = _SHARES[place]
    return list(shares)[random.choice(len(shares), p=list(shares.values()))]


def _between(one: SumoLane, two: SumoLane, *, solid: bool) -> LaneMark:
    if two.kind is None:
        return LaneMark.SOLID_WHITE
    if solid or one.kind != two.kind or one.kind is LaneKind.BIKE:
        return LaneMark.SOLID_WHITE
    return LaneMark.DASHED_WHITE


_MEDIAN_M: Final = 22.0
_SPREAD: Final = 0.92
"""Standard deviation of the logarithm of the length."""
_LEAST_M: Final = 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainSections:
    """Segments of a chain; lanes of one edge are split at the same positions."""

    parts: tuple[WideLine, ...]
    num_before: int
    """Number of junction segments before the road's own ones."""
    num_own: int


def edge_cuts(net: SumoNet, random: np.random.Generator) -> dict[str, list[float]]:
    """Sample the fractions along each normal edge at which its lanes are split."""
    cuts = {}
    for edge in net.junction_of:
        length = _length_m(net.lanes_of_edge[edge][-1])
        at, fractions = 0.0, []
        while True:
            step = _MEDIAN_M * np.exp(_SPREAD * random.normal())
            at += float(np.clip(step, _LEAST_M, 150.0))
            if at > length - _LEAST_M:
                break
            fractions.append(at / length)
        cuts[edge] = fractions
    return cuts


def chain_sections(
    chain: LaneChain, line: WideLine, fractions: list[float]
) -> ChainSections:
    """Split a chain at fractions of its road's lane, and at that lane's ends."""
    row = chain.lanes.index(chain.main)
    start = sum(_length_m(lane) for lane in chain.lanes[:row])
    length = _length_m(chain.main)
    total = float(arc_length(line.points_m)[-1])
    cuts = [start + fraction * length for fraction in fractions]
    opens, closes = start > _LEAST_M, total - start - length > _LEAST_M
    if chain.main.is_internal or length < _LEAST_M:
        opens = closes = False
    before = [start] if opens else []
    after = [start + length] if closes else []
    parts = pieces(line, [*before, *cuts, *after])
    return ChainSections(
        parts=tuple(parts), num_before=len(before), num_own=len(cuts) + 1
    )


def _length_m(lane: SumoLane) -> float:
    return float(arc_length(lane.shape_m)[-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class NetRoadMap:
    """Map of a net, and the lanes of the map by SUMO lane."""

    road_map: RoadMap
    lane_of_sumo: Mapping[str, tuple[int, ...]]
    """Lanes of the map along each SUMO lane for traffic, in driving order."""
    parking_bays: tuple[ParkingBay, ...]
    """Bays beside the lanes, included in the drivable area."""


def net_road_map(
    net: SumoNet, random: np.random.Generator, bay_share: float = BAY_SHARE
) -> NetRoadMap:
    """Convert a net to a map; long lanes are split into segments at random.

    Lanes of one edge are split at the same positions, so that neighbours stay adjacent.
    """
    chains = lane_chains(net)
    cuts = edge_cuts(net, random)
    markings = sample_lane_markings(net, chains, random)
    lines = chain_lines(chains)
    sections = [
        chain_sections(chain, line, cuts.get(chain.main.edge, []))
        for chain, line in zip(chains.chains, lines, strict=True)
    ]
    first_id = 1000 + np.concatenate(
        [[0], np.cumsum([len(cut.parts) for cut in sections])]
    )
    ids = [
        [int(first_id[n]) + k for k in range(len(cut.parts))]
        for n, cut in enumerate(sections)
    ]
    lanes = tuple(
        lane
        for n in range(len(sections))
        for lane in _lanes_of_chain(net, chains, n, sections, ids, markings)
    )
    lanes = _with_predecessors(lanes)
    bays = sample_parking_bays(lanes, random, bay_share)
    road_map = RoadMap(
        lanes=lanes,
        crosswalks=net.crosswalks(1),
        drivable_areas=drivable_areas(net, lanes, bays, 500),
    )
    return NetRoadMap(
        road_map=road_map,
        lane_of_sumo=_lane_of_sumo(chains, sections, ids),
        parking_bays=bays,
    )


def _lanes_of_chain(
    net: SumoNet,
    chains: LaneChains,
    number: int,
    sections: list[ChainSections],
    ids: list[list[int]],
    markings: LaneMarkings,
) -> list[Lane]:
    chain = chains.chains[number]
    left, right = (_neighbor_chain(net, chains, chain.main, step) for step in (1, -1))
    following = [ids[after][0] for after in chains.next_of[number]]
    lanes = []
    last = len(sections[number].parts) - 1
    parts = sections[number].parts
    for k, (section, borders) in enumerate(zip(parts, borders_m(parts), strict=True)):
        marks = markings.marks(chain, at_end=k == last)
        lanes.append(
            Lane(
                lane_id=ids[number][k],
                kind=chain.kind,
                is_intersection=chain.is_intersection,
                centerline=at_height_zero(section.points_m),
                left=at_height_zero(borders[0]),
                right=at_height_zero(borders[1]),
                left_mark=marks[0],
                right_mark=marks[1],
                successors=tuple(following) if k == last else (ids[number][k + 1],),
                predecessors=(),
                left_neighbor=_section_beside(sections, ids, number, k, left),
                right_neighbor=_section_beside(sections, ids, number, k, right),
            )
        )
    return lanes


def _section_beside(
    sections: list[ChainSections],
    ids: list[list[int]],
    number: int,
    row: int,
    beside: int | None,
) -> int | None:
    """Adjacent segment of the neighbouring chain; None where a lane opens or closes."""
    own = row - sections[number].num_before
    if beside is None or not 0 <= own < sections[number].num_own:
        return None
    return ids[beside][own + sections[beside].num_before]


def _neighbor_chain(
    net: SumoNet, chains: LaneChains, lane: SumoLane, step: int
) -> int | None:
    """Chain of the neighbouring lane in the same direction; None without one."""
    if lane.is_internal:
        return None
    for other in net.lanes_of_edge[lane.edge]:
        if other.index == lane.index + step and other.kind is not None:
            return chains.chain_of[other.sumo_id]
    return None


def _with_predecessors(lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    before: dict[int, list[int]] = {lane.lane_id: [] for lane in lanes}
    for lane in lanes:
        for after in lane.successors:
            before[after].append(lane.lane_id)
    return tuple(
        replace(lane, predecessors=tuple(before[lane.lane_id])) for lane in lanes
    )


def _lane_of_sumo(
    chains: LaneChains,
    sections: list[ChainSections],
    ids: list[list[int]],
) -> dict[str, tuple[int, ...]]:
    result = {}
    for n, chain in enumerate(chains.chains):
        ends = np.cumsum([arc_length(part.points_m)[-1] for part in sections[n].parts])
        at = 0.0
        for lane in chain.lanes:
            length = float(arc_length(lane.shape_m)[-1])
            first = int(np.searchsorted(ends, at + 0.1))
            last = int(np.searchsorted(ends, at + length - 0.1))
            first = min(first, len(ids[n]) - 1)
            last = min(max(last, first), len(ids[n]) - 1)
            result[lane.sumo_id] = tuple(ids[n][first : last + 1])
            at += length
    return result


def drivable_areas(
    net: SumoNet, lanes: tuple[Lane, ...], bays: Iterable[ParkingBay], first_id: int
) -> tuple[DrivableArea, ...]:
    """Drivable areas: lanes, parking strips, bays and junctions, without sidewalks."""
    ground = [valid_area(lane.outline_m()) for lane in lanes]
    ground += [shapely.make_valid(bay.area()) for bay in bays]
    return areas_of(paved_rings([*ground, *net.paved_beside_lanes()]), first_id)
