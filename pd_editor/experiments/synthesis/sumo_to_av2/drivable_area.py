"""Drivable areas of a SUMO net, as rings without holes."""

from collections.abc import Iterable

import shapely

from pd_editor.experiments.synthesis.sumo_to_av2.parking_bays import ParkingBay
from pd_editor.scene.formats.sumo_net import SumoNet
from pd_editor.scene.geometry.paved_area import paved_rings, valid_area
from pd_editor.scene.road_map import DrivableArea, Lane, areas_of


def drivable_areas(
    net: SumoNet, lanes: tuple[Lane, ...], bays: Iterable[ParkingBay], first_id: int
) -> tuple[DrivableArea, ...]:
    """Drivable areas: lanes, parking strips, bays and junctions, without sidewalks."""
    ground = [valid_area(lane.outline_m()) for lane in lanes]
    ground += [shapely.make_valid(bay.area()) for bay in bays]
    return areas_of(paved_rings([*ground, *net.paved_beside_lanes()]), first_id)
