"""Each switch of the first stage changes what it names, and nothing else."""

from dataclasses import replace

import pytest
import torch

from pd_editor.base.errors import ModelError
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.initial_state.loss import (
    InitialStateLossConfig,
    initial_state_loss,
    training_task,
)
from pd_editor.generation.initial_state.network.conditioning import (
    order_by,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.generation.initial_state.sampler import (
    InitialStateSamplerConfig,
    finished_states,
    sample_initial_states,
)
from tests.generation.initial_state.scenes import scene_batch, trained_a_little

SMALL = InitialStateConfig(
    width=32, num_heads=2, num_layers=2, num_near_pieces=6, relation_width=16
)
ABSOLUTE = replace(
    SMALL,
    sees_relations=False,
    sees_boundary=False,
    sees_box_gaps=False,
    folds_turns=False,
    samples_activity=False,
)
PAPER = replace(
    ABSOLUTE, noise_schedule="betas", prediction="noise", orders_all_kinds=True
)


def made(config: InitialStateConfig) -> InitialStateDenoiser:
    torch.manual_seed(0)
    return trained_a_little(InitialStateDenoiser(config)).eval()


def test_without_relations_no_part_of_the_network_is_made_for_them():
    def parts(config: InitialStateConfig) -> set[str]:
        names = {name.split(".")[0] for name, _ in made(config).named_parameters()}
        names |= {
            name.split(".")[2]
            for name, _ in made(config).named_parameters()
            if name.startswith("layers.")
        }
        return names

    related = replace(ABSOLUTE, sees_relations=True)
    assert parts(related) - parts(ABSOLUTE) == {
        "pair_in",
        "near_in",
        "near_token_in",
        "near_context_in",
        "lane_anchored_head",
        "near_attention",
    }
    assert not parts(ABSOLUTE) - parts(related)


def test_without_relations_the_frame_of_the_scene_counts_and_with_them_little():
    scene = scene_batch(6)
    noisy = 0.3 * torch.randn(2, 1, 6, ABSOLUTE.num_state_parts)
    shift = torch.tensor([0.2, -0.1])
    moved = replace(
        scene,
        piece_pose=torch.cat(
            [scene.piece_pose[..., :2] + 62 * shift, scene.piece_pose[..., 2:]], dim=-1
        ),
    )
    for config in (ABSOLUTE, replace(ABSOLUTE, sees_relations=True)):
        model = made(config)
        with torch.no_grad():
            # Without the first layer's coordinates only relations tell where agents are.
            model.state_in.weight[:, :2] = 0
            model.state_in.weight[:, 5:] = 0
            model.map_token[0].weight[:, -24:] = 0
        context = model.encode_context(scene, sampling_conditioning(scene))
        other = model.encode_context(moved, sampling_conditioning(moved))
        level = model.encode_level(torch.full((2, 1), 0.4), context)
        one = model.denoise(noisy, level, context)
        two = model.denoise(noisy, level, other)
        is_blind = torch.allclose(one, two, atol=1e-5)
        assert is_blind is not config.sees_relations


def test_what_needs_relations_is_refused_without_them():
    with pytest.raises(ModelError, match="sees_boundary and sees_box_gaps"):
        replace(SMALL, sees_relations=False)


def test_ranks_among_all_agents_or_within_kinds():
    scene = replace(scene_batch(5), agent_kind=torch.tensor([[0, 0, 4, 0, 4]]))
    x = torch.tensor([[3.0, -1.0, 0.0, 1.0, -9.0]])
    given = torch.tensor([[False, False, False, True, False]])
    found = order_by(x, scene, given, within_kinds=False)
    assert found.tolist() == [[4, 2, 3, 0, 1]]
    assert order_by(x, scene, given).tolist() == [[2, 1, 2, 0, 1]]


@pytest.mark.parametrize("config", [SMALL, ABSOLUTE, PAPER])
def test_cdb_isolates_agents_in_the_named_share_of_the_scenes(
    config: InitialStateConfig,
):
    scene = scene_batch(*[4] * 40)
    shares = {}
    for share in (0.0, 0.5, 1.0):
        settings = InitialStateLossConfig(decentralized_share=share, given_share=0.0)
        task = training_task(scene, torch.Generator().manual_seed(1), settings)[1]
        shares[share] = float((~task.is_central).float().mean())
    assert (shares[0.0], shares[1.0]) == (0.0, 1.0)
    assert 0.3 < shares[0.5] < 0.7
    # An isolated agent does not change when another one does.
    scene, model = scene_batch(5), made(config)
    noisy = torch.randn(1, 1, 5, config.num_state_parts)
    other = noisy.clone()
    other[:, :, 0] += 1.0
    for is_central in (False, True):
        task = replace(
            sampling_conditioning(scene), is_central=torch.tensor([is_central])
        )
        context = model.encode_context(scene, task)
        level = model.encode_level(torch.full((1, 1), 0.5), context)
        one, two = (model.denoise(each, level, context) for each in (noisy, other))
        assert torch.equal(one[:, :, 1:], two[:, :, 1:]) is not is_central


def test_the_predicted_noise_of_the_paper_leads_back_to_the_clean_state():
    model, scene = made(PAPER), scene_batch(4)
    context = model.encode_context(scene, sampling_conditioning(scene))
    clean = model.encode_states(scene)[None]
    noise = torch.randn_like(clean)
    for level in (0.0, 0.3, 1.0):
        table = torch.tensor([[level]])
        alpha = model.schedule.alpha(table[..., None, None])
        sigma = model.schedule.sigma(table[..., None, None])
        torch.testing.assert_close(
            alpha.square() + sigma.square(), torch.ones_like(alpha)
        )
        encoded = model.encode_level(table, context)
        noisy = alpha * clean + sigma * noise
        found = encoded.factor_skip * noisy - encoded.factor_out * noise
        torch.testing.assert_close(found, clean, atol=2e-5, rtol=1e-4)


def test_the_paper_s_loss_is_the_error_of_the_noise_alone():
    config = InitialStateLossConfig(
        across_weight=1.0, overlap_weight=0.0, given_share=0.0
    )
    scene = scene_batch(6, 9)
    loss, parts = initial_state_loss(
        made(PAPER), scene, torch.Generator().manual_seed(0), config=config
    )
    assert set(parts) == {"position", "heading", "speed"}
    # An output of 0 is wrong by the noise, whose variance is 1.
    model = made(PAPER)
    with torch.no_grad():
        for parameter in model.output.parameters():
            parameter.zero_()
    many = scene_batch(*[9] * 30)
    blank, parts = initial_state_loss(
        model, many, torch.Generator().manual_seed(0), config=config
    )
    assert float(blank.detach()) == pytest.approx(3.0, rel=0.1)
    assert loss.isfinite()


def test_the_paper_s_variant_samples_deterministically_from_its_noise():
    scene = scene_batch(7)
    model = made(PAPER)
    task = sampling_conditioning(scene, within_kinds=False)
    settings = InitialStateSamplerConfig(
        num_steps=6, level_emphasis=0.0, eta=0.0, is_second_order=False
    )
    for _ in range(2):
        steps = list(
            sample_initial_states(
                model,
                scene,
                RandomStreams(3, "states", [0, 1]),
                task,
                config=settings,
            )
        )
        assert len(steps) == 6
        assert finished_states(scene, task, steps[-1].clean).isfinite().all()
