"""Who travels when and where, written down as SUMO reads it."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.synthesis.sumo.traffic_graph import TrafficEdge, TrafficGraph
from pd_editor.synthesis.traffic.demand_config import DemandOptions
from pd_editor.synthesis.traffic.routing import RouteChoice
from pd_editor.synthesis.traffic.vehicle_types import (
    MODELS,
    DrawnType,
    VehicleModel,
    draw_pedestrian_type,
    draw_type,
)

MEAN_TRAVEL_SPEED_MPS: Final = 6.0
"""Speed that turns a flow into the number of vehicles that are there at first."""

TYPICAL_LIMIT_MPS: Final = 12.0
FLOW_POWER: Final = 2.0
"""How much more traffic fast roads have: with this power of their speed limits."""

WALK_M: Final = 350.0
"""How far pedestrians go, as the crow flies."""

PEDESTRIAN_SPEED_MPS: Final = 1.3

ROUTES_PER_IDEA: Final = 6
"""Routes drawn from an entry before drivers change their minds on travel times."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Demand:
    """All trips of a simulation."""

    types: dict[str, DrawnType]
    """Type of each vehicle and pedestrian, by their SUMO id."""
    root: ElementTree.Element

    def write(self, path: Path) -> None:
        """Write a SUMO route file."""
        ElementTree.ElementTree(self.root).write(path, encoding="utf-8")


@dataclass(frozen=True, kw_only=True)
class _Trip:
    depart_s: float
    route: tuple[str, ...]
    starts_inside: bool
    model: VehicleModel


def draw_demand(
    graph: TrafficGraph,
    options: DemandOptions,
    duration_s: float,
    random: np.random.Generator,
) -> Demand:
    """Trips of all vehicles and pedestrians for a simulation of some length."""
    types: dict[str, DrawnType] = {}
    entries: list[tuple[float, list[ElementTree.Element]]] = []
    for number, trip in enumerate(_trips(graph, options, duration_s, random)):
        name = f"{trip.model.name}-{number:04d}"
        types[name] = draw_type(f"type-{name}", trip.model, random)
        vehicle = _vehicle(name, trip, graph, options, random)
        entries.append((trip.depart_s, [types[name].element, vehicle]))
    for number, (depart_s, start, end) in enumerate(
        _walks(graph, options, duration_s, random)
    ):
        name = f"pedestrian-{number:04d}"
        types[name] = draw_pedestrian_type(f"type-{name}", random)
        person = ElementTree.Element(
            "person",
            {
                "id": name,
                "type": f"type-{name}",
                "depart": f"{depart_s:.1f}",
                "departPos": "random",
            },
        )
        if random.random() < 0.15:
            wait_s = random.uniform(5.0, 120.0)
            ElementTree.SubElement(
                person, "stop", {"edge": start, "duration": f"{wait_s:.1f}"}
            )
        ElementTree.SubElement(person, "walk", {"from": start, "to": end})
        entries.append((depart_s, [types[name].element, person]))
    root = ElementTree.Element("routes")
    for _, elements in sorted(entries, key=lambda entry: entry[0]):
        root.extend(elements)
    return Demand(types=types, root=root)


def _trips(
    graph: TrafficGraph,
    options: DemandOptions,
    duration_s: float,
    random: np.random.Generator,
) -> list[_Trip]:
    trips: list[_Trip] = []
    for model, share in _present_models(options):
        choice = RouteChoice(
            graph=graph,
            vehicle_class=model.sumo_class,
            turn_cost_s=options.turn_cost_s,
            turn_aversion=options.turn_aversion,
        )
        for entry in choice.entries:
            num_lanes = len(graph.edges[entry].lanes_for(model.sumo_class))
            flow = share * options.flow_per_lane / 3600 * num_lanes
            flow *= (graph.edges[entry].speed_mps / TYPICAL_LIMIT_MPS) ** FLOW_POWER
            flow *= random.lognormal(0.0, options.flow_spread)
            trips += _trips_of(choice, entry, model, flow, duration_s, random)
    return trips


def _present_models(options: DemandOptions) -> list[tuple[VehicleModel, float]]:
    return [
        (model, options.shares[model.name])
        for model in MODELS
        if options.shares.get(model.name, 0.0) > 0
    ]


def _trips_of(
    choice: RouteChoice,
    entry: str,
    model: VehicleModel,
    flow: float,
    duration_s: float,
    random: np.random.Generator,
) -> list[_Trip]:
    """Trips from one entry: some on their way at first, the others come later."""
    num_later = random.poisson(flow * duration_s)
    probe = choice.draw(entry, ROUTES_PER_IDEA, random)
    if not probe:
        return []
    edges = choice.graph.edges
    length_m = np.mean([sum(edges[edge].length_m for edge in way) for way in probe])
    num_first = random.poisson(flow * length_m / MEAN_TRAVEL_SPEED_MPS)
    routes = list(probe)
    while len(routes) < num_first + num_later:
        routes += choice.draw(entry, ROUTES_PER_IDEA, random)
    departs = random.uniform(0.0, duration_s, num_later)
    trips = [
        _Trip(depart_s=float(at), route=way, starts_inside=False, model=model)
        for at, way in zip(departs, routes[num_first:], strict=False)
    ]
    for way in routes[:num_first]:
        lengths = np.array([edges[edge].length_m for edge in way])
        first = random.choice(len(way), p=lengths / lengths.sum())
        trips.append(
            _Trip(depart_s=0.0, route=way[first:], starts_inside=True, model=model)
        )
    return trips


def _vehicle(
    name: str,
    trip: _Trip,
    graph: TrafficGraph,
    options: DemandOptions,
    random: np.random.Generator,
) -> ElementTree.Element:
    vehicle = ElementTree.Element(
        "vehicle",
        {
            "id": name,
            "type": f"type-{name}",
            "depart": f"{trip.depart_s:.1f}",
            "departLane": "best",
            "departPos": "random_free" if trip.starts_inside else "base",
            "departSpeed": "max",
        },
    )
    ElementTree.SubElement(vehicle, "route", {"edges": " ".join(trip.route)})
    edges = [graph.edges[edge] for edge in trip.route[1:-1]]
    if trip.model.name == "bus":
        halts = [edge for edge in edges if random.random() < 0.35]
    elif random.random() < options.halting_share:
        halts = edges[-2:][:1]
    else:
        halts = []
    for edge in halts:
        _add_halt(vehicle, edge, trip.model, random)
    return vehicle


def _add_halt(
    vehicle: ElementTree.Element,
    edge: TrafficEdge,
    model: VehicleModel,
    random: np.random.Generator,
) -> None:
    """A stop at the right edge of an edge: a bus stop, a delivery, a passenger."""
    lanes = edge.lanes_for(model.sumo_class)
    if edge.length_m < 60.0:
        return
    may_block = len(lanes) > 1
    long_s = random.uniform(20.0, 120.0) if may_block else random.uniform(6.0, 20.0)
    duration_s = random.uniform(8.0, 25.0) if model.name == "bus" else long_s
    ElementTree.SubElement(
        vehicle,
        "stop",
        {
            "lane": lanes[0].lane_id,
            "endPos": f"{random.uniform(30.0, edge.length_m - 15.0):.1f}",
            "duration": f"{duration_s:.1f}",
        },
    )


def _walks(
    graph: TrafficGraph,
    options: DemandOptions,
    duration_s: float,
    random: np.random.Generator,
) -> list[tuple[float, str, str]]:
    """Departure, first and last edge of each pedestrian."""
    edges = graph.sidewalk_edges
    if not edges:
        return []
    lengths = np.array([edge.length_m for edge in edges])
    middles = np.array([edge.lanes[0].shape_m.mean(axis=0) for edge in edges])
    spread = options.pedestrian_spread
    crowd = random.lognormal(-0.5 * spread**2, spread)
    present = crowd * options.pedestrians_per_km * lengths.sum() / 1000
    walk_time_s = WALK_M / PEDESTRIAN_SPEED_MPS
    num_first = random.poisson(present)
    num_later = random.poisson(present * duration_s / walk_time_s)
    departs = np.concatenate(
        [np.zeros(num_first), random.uniform(0.0, duration_s, num_later)]
    )
    starts = random.choice(len(edges), size=len(departs), p=lengths / lengths.sum())
    walks = []
    for depart_s, start in zip(departs, starts, strict=True):
        near = np.linalg.norm(middles - middles[start], axis=1)
        reached = np.flatnonzero((near < WALK_M) & (near > 0))
        end = start if len(reached) == 0 else int(random.choice(reached))
        walks.append((float(depart_s), edges[start].edge_id, edges[end].edge_id))
    return walks
