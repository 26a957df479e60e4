"""Room to park beside streets: bays at an angle to the lane, and wide kerb lanes."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet
from pd_editor.scene.geometry.polyline import (
    arc_length,
    offset_line,
    point_at,
    without_repeats,
)
from pd_editor.scene.road_map import Lane, LaneKind

BAY_SHARE: Final = 0.1
"""Share of street sides with a bay."""
END_M: Final = 3.0
"""Distance between a bay and both ends of its street side."""
MIN_LENGTH_M: Final = 10.0

BEHIND_M: Final = 2.7
"""Width of the drivable area beyond the centres of the vehicles."""


@dataclass(frozen=True, kw_only=True)
class _BayKind:
    """Places at an angle to the lane; lanes of recorded maps often include a part."""

    pitch_m: float
    aside_m: tuple[float, float]
    """Range of the distance from the lane's edge to the centres of the vehicles."""
    angle_deg: tuple[float, float] = (-90.0, -90.0)
    """Range of their angle to the lane."""


_PERPENDICULAR: Final = _BayKind(pitch_m=2.75, aside_m=(1.6, 5.0))
_ANGLED: Final = _BayKind(pitch_m=3.5, aside_m=(1.2, 3.2), angle_deg=(-60.0, -42.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class ParkingBay:
    """A row of places at one angle beside a street."""

    lane_id: int
    """Lane to whose right the bay is."""
    kerb_m: Float[np.ndarray, "N 2"]
    """Right boundary of the lane along the bay, in driving direction."""
    angle_rad: float
    """Angle of the vehicles to the lane; clockwise angles are negative."""
    aside_m: float
    """Distance from the kerb to the centres of the vehicles."""
    pitch_m: float
    """Distance between neighbours."""

    @property
    def is_perpendicular(self) -> bool:
        """Whether vehicles stand at a right angle to the lane."""
        return bool(abs(self.angle_rad) > np.deg2rad(75.0))

    def area(self) -> shapely.Polygon:
        """Drivable area of the bay, beside the lane."""
        outer = offset_line(self.kerb_m, -(self.aside_m + BEHIND_M))
        return shapely.Polygon(np.concatenate([self.kerb_m, outer[::-1]]))


def kerb_lanes(lanes: Iterable[Lane]) -> list[Lane]:
    """Rightmost lanes of streets outside junctions."""
    return [
        lane
        for lane in lanes
        if lane.right_neighbor is None
        and lane.kind is not LaneKind.BIKE
        and not lane.is_intersection
    ]


def sample_parking_bays(
    lanes: Iterable[Lane], random: np.random.Generator, share: float = BAY_SHARE
) -> tuple[ParkingBay, ...]:
    """Sample the bays of a road network: equal for all traffic on it."""
    found = []
    for lane in kerb_lanes(lanes):
        if random.random() >= share:
            continue
        is_perpendicular = random.random() < 0.25
        kind = _PERPENDICULAR if is_perpendicular else _ANGLED
        length = float(arc_length(lane.right_m)[-1])
        if length < 2 * END_M + MIN_LENGTH_M:
            continue
        at = np.linspace(END_M, length - END_M, int(length / 2.0) + 2)
        angle = -90.0 if is_perpendicular else random.uniform(*kind.angle_deg)
        found.append(
            ParkingBay(
                lane_id=lane.lane_id,
                kerb_m=point_at(lane.right_m, at),
                angle_rad=float(np.deg2rad(angle)),
                aside_m=random.uniform(*kind.aside_m),
                pitch_m=kind.pitch_m,
            )
        )
    return tuple(found)


SHARE_OF_SINGLE: Final = 0.55
"""Share of wide kerb lanes among streets with one lane per direction. A third of the
vehicles parked beside lanes in Argoverse 2 are within 2 m of the centre lines of lanes
that are 5 to 6 m wide."""
SHARE_OF_SEVERAL: Final = 0.3


def with_wide_kerb_lanes(net: SumoNet, random: np.random.Generator) -> SumoNet:
    """Widen some lanes of a net by the parking strip beside them.

    Traffic stays where it was, left of the new centre lines; vehicles park on the lane.
    """
    lanes = dict(net.lanes)
    for edge in net.junction_of:
        beside = net.lanes_of_edge[edge]
        num_driven = sum(lane.kind is not None for lane in beside)
        share = SHARE_OF_SINGLE if num_driven == 1 else SHARE_OF_SEVERAL
        is_wide = random.random() < share
        for strip in beside:
            if strip.is_parking and is_wide:
                for lane in beside:
                    if lane.index == strip.index + 1 and lane.kind is not None:
                        lanes[lane.sumo_id] = _widened(lane, strip.width_m)
    return replace(net, lanes=lanes)


def _widened(lane: SumoLane, by_m: float) -> SumoLane:
    """Widen a lane on its right."""
    middle = offset_line(without_repeats(lane.shape_m, 1e-3), -by_m / 2)
    return replace(lane, shape_m=middle, width_m=lane.width_m + by_m)
