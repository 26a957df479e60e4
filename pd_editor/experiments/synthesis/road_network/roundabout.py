"""Roundabouts, and the streets that lead to them."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.road_network.network import NetworkBuilder
from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    PlainNetwork,
    Strip,
    StripKind,
)
from pd_editor.experiments.synthesis.road_network.streets import (
    Carriageway,
    between_poses,
    collector,
    control,
    crossing_width_m,
    curve,
    direction,
    residential,
    sample_curve_kind,
)
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.polyline import offset_line

_ENTRY_RAD: Final = np.radians(48.0)
"""Angle between the ring and an entry or exit."""
_RADII_M: Final = {3: (17.0, 24.0), 4: (23.0, 28.0)}
"""Range of the radius of the ring's left edge, by its number of legs."""
_CLEAR_M: Final = 2.5
"""Distance between the ring and the ends of entries."""


@dataclass(frozen=True, kw_only=True)
class Ring:
    """Carriageway around the central island."""

    radius_m: float
    """Radius of its left edge."""
    width_m: float
    strips: tuple[Strip, ...]

    @property
    def half_opening_rad(self) -> float:
        """Angle between a leg and the point where its entry meets the ring."""
        return 9.0 / self.radius_m

    @property
    def half_gap_rad(self) -> float:
        """Half of the angle of the ring that a junction occupies."""
        return 4.0 / self.radius_m

    def middle_m(self) -> float:
        """Radius of the carriageway's centre line."""
        return self.radius_m + self.width_m / 2


def generate_roundabout(random: np.random.Generator) -> PlainNetwork:
    """Generate a ring with three or four legs, some with a junction at their end."""
    builder = NetworkBuilder()
    num_legs = int(random.choice([3, 4], p=[0.4, 0.6]))
    num_lanes = int(random.choice([1, 2], p=[0.75, 0.25]))
    turn = float(random.uniform(0, 2 * np.pi))
    angles = turn + 2 * np.pi * np.arange(num_legs) / num_legs
    angles = angles + random.uniform(-0.12, 0.12, num_legs)
    width = round(float(random.uniform(4.0, 4.8) if num_lanes == 1 else 3.7), 2)
    strips = (Strip(kind=StripKind.CAR, width_m=width),) * num_lanes
    ring = Ring(
        radius_m=float(random.uniform(*_RADII_M[num_legs])) + 5.0 * (num_lanes - 1),
        strips=strips,
        width_m=width * num_lanes,
    )
    for leg, angle in enumerate(angles):
        style = collector(random).lanes_only(num_lanes)
        _leg(builder, leg, float(angle), ring, style, random)
    _arcs(builder, angles, ring)
    return builder.network(crossing_width_m(random))


def _arcs(builder: NetworkBuilder, angles: Float[np.ndarray, "L"], ring: Ring) -> None:
    """Add counter-clockwise arcs between the exits and entries of legs."""
    places = []
    for leg, angle in enumerate(angles):
        places += [
            (f"out{leg}", angle - ring.half_opening_rad),
            (f"in{leg}", angle + ring.half_opening_rad),
        ]
    edges = []
    for k, (start, first) in enumerate(places):
        end, last = places[(k + 1) % len(places)]
        sweep = (last - first) % (2 * np.pi) - 2 * ring.half_gap_rad
        count = max(int(sweep * ring.radius_m / 2.0), 3)
        at = first + ring.half_gap_rad + np.linspace(0.0, sweep, count)
        arc = ring.radius_m * unit_vector(at)
        edges.append(builder.one_way(start, end, arc, ring.strips, 7.5, priority=3))
    builder.roundabouts.append((tuple(name for name, _ in places), tuple(edges)))


def _leg(
    builder: NetworkBuilder,
    leg: int,
    angle: float,
    ring: Ring,
    style: Carriageway,
    random: np.random.Generator,
) -> None:
    """Add entry, exit and street of a leg, and sometimes a junction at its far end."""
    outer = ring.radius_m + ring.width_m
    far = float(random.uniform(150, 230)) * unit_vector(angle)
    # Distance from the ring at which entry and exit separate.
    near = (outer + 32.0) * unit_vector(angle)
    kind = sample_curve_kind(random)
    street = curve(near, far, kind, float(random.uniform(-0.4, 0.4)))
    side = residential(random)
    has_junction = random.random() < 0.5
    right_of_way = control(style, side, random) if has_junction else NodeKind.PRIORITY
    builder.node(f"far{leg}", far, right_of_way)
    if has_junction:
        _cross_street(builder, leg, street, side, style, random)
    for enters in (True, False):
        _link(builder, leg, angle, ring, street, style, enters=enters)


def _link(
    builder: NetworkBuilder,
    leg: int,
    angle: float,
    ring: Ring,
    street: Float[np.ndarray, "N 2"],
    style: Carriageway,
    *,
    enters: bool,
) -> None:
    """Add the direction of a leg that enters the ring, or the one that leaves it."""
    side = 1 if enters else -1
    at = angle + side * ring.half_opening_rad
    name = f"{'in' if enters else 'out'}{leg}"
    builder.node(name, ring.middle_m() * unit_vector(at))
    line = offset_line(street[::-side], -0.8 / 2)
    at = at - side * 1.3 * ring.half_gap_rad
    point = (ring.radius_m + ring.width_m + _CLEAR_M) * unit_vector(at)
    around, inward = unit_vector(at + np.pi / 2), -side * unit_vector(at)
    way = np.cos(_ENTRY_RAD) * around + np.sin(_ENTRY_RAD) * inward
    if enters:
        curl = between_poses(line[-1], direction(line[-2:]), point, way)
        left, ends = np.concatenate([line, curl[1:]]), (f"far{leg}", name)
    else:
        curl = between_poses(point, way, line[0], direction(line[:2]))
        left, ends = np.concatenate([curl, line[1:]]), (name, f"far{leg}")
    builder.one_way(*ends, left, style.strips(), style.speed_mps, style.num_lanes)


def _cross_street(
    builder: NetworkBuilder,
    leg: int,
    street: Float[np.ndarray, "N 2"],
    side: Carriageway,
    style: Carriageway,
    random: np.random.Generator,
) -> None:
    """Add streets to the left, right and ahead at the far end of a leg."""
    ahead = street[-1] - street[-3]
    heading = float(np.arctan2(ahead[1], ahead[0]))
    for k, turn in enumerate((-np.pi / 2, 0.0, np.pi / 2)):
        if k != 1 and random.random() < 0.25:
            continue
        name = f"far{leg}.{k}"
        reach = float(random.uniform(70, 130))
        away = unit_vector(heading + turn + float(random.normal(0.0, 0.1)))
        builder.node(name, street[-1] + reach * away)
        line = builder.line_m(f"far{leg}", name)
        builder.street(f"far{leg}", name, line, style if k == 1 else side)
