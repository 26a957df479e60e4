"""Drivable areas of a SUMO net, as rings without holes."""

from collections.abc import Iterable

import shapely

from pd_editor.experiments.synthesis.sumo.sumo_net import SumoNet
from pd_editor.experiments.synthesis.sumo_to_av2.parking_bays import ParkingBay
from pd_editor.scene.geometry.paved_area import paved_rings, valid_area
from pd_editor.scene.road_map import DrivableArea, Lane, areas_of


def drivable_areas(
    net: SumoNet, lanes: tuple[Lane, ...], bays: Iterable[ParkingBay], first_id: int
) -> tuple[DrivableArea, ...]:
    """Drivable areas: lanes, parking strips, bays and junctions, without sidewalks."""
    ground = [valid_area(lane.outline_m()) for lane in lanes]
    ground += [
        shapely.LineString(lane.shape_m).buffer(lane.width_m / 2, cap_style="flat")
        for lane in net.lanes.values()
        if lane.is_parking
    ]
    ground += [shapely.make_valid(bay.area()) for bay in bays]
    junctions = shapely.union_all(
        [valid_area(area) for area in net.junction_areas_m.values() if len(area) > 2]
    )
    pavements = shapely.union_all(
        [valid_area(area) for area in net.walking_areas_m if len(area) > 2]
    )
    rings = paved_rings([*ground, junctions.difference(pavements)])
    return areas_of(rings, first_id)
