"""Main roads with side streets: arterials, and rows of T-junctions."""

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.road_network.network import (
    NetworkBuilder,
    split,
)
from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    PlainNetwork,
)
from pd_editor.experiments.synthesis.road_network.street_curves import (
    curve,
    pose_at,
    sample_curve_kind,
    sample_main_line,
)
from pd_editor.experiments.synthesis.road_network.street_types import (
    Carriageway,
    avenue,
    collector,
    control,
    corner_radius_m,
    crossing_width_m,
    residential,
)
from pd_editor.scene.geometry.angles import left_of
from pd_editor.scene.geometry.polyline import arc_length, point_at


def generate_arterial(random: np.random.Generator) -> PlainNetwork:
    """Generate a main road with left-turn lanes that is crossed by streets."""
    main = avenue(random)
    builder = NetworkBuilder()
    line, at = sample_main_line(random, (480, 640), (80, 120), (95, 180), 70)
    names = _main_nodes(builder, line, at)
    _join(builder, names, line, at, main, float(random.uniform(30, 55)))
    for name, place in zip(names[1:-1], at, strict=True):
        street_type = collector if random.random() < 0.5 else residential
        style = street_type(random)
        sides = [1, -1] if random.random() < 0.65 else [int(random.choice([1, -1]))]
        kind = control(main, style, random)
        _reset(builder, name, kind, corner_radius_m(random))
        for side in sides:
            _side_street(builder, name, line, place, side, style, random)
    return builder.network(crossing_width_m(random))


def generate_t_junctions(random: np.random.Generator) -> PlainNetwork:
    """Generate a through street with side streets on alternating sides."""
    main = collector(random)
    builder = NetworkBuilder()
    line, at = sample_main_line(random, (480, 640), (80, 120), (45, 110), 70)
    names = _main_nodes(builder, line, at)
    _join(builder, names, line, at, main, 0.0)
    side = int(random.choice([1, -1]))
    for name, place in zip(names[1:-1], at, strict=True):
        style = residential(random)
        kind = NodeKind.MINOR_STOP if random.random() < 0.6 else NodeKind.PRIORITY
        if random.random() < 0.2:
            kind = NodeKind.SIGNALS
        _reset(builder, name, kind, corner_radius_m(random))
        _side_street(builder, name, line, place, side, style, random)
        side = -side if random.random() < 0.75 else side
    return builder.network(crossing_width_m(random))


def _main_nodes(
    builder: NetworkBuilder, line: Float[np.ndarray, "N 2"], at: list[float]
) -> list[str]:
    places = [0.0, *at, float(arc_length(line)[-1])]
    names = [f"m{k}" for k in range(len(places))]
    for name, point in zip(names, point_at(line, np.array(places)), strict=True):
        builder.node(name, point)
    return names


def _reset(builder: NetworkBuilder, name: str, kind: NodeKind, radius_m: float) -> None:
    builder.node(name, builder.point_m(name), kind, radius_m)


def _join(
    builder: NetworkBuilder,
    names: list[str],
    line: Float[np.ndarray, "N 2"],
    at: list[float],
    main: Carriageway,
    bay_m: float,
) -> None:
    for k, part in enumerate(split(line, at)):
        bays = k > 0, k < len(at)
        builder.street(names[k], names[k + 1], part, main, bay_m=bay_m, bays=bays)


def _side_street(
    builder: NetworkBuilder,
    name: str,
    line: Float[np.ndarray, "N 2"],
    place_m: float,
    side: int,
    style: Carriageway,
    random: np.random.Generator,
) -> None:
    """Add a side street to the left (1) or right (-1), nearly perpendicular."""
    here, ahead = pose_at(line, place_m)
    away = side * left_of(ahead)
    away = away + float(random.normal(0.0, 0.12)) * ahead
    length = float(random.uniform(90, 200))
    far = f"{name}.{'left' if side > 0 else 'right'}"
    kind = sample_curve_kind(random)
    middle = curve(here, here + length * away, kind, float(random.uniform(-0.5, 0.5)))
    if builder.is_free(middle):
        builder.node(far, here + length * away)
        builder.street(name, far, middle, style)
