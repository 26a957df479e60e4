"""Irregular towns: SUMO's random street plans, their streets bent."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from xml.etree import ElementTree

import numpy as np

from pd_editor.synthesis.edge_shapes import CurveKind
from pd_editor.synthesis.network_sketch import NetworkSketch
from pd_editor.synthesis.plain_network import NodeKind, PlainNetwork
from pd_editor.synthesis.street import Carriageway
from pd_editor.synthesis.street_styles import (
    collector,
    control,
    crossing_width_m,
    residential,
)
from pd_editor.synthesis.sumo_tools import run_sumo_tool

_MAX_TURN_RAD: Final = 0.5
_SHARE_MAIN: Final = 0.35


def draw_town(random: np.random.Generator) -> PlainNetwork:
    """Quiet and through streets that meet at all angles above 60 degrees."""
    points, roads = _street_plan(random)
    styles = [collector(random), residential(random), residential(random)]
    shares = [_SHARE_MAIN, (1 - _SHARE_MAIN) / 2, (1 - _SHARE_MAIN) / 2]
    chosen = [styles[k] for k in random.choice(3, len(roads), p=shares)]
    meets: dict[str, list[Carriageway]] = {name: [] for name in points}
    for ends, carriageway in zip(roads, chosen, strict=True):
        for name in ends:
            meets[name].append(carriageway)
    sketch = NetworkSketch()
    for name, point in points.items():
        there = sorted(meets[name], key=lambda carriageway: carriageway.num_lanes)
        kind = NodeKind.PRIORITY
        if len(there) > 2:
            kind = control(there[0], there[-1], random)
        sketch.node(name, np.array(point), kind, float(random.uniform(5, 9)))
    kinds = list(CurveKind)
    for (start, end), carriageway in zip(roads, chosen, strict=True):
        curve_kind = kinds[random.integers(len(kinds))]
        turn = float(random.uniform(-_MAX_TURN_RAD, _MAX_TURN_RAD))
        line = sketch.line_m(start, end, curve_kind, turn)
        if sketch.is_free(line, meets_at_end=True):
            sketch.street(start, end, line, carriageway)
    return sketch.network(crossing_width_m(random))


def _street_plan(
    random: np.random.Generator,
) -> tuple[dict[str, tuple[float, float]], list[tuple[str, str]]]:
    """Nodes, and the pairs of them that a street joins."""
    plan = "--rand --rand.min-angle 62 --rand.connectivity 0.96 --rand.num-tries 30"
    plan += f" --rand.iterations {random.integers(20, 30)}"
    plan += f" --rand.min-distance {random.uniform(75, 95):.1f}"
    plan += f" --rand.max-distance {random.uniform(120, 170):.1f}"
    plan += f" --seed {random.integers(1, 10**6)}"
    plan += " --offset.disable-normalization --plain-output-prefix town"
    with TemporaryDirectory() as name:
        run_sumo_tool("netgenerate", plan.split(), Path(name))
        nodes = ElementTree.parse(Path(name) / "town.nod.xml").getroot()
        edges = ElementTree.parse(Path(name) / "town.edg.xml").getroot()
    points = {
        node.attrib["id"]: (float(node.attrib["x"]), float(node.attrib["y"]))
        for node in nodes.iterfind("node")
    }
    pairs = {(edge.attrib["from"], edge.attrib["to"]) for edge in edges.iter("edge")}
    roads = sorted({(min(pair), max(pair)) for pair in pairs})
    return {name: points[name] for name in sorted(points)}, roads
