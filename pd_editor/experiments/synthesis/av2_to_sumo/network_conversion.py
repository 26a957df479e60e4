"""Conversion of an Argoverse 2 map to a network for SUMO."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.av2_to_sumo.connections import lane_roads
from pd_editor.experiments.synthesis.av2_to_sumo.edges import LaneInterval, LaneLines
from pd_editor.experiments.synthesis.av2_to_sumo.net_file import write_lane_net
from pd_editor.experiments.synthesis.av2_to_sumo.parking_strips import parking_strips
from pd_editor.experiments.synthesis.road_network.footways import footways_of
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.scene.road_map import RoadMap

FAMILY: Final = "av2"


@dataclass(frozen=True, kw_only=True, eq=False)
class Av2Network(Network):
    """Network whose lanes are exactly on the centre lines of the original map.

    Simulated poses are therefore on the original lanes, also in junctions.
    """

    lane_intervals: Mapping[str, tuple[LaneInterval, ...]]
    """Lane intervals of the map along each SUMO lane, in driving order."""


def network_of_map(road_map: RoadMap, name: str, folder: Path) -> Av2Network:
    """Convert a map, which becomes the road map of the network.

    Lanes outside junctions become edges, adjacent lanes one edge. Lanes in junctions
    become connections, for which SUMO applies right of way.

    Raises:
        SynthesisError: the map has no lanes, or SUMO is missing or refused them.
    """
    if not road_map.lanes:
        raise SynthesisError(f"Map {name} has no lanes to drive on.")
    folder.mkdir(parents=True, exist_ok=True)
    lines = LaneLines(road_map=road_map)
    net = write_lane_net(lines, lane_roads(lines), folder)
    return Av2Network(
        name=name,
        family=FAMILY,
        folder=folder,
        net_file=net.path,
        road_map=road_map,
        lane_of_sumo={
            sumo_id: tuple(dict.fromkeys(part.lane_id for part in parts))
            for sumo_id, parts in net.lane_intervals.items()
        },
        has_signals=net.has_signals,
        parking_strips_m=parking_strips(road_map),
        footways=footways_of(road_map),
        lane_intervals=net.lane_intervals,
    )
