"""Chains of SUMO lanes, which join short junction lanes to others."""

from collections.abc import Mapping
from dataclasses import dataclass

from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet
from pd_editor.scene.road_map import LaneKind


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneChain:
    """Consecutive SUMO lanes without a branch."""

    lanes: tuple[SumoLane, ...]
    main: SumoLane
    """The road's lane in the chain, or the longest lane within a junction."""
    is_intersection: bool

    @property
    def kind(self) -> LaneKind:
        """Kind of the chain's lanes."""
        assert self.main.kind is not None
        return self.main.kind


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneChains:
    """All lanes for traffic, each in one chain."""

    chains: tuple[LaneChain, ...]
    chain_of: Mapping[str, int]
    """Index of the chain of each SUMO lane id."""
    next_of: Mapping[int, tuple[int, ...]]


def lane_chains(net: SumoNet) -> LaneChains:
    """Join the lanes of a net to chains, in the order of the file."""
    driven = {key: lane for key, lane in net.lanes.items() if lane.kind is not None}
    links = [link for link in net.links if link[0] in driven and link[1] in driven]
    after: dict[str, list[str]] = {key: [] for key in driven}
    before: dict[str, list[str]] = {key: [] for key in driven}
    for start, end in links:
        after[start].append(end)
        before[end].append(start)
    crossing = net.crossed_junctions
    joined = _joins(driven, after, before, crossing)
    has_front = set(joined.values())
    chains = []
    for key in driven:
        if key in has_front:
            continue
        keys = [key]
        while keys[-1] in joined:
            keys.append(joined[keys[-1]])
        chains.append(_chain([driven[k] for k in keys], crossing))
    chain_of = {
        lane.sumo_id: number
        for number, chain in enumerate(chains)
        for lane in chain.lanes
    }
    next_of = {
        number: tuple(chain_of[key] for key in after[chain.lanes[-1].sumo_id])
        for number, chain in enumerate(chains)
    }
    return LaneChains(chains=tuple(chains), chain_of=chain_of, next_of=next_of)


def _joins(
    driven: Mapping[str, SumoLane],
    after: Mapping[str, list[str]],
    before: Mapping[str, list[str]],
    crossing: set[str],
) -> dict[str, str]:
    """Next lane in the same chain, by lane."""
    joined: dict[str, str] = {}
    taken: set[str] = set()

    def join(first: str, second: str) -> None:
        if first not in joined and second not in taken:
            joined[first] = second
            taken.add(second)

    for key, lane in driven.items():
        if not lane.is_internal or not before[key] or not after[key]:
            continue
        front, back = before[key][0], after[key][0]
        if lane.junction in crossing:
            if driven[front].is_internal and len(after[front]) == 1:
                join(front, key)
        elif len(before[back]) == 1:
            join(key, back)
        elif len(after[front]) == 1:
            join(front, key)
    return joined


def _chain(lanes: list[SumoLane], crossing: set[str]) -> LaneChain:
    roads = [lane for lane in lanes if not lane.is_internal]
    main = roads[0] if roads else max(lanes, key=lambda lane: len(lane.shape_m))
    return LaneChain(
        lanes=tuple(lanes),
        main=main,
        is_intersection=not roads and main.junction in crossing,
    )
