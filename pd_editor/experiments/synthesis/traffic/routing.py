"""Samples routes across a network, with few turns as in real traffic."""

import heapq
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from pd_editor.experiments.synthesis.sumo.traffic_graph import TrafficGraph

TURN_SHARE: Final = {"s": 0.0, "L": 0.3, "R": 0.3, "l": 1.0, "r": 0.8}
"""Factor of the turn cost for each of SUMO's direction letters."""

COST_NOISE: Final = 0.3
"""Spread of the expected travel time of an edge between drivers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RouteSampler:
    """Sampler of routes of one vehicle class from the network's entries to its exits."""

    graph: TrafficGraph
    vehicle_class: str
    turn_cost_s: float
    """Detour that a driver accepts to save one turn."""
    turn_aversion: float
    """Decay rate of a destination's probability with each turn towards it."""

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
        weight = np.exp(-self.turn_aversion * np.array([turns[edge] for edge in ends]))
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
        noise = random.lognormal(0.0, COST_NOISE, len(names))
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
                    reached = spent + time[after] + share * self.turn_cost_s
                    heapq.heappush(queue, (reached, after, edge, turned + share))
        return cost, turns, before
