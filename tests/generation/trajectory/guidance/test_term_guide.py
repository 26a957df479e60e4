"""Guidance terms on sampled trajectories: each is obeyed, also by a network that knows
nothing (random weights), and changes the agents alone that it names."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pd_editor.analysis.guidance.guidance_kind import OBEYED
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowLane, FollowPath
from pd_editor.analysis.guidance.kinds.space import KeepGap, StayOnRoad
from pd_editor.analysis.guidance.kinds.speed import (
    ComfortLimits,
    SpeedLimit,
    StopAtLine,
    TargetSpeed,
)
from pd_editor.analysis.guidance.report import term_outcomes
from pd_editor.analysis.metrics.motion import WINDOW_STEPS, derivative_operators
from pd_editor.base.errors import ModelError
from pd_editor.base.installed_files import models_folder
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.generation.generators import SHIPPED_MODEL
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.generation.stages import TRAJECTORIES
from pd_editor.generation.trajectory.guidance.term_guide import TERM_MAKERS, TermGuide
from pd_editor.generation.trajectory.guidance.trajectory_term import TermGuidance
from pd_editor.generation.trajectory.task import TrajectoryTask
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers
from tests.generation.generated_traffic import SINGLE, generated, same
from tests.generation.trajectory.scenes import small_model


@pytest.fixture
def scenario() -> Scenario:
    """Three drivers on two lanes, and one that stands."""
    return scenario_with(
        straight_drivers(
            [(0, 0, 0, 10), (-30, 0, 0, 8), (0, 3.5, 0, 9), (90, 3.5, 0, 0)]
        )
    )


def guided(
    diffuser: PathDiffuser, scenario: Scenario, *terms: GuidanceTerm, seed: int = 3
) -> TrafficSample:
    found = generated(
        diffuser, scenario, scenario.agents.ids, guidance=(SINGLE, *terms), seed=seed
    )
    return found.samples[0]


def speeds(sample: TrafficSample, row: int) -> np.ndarray:
    return np.hypot(*sample.velocity_mps[row].T)


def test_a_goal_is_reached_at_its_time_and_others_keep_their_noise(
    diffuser: PathDiffuser, scenario: Scenario
):
    goal = GoalPoint(agent_id="100", point_m=(48.0, 2.0))
    early = GoalPoint(agent_id="100", point_m=(33.0, 0.0), at_s=4.0)
    at_end = guided(diffuser, scenario, goal).position_m[0, -1]
    at_4_s = guided(diffuser, scenario, early).position_m[0, 40]
    assert np.linalg.norm(at_end - goal.point_m) < 0.3
    assert np.linalg.norm(at_4_s - early.point_m) < 0.3


LINE_M = ((0.0, 0.0), (20.0, 0.0), (40.0, 0.0))


def test_way_points_are_passed_at_their_times_and_speeds(
    diffuser: PathDiffuser, scenario: Scenario
):
    """Also by a network of random weights, to which other paces are as likely."""
    timed = FollowPath(agent_id="100", points_m=LINE_M, times_s=(None, 3.0, 5.5))
    x = guided(diffuser, scenario, timed).position_m[0, :, 0]
    assert abs(x[30] - 20.0) < OBEYED.goal_m
    assert abs(x[55] - 40.0) < OBEYED.goal_m
    slow = FollowPath(agent_id="100", points_m=LINE_M, speeds_mps=(None, 5.0, None))
    sample = guided(diffuser, scenario, slow)
    there = int(np.abs(sample.position_m[0, :, 0] - 20.0).argmin())
    assert abs(speeds(sample, 0)[there] - 5.0) < 0.7


def test_what_is_asked_behind_an_agent_leaves_its_pace_to_the_model(
    diffuser: PathDiffuser, scenario: Scenario
):
    path = FollowPath(agent_id="100", points_m=LINE_M)
    behind = replace(path, speeds_mps=(2.0, None, None))
    one, two = (guided(diffuser, scenario, term) for term in (path, behind))
    assert np.array_equal(one.position_m, two.position_m)


def test_an_agent_waits_at_a_way_point_until_another_one_has_passed(
    diffuser: PathDiffuser,
):
    """The other one is kept, or generated in the same run."""
    scene = scenario_with(straight_drivers([(0, 0, 0, 8), (26, -34, np.pi / 2, 8)]))
    waits = FollowPath(agent_id="100", points_m=LINE_M, waits_for=(None, "101", None))
    for ids in (("100",), ("100", "101")):
        sample = generated(
            diffuser, scene, ids, guidance=(SINGLE, waits), seed=3
        ).samples[0]
        x = sample.position_m[0, :, 0]
        other_y = (
            sample.position_m[1, :, 1]
            if len(ids) > 1
            else scene.agents.position_m[1, scene.current_step :, 1]
        )
        passed = int((other_y > 4.0).argmax())
        assert passed > 30
        assert x[passed] < 21.5
        assert x[-1] > x[passed] + 0.5 or passed > 50


def test_target_speed_is_reached_and_kept(diffuser: PathDiffuser, scenario: Scenario):
    sample = guided(diffuser, scenario, TargetSpeed(agent_ids=("100",), speed_mps=6.0))
    assert abs(speeds(sample, 0)[-10:].mean() - 6.0) < 0.5


def test_a_speed_limit_is_kept_once_it_can_be(
    diffuser: PathDiffuser, scenario: Scenario
):
    sample = guided(diffuser, scenario, SpeedLimit(speed_mps=7.0))
    for row in range(3):
        first = speeds(sample, row)[0]
        time = 0.1 * np.arange(61)
        assert (speeds(sample, row) < np.maximum(7.0, first - 2.0 * time) + 0.5).all()


def test_an_agent_stops_in_front_of_a_line(diffuser: PathDiffuser, scenario: Scenario):
    line = StopAtLine(agent_id="100", line_m=((40.0, -2.0), (40.0, 2.0)))
    fast = TargetSpeed(agent_ids=("100",), speed_mps=10.0)
    assert guided(diffuser, scenario, fast).position_m[0, -1, 0] > 45
    samples = [guided(diffuser, scenario, line, seed=seed) for seed in range(7)]
    fronts = [one.position_m[0, :, 0] + one.size_m[0, 0] / 2 for one in samples]
    # The weights are random: with some seeds the agent passes beside the line.
    assert np.median([front.max() for front in fronts]) < 40.0


def test_an_agent_does_not_turn_aside_while_it_stops():
    """With little speed left, a drift to the side turned it by up to 50 degrees."""
    shipped = PathDiffuser(models_folder() / SHIPPED_MODEL)
    scenario = open_scenario("signalised-junction")
    now = scenario.current_step
    way_m = scenario.agents.position_m[scenario.agents.row_of["AV"], now:]
    place = np.flatnonzero(np.linalg.norm(way_m - way_m[0], axis=-1) > 24.0)[0]
    course = way_m[place + 1] - way_m[place]
    aside = 3.0 * np.array([-course[1], course[0]]) / np.hypot(*course)
    line = StopAtLine(
        agent_id="AV",
        line_m=(tuple(way_m[place] - aside), tuple(way_m[place] + aside)),
    )
    ids = drivable_agent_ids(scenario, None)
    for seed in (1, 3):
        found = generated(shipped, scenario, ids, guidance=(line,), seed=seed)
        row = ids.index("AV")
        heading = np.unwrap(found.samples[0].heading_rad[row])
        assert speeds(found.samples[0], row)[-1] < 0.4
        assert np.degrees(np.ptp(heading)) < 12.0


def test_a_path_and_a_lane_are_followed(diffuser: PathDiffuser, scenario: Scenario):
    change = FollowLane(agent_id="100", lane_ids=(3, 4))
    assert abs(guided(diffuser, scenario, change).position_m[0, -1, 1] - 3.5) < 0.5
    swerve = FollowPath(
        agent_id="101", points_m=((-30.0, 0.0), (-5.0, 2.0), (20.0, 2.0), (40.0, 2.0))
    )
    assert abs(guided(diffuser, scenario, swerve).position_m[1, -1, 1] - 2.0) < 0.5


def test_comfort_limits_lower_accelerations(diffuser: PathDiffuser, scenario: Scenario):
    limits = ComfortLimits(
        max_acceleration_mps2=0.5, max_braking_mps2=0.5, max_lateral_mps2=0.3
    )

    def excess(*terms: GuidanceTerm) -> float:
        sample = guided(diffuser, scenario, *terms)
        return term_outcomes(scenario, sample, [limits])[0].error

    assert excess() > 0.5
    assert excess(limits) < 0.1


def test_terms_that_are_off_or_of_no_weight_change_nothing(
    diffuser: PathDiffuser, scenario: Scenario
):
    goal = GoalPoint(agent_id="100", point_m=(48.0, 2.0))
    plain = guided(diffuser, scenario)
    assert same(guided(diffuser, scenario, replace(goal, is_on=False)), plain)
    assert same(guided(diffuser, scenario, replace(goal, weight=0.0)), plain)


def test_terms_of_the_scenario_are_in_force_like_those_of_the_run(
    diffuser: PathDiffuser, scenario: Scenario
):
    goal = GoalPoint(agent_id="100", point_m=(48.0, 2.0))
    with_goal = replace(scenario, guidance=(goal,))
    assert same(guided(diffuser, with_goal), guided(diffuser, scenario, goal))


def test_standing_agents_are_moved_only_if_they_are_named(
    diffuser: PathDiffuser, scenario: Scenario
):
    named = guided(diffuser, scenario, TargetSpeed(agent_ids=("103",), speed_mps=5.0))
    assert abs(speeds(named, 3)[-5:].mean() - 5.0) < 0.5


def test_the_unguided_sample_in_the_batch_changes_nothing(
    diffuser: PathDiffuser, scenario: Scenario
):
    goal = GoalPoint(agent_id="100", point_m=(48.0, 2.0))
    asked = {"guidance": (SINGLE, goal), "num_samples": 2, "seed": 5}
    ids = scenario.agents.ids
    alone = generated(diffuser, scenario, ids, reports_cost=False, **asked)
    paired = generated(diffuser, scenario, ids, reports_cost=True, **asked)
    for one, other in zip(alone.samples, paired.samples, strict=True):
        np.testing.assert_allclose(one.position_m, other.position_m, atol=1e-3)


def test_derivatives_are_those_of_the_decoded_motion(scenario: Scenario):
    model = small_model()
    rows = scenario.agents.rows(scenario.agents.ids)
    task = TrajectoryTask.of(scenario, rows, model.decoder.basis)
    table = task.latent_motion(model.decoder)
    latent = torch.randn(2, 4, 10, generator=torch.Generator().manual_seed(0))
    predicted = table.predicted(latent, 0.5)
    exact = task.motion(model.decoder.basis, latent[:, None])
    moves = slice(0, 3)
    position = predicted.position_m.numpy()[:, moves]
    np.testing.assert_allclose(position, exact.position_m[:, moves], atol=1e-3)
    velocity = predicted.velocity_mps.numpy()[:, moves]
    np.testing.assert_allclose(velocity, exact.velocity_mps[:, moves], atol=1e-2)
    _, second, _ = derivative_operators(61, WINDOW_STEPS, 0.1)
    found = predicted.acceleration_mps2.numpy()[:, moves]
    np.testing.assert_allclose(found, second @ exact.position_m[:, moves], atol=5e-2)


def test_agents_that_are_not_sampled_move_as_recorded(scenario: Scenario):
    model = small_model()
    task = TrajectoryTask.of(scenario, np.array([0]), model.decoder.basis)
    predicted = task.latent_motion(model.decoder).predicted(torch.zeros(1, 4, 10), 1.0)
    recorded = scenario.agents.position_m[1:, scenario.current_step :]
    np.testing.assert_allclose(predicted.position_m[0, 1:], recorded, atol=1e-4)
    assert predicted.is_sampled.tolist() == [True, False, False, False]
    goal = GoalPoint(agent_id="101", point_m=(48.0, 2.0))
    context = task.term_context(TermGuidance())
    assert TERM_MAKERS[GoalPoint]([goal], context) == []


def test_terms_of_several_agents_are_those_of_each_alone(scenario: Scenario):
    """All values of a kind make one term."""
    model = small_model()
    rows = scenario.agents.rows(scenario.agents.ids)
    task = TrajectoryTask.of(scenario, rows, model.decoder.basis)
    context = task.term_context(TermGuidance())
    motion = task.latent_motion(model.decoder)
    latent = 0.3 * torch.randn(2, 1, 4, 10, generator=torch.Generator().manual_seed(1))
    line = ((40.0, -2.0), (40.0, 2.0))
    short, long = ((-30.0, 0.0), (-5.0, 2.0)), ((0.0, 0.0), (30.0, 2.0), (90.0, 2.0))
    alike: list[list[GuidanceTerm]] = [
        [
            GoalPoint(agent_id="100", point_m=(48.0, 2.0)),
            GoalPoint(agent_id="101", point_m=(10.0, 1.0), weight=3.0),
            GoalPoint(agent_id="100", point_m=(22.0, 0.0), at_s=2.0),
        ],
        [
            FollowPath(agent_id="101", points_m=short),
            FollowPath(agent_id="100", points_m=long),
        ],
        [TargetSpeed(speed_mps=5.0), TargetSpeed(agent_ids=("103",), speed_mps=3.0)],
        [SpeedLimit(speed_mps=6.0), SpeedLimit(agent_ids=("101",), speed_mps=3.0)],
        [
            ComfortLimits(max_acceleration_mps2=0.2, weight=2.0),
            ComfortLimits(agent_ids=("102",), max_braking_mps2=0.2),
        ],
        [
            StopAtLine(agent_id="100", line_m=line),
            StopAtLine(agent_id="101", line_m=((5.0, -2.0), (5.0, 2.0)), weight=2.0),
        ],
        [StayOnRoad(), StayOnRoad(agent_ids=("100",), weight=4.0)],
        [KeepGap(gap_m=40.0), KeepGap(agent_ids=("102",), gap_m=95.0)],
    ]
    for values in alike:
        make = TERM_MAKERS[type(values[0])]
        together = make(values, context)
        alone = [term for one in values for term in make([one], context)]
        assert (len(together), len(alone)) == (1, len(values))
        one, other = (
            TermGuide(motion=motion, terms=tuple(terms)) for terms in (together, alone)
        )
        for found, expected in (
            (one(latent, 0.5), other(latent, 0.5)),
            (one.closed(latent), other.closed(latent)),
        ):
            assert not torch.equal(found, latent), values
            torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-4)


def test_paths_of_agents_that_are_not_sampled_lead_no_one_else(scenario: Scenario):
    model = small_model()
    task = TrajectoryTask.of(scenario, np.array([1]), model.decoder.basis)
    motion = task.latent_motion(model.decoder)
    other = FollowPath(agent_id="100", points_m=((0.0, 0.0), (30.0, 2.0), (90.0, 2.0)))
    own = FollowPath(agent_id="101", points_m=((-30.0, 0.0), (-5.0, 2.0)))
    context = task.term_context(TermGuidance())
    found, expected = (
        TermGuide(motion=motion, terms=tuple(TERM_MAKERS[FollowPath](some, context)))
        for some in ([other, own], [own])
    )
    latent = 0.3 * torch.randn(2, 1, 4, 10, generator=torch.Generator().manual_seed(1))
    assert not torch.equal(expected(latent, 0.5), latent)
    assert torch.equal(found(latent, 0.5), expected(latent, 0.5))


def test_the_settings_are_stored_with_the_model_and_checked():
    assert TRAJECTORIES.default_sampling()["terms"] == TermGuidance()
    with pytest.raises(ModelError, match="goal_m"):
        TermGuidance(goal_m=-1.0)


def test_each_sample_comes_with_a_report(diffuser: PathDiffuser, scenario: Scenario):
    goal = GoalPoint(agent_id="100", point_m=(48.0, 2.0))
    ids = scenario.agents.ids
    traffic = generated(
        diffuser, scenario, ids, guidance=(SINGLE, goal), num_samples=2, seed=5
    )
    assert len(traffic.guidance) == 2
    for report in traffic.guidance:
        (outcome,) = report.outcomes
        assert outcome.term == goal
        assert outcome.is_obeyed
        assert report.cost is not None
        assert (report.unguided is not None) == report.cost.is_worse
    assert generated(diffuser, scenario, ids, seed=5).guidance == ()


def test_boxes_that_would_leave_the_road_stay_on_it(
    diffuser: PathDiffuser, scenario: Scenario
):
    """Without the term a path leads off the road."""
    away = FollowPath(
        agent_id="101", points_m=((-30.0, 0.0), (0.0, -4.0), (40.0, -5.0))
    )
    stay = StayOnRoad(agent_ids=("101",), weight=10.0)
    assert guided(diffuser, scenario, away).position_m[1, :, 1].min() < -3.0
    low = guided(diffuser, scenario, stay).position_m[1, :, 1].min()
    assert low - scenario.agents.size_m[1, 1] / 2 > -2.05


def test_a_goal_out_of_reach_is_approached_within_limits(
    diffuser: PathDiffuser, scenario: Scenario
):
    far = GoalPoint(agent_id="100", point_m=(190.0, 0.0))
    sample = guided(diffuser, scenario, far)
    assert 95 < sample.position_m[0, -1, 0] < 105
    assert np.abs(np.diff(speeds(sample, 0))).max() < 0.5


def test_a_path_backwards_is_not_followed(diffuser: PathDiffuser, scenario: Scenario):
    back = FollowPath(agent_id="100", points_m=((5.0, 3.0), (-40.0, 3.0)))
    assert same(guided(diffuser, scenario, back), guided(diffuser, scenario))
