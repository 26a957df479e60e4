"""Conversion of a SUMO net to an Argoverse 2 map."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pd_editor.experiments.synthesis.sumo_to_av2.centerlines import chain_lines
from pd_editor.experiments.synthesis.sumo_to_av2.drivable_area import drivable_areas
from pd_editor.experiments.synthesis.sumo_to_av2.lane_chains import (
    LaneChains,
    lane_chains,
)
from pd_editor.experiments.synthesis.sumo_to_av2.lane_markings import (
    LaneMarkings,
    sample_lane_markings,
)
from pd_editor.experiments.synthesis.sumo_to_av2.lane_segments import (
    ChainSections,
    chain_sections,
    edge_cuts,
)
from pd_editor.experiments.synthesis.sumo_to_av2.parking_bays import (
    BAY_SHARE,
    ParkingBay,
    sample_parking_bays,
)
from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet
from pd_editor.scene.geometry.polyline import arc_length, at_height_zero
from pd_editor.scene.road_map import Lane, RoadMap

FIRST_LANE_ID: Final = 1000
FIRST_CROSSWALK_ID: Final = 1
FIRST_AREA_ID: Final = 500


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
    first_id = FIRST_LANE_ID + np.concatenate(
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
        crosswalks=net.crosswalks(FIRST_CROSSWALK_ID),
        drivable_areas=drivable_areas(net, lanes, bays, FIRST_AREA_ID),
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
    for k, section in enumerate(sections[number].parts):
        marks = markings.marks(chain, at_end=k == last)
        lanes.append(
            Lane(
                lane_id=ids[number][k],
                kind=chain.kind,
                is_intersection=chain.is_intersection,
                centerline=at_height_zero(section.points_m),
                left=at_height_zero(section.left_m()),
                right=at_height_zero(section.right_m()),
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
