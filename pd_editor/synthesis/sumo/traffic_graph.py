"""What a SUMO network lets each class of traffic do: edges, turns, sidewalks."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pd_editor.errors import SynthesisError


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficLane:
    """A lane of a SUMO edge, index 0 the rightmost."""

    lane_id: str
    allow: frozenset[str] | None
    """Vehicle classes that may use it; None where ``disallow`` says it."""
    disallow: frozenset[str]
    length_m: float
    width_m: float
    speed_mps: float
    shape_m: Float[np.ndarray, "N 2"]

    def allows(self, vehicle_class: str) -> bool:
        """Whether a SUMO vehicle class may use the lane."""
        if self.allow is not None:
            return vehicle_class in self.allow or "all" in self.allow
        return vehicle_class not in self.disallow and "all" not in self.disallow

    @property
    def is_sidewalk(self) -> bool:
        """Whether only pedestrians may use the lane."""
        return self.allow == {"pedestrian"}


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
    """A way from one edge on to the next."""

    from_edge: str
    to_edge: str
    from_lane: int
    to_lane: int
    direction: str
    """SUMO's letter: s straight, l and r turns, L and R slight ones, t U-turn."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficGraph:
    """Edges of a SUMO network without those inside junctions, and turns."""

    edges: Mapping[str, TrafficEdge]
    turns: tuple[Turn, ...]

    @cached_property
    def sidewalk_edges(self) -> tuple[TrafficEdge, ...]:
        """Edges with a sidewalk."""
        return tuple(edge for edge in self.edges.values() if edge.has_sidewalk)

    def turns_for(self, vehicle_class: str) -> dict[str, dict[str, str]]:
        """Direction letter of each next edge of each edge that a class may use."""
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
    """Edges and turns of a SUMO network file.

    Raises:
        SynthesisError: the file is missing or no SUMO network.
    """
    try:
        root = ElementTree.parse(net_file).getroot()
        edges = {
            element.attrib["id"]: _edge(element)
            for element in root.iter("edge")
            if "function" not in element.attrib and element.find("lane") is not None
        }
        turns = tuple(
            Turn(
                from_edge=element.attrib["from"],
                to_edge=element.attrib["to"],
                from_lane=int(element.attrib["fromLane"]),
                to_lane=int(element.attrib["toLane"]),
                direction=element.attrib["dir"],
            )
            for element in root.iter("connection")
            if element.attrib["from"] in edges and element.attrib["to"] in edges
        )
    except (OSError, ElementTree.ParseError, KeyError, ValueError) as error:
        raise SynthesisError(
            f"{net_file} is not a readable SUMO network ({error})."
        ) from error
    if not edges:
        raise SynthesisError(f"The SUMO network {net_file} has no edges.")
    return TrafficGraph(edges=edges, turns=turns)


def _edge(element: ElementTree.Element) -> TrafficEdge:
    return TrafficEdge(
        edge_id=element.attrib["id"],
        start_junction=element.attrib["from"],
        end_junction=element.attrib["to"],
        lanes=tuple(
            TrafficLane(
                lane_id=lane.attrib["id"],
                allow=(
                    frozenset(lane.attrib["allow"].split())
                    if "allow" in lane.attrib
                    else None
                ),
                disallow=frozenset(lane.attrib.get("disallow", "").split()),
                length_m=float(lane.attrib["length"]),
                width_m=float(lane.attrib.get("width", 3.2)),
                speed_mps=float(lane.attrib["speed"]),
                shape_m=np.array(
                    [
                        [float(value) for value in point.split(",")[:2]]
                        for point in lane.attrib["shape"].split()
                    ]
                ),
            )
            for lane in element.iter("lane")
        ),
    )
