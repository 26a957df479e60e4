"""Routes follow turns that exist, and mostly go straight on."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pd_editor.experiments.synthesis.road_network.generator import generate_network
from pd_editor.experiments.synthesis.traffic.demand import (
    RouteSampler,
    TrafficGraph,
    read_traffic_graph,
    sample_demand,
)
from pd_editor.experiments.synthesis.traffic.demand_config import DemandOptions
from pd_editor.experiments.synthesis.traffic.simulation import (
    LEAST_GREEN_S,
    sample_signal_plans,
)


@pytest.fixture(scope="module")
def net_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return generate_network("grid", 1, tmp_path_factory.mktemp("net")).net_file


@pytest.fixture(scope="module")
def graph(net_file: Path) -> TrafficGraph:
    return read_traffic_graph(net_file)


def _choice(graph: TrafficGraph, aversion: float) -> RouteSampler:
    options = DemandOptions(turn_cost_s=30.0, turn_aversion=aversion)
    return RouteSampler(graph=graph, vehicle_class="passenger", options=options)


def _routes(choice: RouteSampler) -> list[tuple[str, ...]]:
    random = np.random.default_rng(0)
    return [
        route for entry in choice.entries for route in choice.sample(entry, 20, random)
    ]


def test_routes_are_chains_of_turns_from_entries_to_exits(graph: TrafficGraph):
    choice = _choice(graph, 1.0)
    for route in _routes(choice):
        assert route[0] in choice.entries
        assert not choice.next_edges[route[-1]]
        assert len(set(route)) == len(route)
        for edge, after in pairwise(route):
            assert after in choice.next_edges[edge]


def test_aversion_to_turns_makes_fewer_turns(graph: TrafficGraph):
    def turns(choice: RouteSampler) -> float:
        letters = [
            choice.next_edges[edge][after]
            for route in _routes(choice)
            for edge, after in pairwise(route)
        ]
        return float(np.mean([letter in "lr" for letter in letters]))

    assert turns(_choice(graph, 2.0)) < 0.8 * turns(_choice(graph, 0.0))


def test_no_route_uses_a_lane_of_pedestrians_or_parked_vehicles(graph: TrafficGraph):
    for edge in graph.edges.values():
        lanes = edge.lanes_for("passenger")
        assert not any(lane.is_sidewalk for lane in lanes)
        assert all("passenger" in lane.admitted for lane in lanes)


def test_demand_is_in_order_of_departure_and_names_its_types(graph: TrafficGraph):
    demand = sample_demand(graph, DemandOptions(), 60.0, np.random.default_rng(1))
    users = [one for one in demand.root if one.tag in {"vehicle", "person"}]
    departs = [float(one.attrib["depart"]) for one in users]
    assert departs == sorted(departs)
    assert {one.attrib["id"] for one in users} == set(demand.types)
    types = {one.attrib["id"] for one in demand.root if one.tag == "vType"}
    assert types == {one.attrib["type"] for one in users}


def test_signal_plans_keep_phases_and_never_flash_green(net_file: Path):
    plans = sample_signal_plans(
        net_file, DemandOptions(green_share=(0.35, 0.7)), np.random.default_rng(0)
    )
    assert len(plans) > 0
    for plan in plans:
        for phase in plan:
            if "y" not in phase.attrib["state"] and "minDur" in phase.attrib:
                assert float(phase.attrib["minDur"]) >= LEAST_GREEN_S
            assert float(phase.attrib["duration"]) > 0
