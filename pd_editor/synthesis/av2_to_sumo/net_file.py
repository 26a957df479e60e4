"""A lane graph as a SUMO net file whose lanes lie exactly on the centre lines."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.errors import SynthesisError
from pd_editor.geometry.polyline import arc_length, resample
from pd_editor.scene.road_map import LaneKind
from pd_editor.synthesis.av2_to_sumo.connections import LaneRoads, Link, junction_points
from pd_editor.synthesis.av2_to_sumo.edges import LaneLines, Road, Stretch
from pd_editor.synthesis.road_network.plain_xml import NET_FILE, NodeKind, StripKind
from pd_editor.synthesis.sumo.curve_speeds import curve_speed_mps
from pd_editor.synthesis.sumo.sumo_tools import run_sumo_tool

_STRIP_OF: Final = {
    LaneKind.VEHICLE: StripKind.CAR,
    LaneKind.BUS: StripKind.BUS,
    LaneKind.BIKE: StripKind.BIKE,
}
_MANY_LANES: Final = 6
"""Lanes towards a junction whose ways cross; with so many it has signals."""
_SPEED_MPS: Final = (11.5, 13.5, 16.0)
"""Limit on roads with one, two and more lanes; Argoverse 2 maps carry none."""

_BEND_MPS2: Final = 2.2
"""Lateral acceleration of an average driver in a bend."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneNetFile:
    """A net file, and the centre lines along each of its lanes."""

    path: Path
    stretches: Mapping[str, tuple[Stretch, ...]]
    has_signals: bool


def write_lane_net(lines: LaneLines, network: LaneRoads, folder: Path) -> LaneNetFile:
    """Let netconvert find the right of way, then put its lanes on the centre lines.

    netconvert cuts lanes back at junctions as it sees fit; what it finds out about
    who yields to whom stays right when the lanes get their own lines back.

    Raises:
        SynthesisError: SUMO is missing, or refused the network.
    """
    _write(folder / "net.nod.xml", _nodes(lines, network))
    _write(folder / "net.edg.xml", _edges(lines, network))
    _write(folder / "net.con.xml", _connections(lines, network))
    parts = "--node-files net.nod.xml --edge-files net.edg.xml"
    parts += f" --connection-files net.con.xml --output-file {NET_FILE}"
    options = "--offset.disable-normalization --precision 4 --no-turnarounds"
    options += " --junctions.join false --junctions.limit-turn-speed 3.5"
    options += " --check-lane-foes.all"
    arguments = [*parts.split(), *options.split()]
    run_sumo_tool("netconvert", arguments, folder)
    path = folder / NET_FILE
    tree = ElementTree.parse(path)
    stretches = _with_own_lines(lines, network, tree.getroot())
    tree.write(path, encoding="utf-8")
    return LaneNetFile(
        path=path,
        stretches=stretches,
        has_signals=tree.getroot().find("tlLogic") is not None,
    )


def _write(path: Path, root: ElementTree.Element) -> None:
    ElementTree.ElementTree(root).write(path, encoding="utf-8")


def _shape(points_m: Float[np.ndarray, "N 2"]) -> str:
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in points_m)


def _nodes(lines: LaneLines, network: LaneRoads) -> ElementTree.Element:
    root = ElementTree.Element("nodes")
    kinds = _node_kinds(lines, network)
    for index, (x, y) in enumerate(junction_points(lines, network)):
        ElementTree.SubElement(
            root,
            "node",
            id=f"n{index}",
            x=f"{x:.3f}",
            y=f"{y:.3f}",
            type=kinds[index].value,
        )
    return root


def _node_kinds(lines: LaneLines, network: LaneRoads) -> list[NodeKind]:
    """Signals at large junctions, stop signs where four small roads meet."""
    kinds = [NodeKind.PRIORITY] * network.num_junctions
    ways = [shapely.LineString(lines.line(link.stretches)) for link in network.links]
    crossed = {
        network.end_junction[network.links[one].start[0]]
        for one, _ in shapely.STRtree(ways).query(ways, predicate="crosses").T
    }
    for junction in crossed:
        arriving = [
            sum(lines.lane(s.lane_id).kind is not LaneKind.BIKE for s in road.lanes)
            for road, end in zip(network.roads, network.end_junction, strict=True)
            if end == junction
        ]
        if sum(arriving) >= _MANY_LANES and len(arriving) > 2:
            kinds[junction] = NodeKind.SIGNALS
        elif len(arriving) >= 4:
            kinds[junction] = NodeKind.ALL_WAY_STOP
    return kinds


def _edges(lines: LaneLines, network: LaneRoads) -> ElementTree.Element:
    root = ElementTree.Element("edges")
    for index, road in enumerate(network.roads):
        middle = lines.line((road.lanes[len(road.lanes) // 2],))
        num_wide = sum(
            lines.lane(s.lane_id).kind is LaneKind.VEHICLE for s in road.lanes
        )
        attributes = {
            "id": f"r{index}",
            "from": f"n{network.start_junction[index]}",
            "to": f"n{network.end_junction[index]}",
            "numLanes": str(len(road.lanes)),
            "spreadType": "center",
            "speed": f"{_SPEED_MPS[min(max(num_wide, 1), 3) - 1]:.2f}",
            "priority": str(1 + num_wide),
            "shape": _shape(middle),
        }
        edge = ElementTree.SubElement(root, "edge", attributes)
        for place, stretch in enumerate(road.lanes):
            ElementTree.SubElement(
                edge,
                "lane",
                index=str(place),
                allow=_STRIP_OF[lines.lane(stretch.lane_id).kind].value,
                width=f"{_width_m(lines, stretch.lane_id):.2f}",
                shape=_shape(lines.line((stretch,))),
            )
    return root


def _width_m(lines: LaneLines, lane_id: int) -> float:
    """Median distance of a lane's boundaries, within what SUMO can drive on."""
    lane = lines.lane(lane_id)
    across = resample(lane.left_m, 9) - resample(lane.right_m, 9)
    return float(np.clip(np.median(np.hypot(*across.T)), 1.2, 5.0))


def _connections(lines: LaneLines, network: LaneRoads) -> ElementTree.Element:
    root = ElementTree.Element("connections")
    for link in network.links:
        attributes = dict(_key(link))
        attributes["shape"] = _shape(lines.line(link.stretches))
        ElementTree.SubElement(root, "connection", attributes)
    leaving = {link.start[0] for link in network.links}
    for index in set(range(len(network.roads))) - leaving:
        ElementTree.SubElement(root, "connection", {"from": f"r{index}"})
    return root


def _key(link: Link) -> tuple[tuple[str, str], ...]:
    return (
        ("from", f"r{link.start[0]}"),
        ("to", f"r{link.end[0]}"),
        ("fromLane", str(link.start[1])),
        ("toLane", str(link.end[1])),
    )


def _with_own_lines(
    lines: LaneLines, network: LaneRoads, root: ElementTree.Element
) -> dict[str, tuple[Stretch, ...]]:
    """Give every lane of the net its centre line; say which that is."""
    lane_of = {lane.attrib["id"]: lane for lane in root.iter("lane")}
    stretches: dict[str, tuple[Stretch, ...]] = {}
    for index, road in enumerate(network.roads):
        length = _mean_length_m(road)
        for place, stretch in enumerate(road.lanes):
            name = f"r{index}_{place}"
            if name not in lane_of:
                raise SynthesisError(
                    f"netconvert left out lane {stretch.lane_id} of the map."
                )
            _set_line(lane_of[name], lines.line((stretch,)), length)
            stretches[name] = (stretch,)
    via = {
        tuple(
            (name, c.attrib[name]) for name in ("from", "to", "fromLane", "toLane")
        ): (c.get("via"))
        for c in root.iterfind("connection")
    }
    following = {
        f"{c.attrib['from']}_{c.attrib['fromLane']}": c.get("via")
        for c in root.iterfind("connection")
        if c.attrib["from"].startswith(":")
    }
    for link in network.links:
        name = via.get(_key(link))
        if name is None:
            raise SynthesisError(
                f"netconvert left out the way from lane {link.stretches[0].lane_id} "
                f"to lane {link.stretches[-1].lane_id} of the map."
            )
        names = []
        while name is not None:
            names.append(name)
            name = following[name]
        _divide(lines, link, [lane_of[name] for name in names], stretches)
    return stretches


def _mean_length_m(road: Road) -> float:
    return float(np.mean([s.end_m - s.start_m for s in road.lanes]))


def _set_line(
    lane: ElementTree.Element, points_m: Float[np.ndarray, "N 2"], length_m: float
) -> None:
    """Give a lane its line, its length, and a speed for its sharpest bend."""
    lane.set("shape", _shape(points_m))
    lane.set("length", f"{length_m:.4f}")
    limit = float(lane.attrib["speed"])
    in_bend = curve_speed_mps(points_m, _BEND_MPS2)
    lane.set("speed", f"{min(limit, in_bend):.2f}")


def _divide(
    lines: LaneLines,
    link: Link,
    lanes: list[ElementTree.Element],
    stretches: dict[str, tuple[Stretch, ...]],
) -> None:
    """Lay a way's parts along its line; it has more than one where drivers wait."""
    lengths = np.array([float(lane.attrib["length"]) for lane in lanes])
    total = float(arc_length(lines.line(link.stretches))[-1])
    bounds = np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()]) * total
    for lane, start, end in zip(lanes, bounds[:-1], bounds[1:], strict=True):
        part = _sub(link.stretches, float(start), float(end))
        _set_line(lane, lines.line(part), max(float(end - start), 0.1))
        stretches[lane.attrib["id"]] = part


def _sub(
    stretches: tuple[Stretch, ...], start_m: float, end_m: float
) -> tuple[Stretch, ...]:
    """What lies between two arc lengths along stretches in a row."""
    found = []
    passed = 0.0
    for stretch in stretches:
        length = stretch.end_m - stretch.start_m
        low, high = max(start_m - passed, 0.0), min(end_m - passed, length)
        if high - low > 1e-6:
            found.append(
                Stretch(
                    lane_id=stretch.lane_id,
                    start_m=stretch.start_m + low,
                    end_m=stretch.start_m + high,
                )
            )
        passed += length
    return tuple(found)
