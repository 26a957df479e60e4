"""Roundabouts, and the streets that lead to them."""

from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.geometry.polyline import offset_line
from pd_editor.synthesis.edge_shapes import CurveKind, between_poses, curve
from pd_editor.synthesis.network_sketch import NetworkSketch
from pd_editor.synthesis.plain_network import PlainNetwork, Strip, StripKind
from pd_editor.synthesis.street import Carriageway
from pd_editor.synthesis.street_styles import (
    collector,
    control,
    crossing_width_m,
    residential,
)

_FLARE_M: Final = 32.0
"""Before the ring, entry and exit part from each other."""
_RING_SPACING_M: Final = 2.0
_ENTRY_RAD: Final = np.radians(38.0)
"""Between the ring's direction and that of an entry or exit."""


def draw_roundabout(random: np.random.Generator) -> PlainNetwork:
    """A ring with three or four legs; some legs meet another street further on."""
    sketch = NetworkSketch()
    radius = float(random.uniform(13.0, 22.0))
    num_legs = int(random.choice([3, 4], p=[0.4, 0.6]))
    turn = float(random.uniform(0, 2 * np.pi))
    angles = turn + 2 * np.pi * np.arange(num_legs) / num_legs
    angles = angles + random.uniform(-0.2, 0.2, num_legs)
    num_lanes = int(random.choice([1, 2], p=[0.75, 0.25]))
    ring_width = float(random.uniform(4.2, 5.0) if num_lanes == 1 else 3.8)
    ring = (Strip(kind=StripKind.CAR, width_m=round(ring_width, 2)),) * num_lanes
    outer = radius + ring_width * num_lanes
    half_opening = 11.0 / outer
    for leg, angle in enumerate(angles):
        style = collector(random)
        _leg(sketch, leg, float(angle), outer, half_opening, style, random)
    _ring(sketch, angles, radius, half_opening, ring)
    return sketch.network(crossing_width_m(random))


def _unit(angle: float) -> Float[np.ndarray, "2"]:
    return np.array([np.cos(angle), np.sin(angle)])


def _ring(
    sketch: NetworkSketch,
    angles: Float[np.ndarray, "L"],
    radius_m: float,
    half_opening: float,
    strips: tuple[Strip, ...],
) -> None:
    """Counter-clockwise arcs between the places where legs leave and join."""
    places = []
    for leg, angle in enumerate(angles):
        places += [
            (f"out{leg}", angle - half_opening),
            (f"in{leg}", angle + half_opening),
        ]
    edges = []
    for k, (start, first) in enumerate(places):
        end, last = places[(k + 1) % len(places)]
        if last < first:
            last = last + 2 * np.pi
        count = max(int((last - first) * radius_m / _RING_SPACING_M), 3)
        at = np.linspace(first, last, count)
        arc = radius_m * np.stack([np.cos(at), np.sin(at)], axis=-1)
        edges.append(sketch.one_way(start, end, arc, strips, 7.5, priority=3))
    sketch.roundabouts.append((tuple(name for name, _ in places), tuple(edges)))


def _leg(
    sketch: NetworkSketch,
    leg: int,
    angle: float,
    outer_m: float,
    half_opening: float,
    style: Carriageway,
    random: np.random.Generator,
) -> None:
    """Entry, exit, the street to them, and perhaps a junction at its far end."""
    far = float(random.uniform(150, 230)) * _unit(angle)
    near = (outer_m + _FLARE_M) * _unit(angle)
    kind = list(CurveKind)[random.integers(len(CurveKind))]
    street = curve(near, far, kind, float(random.uniform(-0.4, 0.4)))
    has_junction = random.random() < 0.5
    side = residential(random)
    sketch.node(f"far{leg}", far)
    if has_junction:
        sketch.node(f"far{leg}", far, control(style, side, random))
        _cross_street(sketch, leg, street, side, style, random)
    left_in = offset_line(street[::-1], -0.4)
    left_out = offset_line(street, -0.4)
    ring_m = outer_m - 2.0
    for name, line, at in (
        (f"in{leg}", left_in, angle + half_opening),
        (f"out{leg}", left_out, angle - half_opening),
    ):
        sketch.node(name, ring_m * _unit(at), radius_m=4.0)
        along = _unit(at + np.pi / 2)
        swing = np.cos(_ENTRY_RAD) * along
        point = (outer_m - 1.5) * _unit(at)
        if name.startswith("in"):
            ahead = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
            curl = between_poses(
                line[-1], ahead, point, swing - np.sin(_ENTRY_RAD) * _unit(at)
            )
            left = np.concatenate([line, curl[1:]])
            ends = f"far{leg}", name
        else:
            ahead = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
            curl = between_poses(
                point, swing + np.sin(_ENTRY_RAD) * _unit(at), line[0], ahead
            )
            left = np.concatenate([curl, line[1:]])
            ends = name, f"far{leg}"
        strips = style.strips()
        sketch.one_way(*ends, left, strips, style.speed_mps, style.num_lanes)


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
