"""Roundabouts, and the streets that lead to them."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.geometry.polyline import offset_line
from pd_editor.synthesis.road_network.cross_section import Carriageway
from pd_editor.synthesis.road_network.network_builder import NetworkSketch
from pd_editor.synthesis.road_network.plain_xml import (
    NodeKind,
    PlainNetwork,
    Strip,
    StripKind,
)
from pd_editor.synthesis.road_network.street_curves import (
    between_poses,
    curve,
    drawn_kind,
)
from pd_editor.synthesis.road_network.street_types import (
    collector,
    control,
    crossing_width_m,
    residential,
)

_FLARE_M: Final = 32.0
"""Before the ring, entry and exit part from each other."""
_RING_SPACING_M: Final = 2.0
_ENTRY_RAD: Final = np.radians(48.0)
"""Between the ring's direction and that of an entry or exit."""
_RADII_M: Final = {3: (17.0, 24.0), 4: (23.0, 28.0)}
"""Of the left edge of the ring, by its number of legs."""
_MEDIAN_M: Final = 0.8
_CLEAR_M: Final = 2.5
"""Between the ring and the places where entries end."""


@dataclass(frozen=True, kw_only=True)
class Ring:
    """The carriageway around the island."""

    radius_m: float
    """Of its left edge."""
    width_m: float
    strips: tuple[Strip, ...]

    @property
    def half_opening_rad(self) -> float:
        """Between a leg and the place where its entry meets the ring."""
        return 9.0 / self.radius_m

    @property
    def half_gap_rad(self) -> float:
        """Half of what a junction takes of the ring."""
        return 4.0 / self.radius_m

    def middle_m(self) -> float:
        """Radius of the middle of the carriageway."""
        return self.radius_m + self.width_m / 2


def draw_roundabout(random: np.random.Generator) -> PlainNetwork:
    """A ring with three or four legs; some legs meet another street further on."""
    sketch = NetworkSketch()
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
        style = replace(
            collector(random),
            num_lanes=num_lanes,
            bike_width_m=0.0,
            parking_width_m=0.0,
            sidewalk_width_m=0.0,
        )
        _leg(sketch, leg, float(angle), ring, style, random)
    _arcs(sketch, angles, ring)
    return sketch.network(crossing_width_m(random))


def _unit(angle: float) -> Float[np.ndarray, "2"]:
    return np.array([np.cos(angle), np.sin(angle)])


def _arcs(sketch: NetworkSketch, angles: Float[np.ndarray, "L"], ring: Ring) -> None:
    """Counter-clockwise arcs between the places where legs leave and join."""
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
        count = max(int(sweep * ring.radius_m / _RING_SPACING_M), 3)
        at = first + ring.half_gap_rad + np.linspace(0.0, sweep, count)
        arc = ring.radius_m * np.stack([np.cos(at), np.sin(at)], axis=-1)
        edges.append(sketch.one_way(start, end, arc, ring.strips, 7.5, priority=3))
    sketch.roundabouts.append((tuple(name for name, _ in places), tuple(edges)))


def _leg(
    sketch: NetworkSketch,
    leg: int,
    angle: float,
    ring: Ring,
    style: Carriageway,
    random: np.random.Generator,
) -> None:
    """Entry, exit, the street to them, and perhaps a junction at its far end."""
    outer = ring.radius_m + ring.width_m
    far = float(random.uniform(150, 230)) * _unit(angle)
    near = (outer + _FLARE_M) * _unit(angle)
    kind = drawn_kind(random)
    street = curve(near, far, kind, float(random.uniform(-0.4, 0.4)))
    side = residential(random)
    has_junction = random.random() < 0.5
    right_of_way = control(style, side, random) if has_junction else NodeKind.PRIORITY
    sketch.node(f"far{leg}", far, right_of_way)
    if has_junction:
        _cross_street(sketch, leg, street, side, style, random)
    _entry(sketch, leg, angle + ring.half_opening_rad, ring, street, style)
    _exit(sketch, leg, angle - ring.half_opening_rad, ring, street, style)


def _entry(
    sketch: NetworkSketch,
    leg: int,
    at: float,
    ring: Ring,
    street: Float[np.ndarray, "N 2"],
    style: Carriageway,
) -> None:
    sketch.node(f"in{leg}", ring.middle_m() * _unit(at))
    line = offset_line(street[::-1], -_MEDIAN_M / 2)
    at = at - 1.3 * ring.half_gap_rad
    point = (ring.radius_m + ring.width_m + _CLEAR_M) * _unit(at)
    toward = np.cos(_ENTRY_RAD) * _unit(at + np.pi / 2) - np.sin(_ENTRY_RAD) * _unit(at)
    curl = between_poses(line[-1], _direction(line[-2:]), point, toward)
    left = np.concatenate([line, curl[1:]])
    ends = f"far{leg}", f"in{leg}"
    sketch.one_way(*ends, left, style.strips(), style.speed_mps, style.num_lanes)


def _exit(
    sketch: NetworkSketch,
    leg: int,
    at: float,
    ring: Ring,
    street: Float[np.ndarray, "N 2"],
    style: Carriageway,
) -> None:
    sketch.node(f"out{leg}", ring.middle_m() * _unit(at))
    line = offset_line(street, -_MEDIAN_M / 2)
    at = at + 1.3 * ring.half_gap_rad
    point = (ring.radius_m + ring.width_m + _CLEAR_M) * _unit(at)
    away = np.cos(_ENTRY_RAD) * _unit(at + np.pi / 2) + np.sin(_ENTRY_RAD) * _unit(at)
    curl = between_poses(point, away, line[0], _direction(line[:2]))
    left = np.concatenate([curl, line[1:]])
    ends = f"out{leg}", f"far{leg}"
    sketch.one_way(*ends, left, style.strips(), style.speed_mps, style.num_lanes)


def _direction(points_m: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "2"]:
    step = points_m[1] - points_m[0]
    return step / np.linalg.norm(step)


def _cross_street(
    sketch: NetworkSketch,
    leg: int,
    street: Float[np.ndarray, "N 2"],
    side: Carriageway,
    style: Carriageway,
    random: np.random.Generator,
) -> None:
    """Streets left, right and ahead at the far end of a leg."""
    ahead = street[-1] - street[-3]
    heading = float(np.arctan2(ahead[1], ahead[0]))
    for k, turn in enumerate((-np.pi / 2, 0.0, np.pi / 2)):
        if k != 1 and random.random() < 0.25:
            continue
        name = f"far{leg}.{k}"
        reach = float(random.uniform(70, 130))
        away = _unit(heading + turn + float(random.normal(0.0, 0.1)))
        sketch.node(name, street[-1] + reach * away)
        line = sketch.line_m(f"far{leg}", name)
        sketch.street(f"far{leg}", name, line, style if k == 1 else side)
