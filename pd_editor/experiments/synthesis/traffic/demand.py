"""Samples traffic demand: trips of vehicles and pedestrians as a SUMO route file."""

import heapq
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.experiments.synthesis.traffic.demand_config import (
    MODELS,
    DemandOptions,
    SampledType,
    VehicleModel,
    sample_pedestrian_type,
    sample_vehicle_type,
)
from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet, read_sumo_net


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficEdge:
    """One direction of a road between two junctions."""

    edge_id: str
    lanes: tuple[SumoLane, ...]

    @property
    def length_m(self) -> float:
        """Length of its lanes."""
        return self.lanes[0].length_m

    @property
    def has_sidewalk(self) -> bool:
        """Whether pedestrians have a lane of their own."""
        return any(lane.is_sidewalk for lane in self.lanes)

    @property
    def speed_mps(self) -> float:
        """Speed limit of its fastest lane."""
        return max(lane.speed_mps for lane in self.lanes)

    def lanes_for(self, vehicle_class: str) -> tuple[SumoLane, ...]:
        """Lanes that a vehicle class may use, from right to left."""
        return tuple(
            lane
            for lane in self.lanes
            if vehicle_class in lane.admitted and not lane.is_sidewalk
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficGraph:
    """Normal edges of a SUMO network, and the turns between them."""

    net: SumoNet

    @cached_property
    def edges(self) -> dict[str, TrafficEdge]:
        """Edges by their ids."""
        return {
            name: TrafficEdge(edge_id=name, lanes=tuple(self.net.lanes_of_edge[name]))
            for name in self.net.junction_of
        }

    @cached_property
    def sidewalk_edges(self) -> tuple[TrafficEdge, ...]:
        """Edges with a sidewalk."""
        return tuple(edge for edge in self.edges.values() if edge.has_sidewalk)

    def turns_for(self, vehicle_class: str) -> dict[str, dict[str, str]]:
        """Direction letters by edge and next edge, for a vehicle class."""
        found: dict[str, dict[str, str]] = {
            edge.edge_id: {}
            for edge in self.edges.values()
            if edge.lanes_for(vehicle_class)
        }
        for turn in self.net.turns:
            start, end = self.net.lanes[turn.start], self.net.lanes[turn.end]
            if (
                turn.direction != "t"
                and vehicle_class in start.admitted & end.admitted
                and not (start.is_sidewalk or end.is_sidewalk)
            ):
                found[start.edge][end.edge] = turn.direction
        return found


def read_traffic_graph(net_file: Path) -> TrafficGraph:
    """Read edges and turns of a SUMO network file.

    Raises:
        FormatError: the file is missing or no SUMO network.
    """
    return TrafficGraph(net=read_sumo_net(net_file))


TURN_SHARE: Final = {"s": 0.0, "L": 0.3, "R": 0.3, "l": 1.0, "r": 0.8}
"""Factor of the turn cost for each of SUMO's direction letters."""


ROUTES_PER_IDEA: Final = 6
"""Number of routes from an entry that share the same expected travel times."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RouteSampler:
    """Sampler of routes of one vehicle class from the network's entries to its exits."""

    graph: TrafficGraph
    vehicle_class: str
    options: DemandOptions

    @cached_property
    def next_edges(self) -> dict[str, dict[str, str]]:
        """Direction letter of each next edge of each edge."""
        return self.graph.turns_for(self.vehicle_class)

    @cached_property
    def entries(self) -> tuple[str, ...]:
        """Edges without a predecessor; all edges of a closed network."""
        followers = {edge for after in self.next_edges.values() for edge in after}
        found = tuple(edge for edge in self.next_edges if edge not in followers)
        return found or tuple(self.next_edges)

    def sample(
        self, entry: str, count: int, random: np.random.Generator
    ) -> list[tuple[str, ...]]:
        """Sample routes from one entry, with the same expected travel times for all."""
        cost, turns, before = self._tree(entry, random)
        ends = [edge for edge in cost if not self.next_edges[edge]]
        ends = ends or [edge for edge in cost if edge != entry]
        if not ends:
            return []
        num_turns = np.array([turns[edge] for edge in ends])
        weight = np.exp(-self.options.turn_aversion * num_turns)
        chosen = random.choice(len(ends), size=count, p=weight / weight.sum())
        routes = []
        for end in chosen:
            route = [ends[end]]
            while route[-1] != entry:
                route.append(before[route[-1]])
            routes.append(tuple(reversed(route)))
        return routes

    def _tree(
        self, entry: str, random: np.random.Generator
    ) -> tuple[dict[str, float], dict[str, float], dict[str, str]]:
        """Cost, number of turns and previous edge of each reached edge (Dijkstra)."""
        names = list(self.next_edges)
        noise = random.lognormal(0.0, self.options.cost_noise, len(names))
        time = {
            name: factor
            * self.graph.edges[name].length_m
            / self.graph.edges[name].speed_mps
            for name, factor in zip(names, noise, strict=True)
        }
        cost: dict[str, float] = {}
        turns = {entry: 0.0}
        before: dict[str, str] = {}
        queue = [(time[entry], entry, entry, 0.0)]
        while queue:
            spent, edge, last, turned = heapq.heappop(queue)
            if edge in cost:
                continue
            cost[edge], turns[edge], before[edge] = spent, turned, last
            for after, letter in self.next_edges[edge].items():
                if after not in cost:
                    share = TURN_SHARE.get(letter, 1.0)
                    reached = spent + time[after] + share * self.options.turn_cost_s
                    heapq.heappush(queue, (reached, after, edge, turned + share))
        return cost, turns, before


@dataclass(frozen=True, kw_only=True, eq=False)
class Demand:
    """All trips of a simulation."""

    types: dict[str, SampledType]
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


def sample_demand(
    graph: TrafficGraph,
    options: DemandOptions,
    duration_s: float,
    random: np.random.Generator,
) -> Demand:
    """Sample the trips of all vehicles and pedestrians of a simulation."""
    types: dict[str, SampledType] = {}
    entries: list[tuple[float, list[ElementTree.Element]]] = []
    for number, trip in enumerate(_trips(graph, options, duration_s, random)):
        name = f"{trip.model.name}-{number:04d}"
        types[name] = sample_vehicle_type(f"type-{name}", trip.model, options, random)
        vehicle = _vehicle(name, trip, graph, options, random)
        entries.append((trip.depart_s, [types[name].element, vehicle]))
    for number, (depart_s, start, end) in enumerate(
        _walks(graph, options, duration_s, random)
    ):
        name = f"pedestrian-{number:04d}"
        types[name] = sample_pedestrian_type(f"type-{name}", random)
        person = ElementTree.Element(
            "person",
            {
                "id": name,
                "type": f"type-{name}",
                "depart": f"{depart_s:.1f}",
                "departPos": "random",
            },
        )
        if random.random() < options.standing_share:
            wait_s = random.uniform(*options.standing_s)
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
    for model in MODELS:
        share = options.shares.get(model.name, 0.0)
        if share <= 0:
            continue
        choice = RouteSampler(
            graph=graph, vehicle_class=model.sumo_class, options=options
        )
        for entry in choice.entries:
            num_lanes = len(graph.edges[entry].lanes_for(model.sumo_class))
            flow = share * options.flow_per_lane / 3600 * num_lanes
            speed = graph.edges[entry].speed_mps / options.typical_limit_mps
            flow *= speed**options.flow_power
            flow *= random.lognormal(0.0, options.flow_spread)
            trips += _trips_of(choice, entry, model, flow, duration_s, random)
    return trips


def _trips_of(
    choice: RouteSampler,
    entry: str,
    model: VehicleModel,
    flow: float,
    duration_s: float,
    random: np.random.Generator,
) -> list[_Trip]:
    """Trips from one entry: some start on the road, the others enter later."""
    num_later = random.poisson(flow * duration_s)
    probe = choice.sample(entry, ROUTES_PER_IDEA, random)
    if not probe:
        return []
    edges = choice.graph.edges
    length_m = np.mean([sum(edges[edge].length_m for edge in way) for way in probe])
    num_first = random.poisson(flow * length_m / choice.options.mean_travel_mps)
    routes = list(probe)
    while len(routes) < num_first + num_later:
        routes += choice.sample(entry, ROUTES_PER_IDEA, random)
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
    """Add a stop at the right side of an edge: a bus stop, a delivery, a passenger."""
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
            "lane": lanes[0].sumo_id,
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
    """Sample departure, first and last edge of each pedestrian."""
    edges = graph.sidewalk_edges
    if not edges:
        return []
    lengths = np.array([edge.length_m for edge in edges])
    middles = np.array([edge.lanes[0].shape_m.mean(axis=0) for edge in edges])
    spread = options.pedestrian_spread
    density = random.lognormal(-0.5 * spread**2, spread)
    present = density * options.pedestrians_per_km * lengths.sum() / 1000
    walk_time_s = options.walk_m / options.walking_mps
    num_first = random.poisson(present)
    num_later = random.poisson(present * duration_s / walk_time_s)
    departs = np.concatenate(
        [np.zeros(num_first), random.uniform(0.0, duration_s, num_later)]
    )
    starts = random.choice(len(edges), size=len(departs), p=lengths / lengths.sum())
    walks = []
    for depart_s, start in zip(departs, starts, strict=True):
        near = np.linalg.norm(middles - middles[start], axis=1)
        reached = np.flatnonzero((near < options.walk_m) & (near > 0))
        end = start if len(reached) == 0 else int(random.choice(reached))
        walks.append((float(depart_s), edges[start].edge_id, edges[end].edge_id))
    return walks
