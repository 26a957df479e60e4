"""Which marks are painted along each lane of a SUMO net."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pd_editor.scene.road_map import LaneKind, LaneMark
from pd_editor.synthesis.lane_chains import LaneChain, LaneChains
from pd_editor.synthesis.sumo_net import SumoLane, SumoNet

_SHARE_MIDDLE: Final = {
    LaneMark.DOUBLE_SOLID_YELLOW: 0.8,
    LaneMark.SOLID_YELLOW: 0.1,
    LaneMark.NONE: 0.1,
}
"""Between the two directions of a road: shares seen in Argoverse 2 maps."""
_SHARE_KERB: Final = {LaneMark.SOLID_WHITE: 0.55, LaneMark.NONE: 0.45}


@dataclass(frozen=True, kw_only=True, eq=False)
class LanePaint:
    """The marks of a net's lanes."""

    net: SumoNet
    middle_of: Mapping[str, LaneMark]
    """Left of each edge."""
    kerb_of: Mapping[str, LaneMark]
    """Right of each edge."""
    stops: frozenset[str]
    """Edges that end at an intersection."""

    def marks(self, chain: LaneChain, *, at_end: bool) -> tuple[LaneMark, LaneMark]:
        """Marks left and right of a lane segment, at the end of its road or before."""
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


def lane_paint(
    net: SumoNet, chains: LaneChains, random: np.random.Generator
) -> LanePaint:
    """Marks drawn for each road; both directions of a road agree on the middle."""
    middle: dict[str, LaneMark] = {}
    kerb: dict[str, LaneMark] = {}
    edge_between = {ends: edge for edge, ends in net.junction_of.items()}
    for edge, (start, end) in net.junction_of.items():
        other = edge_between.get((end, start))
        if other is None:
            middle[edge] = LaneMark.SOLID_YELLOW
        else:
            middle[edge] = middle.get(other) or _drawn(_SHARE_MIDDLE, random)
        kerb[edge] = _drawn(_SHARE_KERB, random)
    stops = frozenset(
        chains.chains[n].main.edge
        for n, following in chains.next_of.items()
        if any(chains.chains[after].is_intersection for after in following)
    )
    return LanePaint(net=net, middle_of=middle, kerb_of=kerb, stops=stops)


def _drawn(shares: Mapping[LaneMark, float], random: np.random.Generator) -> LaneMark:
    return list(shares)[random.choice(len(shares), p=list(shares.values()))]


def _between(one: SumoLane, two: SumoLane, *, solid: bool) -> LaneMark:
    if two.kind is None:
        return LaneMark.SOLID_WHITE
    if solid or one.kind != two.kind or one.kind is LaneKind.BIKE:
        return LaneMark.SOLID_WHITE
    return LaneMark.DASHED_WHITE
