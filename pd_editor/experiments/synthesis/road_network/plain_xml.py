"""Plain-XML input of netconvert: nodes, edges and connections."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.sumo.sumo_tools import run_sumo_tool
from pd_editor.scene.formats.sumo_net import ALLOWED_ON
from pd_editor.scene.road_map import LaneKind

NET_FILE: Final = "net.net.xml"


class StripKind(StrEnum):
    """Use of a lane; the value is the vehicle class that SUMO allows on it."""

    CAR = ALLOWED_ON[LaneKind.VEHICLE]
    BUS = ALLOWED_ON[LaneKind.BUS]
    BIKE = ALLOWED_ON[LaneKind.BIKE]
    PARKING = ""
    SIDEWALK = "pedestrian"


class NodeKind(StrEnum):
    """Right of way at a node; the value is SUMO's node type."""

    PRIORITY = "priority"
    SIGNALS = "traffic_light"
    ALL_WAY_STOP = "allway_stop"
    MINOR_STOP = "priority_stop"
    ZIPPER = "zipper"


@dataclass(frozen=True, kw_only=True)
class PlainNode:
    """Node at which edges meet."""

    node_id: str
    point_m: tuple[float, float]
    kind: NodeKind = NodeKind.PRIORITY
    radius_m: float = 7.0
    """Radius of the outer edge, including sidewalks, at the corners."""


@dataclass(frozen=True, kw_only=True)
class Strip:
    """A lane of SUMO, including sidewalks and parking strips."""

    kind: StripKind
    width_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class PlainEdge:
    """One direction of a road between two nodes."""

    edge_id: str
    start: str
    end: str
    left_edge_m: Float[np.ndarray, "N 2"]
    """Left edge of the leftmost strip, in driving direction."""
    strips: tuple[Strip, ...]
    """Strips from the kerb to the left."""
    speed_mps: float
    priority: int = 1


@dataclass(frozen=True, kw_only=True)
class PlainConnection:
    """Connection from a strip of one edge to a strip of another."""

    start: str
    end: str
    start_strip: int
    end_strip: int


@dataclass(frozen=True, kw_only=True, eq=False)
class PlainNetwork:
    """Nodes and edges; connections only where netconvert must not guess them."""

    nodes: tuple[PlainNode, ...]
    edges: tuple[PlainEdge, ...]
    connections: tuple[PlainConnection, ...] = ()
    removed: tuple[tuple[str, str], ...] = ()
    """Pairs of edges that netconvert must not connect."""
    crossing_width_m: float = 4.0
    roundabouts: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = ()
    """Node ids and edge ids of each roundabout."""


def convert(plain: PlainNetwork, folder: Path) -> Path:
    """Write a network's parts into a folder and convert them with netconvert.

    Raises:
        SynthesisError: SUMO is missing or refused the network.
    """
    shape = "--junctions.internal-link-detail 20 --junctions.corner-detail 5"
    shape += " --junctions.small-radius 1"
    shape += " --crossings.guess --crossings.guess.speed-threshold 18"
    shape += f" --default.crossing-width {plain.crossing_width_m:.2f}"
    return run_netconvert(
        folder, _nodes(plain), _edges(plain), _connections(plain), shape
    )


def run_netconvert(
    folder: Path,
    nodes: Iterable[ElementTree.Element],
    edges: Iterable[ElementTree.Element],
    connections: Iterable[ElementTree.Element],
    options: str,
) -> Path:
    """Write parts of a network into a folder; returns the net file made of them.

    Raises:
        SynthesisError: SUMO is missing or refused the network.
    """
    parts = {"node": nodes, "edge": edges, "connection": connections}
    files = f"--output-file {NET_FILE}"
    for kind, elements in parts.items():
        root, name = ElementTree.Element(f"{kind}s"), f"net.{kind[:3]}.xml"
        root.extend(elements)
        ElementTree.ElementTree(root).write(folder / name, encoding="utf-8")
        files += f" --{kind}-files {name}"
    shared = "--offset.disable-normalization --precision 4 --no-turnarounds"
    shared += " --junctions.limit-turn-speed 3.5"
    run_sumo_tool("netconvert", f"{files} {shared} {options}".split(), folder)
    return folder / NET_FILE


def shape_text(points_m: Float[np.ndarray, "N 2"], digits: int) -> str:
    """Points of a line as SUMO writes them."""
    return " ".join(f"{x:.{digits}f},{y:.{digits}f}" for x, y in points_m)


def _nodes(plain: PlainNetwork) -> Iterator[ElementTree.Element]:
    for node in plain.nodes:
        x, y = node.point_m
        yield ElementTree.Element(
            "node",
            id=node.node_id,
            x=f"{x:.3f}",
            y=f"{y:.3f}",
            type=node.kind.value,
            radius=f"{node.radius_m:.2f}",
        )


def _edges(plain: PlainNetwork) -> Iterator[ElementTree.Element]:
    for edge in plain.edges:
        attributes = {
            "id": edge.edge_id,
            "from": edge.start,
            "to": edge.end,
            "spreadType": "right",
            "speed": f"{edge.speed_mps:.2f}",
            "priority": str(edge.priority),
            "numLanes": str(len(edge.strips)),
            "shape": shape_text(edge.left_edge_m, 3),
        }
        element = ElementTree.Element("edge", attributes)
        for index, strip in enumerate(edge.strips):
            is_closed = strip.kind is StripKind.PARKING
            ElementTree.SubElement(
                element,
                "lane",
                {
                    "index": str(index),
                    "width": f"{strip.width_m:.2f}",
                    "disallow" if is_closed else "allow": strip.kind.value or "all",
                },
            )
        yield element
    for nodes, edges in plain.roundabouts:
        yield ElementTree.Element(
            "roundabout", nodes=" ".join(nodes), edges=" ".join(edges)
        )


def _connections(plain: PlainNetwork) -> Iterator[ElementTree.Element]:
    for one in plain.connections:
        ends = {"from": one.start, "to": one.end}
        strips = {"fromLane": str(one.start_strip), "toLane": str(one.end_strip)}
        yield ElementTree.Element("connection", ends | strips)
    for start, end in plain.removed:
        yield ElementTree.Element("delete", {"from": start, "to": end})
