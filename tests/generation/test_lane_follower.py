from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.base.errors import EditError, GenerationError
from pd_editor.generation.lane_follower import LaneFollower
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS, AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import GenerationRequest, TrafficSample, run_to_end
from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.paths.car_following import following_acceleration
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import (
    scenario_with,
    straight_drivers,
    straight_lane,
    two_agents_that_collide,
    two_agents_that_pass,
)

STEP_S = TimeAxis().step_s


def drive(scenario: Scenario, *ids: str, **wishes) -> tuple[TrafficSample, ...]:
    request = GenerationRequest(
        scenario=scenario, agent_ids=ids or scenario.agents.ids, **wishes
    )
    return run_to_end(LaneFollower().generate(request)).samples


def ever_overlap(sample: TrafficSample) -> bool:
    boxes = Boxes(
        position_m=sample.position_m,
        heading_rad=sample.heading_rad,
        size_m=sample.size_m[:, None],
    )
    one, two = np.triu_indices(len(sample.ids), 1)
    return bool(boxes_touch(boxes[one], boxes[two]).any())


def crossing(*states: tuple[float, float, float, float]) -> Scenario:
    roads = RoadMap(
        lanes=(
            straight_lane(1, (-100, 0), (100, 0)),
            straight_lane(2, (0, -100), (0, 100)),
        )
    )
    return scenario_with(straight_drivers(list(states)), roads)


@pytest.mark.parametrize("seed", range(5))
def test_stops_behind_a_standing_car(seed):
    scenario = two_agents_that_collide()
    agents = scenario.agents
    position = agents.position_m.copy()
    position[1, :, 0] = 45.0
    scenario = scenario.with_agents(replace(agents, position_m=position))
    (sample,) = drive(scenario, "100", seed=seed)
    end = sample.position_m[0, -1]
    changed_lane = end[1] > 1.75
    assert changed_lane or end[0] < 45.0 - 4.6
    assert end[0] > 25.0


@pytest.mark.parametrize("seed", range(5))
def test_never_runs_into_a_slower_leader(seed):
    scenario = scenario_with(
        straight_drivers([(0, 0, 0, 12), (40, 0, 0, 6), (20, 3.5, 0, 9)])
    )
    (sample,) = drive(scenario, seed=seed)
    assert not ever_overlap(sample)


def test_cars_that_pass_keep_their_lanes_and_speeds():
    for sample in drive(two_agents_that_pass(), num_samples=4, seed=3):
        gone = sample.position_m[:, -1, 0]
        assert (gone > 40).all()
        assert not ever_overlap(sample)


@pytest.mark.parametrize("seed", range(6))
def test_one_of_two_gives_way_at_a_crossing(seed):
    scenario = crossing((-30, 0, 0, 10), (0, -33, np.pi / 2, 10))
    (sample,) = drive(scenario, seed=seed)
    assert not ever_overlap(sample)
    ends = np.array([sample.position_m[0, -1, 0], sample.position_m[1, -1, 1]])
    assert ends.max() > 15, "one goes through"


def test_gives_way_to_a_walker_that_is_kept():
    agents = straight_drivers(
        [(-40, 0, 0, 10), (0, -4, np.pi / 2, 1.5)],
        kinds=(AgentKind.VEHICLE, AgentKind.PEDESTRIAN),
    )
    scenario = scenario_with(
        agents, RoadMap(lanes=(straight_lane(1, (-90, 0), (90, 0)),))
    )
    (sample,) = drive(scenario, "100", seed=1)
    walker = agents.position_m[1, 49:]
    gap = np.abs(sample.position_m[0] - walker)
    assert not ((gap[:, 0] < 2.3 + 0.35) & (gap[:, 1] < 0.95 + 0.35)).any()


def test_parked_cars_stay_and_walkers_walk_on():
    agents = straight_drivers(
        [(0, -2.4, 0, 0), (10, 0, 1.2, 0), (0, 12, 0.5, 1.2)],
        kinds=(AgentKind.VEHICLE, AgentKind.VEHICLE, AgentKind.PEDESTRIAN),
    )
    for sample in drive(scenario_with(agents), num_samples=5):
        assert (np.ptp(sample.position_m[:2], axis=1) == 0).all()
        assert np.allclose(sample.position_m[2], agents.position_m[2, 49:])


def test_a_queue_starts_in_some_samples_only():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0)]))
    gone = [s.position_m[0, -1, 0] for s in drive(scenario, num_samples=30)]
    assert 3 <= sum(way > 1 for way in gone) <= 27


def test_samples_are_reproducible_differ_and_do_not_depend_on_their_number():
    scenario = two_agents_that_collide()
    three = drive(scenario, num_samples=3, seed=7)
    again = drive(scenario, num_samples=2, seed=7)
    for one, other in zip(three, again, strict=False):
        assert (one.position_m == other.position_m).all()
    # Two may be alike: what they decide may be the same.
    first, *others = (one.position_m for one in three)
    assert not all(np.array_equal(first, other) for other in others)


@pytest.mark.parametrize("place", [0, 3, 11, 37, 41])
def test_laws_on_real_scenarios(av2_scenario_folders, place):
    scenario = read_scenario(av2_scenario_folders[place])
    agents, step = scenario.agents, scenario.current_step
    movers = agents.kind_mask(MOTOR_VEHICLE_KINDS) & agents.is_valid[:, step]
    rows = np.flatnonzero(movers)
    (sample,) = drive(scenario, *(agents.ids[row] for row in rows))
    assert (sample.position_m[:, 0] == agents.position_m[rows, step]).all()
    assert (sample.heading_rad[:, 0] == agents.heading_rad[rows, step]).all()
    assert (sample.velocity_mps[:, 0] == agents.velocity_mps[rows, step]).all()
    moves = np.diff(sample.position_m, axis=1)
    pace = np.linalg.norm(moves, axis=-1) / STEP_S
    assert (np.abs(np.diff(pace, axis=1)) / STEP_S < 9.0).all()
    drives = pace[:, 10:] > 2.0
    turn = wrap_angle(heading_of(moves)[:, 10:] - sample.heading_rad[:, 10:-1])
    assert (np.abs(turn[drives]) < np.radians(15)).mean() > 0.98
    middle = (sample.velocity_mps[:, 1:-1] + sample.velocity_mps[:, 2:]) / 2
    assert np.abs(middle * STEP_S - moves[:, 1:]).max() < 0.15
    for track in sample.position_m:
        check_leaves_lanes_at_their_ends_only(scenario.road_map, track)


def check_leaves_lanes_at_their_ends_only(road_map: RoadMap, track: np.ndarray) -> None:
    match = nearest_lanes(road_map, track)
    if match.distance_m[0] > 1.0 or match.distance_m[-1] < 2.5:
        return
    graph = lane_graph(road_map)
    last = int(np.flatnonzero(match.distance_m < 1.3)[-1])
    lane = graph.row_of[int(match.lane_id[last])]
    assert match.along_m[last] > graph.lengths_m[lane] - 4.0
    assert not graph.successors[lane]


def test_it_reports_progress_often_enough_to_be_cancelled():
    request = GenerationRequest(
        scenario=two_agents_that_pass(), agent_ids=("100",), num_samples=2
    )
    reports = [step.fraction for step in LaneFollower().generate(request)]
    assert len(reports) >= 10
    assert reports == sorted(reports)
    assert 0.0 <= reports[0] < reports[-1] < 1.0


def test_what_it_refuses():
    scenario = two_agents_that_pass()
    with pytest.raises(GenerationError, match="cannot place new agents"):
        drive(scenario, num_new_agents={AgentKind.VEHICLE: 2})
    with pytest.raises(EditError, match="'missing'"):
        drive(scenario, "missing")
    with pytest.raises(GenerationError, match="twice"):
        drive(scenario, "100", "100")
    with pytest.raises(GenerationError, match="expected 1 to 1000"):
        drive(scenario, num_samples=0)
    with pytest.raises(GenerationError, match="seed"):
        drive(scenario, seed=-1)
    gone = scenario.agents.is_valid.copy()
    gone[0, 49] = False
    absent = scenario.with_agents(replace(scenario.agents, is_valid=gone))
    with pytest.raises(GenerationError, match="100 is not there"):
        drive(absent, "100")


def test_agents_off_the_lanes_are_reported_and_go_straight_on():
    scenario = scenario_with(straight_drivers([(0, 40, 1.0, 5)]))
    request = GenerationRequest(scenario=scenario, agent_ids=("100",))
    traffic = run_to_end(LaneFollower().generate(request))
    assert any("100" in note for note in traffic.notes)
    way = traffic.samples[0].position_m[0, -1] - [0, 40]
    assert np.arctan2(way[1], way[0]) == pytest.approx(1.0)


def test_no_agents_or_no_lanes_is_fine():
    empty = scenario_with(straight_drivers([]))
    assert drive(empty)[0].position_m.shape == (0, 61, 2)
    bare = scenario_with(straight_drivers([(0, 0, 0, 5)]), RoadMap(lanes=()))
    assert drive(bare)[0].position_m.shape == (1, 61, 2)
    axis = TimeAxis(num_steps=51)
    last = straight_drivers([(0, 0, 0, 10)], time_axis=axis)
    scenario = replace(bare, agents=last, time_axis=axis)
    assert drive(scenario)[0].position_m.shape == (1, 2, 2)


def test_idm_balances_at_its_own_gap():
    speed = np.array([0.0, 5.0, 10.0])
    gap = 2.0 + 1.4 * speed
    assert np.allclose(following_acceleration(speed, gap, speed), 0.0)
    assert (following_acceleration(speed, gap / 2, speed) < 0).all()
    assert (following_acceleration(speed, gap * 2, speed) > 0).all()
