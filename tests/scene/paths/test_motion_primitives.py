from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS, AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.paths.motion_primitives import (
    SAME_M,
    CandidateSet,
    candidate_positions,
    candidates,
)
from pd_editor.scene.road_map import LaneKind, RoadMap
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import scenario_with, straight_drivers, straight_lane

STEP_S = TimeAxis().step_s

states = st.lists(
    st.tuples(
        st.floats(-90, 60), st.floats(-2, 5.5), st.floats(-0.9, 0.9), st.floats(0, 25)
    ),
    min_size=1,
    max_size=4,
)


def found_for(scenario: Scenario) -> CandidateSet:
    return candidates(scenario, np.arange(len(scenario.agents)))


def moved(scenario: Scenario, motion: RigidMotion) -> Scenario:
    agents = scenario.agents
    turned = replace(
        agents,
        position_m=motion.apply(agents.position_m),
        heading_rad=wrap_angle(agents.heading_rad + motion.rotation_rad),
        velocity_mps=motion.turn(agents.velocity_mps),
    )
    return replace(
        scenario, agents=turned, road_map=scenario.road_map.moved(motion.apply)
    )


@pytest.fixture(scope="module")
def real_scenarios(av2_scenario_folders) -> list[Scenario]:
    return [read_scenario(folder) for folder in av2_scenario_folders[::9]]


def check_laws(scenario: Scenario, rows: np.ndarray) -> None:
    """First point exact; own speed and standstill there; no two alike."""
    found = candidates(scenario, rows)
    agents, step = scenario.agents, scenario.current_step
    valid = found.is_valid
    for name in ("position_m", "heading_rad", "velocity_mps"):
        start = getattr(agents, name)[rows, step]
        first = getattr(found, name)[:, :, 0]
        expected = np.repeat(start[:, None], valid.shape[1], axis=1)
        assert (first[valid] == expected[valid]).all()
        assert np.isfinite(getattr(found, name)).all()
    speed = agents.speed_mps()[rows, step]
    own = valid & (np.abs(found.target_speed_mps - speed[:, None]) < 1e-9)
    assert own.any(1).all()
    assert (valid & found.is_standstill).any(1).all()
    half = found.position_m.shape[2] // 2
    marks = found.position_m[:, :, [half, -1]]
    gap = np.linalg.norm(marks[:, :, None] - marks[:, None], axis=-1).max(-1)
    both = valid[:, :, None] & valid[:, None, :] & ~np.eye(valid.shape[1], dtype=bool)
    assert (gap[both] >= SAME_M - 1e-9).all()
    assert [len(lanes) for lanes in found.lane_ids] == valid.sum(1).tolist()


@given(states)
@settings(max_examples=40, deadline=None)
def test_laws_on_the_two_lane_road(table):
    scenario = scenario_with(straight_drivers(table))
    check_laws(scenario, np.arange(len(table)))


def test_laws_on_real_scenarios(real_scenarios):
    for scenario in real_scenarios:
        here = scenario.agents.is_valid[:, scenario.current_step]
        check_laws(scenario, np.flatnonzero(here))


@given(states)
@settings(max_examples=25, deadline=None)
def test_what_an_agent_gets_does_not_depend_on_the_others(table):
    scenario = scenario_with(straight_drivers(table))
    together = found_for(scenario)
    order = np.arange(len(table))[::-1]
    reversed_rows = candidates(scenario, order)
    for row in range(len(table)):
        alone = candidates(scenario, np.array([row]))
        assert np.allclose(alone.position_m[0], together.position_m[row], atol=1e-9)
        assert (alone.is_valid[0] == together.is_valid[row]).all()
        place = int(np.flatnonzero(order == row)[0])
        assert np.allclose(reversed_rows.position_m[place], together.position_m[row])
        assert reversed_rows.lane_ids[place] == together.lane_ids[row]


def test_candidates_move_with_the_scene(real_scenarios):
    for scenario, angle in zip(real_scenarios, (0.3, 1.2, -2.0, 3.0), strict=False):
        agents, step = scenario.agents, scenario.current_step
        movers = agents.kind_mask(MOTOR_VEHICLE_KINDS) & agents.is_valid[:, step]
        rows = np.flatnonzero(movers)
        motion = RigidMotion(x_m=31.0, y_m=-17.0, rotation_rad=angle)
        before = candidates(scenario, rows)
        after = candidates(moved(scenario, motion), rows)
        assert (before.is_valid == after.is_valid).all()
        valid = before.is_valid
        assert np.allclose(
            motion.apply(before.position_m)[valid], after.position_m[valid], atol=1e-5
        )
        turn = wrap_angle(after.heading_rad - before.heading_rad - angle)
        assert np.abs(turn[valid]).max() < 1e-5


@given(st.floats(-60, 60), st.floats(-1.2, 1.2), st.floats(-0.1, 0.1), st.floats(0, 20))
@settings(max_examples=40, deadline=None)
def test_candidates_stay_in_the_lanes(x, y, heading, speed):
    found = found_for(scenario_with(straight_drivers([(x, y, heading, speed)])))
    lateral = found.position_m[0, :, :, 1]
    keeps = found.is_valid[0] & ~found.is_lane_change[0]
    assert np.abs(lateral[keeps]).max() < 1.25 + 0.1 * max(speed * 0.5, 2.0)
    assert np.abs(lateral[keeps, -1]).max() < 1.25 + 0.1 * max(speed * 0.5, 2.0)
    changes = found.is_valid[0] & found.is_lane_change[0]
    assert changes.any()
    assert (lateral[changes] < 3.5 + 1.25).all()


def bend(radius: float) -> RoadMap:
    """A straight lane, then a left turn of 90 degrees, then straight again."""
    angle = np.linspace(0, np.pi / 2, 20)
    arc = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle))], -1)
    end = arc[-1]
    before = straight_lane(1, (-60, 0), (0, 0), successors=(2,))
    after = straight_lane(3, (end[0], end[1]), (end[0], end[1] + 80))
    points = np.column_stack([arc, np.zeros(len(arc))])
    turn = replace(before, lane_id=2, centerline=points, successors=(3,))
    return RoadMap(lanes=(before, turn, after))


@pytest.mark.parametrize("radius", [8.0, 15.0, 30.0])
@pytest.mark.parametrize("speed", [0.0, 5.0, 10.0])
def test_speeds_suit_the_curves(radius, speed):
    scenario = scenario_with(
        straight_drivers([(-30, 0.3, 0.0, speed)]), road_map=bend(radius)
    )
    found = found_for(scenario)
    pace = np.linalg.norm(np.diff(found.position_m[0], axis=1), axis=-1) / STEP_S
    pace = pace[found.is_valid[0]]
    push = np.diff(pace, axis=1) / STEP_S
    assert push.max() < 3.3
    assert push.min() > -4.5
    heading = np.unwrap(found.heading_rad[0][found.is_valid[0]], axis=1)
    # Over half a second, since paths are made of straight pieces of 2 m.
    turning = (heading[:, 5:] - heading[:, :-5]) / (5 * STEP_S)
    assert np.abs(turning * pace[:, 2:-2]).max() < 4.8
    if speed:
        ends = found.position_m[0, found.is_valid[0], -1]
        assert ends[:, 1].max() > 1.0, "some candidate gets round the bend"


def test_headings_and_velocities_agree_with_the_motion(real_scenarios):
    for scenario in real_scenarios:
        agents, step = scenario.agents, scenario.current_step
        rows = np.flatnonzero(
            agents.kind_mask(MOTOR_VEHICLE_KINDS)
            & agents.is_valid[:, step]
            & (agents.speed_mps()[:, step] > 1.0)
        )
        found = candidates(scenario, rows)
        step_m = np.diff(found.position_m, axis=2)[:, :, 20:]
        moves = (np.linalg.norm(step_m, axis=-1) > 0.2) & found.is_valid[:, :, None]
        apart = wrap_angle(found.heading_rad[:, :, 21:] - heading_of(step_m))
        ahead = np.abs(apart) < np.radians(12)
        assert ahead[moves & found.has_lane[:, None, None]].mean() > 0.99
        middle = (found.velocity_mps[:, :, 20:-1] + found.velocity_mps[:, :, 21:]) / 2
        assert np.abs(middle * STEP_S - step_m)[found.is_valid].max() < 0.1


def test_every_mover_near_a_lane_gets_a_candidate_that_goes(real_scenarios):
    for scenario in real_scenarios:
        agents, step = scenario.agents, scenario.current_step
        movers = agents.kind_mask(MOTOR_VEHICLE_KINDS) & agents.is_valid[:, step]
        rows = np.flatnonzero(movers)
        if not len(rows):
            continue
        heading = agents.heading_rad[rows, step]
        match = nearest_lanes(
            scenario.road_map, agents.position_m[rows, step], heading_rad=heading
        )
        turn = np.abs(wrap_angle(heading - match.heading_rad))
        near = (match.distance_m <= 3.0) & (turn < np.pi / 2 - 1e-6)
        found = candidates(scenario, rows)
        way = found.position_m[:, :, -1] - found.position_m[:, :, 0]
        goes = np.linalg.norm(way, axis=-1) > 2.0
        assert (goes & found.is_valid).any(1)[near].all()
        assert found.has_lane[near].all()


def test_standing_agents_do_not_slide_or_turn():
    found = found_for(scenario_with(straight_drivers([(0, 1.0, 0.3, 0.0)])))
    stands = found.is_standstill[0] & found.is_valid[0]
    assert stands.sum() == 1
    assert np.ptp(found.position_m[0, stands], axis=1).max() == 0
    assert np.ptp(found.heading_rad[0, stands]) == 0


def test_pedestrians_walk_on_or_stop():
    agents = straight_drivers([(0, 0, 0, 1.5)], kinds=(AgentKind.PEDESTRIAN,))
    found = found_for(scenario_with(agents))
    assert found.is_valid[0].sum() == 2
    assert not found.has_lane[0]
    ends = found.position_m[0, :2, -1, 0]
    assert ends[0] == pytest.approx(1.5 * 6.0)
    assert ends[1] < 2.0


def test_off_the_lanes_drivers_go_straight_or_turn():
    found = found_for(scenario_with(straight_drivers([(0, 30, 1.0, 5.0)])))
    valid = found.is_valid[0]
    assert not found.has_lane[0]
    steady = 6.0 * 5.0 * np.array([np.cos(1.0), np.sin(1.0)]) + [0, 30]
    ends = found.position_m[0, valid, -1]
    assert np.linalg.norm(ends - steady, axis=-1).min() < 1e-6
    turns = wrap_angle(found.heading_rad[0, valid, -1] - 1.0)
    assert turns.max() > 0.3
    assert turns.min() < -0.3


def test_driving_beyond_the_last_lane_is_flagged():
    found = found_for(scenario_with(straight_drivers([(190, 0, 0, 10)])))
    valid = found.is_valid[0]
    past = np.maximum(found.position_m[0, valid, -1, 0] - 200, 0)
    assert np.allclose(found.beyond_lanes_m[0, valid], past, atol=0.6)
    assert past.max() > 40


def test_candidates_follow_a_warped_road():
    scenario = scenario_with(straight_drivers([(-20, 0, 0, 9)]))
    warp = RoadWarp(
        anchor=RigidMotion(x_m=-20.0, y_m=0.0, rotation_rad=0.0),
        terms=(WarpTerm(kind="double-turn", power=6.0, length_m=15.0),),
    )
    road_map = scenario.road_map.dense.moved(warp.apply)
    found = found_for(replace(scenario, road_map=road_map))
    keeps = (
        found.is_valid[0] & ~found.is_lane_change[0] & (found.lateral_shift_m[0] == 0)
    )
    points = found.position_m[0, keeps].reshape(-1, 2)
    assert nearest_lanes(road_map, points).distance_m.max() < 0.3
    assert points[:, 1].max() > 5.0


def test_who_rolls_backwards_may_go_on_doing_so():
    agents = straight_drivers([(0, 0, 0, 2)])
    agents = replace(agents, velocity_mps=-agents.velocity_mps)
    found = found_for(scenario_with(agents))
    back = found.position_m[0, :, -1, 0].argmin()
    assert found.position_m[0, back, -1, 0] == pytest.approx(-12.0)
    assert np.ptp(found.heading_rad[0, back]) < 1e-6


def test_only_cyclists_follow_bike_lanes():
    road_map = RoadMap(lanes=(straight_lane(1, (-50, 0), (50, 0), kind=LaneKind.BIKE),))
    for kind, follows in ((AgentKind.CYCLIST, True), (AgentKind.VEHICLE, False)):
        agents = straight_drivers([(0, 0, 0, 4)], kinds=(kind,))
        assert found_for(scenario_with(agents, road_map)).has_lane[0] == follows


def test_branches_that_part_too_late_are_not_repeated():
    lanes = (
        straight_lane(1, (0, 0), (100, 0), successors=(2, 3)),
        straight_lane(2, (100, 0), (200, 40)),
        straight_lane(3, (100, 0), (200, -40)),
    )
    far = scenario_with(straight_drivers([(5, 0, 0, 2)]), RoadMap(lanes=lanes))
    assert {lanes[0] for lanes in found_for(far).lane_ids[0]} == {1}
    assert len(set(found_for(far).lane_ids[0])) == 1
    close = scenario_with(straight_drivers([(80, 0, 0, 8)]), RoadMap(lanes=lanes))
    assert set(found_for(close).lane_ids[0]) == {(1, 2), (1, 3)}


def test_as_many_as_asked_for_and_none_for_agents_that_are_not_there():
    agents = straight_drivers([(0, 0, 0, 10), (20, 0, 0, 8)])
    exists = agents.is_valid.copy()
    exists[1, TimeAxis().current_step] = False
    scenario = scenario_with(replace(agents, is_valid=exists))
    found = candidates(scenario, np.array([0, 1]), max_candidates=5)
    assert found.is_valid.tolist() == [[True] * 5, [False] * 5]
    assert candidates(scenario, np.zeros(0, int)).is_valid.shape == (0, 32)


def test_no_future_or_no_lanes_is_fine():
    agents = straight_drivers([(0, 0, 0, 10)])
    assert found_for(scenario_with(agents, RoadMap(lanes=()))).is_valid.sum() > 3
    axis = TimeAxis(num_steps=50)
    last = straight_drivers([(0, 0, 0, 10)], time_axis=axis)
    scenario = replace(scenario_with(agents), agents=last, time_axis=axis)
    assert found_for(scenario).position_m.shape == (1, 32, 1, 2)


def following(
    scenario: Scenario, *, knows_leaders: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Candidate positions of the first agent, and distances driven at the end."""
    position, agent, _ = candidate_positions(
        scenario,
        np.arange(len(scenario.agents)),
        max_candidates=24,
        num_steps=59,
        step_s=0.1,
        knows_leaders=knows_leaders,
    )
    own = position[agent == 0]
    return own, np.linalg.norm(np.diff(own, axis=1), axis=-1).sum(axis=1)


def test_a_candidate_follows_the_agent_ahead():
    """It ends behind the leader, as fast as the leader, at the gap of the IDM."""
    scenario = scenario_with(straight_drivers([(0, 0, 0, 12), (25, 0, 0, 6)]))
    own, way = following(scenario)
    other, others_way = following(scenario, knows_leaders=False)
    assert len(own) == len(other) + 1
    new = ~np.isclose(way[:, None], others_way, atol=1e-6).any(axis=1)
    assert new.sum() == 1
    path = own[new][0]
    gap = 25 + 6 * 0.1 * np.arange(60) - path[:, 0]
    assert (gap > 4.6 + 1.5).all()
    assert np.diff(path[:, 0])[-1] / 0.1 == pytest.approx(6.0, abs=1.5)


def test_one_that_stands_starts_behind_a_leader_that_drives():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0), (15, 0, 0, 8)]))
    _, way = following(scenario)
    _, others_way = following(scenario, knows_leaders=False)
    assert len(way) > len(others_way)


def test_without_anybody_ahead_no_candidate_follows(real_scenarios):
    for table in ([(0, 0, 0, 12)], [(0, 0, 0, 12), (-20, 0, 0, 12), (20, 12, 0, 3)]):
        scenario = scenario_with(straight_drivers(table))
        one, _ = following(scenario)
        two, _ = following(scenario, knows_leaders=False)
        assert np.array_equal(one, two)


def test_followers_never_reverse_and_are_among_the_others(real_scenarios):
    for scenario in real_scenarios:
        rows = np.flatnonzero(scenario.agents.is_valid[:, scenario.current_step])
        found = candidate_positions(
            scenario,
            rows,
            max_candidates=24,
            num_steps=59,
            step_s=0.1,
            knows_leaders=True,
        )
        position, agent, slot = found
        assert np.isfinite(position).all()
        assert (slot < 24).all()
        assert (np.bincount(agent, minlength=len(rows)) <= 24).all()


def test_positions_alone_are_those_of_the_candidates(real_scenarios):
    for scenario in real_scenarios:
        axis = scenario.time_axis
        rows = np.flatnonzero(scenario.agents.is_valid[:, scenario.current_step])
        expected = candidates(scenario, rows, max_candidates=12)
        position, agent, slot = candidate_positions(
            scenario,
            rows,
            max_candidates=12,
            num_steps=axis.num_future_steps,
            step_s=axis.step_s,
            knows_leaders=False,
        )
        assert len(position) == expected.is_valid.sum()
        assert expected.is_valid[agent, slot].all()
        assert (position == expected.position_m[agent, slot]).all()
