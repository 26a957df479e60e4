"""A task prepares only what results depend on."""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
from hypothesis import given, settings

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import YieldTo
from pd_editor.generation.core.sampler import Sampler, sample_steps
from pd_editor.generation.trajectory.pipeline import (
    TrajectoryOptions,
    TrajectorySampling,
)
from pd_editor.generation.trajectory.sampler import TrajectorySamplerConfig
from pd_editor.generation.trajectory.task import TrajectoryTask, guidance_looks_at
from pd_editor.scene.agent_kind import Activity
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scenario import Scenario
from tests.builders import LANE_WIDTH_M, scenario_with, straight_drivers
from tests.generation.trajectory.scenes import ancestral, small_model

NUM_AGENTS = 40


def latents(task: TrajectoryTask, rows: np.ndarray, sampler: Sampler) -> np.ndarray:
    """Latents of two samples of some agents of the scenario."""
    model = small_model(num_near_agents=2)
    config = TrajectorySamplerConfig(num_steps=3)
    options = TrajectoryOptions(sampler=config, steps=sampler, seed=3)
    run = TrajectorySampling(model=model, task=task, options=options)
    *_, last = run.steps(run.noise([0, 1], None, num_tries=2), run.lane_guide())
    return last.clean[:, 0, np.searchsorted(task.features.agent_row, rows)].numpy()


def crowd(seed: int) -> Scenario:
    """Drivers of whom some leave early or enter late."""
    random = np.random.default_rng(seed)
    states = np.column_stack(
        [
            random.uniform(-400, 400, NUM_AGENTS),
            random.choice([0, LANE_WIDTH_M], NUM_AGENTS),
            np.zeros(NUM_AGENTS),
            random.uniform(0, 15, NUM_AGENTS),
        ]
    )
    agents = straight_drivers([tuple(one) for one in states.tolist()])
    step = np.arange(agents.num_steps)
    last = np.where(random.random(NUM_AGENTS) < 0.2, 53, step[-1])
    first = np.where(random.random(NUM_AGENTS) < 0.1, 60, 0)
    is_valid = (step >= first[:, None]) & (
        (step <= last[:, None]) | (first > 0)[:, None]
    )
    return scenario_with(replace(agents, is_valid=is_valid))


@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    num_asked=st.integers(1, 3),
    sampler=st.sampled_from([sample_steps, ancestral]),
)
def test_a_part_of_a_scene_gives_the_result_of_the_whole(
    seed: int, num_asked: int, sampler: Sampler
) -> None:
    scenario = crowd(seed)
    there = scenario.agents.is_valid[:, scenario.current_step]
    rows = np.flatnonzero(there)[:num_asked]
    model = small_model(num_near_agents=2)
    part, whole = (
        TrajectoryTask.of(
            scenario, rows, model.decoder.basis, config=model.config, also=also
        )
        for also in (None, np.arange(len(scenario.agents)))
    )
    assert len(part.features.agent_row) < len(whole.features.agent_row)
    of_part, of_whole = (latents(task, rows, sampler) for task in (part, whole))
    assert np.abs(of_part - of_whole).max() < 1e-4
    assert np.abs(of_whole).max() > 0.1


def test_guidance_looks_at_agents_that_could_be_met_and_at_those_it_names() -> None:
    """One guided agent used to prepare the whole scene."""
    states = [(150.0 * row, 0.0, 0.0, 5.0) for row in range(8)]
    agents = straight_drivers(states)
    is_valid = agents.is_valid.copy()
    is_valid[5, :60] = False
    scenario = scenario_with(replace(agents, is_valid=is_valid))
    own, rows = scenario.agents.ids[0], np.array([0])

    def seen(*terms: GuidanceTerm) -> list[int]:
        return guidance_looks_at(scenario, rows, terms).tolist()

    assert seen() == []
    assert seen(GoalPoint(agent_id=own, point_m=(30.0, 0.0))) == [0, 1, 2, 5]
    far = YieldTo(agent_id=own, other_id=scenario.agents.ids[7])
    assert seen(far) == [0, 1, 2, 5, 7]


def test_a_task_of_all_agents_leaves_none_out() -> None:
    states = [(20.0 * row, 0.0, 0.0, 5.0) for row in range(NUM_AGENTS)]
    scenario = scenario_with(straight_drivers(states))
    model = small_model(num_near_agents=2)
    task = TrajectoryTask.of(
        scenario, np.arange(NUM_AGENTS), model.decoder.basis, config=model.config
    )
    assert task.features.agent_row.tolist() == list(range(NUM_AGENTS))


def test_only_who_waits_is_seen_at_a_least_speed() -> None:
    """At exactly 0 the network sees no reason to start, but who is parked is to stay."""
    agents = straight_drivers([(20.0 * row, 0.0, 0.0, 0.0) for row in range(3)])
    activity = np.array([Activity.WAITING, Activity.PARKED, Activity.UNKNOWN])
    scenario = scenario_with(replace(agents, activity=activity))
    model = small_model(num_near_agents=2)
    basis, rows = model.decoder.basis, np.arange(3)
    task = TrajectoryTask.of(scenario, rows, basis, config=model.config)
    seen = task.with_waiting_at(0.25).scene.agent_speed[0].tolist()
    assert seen == [0.25, 0.0, 0.0]
    assert task.scene.agent_speed[0].tolist() == [0.0, 0.0, 0.0]
