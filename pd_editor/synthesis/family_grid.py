"""Urban grids: avenues and side streets at nearly right angles."""

import numpy as np

from pd_editor.synthesis.edge_shapes import CurveKind
from pd_editor.synthesis.plain_network import NodeKind, PlainNetwork
from pd_editor.synthesis.street import Carriageway, NetworkSketch
from pd_editor.synthesis.street_styles import avenue, collector, median_m, residential


def draw_grid(random: np.random.Generator) -> PlainNetwork:
    """Blocks of 70-150 m; each street keeps its style all along."""
    columns = _places(random)
    rows = _places(random)
    angle = float(random.uniform(0, np.pi / 2))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    style = {
        (axis, k): _style(random)
        for axis, places in ((0, columns), (1, rows))
        for k in range(1, len(places) - 1)
    }
    sketch = NetworkSketch()
    shift = random.normal(0.0, 3.0, (len(columns), len(rows), 2))
    for i in range(len(columns)):
        for j in range(len(rows)):
            inner = 0 < i < len(columns) - 1, 0 < j < len(rows) - 1
            if not any(inner):
                continue
            kind = NodeKind.PRIORITY
            if all(inner):
                kind = _control(style[0, i][0], style[1, j][0], random)
            point = np.array([columns[i], rows[j]]) + shift[i, j]
            sketch.node(f"n{i}.{j}", point @ turn, kind, float(random.uniform(5, 9)))
    for i in range(len(columns)):
        for j in range(len(rows)):
            if 0 < j < len(rows) - 1 and i + 1 < len(columns):
                _street(sketch, f"n{i}.{j}", f"n{i + 1}.{j}", style[1, j], random)
            if 0 < i < len(columns) - 1 and j + 1 < len(rows):
                _street(sketch, f"n{i}.{j}", f"n{i}.{j + 1}", style[0, i], random)
    return sketch.network(float(random.uniform(3.0, 5.5)))


def _places(random: np.random.Generator) -> np.ndarray:
    """Where parallel streets lie; the first and last place are their ends."""
    blocks = random.uniform(70, 150, int(random.integers(4, 6)))
    return np.concatenate([[0.0], np.cumsum(blocks)])


def _style(random: np.random.Generator) -> tuple[Carriageway, float]:
    draw = random.choice([residential, collector, avenue], p=[0.45, 0.3, 0.25])
    carriageway = draw(random)
    return carriageway, median_m(random) if draw is avenue else 0.0


def _control(
    one: Carriageway, two: Carriageway, random: np.random.Generator
) -> NodeKind:
    more, fewer = (
        max(one.num_lanes, two.num_lanes),
        min(one.num_lanes, two.num_lanes),
    )
    if more == 1:
        return NodeKind(
            random.choice(
                [NodeKind.ALL_WAY_STOP, NodeKind.MINOR_STOP, NodeKind.SIGNALS],
                p=[0.5, 0.3, 0.2],
            )
        )
    if fewer == 1:
        return NodeKind(
            random.choice([NodeKind.MINOR_STOP, NodeKind.SIGNALS], p=[0.4, 0.6])
        )
    return NodeKind.SIGNALS


def _street(
    sketch: NetworkSketch,
    start: str,
    end: str,
    style: tuple[Carriageway, float],
    random: np.random.Generator,
) -> None:
    carriageway, median = style
    bent = random.random() < 0.3
    line = sketch.line_m(
        start,
        end,
        CurveKind.ARC if bent else CurveKind.STRAIGHT,
        float(random.uniform(-0.25, 0.25)),
    )
    sketch.two_way(start, end, line, carriageway, median, carriageway.num_lanes)
