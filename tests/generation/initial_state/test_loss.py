from dataclasses import replace

import pytest
import torch

from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.initial_state.loss import (
    InitialStateLossConfig,
    initial_state_loss,
    squared_error,
    training_task,
)
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    UNCONDITIONED,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.generation.initial_state.network.lane_distance import (
    follows_lanes,
    offset_from_lane_m,
)
from pd_editor.generation.initial_state.sampler import (
    InitialStateSamplerConfig,
    finished_activity,
    finished_states,
    sample_initial_states,
)
from pd_editor.scene.agent_kind import Activity
from tests.generation.initial_state.scenes import (
    scene_batch,
    small_model,
    trained_a_little,
)


@pytest.mark.parametrize(("noise_m", "weight"), [(3.9, 5.0), (4.1, 1.0)])
def test_errors_across_a_known_heading_count_more(noise_m: float, weight: float):
    config = InitialStateLossConfig(across_weight=5.0)
    north = torch.tensor([[[0.0, 1.0]]])
    others = torch.tensor([[0.1, 0.3, -0.4]])
    for shift, expected in (([[0.2, 0.0]], weight), ([[0.0, 0.2]], 1.0)):
        error = torch.cat([torch.tensor(shift), others], dim=-1)[None, None]
        found = squared_error(error, north, torch.full((1, 1, 1), noise_m), config)
        assert found[..., :2].sum().item() == pytest.approx(expected * 0.04)
        torch.testing.assert_close(found[..., 2:], others[None, None].square())


def test_the_loss_says_what_it_is_made_of():
    model, scene = trained_a_little(small_model(is_ordered=True)), scene_batch(4, 9, 13)
    config = InitialStateLossConfig(overlap_weight=0.5)
    loss, parts = initial_state_loss(
        model, scene, torch.Generator().manual_seed(0), config=config
    )
    names = ("position", "heading", "speed", "activity")
    assert set(parts) == {*names, "overlap"}
    plain = torch.stack([parts[name] for name in names]).sum()
    torch.testing.assert_close(loss.detach(), plain + 0.5 * parts["overlap"])
    again, _ = initial_state_loss(
        model, scene, torch.Generator().manual_seed(0), config=config
    )
    assert torch.equal(loss, again)
    loss.backward()
    slopes = {
        name: parameter.grad is not None and bool(parameter.grad.any())
        for name, parameter in model.named_parameters()
    }
    assert [name for name, has_slope in slopes.items() if not has_slope] == []


def test_unknown_activities_do_not_count_in_the_loss():
    model, scene = trained_a_little(small_model()), scene_batch(9)
    config = InitialStateLossConfig(given_share=0.0, unknown_share=0.0)

    def activity_loss(activity: torch.Tensor) -> tuple[float, float]:
        _, parts = initial_state_loss(
            model,
            replace(scene, agent_activity=activity),
            torch.Generator().manual_seed(0),
            config=config,
        )
        return parts["activity"].item(), parts["position"].item()

    known = torch.full_like(scene.agent_activity, Activity.PARKED)
    assert activity_loss(known)[0] > 0.1
    assert activity_loss(torch.zeros_like(known))[0] == 0
    part = known.clone()
    part[:, ::2] = Activity.UNKNOWN
    assert activity_loss(part)[0] > 0.1


def test_activities_of_given_agents_are_hidden_in_some_scenes():
    scene = scene_batch(*[12] * 60)
    scene = replace(scene, agent_activity=scene.has_agent * Activity.WAITING)
    config = InitialStateLossConfig(given_share=1.0, unknown_share=0.5)
    shown, task = training_task(scene, torch.Generator().manual_seed(0), config)
    is_sampled = shown.has_agent & ~task.is_given
    assert (shown.agent_activity[is_sampled] == Activity.WAITING).all()
    known = (shown.agent_activity > 0) & task.is_given
    share = known.sum(dim=1) / task.is_given.sum(dim=1).clamp_min(1)
    some = task.is_given.any(dim=1)
    assert set(share[some].tolist()) == {0.0, 1.0}
    assert 0.3 < share[some].mean() < 0.7


def test_overlap_counts_late_in_training_only():
    model, scene = small_model(is_ordered=True), scene_batch(4, 9)
    config = InitialStateLossConfig(overlap_after=0.6)
    for progress, counts in ((0.0, False), (0.59, False), (0.6, True), (1.0, True)):
        random = torch.Generator().manual_seed(0)
        _, parts = initial_state_loss(model, scene, random, progress, config)
        assert ("overlap" in parts) == counts


def test_tasks_are_as_asked_for():
    scene = scene_batch(*[20] * 40)
    random = torch.Generator().manual_seed(0)
    config = InitialStateLossConfig(decentralized_share=0.3, given_share=0.5)
    shown, task = training_task(scene, random, config)
    inside = (shown.agent_pose[..., :2].abs() <= task.half_side_m[:, None, None]).all(
        -1
    )
    drawn = shown.has_agent & ~task.is_given
    assert not (drawn & ~inside).any()
    assert not (task.is_given & ~shown.has_agent).any()
    assert 0 < shown.has_agent.sum() < scene.has_agent.sum()
    assert ((task.order > 0) == drawn).all()
    assert 0 < (~task.is_central).sum() < 30
    assert 10 < (task.half_side_m < 62).sum() + 10 < 40
    assert task.is_given.any()


def test_traits_are_told_of_all_of_some_or_of_nobody_and_are_true():
    scene = scene_batch(*[20] * 60)
    random = torch.Generator().manual_seed(0)
    shown, task = training_task(
        scene, random, InitialStateLossConfig(conditioned_share=0.6)
    )
    drawn = shown.has_agent & ~task.is_given
    distance = offset_from_lane_m(shown.agent_pose[..., :2], shown)[1]
    traits = {
        "moves": (task.moves, shown.agent_speed >= 0.5, drawn),
        "on_road": (task.on_road, distance <= 4, drawn & follows_lanes(shown)),
    }
    for code, trait, may_be_told in traits.values():
        assert not (code != UNCONDITIONED)[~may_be_told].any()
        assert trait[code == CONDITIONED_YES].all()
        assert not trait[code == CONDITIONED_NO].any()
        share = (code != UNCONDITIONED).sum(-1) / may_be_told.sum(-1)
        for kind in (share == 0, share == 1, (share > 0) & (share < 1)):
            assert 0.1 < kind.float().mean() < 0.6
        assert {CONDITIONED_NO, CONDITIONED_YES} <= set(code.unique().tolist())


@pytest.mark.slow
def test_a_small_model_learns_one_scene_by_heart():
    torch.manual_seed(0)
    config = InitialStateConfig(
        width=64, num_heads=2, num_layers=2, num_near_pieces=6, relation_width=16
    )
    model, scene = InitialStateDenoiser(config), scene_batch(6)
    random = torch.Generator().manual_seed(0)
    optimizer = torch.optim.AdamW(model.parameters(), lr=3e-3)
    options = InitialStateLossConfig(
        num_levels=16, given_share=0, decentralized_share=0, small_square_share=0
    )
    num_steps = 400
    rates = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, num_steps)
    for _ in range(num_steps):
        loss, _ = initial_state_loss(model, scene, random, config=options)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        rates.step()
    task = sampling_conditioning(scene)
    *_, last = sample_initial_states(
        model.eval(),
        scene,
        RandomStreams(0, "states", range(4)),
        task,
        config=InitialStateSamplerConfig(num_steps=20),
    )
    states = finished_states(scene, task, last.clean)[:, 0]
    found = states[..., :2]
    distance, nearest = torch.cdist(found, scene.agent_pose[..., :2]).min(dim=2)
    assert distance.median() < 1.5
    activity = finished_activity(scene, task, last.clean)[:, 0]
    right = activity == scene.agent_activity[0][nearest]
    known = scene.agent_activity[0][nearest] > 0
    assert right[known & (distance < 1.5)].float().mean() > 0.9
