"""Plans of streets: grids, irregular towns of SUMO's random plans, main roads with side streets."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.road_network.network import NetworkBuilder, split
from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    PlainNetwork,
)
from pd_editor.experiments.synthesis.road_network.streets import (
    Carriageway,
    CurveKind,
    avenue,
    collector,
    control,
    corner_radius_m,
    crossing_width_m,
    curve,
    one_way,
    pose_at,
    random_warp,
    residential,
    sample_curve_kind,
    sample_main_line,
    through_points,
)
from pd_editor.experiments.synthesis.sumo.sumo_tools import run_sumo_tool
from pd_editor.scene.geometry.angles import left_of
from pd_editor.scene.geometry.polyline import arc_length, point_at

Style = Callable[[np.random.Generator], Carriageway]


def generate_grid(random: np.random.Generator) -> PlainNetwork:
    """Generate blocks of 70-150 m between avenues, collectors and residential streets."""
    return _grid(random, {residential: 0.42, collector: 0.3, avenue: 0.28})


def generate_downtown(random: np.random.Generator) -> PlainNetwork:
    """Generate blocks between one-way streets, with some avenues."""
    return _grid(random, {one_way: 0.65, avenue: 0.2, collector: 0.15})


def _grid(random: np.random.Generator, shares: dict[Style, float]) -> PlainNetwork:
    columns, rows = _places(random), _places(random)
    style = [
        [_style(random, shares) for _ in range(len(places))]
        for places in (columns, rows)
    ]
    forward = random.random((2, max(len(columns), len(rows)))) < 0.5
    builder = NetworkBuilder(
        warp=random_warp(random, float(random.choice([0, 0, 3, 10])))
    )
    _nodes(builder, columns, rows, style, random)
    bay_m = float(random.uniform(25, 45))
    for i in range(len(columns)):
        for j in range(len(rows)):
            for axis, (di, dj) in enumerate([(0, 1), (1, 0)]):
                along, across = ((j, rows), (i, columns))[:: 1 if axis == 0 else -1]
                inner = 0 < across[0] < len(across[1]) - 1
                if not inner or along[0] + 1 == len(along[1]):
                    continue
                ends = [f"n{i}.{j}", f"n{i + di}.{j + dj}"]
                bays = along[0] > 0, along[0] + 2 < len(along[1])
                if style[axis][across[0]].is_one_way and not forward[axis, across[0]]:
                    ends.reverse()
                _block(builder, ends, style[axis][across[0]], bay_m, bays, random)
    return builder.network(crossing_width_m(random))


def _places(random: np.random.Generator) -> Float[np.ndarray, "N"]:
    """Positions of parallel streets; the first and last one are the network's ends."""
    blocks = random.uniform(70, 150, int(random.integers(3, 6)))
    return np.concatenate([[0.0], np.cumsum(blocks)])


def _style(random: np.random.Generator, shares: dict[Style, float]) -> Carriageway:
    chosen = random.choice(len(shares), p=list(shares.values()))
    return list(shares)[chosen](random)


def _nodes(
    builder: NetworkBuilder,
    columns: Float[np.ndarray, "C"],
    rows: Float[np.ndarray, "R"],
    style: list[list[Carriageway]],
    random: np.random.Generator,
) -> None:
    angle = float(random.uniform(0, np.pi / 2))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    for i, x in enumerate(columns):
        for j, y in enumerate(rows):
            inside = 0 < i < len(columns) - 1, 0 < j < len(rows) - 1
            if not any(inside):
                continue
            kind = NodeKind.PRIORITY
            if all(inside):
                kind = control(style[0][i], style[1][j], random)
            point = (np.array([x, y]) + random.normal(0.0, 2.0, 2)) @ turn
            builder.node(f"n{i}.{j}", point, kind, corner_radius_m(random))


def _block(
    builder: NetworkBuilder,
    ends: list[str],
    carriageway: Carriageway,
    bay_m: float,
    bays: tuple[bool, bool],
    random: np.random.Generator,
) -> None:
    kind = CurveKind.S_CURVE if random.random() < 0.15 else CurveKind.STRAIGHT
    line = builder.line_m(ends[0], ends[1], kind, float(random.uniform(-0.2, 0.2)))
    builder.street(ends[0], ends[1], line, carriageway, bay_m=bay_m, bays=bays)


_MAX_TURN_RAD: Final = 0.5
_SHARE_MAIN: Final = 0.35


def generate_town(random: np.random.Generator) -> PlainNetwork:
    """Generate residential streets and collectors that meet at angles above 60 degrees."""
    points, roads = _street_plan(random)
    streets = _streets(roads)
    styles = [collector(random), residential(random), residential(random)]
    shares = [_SHARE_MAIN, (1 - _SHARE_MAIN) / 2, (1 - _SHARE_MAIN) / 2]
    chosen = [styles[k] for k in random.choice(3, len(streets), p=shares)]
    meets: dict[str, list[Carriageway]] = {}
    for street, carriageway in zip(streets, chosen, strict=True):
        for name in (street[0], street[-1]):
            meets.setdefault(name, []).append(carriageway)
    builder = NetworkBuilder()
    for name in sorted(meets):
        there = sorted(meets[name], key=lambda carriageway: carriageway.num_lanes)
        kind = NodeKind.PRIORITY
        if len(there) > 2:
            kind = control(there[0], there[-1], random)
        builder.node(name, points[name], kind, corner_radius_m(random))
    for street, carriageway in zip(streets, chosen, strict=True):
        line = _middle(np.array([points[name] for name in street]), random)
        if builder.is_free(line, meets_at_end=True):
            builder.street(street[0], street[-1], line, carriageway)
    return builder.network(crossing_width_m(random))


def _middle(
    points_m: Float[np.ndarray, "N 2"], random: np.random.Generator
) -> Float[np.ndarray, "M 2"]:
    """Centre line of a street: one curve, or a smooth line through its points."""
    if len(points_m) == 2:
        kind = sample_curve_kind(random)
        turn = float(random.uniform(-_MAX_TURN_RAD, _MAX_TURN_RAD))
        return curve(points_m[0], points_m[1], kind, turn)
    swing = random.uniform(-0.2, 0.2, len(points_m))
    return through_points(points_m, swing)[0]


def _streets(roads: list[tuple[str, str]]) -> list[list[str]]:
    """Chains of roads, joined at nodes where only two roads meet."""
    beside: dict[str, list[str]] = {}
    for start, end in roads:
        beside.setdefault(start, []).append(end)
        beside.setdefault(end, []).append(start)
    streets, seen = [], set()
    for start in sorted(beside):
        if len(beside[start]) == 2:
            continue
        for after in beside[start]:
            if (start, after) in seen:
                continue
            street = [start, after]
            while len(beside[street[-1]]) == 2:
                one, two = beside[street[-1]]
                street.append(two if one == street[-2] else one)
            seen |= {(street[0], street[1]), (street[-1], street[-2])}
            if street[0] != street[-1]:
                streets.append(street)
    return streets


def _street_plan(
    random: np.random.Generator,
) -> tuple[dict[str, Float[np.ndarray, "2"]], list[tuple[str, str]]]:
    """Nodes, and pairs of nodes that are joined by a street."""
    plan = "--rand --rand.min-angle 62 --rand.connectivity 0.96 --rand.num-tries 30"
    plan += f" --rand.iterations {random.integers(16, 24)}"
    plan += f" --rand.min-distance {random.uniform(75, 95):.1f}"
    plan += f" --rand.max-distance {random.uniform(120, 170):.1f}"
    plan += f" --seed {random.integers(1, 10**6)}"
    plan += " --offset.disable-normalization --plain-output-prefix town"
    with TemporaryDirectory() as name:
        run_sumo_tool("netgenerate", plan.split(), Path(name))
        nodes = ElementTree.parse(Path(name) / "town.nod.xml").getroot()
        edges = ElementTree.parse(Path(name) / "town.edg.xml").getroot()
    points = {
        node.attrib["id"]: np.array([float(node.attrib[axis]) for axis in "xy"])
        for node in nodes.iterfind("node")
    }
    pairs = {(edge.attrib["from"], edge.attrib["to"]) for edge in edges.iter("edge")}
    roads = sorted({(min(pair), max(pair)) for pair in pairs})
    return points, roads


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
