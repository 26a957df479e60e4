from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.generation.features.scene_features import (
    MOST_PIECES,
    NUM_CANDIDATES,
    NUM_FUTURE_STEPS,
    SceneFeatures,
    scene_center,
    scene_features,
)
from pd_editor.generation.features.scene_fields import NUM_NEAR_AGENTS, NUM_NEAR_PIECES
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.paths.motion_primitives import candidates
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import empty_tracks, scenario_with, straight_drivers, straight_lane
from tests.generation.features.moved_scenes import moved

states = st.lists(
    st.tuples(
        st.floats(-90, 60), st.floats(-2, 5.5), st.floats(-0.9, 0.9), st.floats(0, 25)
    ),
    min_size=1,
    max_size=5,
    unique_by=lambda one: (round(one[0]), round(one[1])),
)
SAME_ANYWHERE = (
    "agent_speed",
    "agent_size",
    "agent_kind",
    "near_agents",
    "has_candidate",
    "has_future",
)


@pytest.fixture(scope="module")
def real_scenarios(av2_scenario_folders) -> list[Scenario]:
    return [read_scenario(folder) for folder in av2_scenario_folders[::7]]


def seen_by_agents(found: SceneFeatures) -> np.ndarray:
    """Near pieces as x, y, heading in the frames of the agents, 0 where none is."""
    if not len(found.piece_pose):
        return np.zeros((*found.near_pieces.shape, 4))
    pose = found.piece_pose[found.near_pieces].astype(float)
    gap = pose[..., :2] - found.agent_pose[:, None, :2]
    heading = found.agent_pose[:, None, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    local = np.stack(
        [
            cos * gap[..., 0] + sin * gap[..., 1],
            cos * gap[..., 1] - sin * gap[..., 0],
            np.cos(pose[..., 2] - heading),
            np.sin(pose[..., 2] - heading),
        ],
        axis=-1,
    )
    return np.where(found.near_pieces[..., None] >= 0, local, 0)


def check_laws(scenario: Scenario, found: SceneFeatures) -> None:
    agents, step = scenario.agents, scenario.current_step
    rows = found.agent_row
    wanted = agents.is_valid[:, step] & agents.kind_mask(ROAD_USER_KINDS)
    assert rows.tolist() == np.flatnonzero(wanted).tolist()
    for name, values in vars(found).items():
        assert np.isfinite(values).all(), name
        if values.dtype.kind == "f" and name != "center_m":
            assert values.dtype == np.float32, name
    position = agents.position_m[rows, step] - found.center_m
    assert np.allclose(found.agent_pose[:, :2], position, atol=1e-4)
    counts = len(found.piece_pose), len(rows)
    for near, count, most in (
        (found.near_pieces, counts[0], NUM_NEAR_PIECES),
        (found.near_agents, counts[1] - 1, NUM_NEAR_AGENTS),
    ):
        assert near.shape == (counts[1], most)
        assert (near < max(count + 1, 1)).all()
        assert ((near >= 0).sum(axis=1) == min(max(count, 0), most)).all()
    assert (found.near_agents != np.arange(counts[1])[:, None]).all()
    gap = np.linalg.norm(seen_by_agents(found)[..., :2], axis=-1)
    assert (np.diff(gap[found.near_pieces.min(axis=1, initial=0) >= 0]) > -1e-3).all()
    assert found.has_candidate.any(axis=1).all()
    assert (np.diff(found.has_candidate.astype(int), axis=1) <= 0).all()
    assert (found.candidate_m[~found.has_candidate] == 0).all()
    assert (found.future_m[~found.has_future] == 0).all()


@given(states)
@settings(max_examples=30, deadline=None)
def test_laws_on_the_two_lane_road(table):
    scenario = scenario_with(straight_drivers(table))
    check_laws(scenario, scene_features(scenario))


def test_laws_on_real_scenarios(real_scenarios):
    for scenario in real_scenarios:
        check_laws(scenario, scene_features(scenario))


def cut_to(scenario: Scenario, num_steps: int) -> Scenario:
    """The scenario without the steps that the network does not know of."""
    agents = scenario.agents
    names = ("position_m", "heading_rad", "velocity_mps", "is_valid", "observed")
    cut = {name: getattr(agents, name)[:, :num_steps] for name in names}
    axis = scenario.time_axis
    axis = replace(axis, num_steps=min(num_steps, axis.num_steps))
    return replace(scenario, agents=replace(agents, **cut), time_axis=axis)


def test_candidates_and_futures_are_those_of_the_scenario(real_scenarios):
    for scenario in real_scenarios:
        found = scene_features(scenario, knows_leaders=False)
        rows, step = found.agent_row, scenario.current_step
        pose = np.column_stack(
            [
                scenario.agents.position_m[rows, step],
                scenario.agents.heading_rad[rows, step],
            ]
        )
        is_full = scenario.time_axis.num_future_steps >= NUM_FUTURE_STEPS
        seen = cut_to(scenario, step + 1 + NUM_FUTURE_STEPS)
        expected = candidates(seen, rows, max_candidates=NUM_CANDIDATES)
        if is_full:
            assert (expected.is_valid == found.has_candidate).all()
        for agent, (x, y, heading) in enumerate(pose):
            frame = RigidMotion(x_m=x, y_m=y, rotation_rad=heading)
            if is_full:
                valid = found.has_candidate[agent]
                back = frame.apply(found.candidate_m[agent, valid].astype(float))
                there = expected.position_m[agent, valid, 1:]
                assert np.allclose(back, there, atol=1e-4)
            if found.has_future[agent]:
                back = frame.apply(found.future_m[agent].astype(float))
                there = seen.agents.position_m[rows[agent], step + 1 :]
                assert np.allclose(back, there, atol=1e-4)
        valid = seen.agents.is_valid[rows, step + 1 :]
        whole = valid.all(axis=1) if is_full else np.zeros(len(rows), bool)
        assert (found.has_future == whole).all()


def test_where_and_how_the_scene_lies_does_not_matter(real_scenarios):
    for scenario, angle in zip(real_scenarios, (0.4, -2.5, 3.1), strict=False):
        motion = RigidMotion(x_m=-250.0, y_m=77.0, rotation_rad=angle)
        before = scene_features(scenario)
        after = scene_features(moved(scenario, motion))
        assert np.allclose(motion.apply(before.center_m), after.center_m)
        for name in SAME_ANYWHERE:
            one, two = getattr(before, name), getattr(after, name)
            assert np.allclose(one, two, atol=1e-5), name
        valid = before.has_candidate
        gap = before.candidate_m[valid] - after.candidate_m[valid]
        assert np.abs(gap).max() < 1e-3
        assert np.allclose(before.future_m, after.future_m, atol=1e-3)
        seen, again = seen_by_agents(before), seen_by_agents(after)
        assert np.abs(seen - again).max() < 1e-3
        shape = before.piece_shape[before.near_pieces]
        assert np.allclose(shape, after.piece_shape[after.near_pieces], atol=1e-4)
        turn = after.agent_pose[:, 2] - before.agent_pose[:, 2] - angle
        assert np.abs(wrap_angle(turn)).max() < 1e-5


def test_agents_in_another_order_have_the_same_features(real_scenarios):
    random = np.random.default_rng(3)
    for scenario in real_scenarios[:4]:
        order = random.permutation(len(scenario.agents))
        shuffled = replace(scenario, agents=scenario.agents.taken(order))
        before, after = scene_features(scenario), scene_features(shuffled)
        names = [scenario.agents.ids[row] for row in before.agent_row]
        place = [
            names.index(shuffled.agents.ids[row]) for row in after.agent_row.tolist()
        ]
        for name in ("agent_pose", "candidate_m", "future_m", "near_pieces"):
            expected = getattr(before, name)[place]
            assert np.allclose(expected, getattr(after, name), atol=1e-5), name
        back = np.array([*place, -1])
        assert np.array_equal(before.near_agents[place], back[after.near_agents])


def test_a_scene_without_agents():
    scenario = replace(scenario_with(empty_tracks(110)), focal_id="")
    found = scene_features(scenario)
    assert found.near_pieces.shape == (0, NUM_NEAR_PIECES)
    assert found.candidate_m.shape == (0, NUM_CANDIDATES, NUM_FUTURE_STEPS, 2)
    assert len(found.piece_pose) == 52
    assert np.allclose(found.center_m, [50, 1.75])


def test_a_map_without_lanes():
    for road_map in (
        RoadMap(lanes=()),
        RoadMap(
            lanes=(
                replace(straight_lane(1, (0, 0), (1, 0)), centerline=np.zeros((1, 3))),
            )
        ),
    ):
        scenario = scenario_with(
            straight_drivers([(0, 0, 0, 8), (9, 0, 1, 0)]), road_map
        )
        found = scene_features(scenario)
        check_laws(scenario, found)
        assert (found.near_pieces == -1).all()
        assert found.piece_shape.shape[0] == 0
    empty = scenario_with(empty_tracks(110), RoadMap(lanes=()))
    assert np.array_equal(scene_center(empty), [0, 0])


def test_agents_off_every_lane_still_have_candidates():
    scenario = scenario_with(straight_drivers([(0, 60, 1.0, 8), (400, 400, 0, 5)]))
    found = scene_features(scenario)
    check_laws(scenario, found)
    # The second one is far from everything; its pieces are kept nevertheless.
    assert (found.near_pieces >= 0).all()


def test_five_hundred_agents():
    random = np.random.default_rng(0)
    table = np.column_stack(
        [
            random.uniform(-100, 200, 500),
            random.uniform(-2, 6, 500),
            random.uniform(-3, 3, 500),
            random.uniform(0, 20, 500),
        ]
    )
    scenario = scenario_with(straight_drivers(table.tolist()))
    check_laws(scenario, scene_features(scenario))


def test_a_large_map_is_cut_down():
    lanes = tuple(
        straight_lane(row, (-400, 5 * row), (400, 5 * row)) for row in range(-30, 30)
    )
    scenario = scenario_with(
        straight_drivers([(0, 0, 0, 5), (390, 0, 0, 5)]), RoadMap(lanes=lanes)
    )
    found = scene_features(scenario)
    # Pieces that are equally far from the middle come in or stay out together.
    assert len(found.piece_pose) <= MOST_PIECES + NUM_NEAR_PIECES + 4
    near = np.linalg.norm(seen_by_agents(found)[..., :2], axis=-1)
    assert near.max() < 40


@pytest.mark.parametrize("future_steps", [0, 20, 80])
def test_other_horizons_have_the_same_candidates(future_steps):
    axis = TimeAxis(num_steps=50 + future_steps)
    states = [(0, 0, 0, 10), (30, 3.5, 0.1, 4)]
    usual = scenario_with(straight_drivers(states))
    other = replace(
        usual, agents=straight_drivers(states, time_axis=axis), time_axis=axis
    )
    found, expected = scene_features(other), scene_features(usual)
    assert np.array_equal(found.candidate_m, expected.candidate_m)
    assert found.has_future.all() == (future_steps == 80)


def test_a_coarser_time_axis_gives_no_futures():
    axis = TimeAxis(num_steps=200, step_s=0.2)
    agents = straight_drivers([(0, 0, 0, 5)], time_axis=axis)
    scenario = replace(
        scenario_with(straight_drivers([(0, 0, 0, 5)])), agents=agents, time_axis=axis
    )
    assert not scene_features(scenario).has_future.any()


def test_without_candidates_there_are_none():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10)]))
    found = scene_features(scenario, with_candidates=False)
    assert found.candidate_m.shape == (1, 0, NUM_FUTURE_STEPS, 2)
    assert found.has_future.all()


def test_agents_may_be_chosen():
    kinds = (AgentKind.VEHICLE, AgentKind.CONSTRUCTION, AgentKind.CYCLIST)
    states = [(0.0, 0.0, 0.0, 10.0), (5.0, 3.0, 0.0, 0.0), (9.0, 0.0, 0.0, 4.0)]
    scenario = scenario_with(straight_drivers(states, kinds=kinds))
    assert scene_features(scenario).agent_row.tolist() == [0, 2]
    found = scene_features(scenario, agents=np.array([2, 1]), center_m=np.ones(2))
    assert found.agent_row.tolist() == [2, 1]
    assert found.agent_kind.tolist() == [3, 4]
    assert np.allclose(found.agent_pose[0], [8, -1, 0])


def test_states_that_are_not_finite_are_left_out():
    agents = straight_drivers([(0, 0, 0, 10), (20, 0, 0, 5)])
    velocity = agents.velocity_mps.copy()
    velocity[1, TimeAxis().current_step, 0] = np.nan
    scenario = scenario_with(replace(agents, velocity_mps=velocity))
    found = scene_features(scenario)
    assert found.agent_row.tolist() == [0]


def test_futures_with_a_gap_do_not_count():
    agents = straight_drivers([(0, 0, 0, 10), (20, 0, 0, 5)])
    valid = agents.is_valid.copy()
    valid[1, 90] = False
    found = scene_features(scenario_with(replace(agents, is_valid=valid)))
    assert found.has_future.tolist() == [True, False]
