"""Streets: what lies across them, and their edges in a network."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from pd_editor.geometry.polyline import offset_line
from pd_editor.synthesis.edge_shapes import CurveKind, curve
from pd_editor.synthesis.plain_network import (
    NodeKind,
    PlainConnection,
    PlainEdge,
    PlainNetwork,
    PlainNode,
    Strip,
    StripKind,
)


@dataclass(frozen=True, kw_only=True)
class Carriageway:
    """One direction of a street, from the kerb: pavement, parking, bikes, vehicles."""

    num_lanes: int
    lane_width_m: float
    speed_mps: float
    has_bus_lane: bool = False
    """The rightmost of the lanes is for buses."""
    bike_width_m: float = 0.0
    parking_width_m: float = 0.0
    sidewalk_width_m: float = 0.0

    def strips(self) -> tuple[Strip, ...]:
        """Strips from the kerb to the left."""
        beside = [
            (StripKind.SIDEWALK, self.sidewalk_width_m),
            (StripKind.PARKING, self.parking_width_m),
            (StripKind.BIKE, self.bike_width_m),
        ]
        lanes = [StripKind.CAR] * self.num_lanes
        if self.has_bus_lane:
            lanes[0] = StripKind.BUS
        return tuple(
            [Strip(kind=kind, width_m=width) for kind, width in beside if width > 0]
            + [Strip(kind=kind, width_m=self.lane_width_m) for kind in lanes]
        )


@dataclass(kw_only=True)
class NetworkSketch:
    """Nodes and edges as they are drawn, street by street."""

    nodes: dict[str, PlainNode] = field(default_factory=dict)
    edges: list[PlainEdge] = field(default_factory=list)
    connections: list[PlainConnection] = field(default_factory=list)

    def node(
        self,
        node_id: str,
        point_m: Float[np.ndarray, "2"],
        kind: NodeKind = NodeKind.PRIORITY,
        radius_m: float = 7.0,
    ) -> None:
        """Add a node."""
        x, y = point_m
        self.nodes[node_id] = PlainNode(
            node_id=node_id,
            point_m=(float(x), float(y)),
            kind=kind,
            radius_m=radius_m,
        )

    def point_m(self, node_id: str) -> Float[np.ndarray, "2"]:
        """Where a node is."""
        return np.array(self.nodes[node_id].point_m)

    def line_m(
        self,
        start: str,
        end: str,
        kind: CurveKind = CurveKind.STRAIGHT,
        turn_rad: float = 0.0,
    ) -> Float[np.ndarray, "N 2"]:
        """A curve between two nodes."""
        return curve(self.point_m(start), self.point_m(end), kind, turn_rad)

    def one_way(
        self,
        start: str,
        end: str,
        left_edge_m: Float[np.ndarray, "N 2"],
        carriageway: Carriageway,
        priority: int = 1,
    ) -> str:
        """Add a direction along its left edge; returns the edge's id."""
        edge_id = f"{start}-{end}"
        self.edges.append(
            PlainEdge(
                edge_id=edge_id,
                start=start,
                end=end,
                left_edge_m=left_edge_m,
                strips=carriageway.strips(),
                speed_mps=carriageway.speed_mps,
                priority=priority,
            )
        )
        return edge_id

    def two_way(
        self,
        start: str,
        end: str,
        middle_m: Float[np.ndarray, "N 2"],
        carriageway: Carriageway,
        median_m: float = 0.0,
        priority: int = 1,
    ) -> None:
        """Add both directions of a street along its middle."""
        for ends, line in (
            ((start, end), middle_m),
            ((end, start), middle_m[::-1]),
        ):
            left_edge = offset_line(line, -median_m / 2) if median_m else line
            self.one_way(*ends, left_edge, carriageway, priority)

    def network(self, crossing_width_m: float) -> PlainNetwork:
        """What was drawn."""
        return PlainNetwork(
            nodes=tuple(self.nodes.values()),
            edges=tuple(self.edges),
            connections=tuple(self.connections),
            crossing_width_m=crossing_width_m,
        )
