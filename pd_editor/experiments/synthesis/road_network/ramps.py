"""Divided roads with ramps to parallel streets, and junctions with slip lanes for turning right."""

from dataclasses import dataclass, replace
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
from pd_editor.experiments.synthesis.road_network.streets import (
    Carriageway,
    CurveKind,
    avenue,
    between_poses,
    collector,
    control,
    crossing_width_m,
    curve,
    direction,
    pose_at,
    residential,
    sample_curve_kind,
)
from pd_editor.scene.geometry.angles import left_of, turned, unit_vector
from pd_editor.scene.geometry.polyline import arc_length, offset_line, point_at


@dataclass(frozen=True, kw_only=True, eq=False)
class _Side:
    """One direction of the divided road with its ramps and parallel street."""

    name: str
    left_m: Float[np.ndarray, "N 2"]
    """Left edge of its carriageway, in driving direction."""
    main: Carriageway
    lane: Strip
    """Strip of a ramp, and of the acceleration or deceleration lane."""

    def ramp_left_m(self, at_m: float) -> Float[np.ndarray, "2 2"]:
        """Two points of the left edge of the additional lane."""
        width = self.main.lane_width_m * self.main.num_lanes
        beside = offset_line(self.left_m, -width)
        return point_at(beside, np.array([at_m, at_m + 2.0]))


def generate_merge(random: np.random.Generator) -> PlainNetwork:
    """Generate two carriageways, each with an off-ramp, an on-ramp and a parallel street."""
    builder = NetworkBuilder()
    main = Carriageway(
        num_lanes=int(random.choice([2, 3], p=[0.7, 0.3])),
        lane_width_m=round(float(random.uniform(3.3, 3.7)), 2),
        speed_mps=float(random.uniform(14.0, 17.0)),
        median_m=float(random.uniform(2.0, 6.0)),
    )
    angle = float(random.uniform(0, 2 * np.pi))
    ahead = unit_vector(angle)
    kind = sample_curve_kind(random)
    reach = float(random.uniform(560, 660)) * ahead
    middle = curve(np.zeros(2), reach, kind, float(random.uniform(-0.4, 0.4)))
    num_sides = 2 if random.random() < 0.6 else 1
    for number, line in enumerate((middle, middle[::-1])):
        side = _Side(
            name="ab"[number],
            left_m=offset_line(line, -main.median_m / 2),
            main=main,
            lane=Strip(kind=StripKind.CAR, width_m=main.lane_width_m),
        )
        if number < num_sides:
            _with_ramps(builder, side, line, random)
        else:
            _plain(builder, side)
    return builder.network(crossing_width_m(random))


def _plain(builder: NetworkBuilder, side: _Side) -> None:
    start, end = f"{side.name}0", f"{side.name}9"
    builder.node(start, side.left_m[0])
    builder.node(end, side.left_m[-1])
    strips, speed = side.main.strips(), side.main.speed_mps
    builder.one_way(start, end, side.left_m, strips, speed, priority=5)


def _with_ramps(
    builder: NetworkBuilder,
    side: _Side,
    line: Float[np.ndarray, "N 2"],
    random: np.random.Generator,
) -> None:
    """Add the off-ramp, the on-ramp, and the parallel street's junctions between them."""
    total = float(arc_length(side.left_m)[-1])
    off_m = float(random.uniform(90, 120))
    # Length of acceleration and deceleration lanes.
    off_lane_m, on_lane_m = random.uniform(60.0, 90.0, 2)
    on_m = total - float(random.uniform(100, 120)) - on_lane_m
    names = _main_road(builder, side, [off_m, off_lane_m, on_m, on_lane_m])
    # Distance from the centre of the divided road to the parallel street.
    distance = float(random.uniform(55.0, 80.0)) + side.main.width_m()
    beside = offset_line(line, -distance)
    style = replace(collector(random), num_lanes=1)
    length = float(arc_length(beside)[-1])
    leave = off_m + off_lane_m + float(random.uniform(95, 120))
    enter = max(on_m - float(random.uniform(95, 120)), leave + 45.0)
    places = [0.0, min(leave, length - 120.0), min(enter, length - 60.0), length]
    _street_beside(builder, side, beside, places, style, random)
    leaves_m = off_m + off_lane_m
    _ramp(builder, side, names[1], leaves_m, beside, places[1], is_off=True)
    _ramp(builder, side, names[2], on_m, beside, places[2], is_off=False)


def _main_road(
    builder: NetworkBuilder, side: _Side, lengths_m: list[float]
) -> list[str]:
    """Add the carriageway with its additional lanes; returns its four inner nodes."""
    off_m, off_lane_m, on_m, on_lane_m = lengths_m
    opens, leaves = off_m, off_m + off_lane_m
    joins, closes = on_m, on_m + on_lane_m
    cuts = []
    for at in (opens, leaves, joins, closes):
        cuts += [at - TAPER_M / 2, at + TAPER_M / 2]
    parts = split(side.left_m, cuts)
    names = [f"{side.name}{k}" for k in (0, 1, 2, 3, 4, 9)]
    builder.node(names[0], side.left_m[0])
    builder.node(names[5], side.left_m[-1])
    for k, name in enumerate(names[1:5]):
        kind = NodeKind.ZIPPER if k == 3 else NodeKind.PRIORITY
        builder.node(name, parts[2 * k + 1][0], kind)
    strips, speed = side.main.strips(), side.main.speed_mps
    edges = []
    for k in range(5):
        lanes = (side.lane, *strips) if k in (1, 3) else strips
        ends = names[k], names[k + 1]
        edges.append(builder.one_way(*ends, parts[2 * k], lanes, speed, priority=5))
    number = len(strips)
    straight = [(k, k + 1) for k in range(number)]
    builder.connect(edges[0], edges[1], strips, [(0, 0), *straight])
    wider = (side.lane, *strips)
    back = [(b, a) for a, b in straight]
    builder.connect(edges[1], edges[2], wider, back)
    builder.connect(edges[2], edges[3], strips, straight)
    builder.connect(edges[3], edges[4], wider, [(0, 0), *back])
    ramp = (side.lane,)
    builder.connect(edges[1], f"{names[2]}-{side.name}.off", wider, [(0, 0)])
    builder.connect(f"{side.name}.on-{names[3]}", edges[3], ramp, [(0, 0)])
    return names[1:5]


def _street_beside(
    builder: NetworkBuilder,
    side: _Side,
    line: Float[np.ndarray, "N 2"],
    places: list[float],
    style: Carriageway,
    random: np.random.Generator,
) -> None:
    names = [f"{side.name}.{end}" for end in ("first", "off", "on", "last")]
    crossing = residential(random)
    for k, (name, point) in enumerate(
        zip(names, point_at(line, np.array(places)), strict=True)
    ):
        inner = k in (1, 2)
        kind = control(style, crossing, random) if inner else NodeKind.PRIORITY
        builder.node(name, point, kind)
    for k, part in enumerate(split(line, places[1:3])):
        builder.street(names[k], names[k + 1], part, style)
    for k in (1, 2):
        here, along = pose_at(line, places[k])
        far = f"{names[k]}.out"
        builder.node(far, here - float(random.uniform(70, 120)) * left_of(along))
        builder.street(names[k], far, builder.line_m(names[k], far), crossing)


def _ramp(
    builder: NetworkBuilder,
    side: _Side,
    node: str,
    at_m: float,
    beside: Float[np.ndarray, "N 2"],
    place_m: float,
    *,
    is_off: bool,
) -> None:
    """Add the ramp between an additional lane and a junction of the parallel street."""
    first_m = TAPER_M / 2 if is_off else -TAPER_M / 2 - 2.0
    edge = side.ramp_left_m(at_m + first_m)
    there, along = pose_at(beside, place_m)
    across = -left_of(along)
    end = edge[0] + 0.6 * across, direction(edge)
    street = there - 0.5 * side.lane.width_m * along
    if is_off:
        ends, line = (node, f"{side.name}.off"), between_poses(*end, street, across)
    else:
        ends, line = (f"{side.name}.on", node), between_poses(street, -across, *end)
    builder.one_way(*ends, line, (side.lane,), 11.0)


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
        start, turned(ahead, -_SLIP_RAD), end, turned(onward, _SLIP_RAD)
    )
    slip = builder.one_way(*ends, line, (lane,), 8.5)
    builder.connect(slip, f"join{out}-far{out}", (lane,), [(0, 0)])
    builder.removed.append((f"fork{leg}-c", f"c-join{out}"))


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
            away = turned(ahead, angle + float(random.normal(0.0, 0.1)))
            builder.node(end, here + float(random.uniform(70, 110)) * away)
            builder.street(f"far{leg}", end, builder.line_m(f"far{leg}", end), style)
