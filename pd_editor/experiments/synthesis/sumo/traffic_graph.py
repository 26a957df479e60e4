"""Edges, turns and sidewalks of a SUMO network by vehicle class."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pd_editor.scene.formats.sumo_net import SumoLane, Turn, read_sumo_net


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficEdge:
    """One direction of a road between two junctions."""

    edge_id: str
    start_junction: str
    end_junction: str
    lanes: tuple[SumoLane, ...]

    @property
    def length_m(self) -> float:
        """Length of its lanes."""
        return self.lanes[0].length_m

    @property
    def has_sidewalk(self) -> bool:
        """Whether pedestrians have a lane of their own."""
        return any(lane.is_sidewalk for lane in self.lanes)

    @property
    def speed_mps(self) -> float:
        """Speed limit of its fastest lane."""
        return max(lane.speed_mps for lane in self.lanes)

    def lanes_for(self, vehicle_class: str) -> tuple[SumoLane, ...]:
        """Lanes that a vehicle class may use, from right to left."""
        return tuple(
            lane
            for lane in self.lanes
            if vehicle_class in lane.admitted and not lane.is_sidewalk
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficGraph:
    """Normal edges of a SUMO network, and the turns between them."""

    edges: Mapping[str, TrafficEdge]
    turns: tuple[Turn, ...]

    @cached_property
    def sidewalk_edges(self) -> tuple[TrafficEdge, ...]:
        """Edges with a sidewalk."""
        return tuple(edge for edge in self.edges.values() if edge.has_sidewalk)

    def turns_for(self, vehicle_class: str) -> dict[str, dict[str, str]]:
        """Direction letters by edge and next edge, for a vehicle class."""
        found: dict[str, dict[str, str]] = {
            edge.edge_id: {}
            for edge in self.edges.values()
            if edge.lanes_for(vehicle_class)
        }
        lanes = {lane.sumo_id: lane for e in self.edges.values() for lane in e.lanes}
        for turn in self.turns:
            start, end = lanes[turn.start], lanes[turn.end]
            if (
                turn.direction != "t"
                and vehicle_class in start.admitted & end.admitted
                and not (start.is_sidewalk or end.is_sidewalk)
            ):
                found[start.edge][end.edge] = turn.direction
        return found


def read_traffic_graph(net_file: Path) -> TrafficGraph:
    """Read edges and turns of a SUMO network file.

    Raises:
        FormatError: the file is missing or no SUMO network.
    """
    net = read_sumo_net(net_file)
    return TrafficGraph(
        edges={
            name: TrafficEdge(
                edge_id=name,
                start_junction=start,
                end_junction=end,
                lanes=tuple(net.lanes_of_edge[name]),
            )
            for name, (start, end) in net.junction_of.items()
        },
        turns=net.turns,
    )
