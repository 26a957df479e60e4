"""Samples the lane markings of a SUMO net."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pd_editor.experiments.synthesis.sumo_to_av2.lane_chains import (
    LaneChain,
    LaneChains,
)
from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet
from pd_editor.scene.geometry.polyline import (
    arc_length,
    offset_line,
    resample,
    without_repeats,
)
from pd_editor.scene.road_map import LaneKind, LaneMark

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
_PAINTED_M: Final = 1.0
_MEDIAN_M: Final = 8.0
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
        if gap_m < _PAINTED_M:
            middle[edge] = middle.get(other) or _sampled("two-way", random)
        else:
            beside = "median" if gap_m < _MEDIAN_M else "one-way"
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
