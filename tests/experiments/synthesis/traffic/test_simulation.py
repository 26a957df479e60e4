"""A simulated recording: physics, determinism, and parked vehicles apart."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.base.errors import FormatError
from pd_editor.experiments.recordings.recording import Recording
from pd_editor.experiments.synthesis.road_network.generator import generate_network
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.experiments.synthesis.traffic.demand import read_traffic_graph
from pd_editor.experiments.synthesis.traffic.demand_config import DemandOptions
from pd_editor.experiments.synthesis.traffic.simulation import simulate
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.signals import SignalState

DURATION_S = 40.0


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Network:
    return generate_network("grid", 3, tmp_path_factory.mktemp("grid"))


@pytest.fixture(scope="module")
def recording(network: Network) -> Recording:
    return simulate(network, 5, duration_s=DURATION_S)


def _agent(recording: Recording) -> np.ndarray:
    return np.repeat(np.arange(len(recording.ids)), np.diff(recording.first_row))


def test_all_sorts_of_road_users_are_there(recording: Recording):
    kinds = set(recording.kinds)
    assert {AgentKind.VEHICLE, AgentKind.PEDESTRIAN} <= kinds
    assert recording.is_parked.any()
    assert not recording.is_parked.all()
    assert recording.num_steps == DURATION_S * 10
    ends = recording.first_step + np.diff(recording.first_row)
    assert recording.first_step.min() >= 0
    assert ends.max() <= recording.num_steps
    assert len(set(recording.ids)) == len(recording.ids)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_arrays(network: Network, recording: Recording):
    again = simulate(network, 5, duration_s=DURATION_S)
    assert again.ids == recording.ids
    for name in ("first_step", "first_row", "size_m", "position_m", "heading_rad"):
        assert np.array_equal(getattr(again, name), getattr(recording, name)), name
    other = simulate(network, 6, duration_s=DURATION_S)
    assert other.ids != recording.ids


def test_nobody_jumps_and_velocities_are_rates_of_change(recording: Recording):
    agent = _agent(recording)
    same = agent[1:] == agent[:-1]
    moved = np.diff(recording.position_m, axis=0)[same]
    assert np.linalg.norm(moved, axis=1).max() < 4.5
    mean = (recording.velocity_mps[1:] + recording.velocity_mps[:-1])[same] / 2
    assert np.abs(mean - moved / recording.step_s).max() < 0.6


def test_vehicles_go_where_they_head_within_friction(recording: Recording):
    agent = _agent(recording)
    drives = np.array([kind is not AgentKind.PEDESTRIAN for kind in recording.kinds])
    speed = np.linalg.norm(recording.velocity_mps, axis=1)
    fast = drives[agent] & (speed > 1.0)
    forward = np.column_stack(
        [np.cos(recording.heading_rad), np.sin(recording.heading_rad)]
    )
    along = np.sum(forward * recording.velocity_mps, axis=1)
    assert (along[fast] > 0.8 * speed[fast]).all()
    change = np.diff(recording.velocity_mps, axis=0) / recording.step_s
    aside = forward[1:, 0] * change[:, 1] - forward[1:, 1] * change[:, 0]
    held = (agent[1:] == agent[:-1]) & drives[agent[1:]]
    assert np.abs(aside[held]).max() <= 6.0


def test_no_boxes_overlap_but_those_of_pedestrians(recording: Recording):
    agent = _agent(recording)
    row = np.arange(len(agent))
    step = recording.first_step[agent] + row - recording.first_row[agent]
    walks = np.array([kind is AgentKind.PEDESTRIAN for kind in recording.kinds])
    for now in range(0, recording.num_steps, 37):
        at = np.flatnonzero(step == now)
        boxes = shapely.polygons(
            box_corners(
                recording.position_m[at],
                recording.heading_rad[at],
                recording.size_m[agent[at]],
            )
        )
        one, other = shapely.STRtree(boxes).query(boxes, "intersects")
        pair = (one < other) & ~(walks[agent[at[one]]] & walks[agent[at[other]]])
        shared = shapely.area(shapely.intersection(boxes[one], boxes[other]))
        assert shared[pair].max(initial=0.0) < 1e-6


def test_parked_vehicles_stand_still(recording: Recording):
    rows = recording.is_parked[_agent(recording)]
    assert not recording.velocity_mps[rows].any()
    for agent in np.flatnonzero(recording.is_parked)[:5]:
        part = slice(*recording.first_row[agent : agent + 2])
        assert np.ptp(recording.position_m[part], axis=0).max() == 0.0


def test_more_demand_is_more_traffic(network: Network):
    few, many = (
        simulate(network, 1, duration_s=15.0, demand=DemandOptions(flow_per_lane=flow))
        for flow in (40.0, 400.0)
    )
    assert (~few.is_parked).sum() < (~many.is_parked).sum()


def test_a_missing_network_is_named(tmp_path: Path):
    with pytest.raises(FormatError, match=r"none\.net\.xml"):
        read_traffic_graph(tmp_path / "none.net.xml")


def test_hardly_anybody_passes_a_red_light(recording: Recording):
    obeyed = {lane: one for one in recording.signals for lane in one.lane_ids}
    assert obeyed
    lane_of = recording.road_map.lane_of
    passed = dict.fromkeys(SignalState, 0)
    moving = np.hypot(*recording.velocity_mps.T) > 2.0
    step = np.concatenate(
        [
            first + np.arange(count)
            for first, count in zip(
                recording.first_step, np.diff(recording.first_row), strict=True
            )
        ]
    )
    for lane, signal in obeyed.items():
        line = lane_of[lane].centerline_m
        ahead = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
        gap = recording.position_m - line[0]
        along = gap @ ahead
        near = moving & (np.abs(along) < 0.7) & (np.hypot(*gap.T) < 1.2)
        near &= recording.velocity_mps @ ahead > 2.0
        for state in signal.states[step[near]]:
            passed[SignalState(state)] += 1
    assert passed[SignalState.GO] > 20
    assert passed[SignalState.STOP] <= 0.05 * sum(passed.values())
