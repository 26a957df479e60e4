"""Junctions of main streets with slip lanes for turning right."""

from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.road_network.network import (
    TAPER_M,
    NetworkBuilder,
    split,
)
from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    PlainNetwork,
    Strip,
    StripKind,
)
from pd_editor.experiments.synthesis.road_network.street_curves import (
    CurveKind,
    between_poses,
    curve,
    direction,
    pose_at,
    sample_curve_kind,
)
from pd_editor.experiments.synthesis.road_network.street_types import (
    Carriageway,
    avenue,
    crossing_width_m,
    residential,
)
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.polyline import arc_length, offset_line

_SLIP_MPS: Final = 8.5
_SLIP_RAD: Final = 0.2
"""Angle between a street and the slip lane where it diverges or merges."""
_ISLAND_M: Final = 0.8
"""Gap between a street and the slip lane at its start and end."""


def generate_slip_lanes(random: np.random.Generator) -> PlainNetwork:
    """Generate a large junction with signals and slip lanes for right turns."""
    builder = NetworkBuilder()
    turn = float(random.uniform(0, 2 * np.pi))
    angles = turn + np.pi / 2 * np.arange(4) + random.uniform(-0.15, 0.15, 4)
    styles = [
        avenue(random).lanes_only(int(random.choice([1, 2, 3], p=[0.25, 0.55, 0.2])))
        for _ in range(2)
    ]
    builder.node("c", np.zeros(2), NodeKind.SIGNALS, 10.0)
    legs = [_leg_line(float(angle), random) for angle in angles]
    has_slip = random.random(4) < 0.7
    if not has_slip.any():
        has_slip[0] = True
    slip_m = float(random.uniform(48, 60))
    for k, line in enumerate(legs):
        builder.node(f"far{k}", line[-1])
        for arrives, slip in ((True, k), (False, (k - 1) % 4)):
            split_m = slip_m if has_slip[slip] else None
            _direction(builder, k, line, styles[k % 2], split_m, arrives=arrives)
    for k in range(4):
        if has_slip[k]:
            out = (k + 1) % 4
            _slip(builder, k, out, legs, (styles[k % 2], styles[out % 2]), slip_m)
        _side_streets(builder, k, legs[k], random)
    return builder.network(crossing_width_m(random))


def _leg_line(angle: float, random: np.random.Generator) -> Float[np.ndarray, "N 2"]:
    """Centre line of a street away from the junction, straight near it."""
    away = unit_vector(angle)
    far = float(random.uniform(210, 300))
    start = 90.0
    kind = sample_curve_kind(random)
    swing = angle + float(random.uniform(-0.25, 0.25))
    tip = start * away + (far - start) * unit_vector(swing)
    line = between_poses(start * away, away, tip, (tip - start * away) / (far - start))
    if kind is CurveKind.STRAIGHT:
        line = curve(start * away, far * away, kind, 0.0)
    inner = np.linspace(0.0, 1.0, 30)[:, None] * (start * away)
    return np.concatenate([inner, line[1:]])


def _direction(
    builder: NetworkBuilder,
    leg: int,
    line: Float[np.ndarray, "N 2"],
    style: Carriageway,
    slip_m: float | None,
    *,
    arrives: bool,
) -> None:
    """Add the direction of a leg to the junction or from it, split at its slip lane."""
    left = offset_line(line[::-1] if arrives else line, -style.median_m / 2)
    strips, speed = style.strips(), style.speed_mps
    start, end = (f"far{leg}", "c") if arrives else ("c", f"far{leg}")
    if slip_m is None:
        builder.one_way(start, end, left, strips, speed, 3)
        return
    length = float(arc_length(left)[-1])
    split_m = length - slip_m - TAPER_M if arrives else slip_m
    before, taper, after = split(left, [split_m, split_m + TAPER_M])
    node = f"fork{leg}" if arrives else f"join{leg}"
    builder.node(node, taper[0] if arrives else taper[-1])
    first = builder.one_way(start, node, before, strips, speed, 3)
    last = builder.one_way(node, end, after, strips, speed, 3)
    builder.connect(first, last, strips, [(k, k) for k in range(len(strips))])
    if arrives:
        builder.connect(first, f"{node}-join{(leg + 1) % 4}", strips, [(0, 0)])


def _slip(
    builder: NetworkBuilder,
    leg: int,
    out: int,
    legs: list[Float[np.ndarray, "_ 2"]],
    styles: tuple[Carriageway, Carriageway],
    slip_m: float,
) -> None:
    """Add the slip lane from one street to the next one to its right."""
    lane = Strip(kind=StripKind.CAR, width_m=4.0)
    into, away = styles
    width_in = into.median_m / 2 + into.width_m() + _ISLAND_M
    width_out = away.median_m / 2 + away.width_m() + _ISLAND_M
    approach = offset_line(legs[leg][::-1], -width_in)
    departure = offset_line(legs[out], -width_out)
    total = float(arc_length(approach)[-1])
    start, ahead = pose_at(approach, total - slip_m, 1.0)
    end, onward = pose_at(departure, slip_m, 1.0)
    ends = f"fork{leg}", f"join{out}"
    line = between_poses(
        start, _turned(ahead, -_SLIP_RAD), end, _turned(onward, _SLIP_RAD)
    )
    slip = builder.one_way(*ends, line, (lane,), _SLIP_MPS)
    builder.connect(slip, f"join{out}-far{out}", (lane,), [(0, 0)])
    builder.removed.append((f"fork{leg}-c", f"c-join{out}"))


def _turned(direction: Float[np.ndarray, "2"], angle: float) -> Float[np.ndarray, "2"]:
    """Rotate a direction to the left by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array(
        [c * direction[0] - s * direction[1], s * direction[0] + c * direction[1]]
    )


def _side_streets(
    builder: NetworkBuilder,
    leg: int,
    line: Float[np.ndarray, "N 2"],
    random: np.random.Generator,
) -> None:
    """Add a residential street across the far end of a leg, in some networks."""
    if random.random() < 0.5:
        return
    here, ahead = line[-1], direction(line[-2:])
    style = residential(random)
    builder.node(f"far{leg}", here, NodeKind.MINOR_STOP)
    for name, angle in (("left", np.pi / 2), ("right", -np.pi / 2)):
        if random.random() < 0.8:
            end = f"far{leg}.{name}"
            away = _turned(ahead, angle + float(random.normal(0.0, 0.1)))
            builder.node(end, here + float(random.uniform(70, 110)) * away)
            builder.street(f"far{leg}", end, builder.line_m(f"far{leg}", end), style)
