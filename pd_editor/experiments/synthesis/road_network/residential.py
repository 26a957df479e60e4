"""Residential areas: winding streets and dead ends."""

from typing import Final

import numpy as np
from jaxtyping import Float
from shapely import LineString

from pd_editor.experiments.synthesis.road_network.network import (
    NetworkBuilder,
    split,
)
from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    PlainNetwork,
)
from pd_editor.experiments.synthesis.road_network.streets import (
    Carriageway,
    between_poses,
    collector,
    corner_radius_m,
    crossing_width_m,
    direction,
    pose_at,
    random_warp,
    residential,
    sample_main_line,
    through_points,
)
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.polyline import arc_length, offset_line, point_at

_BULB_RADIUS_M: Final = 8.0
"""Radius of the left lane edge around the bulb of a cul-de-sac."""


def generate_winding_street(random: np.random.Generator) -> PlainNetwork:
    """Generate a winding street with winding side streets."""
    style = residential(random)
    builder = NetworkBuilder(warp=random_warp(random, 6.0))
    points = _bends(random)
    names = [f"w{k}" for k in range(len(points))]
    has_side = [0 < k < len(points) - 1 for k in range(len(points))]
    swing = random.uniform(-0.5, 0.5, len(points))
    line, at = through_points(np.array(points), swing)
    for name, point, inner in zip(names, points, has_side, strict=True):
        kind = NodeKind.PRIORITY
        if inner:
            kind = [NodeKind.ALL_WAY_STOP, NodeKind.MINOR_STOP, NodeKind.PRIORITY][
                random.integers(3)
            ]
        builder.node(name, point, kind, corner_radius_m(random))
    for k, part in enumerate(split(line, at)):
        builder.street(names[k], names[k + 1], part, style)
    for k, place in enumerate(at, start=1):
        for side in _sides(random):
            lengths = 90.0, 180.0
            part, _ = _side_street(line, place, side, random, lengths, 0.5, 0.8)
            if builder.is_free(part):
                far = _far_name(names[k], side)
                builder.node(far, part[-1])
                builder.street(names[k], far, part, residential(random))
    return builder.network(crossing_width_m(random))


def generate_dead_ends(random: np.random.Generator) -> PlainNetwork:
    """Generate a through street with cul-de-sacs, most of which end in a bulb."""
    builder = NetworkBuilder()
    main = collector(random)
    line, at = sample_main_line(random, (420, 560), (70, 100), (55, 110), 60)
    places = np.array([0.0, *at, arc_length(line)[-1]])
    names = [f"m{k}" for k in range(len(places))]
    for name, point in zip(names, point_at(line, places), strict=True):
        kind = NodeKind.MINOR_STOP if random.random() < 0.5 else NodeKind.PRIORITY
        builder.node(name, point, kind, corner_radius_m(random))
    for k, part in enumerate(split(line, at)):
        builder.street(names[k], names[k + 1], part, main)
    for k, place in enumerate(at, start=1):
        for side in _sides(random):
            _dead_end(builder, names[k], line, place, side, random)
    return builder.network(crossing_width_m(random))


def _sides(random: np.random.Generator) -> list[int]:
    if random.random() < 0.3:
        return [1, -1]
    return [int(random.choice([1, -1]))]


def _bends(random: np.random.Generator) -> list[Float[np.ndarray, "2"]]:
    """Points at which a winding street meets others."""
    heading = float(random.uniform(0, 2 * np.pi))
    point, points = np.zeros(2), [np.zeros(2)]
    for _ in range(int(random.integers(4, 6))):
        swing = heading + float(random.uniform(-0.55, 0.55))
        step = float(random.uniform(95, 150))
        point = point + step * unit_vector(swing)
        points.append(point)
    return points


def _far_name(name: str, side: int) -> str:
    return f"{name}.{'left' if side > 0 else 'right'}"


def _side_street(
    line: Float[np.ndarray, "N 2"],
    place_m: float,
    side: int,
    random: np.random.Generator,
    length_m: tuple[float, float],
    slant: float,
    swing: float,
) -> tuple[Float[np.ndarray, "M 2"], Float[np.ndarray, "2"]]:
    """A curve that leaves a line to the left (1) or right (-1), and its last direction."""
    here, ahead = pose_at(line, place_m)
    away = side * left_of(ahead)
    across = left_of(away)
    length = float(random.uniform(*length_m))
    end = here + length * (away + float(random.uniform(-slant, slant)) * across)
    last = away + float(random.uniform(-swing, swing)) * across
    last = last / np.linalg.norm(last)
    return between_poses(here, away, end, last), last


def _dead_end(
    builder: NetworkBuilder,
    name: str,
    line: Float[np.ndarray, "N 2"],
    place_m: float,
    side: int,
    random: np.random.Generator,
) -> None:
    style, far_name = residential(random), _far_name(name, side)
    middle, ahead = _side_street(line, place_m, side, random, (60.0, 150.0), 0.35, 0.6)
    reach = np.concatenate([middle, (middle[-1:] + 4 * _BULB_RADIUS_M * ahead)])
    if not builder.is_free(reach):
        return
    if random.random() < 0.7:
        _bulb_street(builder, name, far_name, middle, style)
    else:
        builder.node(far_name, middle[-1])
        builder.street(name, far_name, middle, style)


def _bulb_street(
    builder: NetworkBuilder,
    name: str,
    tip: str,
    middle_m: Float[np.ndarray, "N 2"],
    style: Carriageway,
) -> None:
    """Add a street whose two directions meet at the tip of a round end."""
    ahead = direction(middle_m[-2:])
    left = left_of(ahead)
    center = middle_m[-1] + (2.4 * _BULB_RADIUS_M) * ahead
    sweep = np.radians(np.linspace(-125.0, 0.0, 14))
    round_m = center + _BULB_RADIUS_M * (
        np.cos(sweep)[:, None] * ahead + np.sin(sweep)[:, None] * left
    )
    tangent = -np.sin(sweep[0]) * ahead + np.cos(sweep[0]) * left
    lead = between_poses(middle_m[-1], ahead, round_m[0], tangent)
    inward = np.concatenate([lead, round_m[1:]])
    offset = inward - center
    mirrored = (
        center + (offset @ ahead)[:, None] * ahead - (offset @ left)[:, None] * left
    )
    builder.node(tip, round_m[-1])
    builder.lines.append(LineString(np.concatenate([middle_m, round_m])))
    there = np.concatenate([middle_m, inward[1:]])
    back = np.concatenate([mirrored[::-1], middle_m[-2::-1]])
    for start, end, edge in ((name, tip, there), (tip, name, back)):
        shifted = offset_line(edge, -style.median_m / 2)
        builder.one_way(start, end, shifted, style.strips(), style.speed_mps)
