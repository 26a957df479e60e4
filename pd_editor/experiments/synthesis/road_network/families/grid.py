"""Grids of streets: with avenues, or of one-way streets downtown."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.road_network.network import NetworkBuilder
from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    PlainNetwork,
)
from pd_editor.experiments.synthesis.road_network.street_curves import (
    CurveKind,
    random_warp,
)
from pd_editor.experiments.synthesis.road_network.street_types import (
    Carriageway,
    avenue,
    collector,
    control,
    corner_radius_m,
    crossing_width_m,
    one_way,
    residential,
)

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
