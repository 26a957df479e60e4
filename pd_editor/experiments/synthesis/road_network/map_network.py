"""Writes a lane graph as a SUMO net file with lanes exactly on the centre lines."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.road_network.footways import footways_of
from pd_editor.experiments.synthesis.road_network.map_edges import (
    LaneInterval,
    LaneLines,
    LaneRoads,
    Link,
    Road,
    junction_points,
    lane_roads,
)
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    StripKind,
    run_netconvert,
    shape_text,
)
from pd_editor.experiments.synthesis.sumo.parking_bays import kerb_lanes
from pd_editor.experiments.synthesis.sumo.sumo_tools import curve_speed_mps
from pd_editor.scene.geometry.angles import left_of
from pd_editor.scene.geometry.polyline import arc_length, point_at, resample
from pd_editor.scene.road_map import Lane, LaneKind, RoadMap

_STRIP_OF: Final = {
    LaneKind.VEHICLE: StripKind.CAR,
    LaneKind.BUS: StripKind.BUS,
    LaneKind.BIKE: StripKind.BIKE,
}
_MANY_LANES: Final = 6
"""Number of incoming lanes from which a junction with crossing links has signals."""
_SPEED_MPS: Final = (11.5, 13.5, 16.0)
"""Speed limits of roads with one, two and more lanes; Argoverse 2 maps have none."""


def _nodes(lines: LaneLines, network: LaneRoads) -> Iterator[ElementTree.Element]:
    kinds = _node_kinds(lines, network)
    for index, (x, y) in enumerate(junction_points(lines, network)):
        place, kind = {"x": f"{x:.3f}", "y": f"{y:.3f}"}, kinds[index].value
        yield ElementTree.Element("node", place, id=f"n{index}", type=kind)


def _node_kinds(lines: LaneLines, network: LaneRoads) -> list[NodeKind]:
    """Signals at large junctions, stop signs where four small roads meet."""
    kinds = [NodeKind.PRIORITY] * network.num_junctions
    ways = [
        shapely.LineString(lines.line(link.lane_intervals)) for link in network.links
    ]
    crossed = {
        network.end_junction[network.links[one].start[0]]
        for one, _ in shapely.STRtree(ways).query(ways, predicate="crosses").T
    }
    for junction in crossed:
        arriving = [
            sum(lines.lane(s.lane_id).kind is not LaneKind.BIKE for s in road)
            for road, end in zip(network.roads, network.end_junction, strict=True)
            if end == junction
        ]
        if sum(arriving) >= _MANY_LANES and len(arriving) > 2:
            kinds[junction] = NodeKind.SIGNALS
        elif len(arriving) >= 4:
            kinds[junction] = NodeKind.ALL_WAY_STOP
    return kinds


def _edges(lines: LaneLines, network: LaneRoads) -> Iterator[ElementTree.Element]:
    for index, road in enumerate(network.roads):
        middle = lines.line((road[len(road) // 2],))
        num_wide = sum(lines.lane(s.lane_id).kind is LaneKind.VEHICLE for s in road)
        attributes = {
            "id": f"r{index}",
            "from": f"n{network.start_junction[index]}",
            "to": f"n{network.end_junction[index]}",
            "numLanes": str(len(road)),
            "spreadType": "center",
            "speed": f"{_SPEED_MPS[min(max(num_wide, 1), 3) - 1]:.2f}",
            "priority": str(1 + num_wide),
            "shape": shape_text(middle, 4),
        }
        edge = ElementTree.Element("edge", attributes)
        for place, interval in enumerate(road):
            ElementTree.SubElement(
                edge,
                "lane",
                index=str(place),
                allow=_STRIP_OF[lines.lane(interval.lane_id).kind].value,
                width=f"{_width_m(lines, interval.lane_id):.2f}",
                shape=shape_text(lines.line((interval,)), 4),
            )
        yield edge


def _width_m(lines: LaneLines, lane_id: int) -> float:
    """Median distance of a lane's boundaries, clamped to widths that SUMO supports."""
    lane = lines.lane(lane_id)
    across = resample(lane.left_m, 9) - resample(lane.right_m, 9)
    return float(np.clip(np.median(np.hypot(*across.T)), 1.2, 5.0))


def _connections(lines: LaneLines, network: LaneRoads) -> Iterator[ElementTree.Element]:
    for link in network.links:
        shape = shape_text(lines.line(link.lane_intervals), 4)
        yield ElementTree.Element("connection", dict(_key(link)), shape=shape)
    leaving = {link.start[0] for link in network.links}
    for index in set(range(len(network.roads))) - leaving:
        yield ElementTree.Element("connection", {"from": f"r{index}"})


def _key(link: Link) -> tuple[tuple[str, str], ...]:
    return (
        ("from", f"r{link.start[0]}"),
        ("to", f"r{link.end[0]}"),
        ("fromLane", str(link.start[1])),
        ("toLane", str(link.end[1])),
    )


def _with_own_lines(
    lines: LaneLines, network: LaneRoads, root: ElementTree.Element
) -> dict[str, tuple[LaneInterval, ...]]:
    """Set the centre line of every lane of the net; returns the lane intervals."""
    lane_of = {lane.attrib["id"]: lane for lane in root.iter("lane")}
    lane_intervals: dict[str, tuple[LaneInterval, ...]] = {}
    for index, road in enumerate(network.roads):
        length = _mean_length_m(road)
        for place, interval in enumerate(road):
            name = f"r{index}_{place}"
            if name not in lane_of:
                raise SynthesisError(
                    f"netconvert left out lane {interval.lane_id} of the map."
                )
            _set_line(lane_of[name], lines.line((interval,)), length)
            lane_intervals[name] = (interval,)
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
                f"netconvert left out the connection from lane {link.lane_intervals[0].lane_id} "
                f"to lane {link.lane_intervals[-1].lane_id} of the map."
            )
        names = []
        while name is not None:
            names.append(name)
            name = following[name]
        _divide(lines, link, [lane_of[name] for name in names], lane_intervals)
    return lane_intervals


def _mean_length_m(road: Road) -> float:
    return float(np.mean([s.end_m - s.start_m for s in road]))


def _set_line(
    lane: ElementTree.Element, points_m: Float[np.ndarray, "N 2"], length_m: float
) -> None:
    """Set line, length, and speed limit for the sharpest curve of a lane."""
    lane.set("shape", shape_text(points_m, 4))
    lane.set("length", f"{length_m:.4f}")
    limit = float(lane.attrib["speed"])
    # Lateral acceleration of an average driver in a curve.
    in_bend = curve_speed_mps(points_m, 2.2)
    lane.set("speed", f"{min(limit, in_bend):.2f}")


def _divide(
    lines: LaneLines,
    link: Link,
    lanes: list[ElementTree.Element],
    lane_intervals: dict[str, tuple[LaneInterval, ...]],
) -> None:
    """Divide a link among its internal lanes; it has several if drivers wait inside."""
    lengths = np.array([float(lane.attrib["length"]) for lane in lanes])
    total = float(arc_length(lines.line(link.lane_intervals))[-1])
    bounds = np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()]) * total
    for lane, start, end in zip(lanes, bounds[:-1], bounds[1:], strict=True):
        part = _sub(link.lane_intervals, float(start), float(end))
        _set_line(lane, lines.line(part), max(float(end - start), 0.1))
        lane_intervals[lane.attrib["id"]] = part


def _sub(
    lane_intervals: tuple[LaneInterval, ...], start_m: float, end_m: float
) -> tuple[LaneInterval, ...]:
    """Part of consecutive intervals between two arc lengths."""
    found = []
    passed = 0.0
    for interval in lane_intervals:
        length = interval.end_m - interval.start_m
        low, high = max(start_m - passed, 0.0), min(end_m - passed, length)
        if high - low > 1e-6:
            found.append(
                LaneInterval(
                    lane_id=interval.lane_id,
                    start_m=interval.start_m + low,
                    end_m=interval.start_m + high,
                )
            )
        passed += length
    return tuple(found)


FAMILY: Final = "av2"
SPACING_M: Final = 1.0
NEEDED_M: Final = 1.9
"""Least width of drivable area beside a lane on which vehicles park."""
MAX_ROOM_M: Final = 5.0
"""A lane with more drivable area than this beside it has no kerb there."""
HALF_VEHICLE_M: Final = 1.15
"""Distance from the kerb to the centre of a vehicle parked along it."""
MIN_LENGTH_M: Final = 14.0
WIDE_M: Final = 4.8
"""Least width of kerb lanes that include a parking strip."""


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
    become connections, for which SUMO applies right of way. netconvert shortens lanes at
    junctions; the priorities that it determines remain valid for the original centre
    lines, which are restored.

    Raises:
        SynthesisError: the map has no lanes, or SUMO is missing or refused them.
    """
    if not road_map.lanes:
        raise SynthesisError(f"Map {name} has no lanes to drive on.")
    folder.mkdir(parents=True, exist_ok=True)
    lines = LaneLines(road_map=road_map)
    network = lane_roads(lines)
    path = run_netconvert(
        folder,
        _nodes(lines, network),
        _edges(lines, network),
        _connections(lines, network),
        "--junctions.join false --check-lane-foes.all",
    )
    tree = ElementTree.parse(path)
    lane_intervals = _with_own_lines(lines, network, tree.getroot())
    tree.write(path, encoding="utf-8")
    return Av2Network(
        name=name,
        family=FAMILY,
        folder=folder,
        net_file=path,
        road_map=road_map,
        lane_of_sumo={
            sumo_id: tuple(dict.fromkeys(part.lane_id for part in parts))
            for sumo_id, parts in lane_intervals.items()
        },
        has_signals=tree.getroot().find("tlLogic") is not None,
        parking_strips_m=parking_strips(road_map),
        footways=footways_of(road_map),
        lane_intervals=lane_intervals,
    )


def parking_strips(road_map: RoadMap) -> tuple[Float[np.ndarray, "_ 2"], ...]:
    """Centre lines of parking strips beside or on rightmost lanes, in driving direction."""
    if not road_map.drivable_areas:
        return ()
    paved = shapely.union_all(
        [
            shapely.Polygon(area.boundary[:, :2]).buffer(0)
            for area in road_map.drivable_areas
        ]
    )
    shapely.prepare(paved)
    strips: list[Float[np.ndarray, "_ 2"]] = []
    for lane in kerb_lanes(road_map.lanes):
        strips += _beside(lane, paved) or _within(lane)
    return tuple(strips)


def _within(lane: Lane) -> list[Float[np.ndarray, "_ 2"]]:
    """Parking strips along the right edge of a lane that is wide enough."""
    length = float(arc_length(lane.right_m)[-1])
    if length < MIN_LENGTH_M:
        return []
    num_points = int(length / SPACING_M) + 2
    right = resample(lane.right_m, num_points)
    across = resample(lane.left_m, num_points) - right
    width = np.linalg.norm(across, axis=1)
    if np.median(width) < WIDE_M:
        return []
    return [right + HALF_VEHICLE_M * across / np.maximum(width, 1e-9)[:, None]]


def _beside(lane: Lane, paved: shapely.Geometry) -> list[Float[np.ndarray, "_ 2"]]:
    """Parking strips on the drivable area to the right of a lane."""
    length = float(arc_length(lane.right_m)[-1])
    if length < MIN_LENGTH_M:
        return []
    along = np.arange(0.0, length, SPACING_M)
    edge = point_at(lane.right_m, along)
    ahead = point_at(lane.right_m, along + 1.0) - point_at(lane.right_m, along - 1.0)
    norm = np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    right = -left_of(ahead / norm)
    reach = np.arange(0.2, MAX_ROOM_M + 0.4, 0.2)
    probes = edge[:, None] + reach[:, None] * right[:, None]
    outside = ~shapely.contains_xy(paved, probes[..., 0], probes[..., 1])
    room = np.where(outside.any(axis=1), reach[outside.argmax(axis=1)], np.inf)
    fits = (room >= NEEDED_M) & (room <= MAX_ROOM_M)
    middle = edge + (np.minimum(room, MAX_ROOM_M) - HALF_VEHICLE_M)[:, None] * right
    bounds = np.flatnonzero(np.diff(fits.astype(int), prepend=0, append=0))
    return [
        middle[start:end]
        for start, end in zip(bounds[::2], bounds[1::2], strict=True)
        if (end - start) * SPACING_M >= MIN_LENGTH_M
    ]
