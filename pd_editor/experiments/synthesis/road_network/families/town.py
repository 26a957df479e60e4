"""Irregular towns: SUMO's random street plans with curved streets."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.road_network.network import NetworkBuilder
from pd_editor.experiments.synthesis.road_network.plain_xml import (
    NodeKind,
    PlainNetwork,
)
from pd_editor.experiments.synthesis.road_network.street_curves import (
    curve,
    sample_curve_kind,
    through_points,
)
from pd_editor.experiments.synthesis.road_network.street_types import (
    Carriageway,
    collector,
    control,
    corner_radius_m,
    crossing_width_m,
    residential,
)
from pd_editor.experiments.synthesis.sumo.sumo_tools import run_sumo_tool

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
    parts = through_points(points_m, swing)
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


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
