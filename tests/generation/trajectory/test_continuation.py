"""Trajectories that are deformed by an edit instead of sampled again."""

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.editor.commands import AddGuidance, TransformAgents, traffic_command
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.generation.trajectory.task import TrajectoryTask
from pd_editor.scene.generation import (
    AVOIDANCE,
    GenerationRequest,
    GuidanceSetting,
    TrafficSample,
    run_to_end,
)
from pd_editor.scene.scenario import Scenario

RAW = GuidanceSetting(name=AVOIDANCE, parameters={"tries": 0.0})


def sampled(diffuser: PathDiffuser, scenario: Scenario, **asked) -> TrafficSample:
    ids = asked.pop("agent_ids", scenario.agents.ids)
    request = GenerationRequest(
        scenario=scenario, agent_ids=ids, guidance=(RAW,), **asked
    )
    return run_to_end(diffuser.generate(request)).samples[0]


@pytest.fixture
def driven(diffuser: PathDiffuser, scenario: Scenario) -> Scenario:
    """The scenario with generated trajectories of both agents."""
    request = GenerationRequest(
        scenario=scenario, agent_ids=scenario.agents.ids, guidance=(RAW,), seed=6
    )
    traffic = run_to_end(diffuser.generate(request))
    return traffic_command(request, traffic).apply(scenario)


def future(scenario: Scenario) -> np.ndarray:
    return scenario.agents.position_m[:, scenario.current_step :]


@pytest.mark.parametrize("steps", [2, 5])
@pytest.mark.parametrize("seed", [0, 9])
def test_an_edit_without_effect_changes_no_trajectory(
    diffuser: PathDiffuser, driven: Scenario, steps: int, seed: int
) -> None:
    same = replace(driven)
    asked = {"num_denoising_steps": steps, "seed": seed}
    continued = sampled(diffuser, same, before_edit=driven, **asked)
    assert np.abs(continued.position_m - future(driven)).max() < 1e-3
    anew = sampled(diffuser, same, **asked)
    assert np.abs(anew.position_m - future(driven)).max() > 0.1


def test_the_first_of_several_tries_is_the_continuation(
    diffuser: PathDiffuser, driven: Scenario
) -> None:
    """Agents that do not collide keep their trajectories at the end of an edit."""
    request = GenerationRequest(
        scenario=replace(driven),
        agent_ids=driven.agents.ids,
        guidance=(GuidanceSetting(name=AVOIDANCE, parameters={"tries": 4.0}),),
        before_edit=driven,
    )
    sample = run_to_end(diffuser.generate(request)).samples[0]
    assert np.abs(sample.position_m - future(driven)).max() < 1e-3


def test_small_edits_change_trajectories_a_little(
    diffuser: PathDiffuser, driven: Scenario
) -> None:
    name = driven.agents.ids[0]
    edits = [
        TransformAgents(agent_ids=(name,), dx_m=dx).apply(driven)
        for dx in np.linspace(0.1, 2.0, 20)
    ]
    frames = np.stack(
        [sampled(diffuser, edited, before_edit=driven).position_m for edited in edits]
    )
    assert np.allclose(
        frames[:, 0, 0], [one.agents.position_m[0, one.current_step] for one in edits]
    )
    own = frames - frames[:, :, :1]
    change = np.linalg.norm(np.diff(own, axis=0), axis=-1).mean(axis=-1)
    assert change.mean() < 0.5


def test_agents_without_a_past_trajectory_are_sampled_from_random_noise(
    diffuser: PathDiffuser, scenario: Scenario, driven: Scenario
) -> None:
    """An agent may be missing before the edit, or have no complete trajectory there."""
    (first, second) = driven.agents.ids
    without = driven.without_agents((second,))
    continued = sampled(diffuser, driven, before_edit=without)
    anew = sampled(diffuser, driven)
    gap = np.abs(continued.position_m - anew.position_m).max(axis=(1, 2))
    assert gap[1] < gap[0]
    assert np.isfinite(continued.position_m).all()
    assert first == continued.ids[0]


def test_edits_of_the_guidance_alone_encode_the_scene_once(
    diffuser: PathDiffuser, driven: Scenario
) -> None:
    ids = driven.agents.ids
    here = tuple(driven.agents.position_m[0, -1].tolist())
    goals = [
        AddGuidance(
            term=GoalPoint(agent_id=ids[0], point_m=(here[0] + dx, here[1]))
        ).apply(driven)
        for dx in (0.0, 2.0)
    ]
    with mock.patch.object(TrajectoryTask, "of", wraps=TrajectoryTask.of) as encode:
        numbers = []
        for edited in (driven, *goals):
            sampled(diffuser, edited, before_edit=driven)
            numbers.append(encode.call_count)
        assert len(set(numbers)) == 1
        moved = TransformAgents(agent_ids=ids[:1], dx_m=1.0).apply(driven)
        sampled(diffuser, moved, before_edit=driven)
        assert encode.call_count == numbers[0] + 1
    fewer = sampled(diffuser, moved, agent_ids=ids[:1], before_edit=driven)
    assert fewer.ids == ids[:1]
