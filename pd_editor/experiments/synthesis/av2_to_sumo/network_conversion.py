"""Conversion of an Argoverse 2 map to a network for SUMO."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.av2_to_sumo.connections import lane_roads
from pd_editor.experiments.synthesis.av2_to_sumo.edges import LaneInterval, LaneLines
from pd_editor.experiments.synthesis.av2_to_sumo.net_file import write_lane_net
from pd_editor.experiments.synthesis.road_network.footways import footways_of
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.experiments.synthesis.sumo_to_av2.parking_bays import kerb_lanes
from pd_editor.scene.geometry.angles import left_of
from pd_editor.scene.geometry.polyline import arc_length, point_at, resample
from pd_editor.scene.road_map import Lane, RoadMap

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
