from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
import torch

from pd_editor.generation.core.sampler import Sampler, sample_steps
from pd_editor.generation.inputs import SceneTensors
from pd_editor.generation.trajectory.guidance.nearest_candidate import (
    NearestCandidateGuide,
    TrajectoryGuidance,
)
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser
from pd_editor.generation.trajectory.sampler import (
    GivenTrajectories,
    TrajectoryGuide,
    TrajectoryNoise,
    TrajectorySamplerConfig,
    sample_trajectories,
)
from tests.generation.trajectory.scenes import ancestral, scene_batch, small_model


def drawn(
    model: TrajectoryDenoiser,
    scene: SceneTensors,
    samples: Sequence[int] = (0, 1, 2),
    *,
    is_given: torch.Tensor | None = None,
    sampler: Sampler = sample_steps,
    guide: TrajectoryGuide | None = None,
) -> torch.Tensor:
    steps = sample_trajectories(
        model,
        scene,
        TrajectoryNoise(samples=samples, seed=5),
        None if is_given is None else GivenTrajectories(is_given, scene.future),
        config=TrajectorySamplerConfig(num_steps=4),
        sampler=sampler,
        guide=guide,
    )
    *_, last = steps
    return last.clean


@pytest.mark.parametrize("sampler", [sample_steps, ancestral])
def test_a_sample_is_the_same_alone_and_among_others(sampler: Sampler) -> None:
    scene, model = scene_batch(5, 8), small_model()
    together = drawn(model, scene, range(4), sampler=sampler)
    alone = drawn(model, scene, [2], sampler=sampler)
    assert torch.allclose(alone[0], together[2], atol=1e-5)
    assert not torch.allclose(together[0], together[1], atol=1e-2)


def test_given_agents_are_bit_identical_and_bind_the_others() -> None:
    scene, model = scene_batch(6), small_model()
    given = torch.zeros_like(scene.has_agent)
    given[0, [1, 4]] = True
    found = drawn(model, scene, is_given=given)
    assert torch.equal(found[:, given], scene.future[given].expand(3, 2, 10))
    other = replace(scene, future=scene.future + 1.0)
    assert not torch.equal(drawn(model, other, is_given=given)[:, 0, 0], found[:, 0, 0])


def test_steps_are_reported_and_cancelled_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene, model = scene_batch(3), small_model()
    calls: list[int] = []
    denoise = TrajectoryDenoiser.denoise

    def counted(*args: Any) -> torch.Tensor:
        calls.append(1)
        return denoise(*args)

    monkeypatch.setattr(TrajectoryDenoiser, "denoise", counted)
    steps = sample_trajectories(
        model,
        scene,
        TrajectoryNoise(samples=[0], seed=0),
        config=TrajectorySamplerConfig(num_steps=6),
    )
    assert next(steps).index == 0
    assert next(steps).num_steps == 6
    assert len(calls) == 2


def guide_of(
    model: TrajectoryDenoiser, scene: SceneTensors, weight: float
) -> NearestCandidateGuide:
    """A guide of all steps, the last one as well."""
    return NearestCandidateGuide.of(
        model.decoder,
        scene,
        torch.full(scene.has_agent.shape, weight),
        TrajectoryGuidance(last_step_share=1.0),
    )


def test_guidance_brings_the_result_nearer_to_candidates() -> None:
    scene, model = scene_batch(6, 9), small_model()
    # Those who stand are pulled only a little once they start.
    scene = replace(scene, agent_speed=scene.agent_speed.clamp_min(1.0))
    free, pulled, firm = (guide_of(model, scene, weight) for weight in (1e-9, 0.3, 1.0))
    costs = [
        float(guide.distances_m(drawn(model, scene, guide=guide)).mean())
        for guide in (free, pulled, firm)
    ]
    assert costs[0] > costs[1] > costs[2]
    assert costs[2] < 1e-4


def test_full_guidance_ends_on_a_candidate_of_the_agent() -> None:
    scene, model = scene_batch(6), small_model()
    found = drawn(model, scene, guide=guide_of(model, scene, 1.0))
    moving = scene.has_candidate.any(-1) & (scene.agent_speed > 0.3)
    gap = (found[:, :, :, None] - scene.candidates).abs().amax(-1)
    gap = gap.masked_fill(~scene.has_candidate, torch.inf).amin(-1)
    assert moving.any()
    assert gap[:, moving].max() < 1e-4


def test_agents_without_candidates_are_left_alone() -> None:
    scene, model = scene_batch(4), small_model()
    scene = replace(scene, has_candidate=torch.zeros_like(scene.has_candidate))
    free = drawn(model, scene)
    assert torch.equal(drawn(model, scene, guide=guide_of(model, scene, 1.0)), free)


def test_who_stands_and_stays_is_not_dragged_along() -> None:
    scene, model = scene_batch(2), small_model()
    scene = replace(
        scene,
        agent_speed=torch.zeros_like(scene.agent_speed),
        candidates=torch.zeros_like(scene.candidates) + 0.4,
        has_candidate=torch.ones_like(scene.has_candidate),
    )
    still = model.decoder.still(scene.agent_speed)[None]
    guide = guide_of(model, scene, 1.0)
    assert torch.equal(guide(still, 0.1), still)
    away = still + 0.35
    assert not torch.equal(guide(away, 0.1), away)
    # With a candidate that stands still too, it is pulled onto that one.
    scene.candidates[:, :, 3] = still[0]
    near = still + 0.001
    assert torch.allclose(guide_of(model, scene, 1.0)(near, 0.1), still)


def test_early_steps_are_not_guided() -> None:
    scene, model = scene_batch(4), small_model()
    latent = torch.randn(1, 1, 4, 10)
    guide = guide_of(model, scene, 1.0)
    assert torch.equal(guide(latent, 0.8), latent)
    assert not torch.equal(guide(latent, 0.7), latent)
