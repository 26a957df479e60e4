"""Who is judged, and whether states are drawn."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.base.errors import GenerationError
from pd_editor.experiments.evaluation.evaluation_task import (
    DRIVING,
    SAMPLED_HALF_SIDE_M,
    EvaluationTask,
    paper_init_agents,
    paper_trajectory_agents,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers

PLACING = EvaluationTask(states="sampled")
NEAR, EDGE, BEYOND, LATER = "100", "101", "102", "103"


@pytest.fixture
def scenario() -> Scenario:
    """Of four drivers one is at the edge of the square, one beyond it, one not there."""
    edge = SAMPLED_HALF_SIDE_M
    agents = straight_drivers(
        [(0, 0, 0, 10), (edge, 3.5, 0, 0), (edge + 0.1, 0, 0, 0), (30, 0, 0, 10)]
    )
    there = agents.is_valid.copy()
    scene = scenario_with(agents)
    there[agents.row_of[LATER], : scene.current_step + 1] = False
    return replace(scene, agents=replace(agents, is_valid=there), focal_id=NEAR)


def asked(task: EvaluationTask, scenario: Scenario, bent: Scenario | None = None):
    return task.request(scenario, bent or scenario, num_samples=3, seed=7)


def test_by_default_all_keep_their_states(scenario: Scenario):
    request = asked(DRIVING, scenario)
    assert request.scenario is scenario
    assert request.agent_ids == (NEAR, EDGE, BEYOND)
    assert not request.samples_states
    assert (request.num_samples, request.seed) == (3, 7)


def test_sampled_states_replace_all_agents_of_the_square(
    scenario: Scenario,
):
    request = asked(PLACING, scenario)
    assert request.agent_ids == request.resampled_state_ids == (NEAR, EDGE)
    assert request.scenario.agents.ids == (NEAR, EDGE)
    assert request.region is not None
    assert request.region.half_side_m == SAMPLED_HALF_SIDE_M
    now = scenario.agents.position_m[0, scenario.current_step]
    assert request.region.center_m == pytest.approx(tuple(now))
    assert not request.only_on_road


@pytest.mark.parametrize(
    ("task", "keeps"),
    [
        (EvaluationTask(states="sampled", agents="paper"), paper_init_agents),
        (EvaluationTask(agents="paper"), paper_trajectory_agents),
    ],
)
def test_the_papers_agents(scenario: Scenario, task: EvaluationTask, keeps):
    kinds = (AgentKind.VEHICLE, AgentKind.PEDESTRIAN, AgentKind.VEHICLE)
    agents = scenario.agents.taken(np.arange(3))
    scenario = replace(scenario, agents=replace(agents, kinds=kinds))
    view = recorded_traffic(scenario)
    kept = [
        name for name, keep in zip(view.agents.ids, keeps(view), strict=True) if keep
    ]
    if task.samples_states:
        assert kept == [NEAR, BEYOND]
        kept = [NEAR]
    request = asked(task, scenario)
    assert list(request.agent_ids) == kept
    assert request.only_on_road == task.samples_states


def test_agents_are_chosen_by_the_recording_and_stand_on_the_bent_road(
    scenario: Scenario,
):
    moved = scenario.agents.position_m + np.array([0.0, 100.0])
    bent = replace(scenario, agents=replace(scenario.agents, position_m=moved))
    request = asked(PLACING, scenario, bent)
    assert request.agent_ids == (NEAR, EDGE)
    np.testing.assert_array_equal(request.scenario.agents.position_m, moved[:2])


def test_a_scene_without_agents_is_reported(scenario: Scenario):
    walkers = (AgentKind.PEDESTRIAN,) * len(scenario.agents)
    scenario = replace(scenario, agents=replace(scenario.agents, kinds=walkers))
    with pytest.raises(GenerationError, match="None of the requested agents"):
        asked(EvaluationTask(states="sampled", agents="paper"), scenario)
