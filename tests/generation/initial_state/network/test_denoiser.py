from dataclasses import replace

import pytest
import torch

from pd_editor.generation.core import attention
from pd_editor.generation.features.map_pieces import CROSSWALK_KIND
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.initial_state.network import map_tokens
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_YES,
    Conditioning,
    order_by,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.generation.inputs import SceneTensors
from tests.generation.initial_state.scenes import (
    scene_batch,
    small_model,
    trained_a_little,
)

PER_AGENT = ("agent_pose", "agent_speed", "agent_size", "agent_kind", "has_agent")


NUM_PARTS = InitialStateConfig().num_state_parts


def noisy_states(scene: SceneTensors, num: int = 2, seed: int = 0) -> torch.Tensor:
    random = torch.Generator().manual_seed(seed)
    return torch.randn((num, *scene.has_agent.shape, NUM_PARTS), generator=random)


def denoised(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    noisy: torch.Tensor,
    task: Conditioning | None = None,
    level: float = 0.4,
) -> torch.Tensor:
    task = sampling_conditioning(scene) if task is None else task
    with torch.no_grad():
        context = model.encode_context(scene, task)
        levels = model.encode_level(torch.full(noisy.shape[:2], level), context)
        return model.denoise(noisy, levels, context)


def only_scene(scene: SceneTensors, row: int) -> SceneTensors:
    fields = {name: getattr(scene, name)[row : row + 1] for name in vars(scene)}
    return SceneTensors(**fields)


def test_an_encoded_map_serves_other_agents():
    """Pedestrians and vehicles see crosswalks at different distances."""
    scene, model = scene_batch(6), small_model()
    kinds = scene.piece_kind.clone()
    kinds[:, ::2] = CROSSWALK_KIND
    scene = replace(scene, piece_kind=kinds)
    walking = replace(scene, agent_kind=torch.full_like(scene.agent_kind, PEDESTRIAN))
    noisy = noisy_states(scene)
    task = sampling_conditioning(walking)
    with torch.no_grad():
        for known in (scene, walking):
            context = model.encode_context(walking, task, model.encode_map(known))
            levels = model.encode_level(torch.full(noisy.shape[:2], 0.4), context)
            found = model.denoise(noisy, levels, context)
            assert torch.equal(found, denoised(model, walking, noisy))


def test_padding_has_no_influence():
    scene, model = scene_batch(3, 9), small_model()
    noisy = noisy_states(scene)
    before = denoised(model, scene, noisy)
    absent = ~scene.has_agent[0]
    noisy[:, 0, absent] += 5.0
    pose, piece = scene.agent_pose.clone(), scene.piece_pose.clone()
    size, shape = scene.agent_size.clone(), scene.piece_shape.clone()
    pose[0, absent], size[0, absent] = 3.0, 9.0
    piece[~scene.has_piece], shape[~scene.has_piece] = 7.0, 9.0
    boundary = scene.boundary_pose.clone()
    boundary[~scene.has_boundary] = 7.0
    changed = replace(
        scene,
        agent_pose=pose,
        agent_size=size,
        piece_pose=piece,
        piece_shape=shape,
        boundary_pose=boundary,
    )
    after = denoised(model, changed, noisy)
    assert torch.equal(before[:, scene.has_agent], after[:, scene.has_agent])


def test_a_scene_alone_equals_the_scene_in_a_batch():
    scene, model = scene_batch(3, 9), small_model()
    noisy = noisy_states(scene)
    both = denoised(model, scene, noisy)
    for row in range(2):
        alone = denoised(model, only_scene(scene, row), noisy[:, row : row + 1])
        torch.testing.assert_close(alone[:, 0], both[:, row], rtol=1e-4, atol=1e-5)


def test_decentralised_agents_do_not_influence_others():
    scene, model = scene_batch(6), small_model()
    noisy = noisy_states(scene)
    shifted = noisy.clone()
    shifted[:, :, 0] += 1.0
    for is_central in (False, True):
        task = replace(
            sampling_conditioning(scene), is_central=torch.tensor([is_central])
        )
        before, after = (denoised(model, scene, one, task) for one in (noisy, shifted))
        assert torch.equal(before[:, :, 1:], after[:, :, 1:]) is not is_central


def permuted(scene: SceneTensors, order: torch.Tensor) -> SceneTensors:
    return replace(
        scene, **{name: getattr(scene, name)[:, order] for name in PER_AGENT}
    )


@pytest.mark.parametrize("is_ordered", [False, True])
def test_agents_come_out_in_the_order_they_go_in(is_ordered: bool):
    scene, model = scene_batch(7), small_model(is_ordered=is_ordered)
    order = torch.randperm(7, generator=torch.Generator().manual_seed(0))
    task = sampling_conditioning(scene)
    moved = replace(task, order=task.order[:, order])
    noisy = noisy_states(scene)
    before = denoised(model, scene, noisy, task)
    after = denoised(model, permuted(scene, order), noisy[:, :, order], moved)
    torch.testing.assert_close(before[:, :, order], after, rtol=1e-4, atol=1e-5)


def test_the_place_in_the_order_counts_only_if_it_is_told():
    scene = scene_batch(7)
    task = sampling_conditioning(scene)
    other = replace(task, order=task.order.flip(1))
    noisy = noisy_states(scene)
    for is_ordered in (False, True):
        model = small_model(is_ordered=is_ordered)
        one, two = (denoised(model, scene, noisy, each) for each in (task, other))
        assert torch.equal(one, two) is not is_ordered


def test_traits_count_once_they_are_learnt():
    scene, noisy = scene_batch(7), noisy_states(scene_batch(7))
    task = sampling_conditioning(scene)
    for name in ("moves", "on_road"):
        model = small_model()
        told = replace(task, **{name: torch.full_like(task.moves, CONDITIONED_YES)})
        before, same = (denoised(model, scene, noisy, one) for one in (task, told))
        assert torch.equal(before, same)
        torch.nn.init.normal_(getattr(model, f"{name}_token").weight[CONDITIONED_YES])
        assert torch.equal(denoised(model, scene, noisy, task), before)
        assert not torch.equal(denoised(model, scene, noisy, told), before)


def test_order_counts_those_drawn_of_a_kind_from_left_to_right():
    scene = replace(scene_batch(5), agent_kind=torch.tensor([[0, 0, 4, 0, 4]]))
    x = torch.tensor([[3.0, -1.0, 0.0, 1.0, -9.0]])
    is_given = torch.tensor([[False, False, False, True, False]])
    assert order_by(x, scene, is_given).tolist() == [[2, 1, 2, 0, 1]]


def test_given_agents_stay_and_count():
    scene, model = scene_batch(6), small_model()
    is_given = torch.tensor([[True, True, False, False, False, False]])
    task = sampling_conditioning(scene, is_given)
    noisy = noisy_states(scene)
    before = denoised(model, scene, noisy, task)
    context = model.encode_context(scene, task)
    assert torch.equal(before[:, 0, :2], context.given[:, :2].expand(2, 2, NUM_PARTS))
    other = noisy.clone()
    other[:, :, :2] = 0.0
    assert torch.equal(before, denoised(model, scene, other, task))
    pose = scene.agent_pose.clone()
    pose[:, 0, :2] += 5.0
    after = denoised(model, replace(scene, agent_pose=pose), noisy, task)
    assert not torch.equal(before[:, :, 2:], after[:, :, 2:])


def test_what_is_drawn_does_not_depend_on_its_recorded_state():
    scene, model = scene_batch(6), small_model(is_ordered=True)
    noisy = noisy_states(scene)
    pose, speed = scene.agent_pose + 4.0, scene.agent_speed + 2.0
    other = replace(scene, agent_pose=pose, agent_speed=speed)
    assert torch.equal(denoised(model, scene, noisy), denoised(model, other, noisy))


def test_a_map_without_pieces_is_no_trouble():
    scene, model = scene_batch(4), small_model()
    bare = replace(
        scene,
        has_piece=torch.zeros_like(scene.has_piece),
        has_boundary=torch.zeros_like(scene.has_boundary),
    )
    assert denoised(model, bare, noisy_states(scene)).isfinite().all()


def test_at_the_lowest_level_the_noisy_state_is_nearly_believed():
    scene, model = scene_batch(6), small_model()
    noisy = noisy_states(scene)
    found = denoised(model, scene, noisy, level=0.0)
    assert (found - noisy).abs().max() < 0.2


def test_given_agents_far_out_do_not_count():
    scene, model = scene_batch(6), small_model()
    is_given = torch.tensor([[True, False, False, False, False, False]])
    task, noisy = sampling_conditioning(scene, is_given), noisy_states(scene)
    found = []
    for x in (20.0, 30.0, 120.0, 150.0):
        pose = scene.agent_pose.clone()
        pose[:, 0, 0] = x
        drawn = denoised(model, replace(scene, agent_pose=pose), noisy, task)
        found.append(drawn[:, :, 1:])
    assert not torch.equal(found[0], found[1])
    assert torch.equal(found[2], found[3])


def test_all_noise_levels_at_once_are_each_of_them_alone():
    scene, model = scene_batch(5, 7), small_model()
    is_given = torch.zeros_like(scene.has_agent)
    is_given[:, 1] = True
    for given in (None, is_given):
        task, noisy = sampling_conditioning(scene, given), noisy_states(scene)
        with torch.no_grad():
            context = model.encode_context(scene, task)
            table = model.encode_level(torch.tensor([0.9, 0.4])[:, None, None], context)
            found = model.denoise(noisy, table.at(1), context)
        expected = denoised(model, scene, noisy, task, 0.4)
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


ADDITIONS = (
    "sees_signals",
    "sees_boundary",
    "relates_map_tokens",
    "sees_box_gaps",
    "folds_turns",
    "samples_activity",
)


def former_and_grown(*additions: str) -> tuple[InitialStateDenoiser, ...]:
    """A network as they were before the additions, and one that goes on from it."""
    former = small_model(is_ordered=True)
    off = dict.fromkeys(ADDITIONS, False)
    former = trained_a_little(
        InitialStateDenoiser(replace(former.config, **off)).eval()
    )
    config = replace(former.config, **dict.fromkeys(additions, True))
    grown = InitialStateDenoiser(config).eval()
    tensors = grown.state_dict()
    for name, old in former.state_dict().items():
        new = tensors[name]
        # Inputs that came later count nothing.
        new = (
            torch.zeros_like(new)
            if new.ndim > 1 and new.shape[1:] != old.shape[1:]
            else new
        )
        new[tuple(slice(size) for size in old.shape)] = old
        tensors[name] = new
    grown.load_state_dict(tensors)
    return former, grown


@pytest.mark.parametrize("additions", [*((one,) for one in ADDITIONS), ADDITIONS])
def test_a_network_that_has_grown_begins_where_the_former_one_was(
    additions: tuple[str, ...],
):
    former, grown = former_and_grown(*additions)
    scene, noisy = scene_batch(5, 9), noisy_states(scene_batch(5, 9))
    is_given = torch.zeros_like(scene.has_agent)
    is_given[:, 1] = True
    task = sampling_conditioning(scene, is_given)
    for level in (0.0, 0.4, 1.0):
        before = denoised(former, scene, noisy[..., :5], task, level)
        states = noisy[..., : grown.config.num_state_parts]
        after = denoised(grown, scene, states, task, level)
        torch.testing.assert_close(after[..., :5], before, rtol=1e-5, atol=1e-5)
    found = denoised(trained_a_little(grown), scene, states, task)
    assert not torch.allclose(found[..., :5], before, atol=1e-3)


def test_the_boundary_counts_wherever_it_is_near():
    scene, model = scene_batch(6), trained_a_little(small_model())
    noisy = noisy_states(scene) * 0.1
    before = denoised(model, scene, noisy)
    pose = scene.boundary_pose.clone()
    pose[..., 1] += 2.0
    after = denoised(model, replace(scene, boundary_pose=pose), noisy)
    assert ((after - before).abs().amax(dim=(0, 1, 3)) > 1e-4).all()
    pose[..., :2] = 200.0
    far = denoised(model, replace(scene, boundary_pose=pose), noisy)
    nothing = torch.zeros_like(scene.has_boundary)
    gone = denoised(model, replace(scene, has_boundary=nothing), noisy)
    assert torch.equal(far, gone)


def test_the_activity_of_given_agents_counts_and_may_be_unknown():
    scene, model = scene_batch(6), trained_a_little(small_model())
    is_given = torch.tensor([[True, True, False, False, False, False]])
    task, noisy = sampling_conditioning(scene, is_given), noisy_states(scene)
    found = []
    for activity in range(4):
        known = scene.agent_activity.clone()
        known[:, 0] = activity
        clean = denoised(model, replace(scene, agent_activity=known), noisy, task)
        assert clean.isfinite().all()
        found.append(clean[:, :, 2:])
    assert all(
        not torch.equal(one, two) for one in found for two in found if one is not two
    )


class Step(torch.nn.Module):
    """A denoising step as a function of noisy states alone."""

    def __init__(self, model: InitialStateDenoiser, scene: SceneTensors) -> None:
        super().__init__()
        self.model = model
        self.context = model.encode_context(scene, sampling_conditioning(scene))
        self.level = model.encode_level(torch.full((1, 1), 0.4), self.context)

    def forward(self, noisy: torch.Tensor) -> torch.Tensor:
        return self.model.denoise(noisy, self.level, self.context)


def test_a_step_can_be_exported():
    scene, model = scene_batch(5), small_model()
    noisy, other = (noisy_states(scene, 1, seed) for seed in (0, 1))
    with torch.no_grad():
        step = Step(model, scene).eval()
        expected = step(other)
        graph = torch.export.export(step, (noisy,), strict=False).module()
        torch.testing.assert_close(graph(other), expected)
        torch.testing.assert_close(step(other), expected)


def test_what_is_not_asked_of_a_gpu_changes_nothing(monkeypatch):
    """On a GPU masks are applied without asking whether they hide anything."""
    scene, model = scene_batch(3), small_model()
    expected = denoised(model, scene, noisy_states(scene))
    for module in (attention, map_tokens):
        monkeypatch.setattr(module, "is_known", lambda _: False)
    found = denoised(model, scene, noisy_states(scene))
    torch.testing.assert_close(found[:, scene.has_agent], expected[:, scene.has_agent])
