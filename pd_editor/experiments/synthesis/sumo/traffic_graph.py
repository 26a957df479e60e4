"""Edges, turns and sidewalks of a SUMO network by vehicle class."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.sumo.sumo_net import lane_shape_m, parsed_net

if TYPE_CHECKING:
    from sumolib.net.edge import Edge


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficLane:
    """A lane of a SUMO edge, index 0 the rightmost."""

    lane_id: str
    admitted: frozenset[str]
    """Vehicle classes that may use it."""
    length_m: float
    speed_mps: float
    shape_m: Float[np.ndarray, "N 2"]

    def allows(self, vehicle_class: str) -> bool:
        """Whether a SUMO vehicle class may use the lane."""
        return vehicle_class in self.admitted

    @property
    def is_sidewalk(self) -> bool:
        """Whether only pedestrians may use the lane."""
        return self.admitted == {"pedestrian"}


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficEdge:
    """One direction of a road between two junctions."""

    edge_id: str
    start_junction: str
    end_junction: str
    lanes: tuple[TrafficLane, ...]

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

    def lanes_for(self, vehicle_class: str) -> tuple[TrafficLane, ...]:
        """Lanes that a vehicle class may use, from right to left."""
        return tuple(
            lane
            for lane in self.lanes
            if lane.allows(vehicle_class) and not lane.is_sidewalk
        )


@dataclass(frozen=True, kw_only=True)
class Turn:
    """Connection from one edge to the next."""

    from_edge: str
    to_edge: str
    from_lane: int
    to_lane: int
    direction: str
    """SUMO's letter: s straight, l and r turns, L and R slight ones, t U-turn."""


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
        for turn in self.turns:
            start = self.edges[turn.from_edge].lanes[turn.from_lane]
            end = self.edges[turn.to_edge].lanes[turn.to_lane]
            if (
                turn.direction != "t"
                and start.allows(vehicle_class)
                and end.allows(vehicle_class)
                and not (start.is_sidewalk or end.is_sidewalk)
            ):
                found[turn.from_edge][turn.to_edge] = turn.direction
        return found


def read_traffic_graph(net_file: Path) -> TrafficGraph:
    """Read edges and turns of a SUMO network file.

    Raises:
        SynthesisError: the file is missing or no SUMO network.
    """
    found = [one for one in parsed_net(net_file).getEdges() if not one.isSpecial()]
    links = [
        link
        for edge in found
        for lane in edge.getLanes()
        for link in lane.getOutgoing()
    ]
    return TrafficGraph(
        edges={edge.getID(): _edge(edge) for edge in found},
        turns=tuple(
            Turn(
                from_edge=link.getFrom().getID(),
                to_edge=link.getTo().getID(),
                from_lane=link.getFromLane().getIndex(),
                to_lane=link.getToLane().getIndex(),
                direction=link.getDirection(),
            )
            for link in links
            if not link.getTo().isSpecial()
        ),
    )


def _edge(edge: "Edge") -> TrafficEdge:
    return TrafficEdge(
        edge_id=edge.getID(),
        start_junction=edge.getFromNode().getID(),
        end_junction=edge.getToNode().getID(),
        lanes=tuple(
            TrafficLane(
                lane_id=lane.getID(),
                admitted=frozenset(lane.getPermissions()),
                length_m=lane.getLength(),
                speed_mps=lane.getSpeed(),
                shape_m=lane_shape_m(lane),
            )
            for lane in edge.getLanes()
        ),
    )
