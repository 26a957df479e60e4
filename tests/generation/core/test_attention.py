import math

import pytest
import torch

from pd_editor.generation.core.attention import (
    DifferentialAttention,
    EdgeAttention,
    Mask,
    initial_lambda,
    visible_agents,
)


@pytest.fixture(autouse=True)
def _seed():
    torch.manual_seed(0)


@pytest.mark.parametrize("depth", [0, 1, 2])
def test_differential_attention_against_its_formula(depth: int):
    heads, width = 2, 16
    attention = DifferentialAttention(width, heads, depth=depth)
    tokens, seen = torch.randn(3, 5, width), torch.randn(3, 7, width)
    is_token = torch.rand(3, 7) < 0.7
    is_token[:, 0] = True
    found = attention(tokens, attention.encode(seen, Mask.of(is_token[:, None, None])))

    start = 0.8 - 0.6 * math.exp(-0.3 * depth)
    one, two, three, four = attention.lambda_vectors
    share = (one @ two).exp() - (three @ four).exp() + start
    weight_q, weight_k = attention.to_queries.weight * 8**0.5, attention.to_keys.weight
    q = torch.einsum("bqd,ed->bqe", tokens, weight_q).reshape(3, 5, heads, 2, 8)
    k = torch.einsum("bkd,ed->bke", seen, weight_k).reshape(3, 7, heads, 2, 8)
    v = torch.einsum("bkd,ed->bke", seen, attention.to_values.weight)
    v = v.reshape(3, 7, heads, 8)
    logits = torch.einsum("bqhmc,bkhmc->bhmqk", q, k) / math.sqrt(8)
    logits[~is_token[:, None, None, None].expand_as(logits)] = -math.inf
    maps = torch.softmax(logits, dim=-1)
    taken = torch.einsum("bhqk,bkhc->bqhc", maps[:, :, 0] - share * maps[:, :, 1], v)
    size = taken.square().mean(dim=-1, keepdim=True).add(1e-5).sqrt()
    expected = (taken / size).flatten(2) @ attention.to_output.weight.T
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


def test_first_lambdas_are_those_of_the_source():
    starts = [initial_lambda(depth) for depth in range(3)]
    assert starts == pytest.approx([0.2, 0.3555, 0.4707], abs=1e-4)


def test_plain_attention_against_torch():
    attention = DifferentialAttention(16, 4, depth=0, is_differential=False)
    tokens, seen = torch.randn(2, 5, 16), torch.randn(2, 7, 16)
    is_token = torch.rand(2, 7) < 0.6
    is_token[:, 0] = True
    found = attention(tokens, attention.encode(seen, Mask.of(is_token[:, None, None])))
    weights = torch.cat(
        [
            attention.to_queries.weight * 2,
            attention.to_keys.weight,
            attention.to_values.weight,
        ]
    )
    expected, _ = torch.nn.functional.multi_head_attention_forward(
        tokens.transpose(0, 1),
        seen.transpose(0, 1),
        seen.transpose(0, 1),
        16,
        4,
        weights,
        None,
        None,
        None,
        add_zero_attn=False,
        dropout_p=0.0,
        out_proj_weight=attention.to_output.weight,
        out_proj_bias=torch.zeros(16),
        key_padding_mask=~is_token,
    )
    torch.testing.assert_close(found, expected.transpose(0, 1), rtol=1e-4, atol=1e-5)


def test_hidden_keys_weigh_exactly_nothing():
    logits = 50 * torch.randn(4, 6, 9)
    is_visible = torch.rand(4, 6, 9) < 0.5
    is_visible[0] = False
    weights = Mask.of(is_visible).weights(logits)
    assert not weights[~is_visible].any()
    sums = weights.sum(dim=-1)
    sees_any = is_visible.any(dim=-1)
    torch.testing.assert_close(sums, sees_any.float())


def test_no_visible_key_gives_zeros_and_finite_slopes():
    logits = torch.randn(2, 3, requires_grad=True)
    weights = Mask.of(torch.zeros(2, 3).bool()).weights(logits)
    weights.square().sum().backward()
    assert logits.grad is not None
    assert not logits.grad.any()
    assert not weights.any()


@pytest.mark.parametrize("with_tokens", [False, True])
def test_hidden_neighbors_change_nothing(with_tokens: bool):
    attention = EdgeAttention(16, 8, 2, with_tokens=with_tokens)
    tokens, relations = torch.randn(1, 4, 16), torch.randn(1, 4, 4, 8)
    is_visible = ~torch.eye(4, dtype=torch.bool)[None]
    is_visible[:, :, 3] = False
    before = attention(tokens, relations, Mask.of(is_visible[:, :, None]))
    tokens[:, 3] += 10.0
    relations[:, :, 3] += 10.0
    after = attention(tokens, relations, Mask.of(is_visible[:, :, None]))
    assert torch.equal(before[:, :3], after[:, :3])


def test_decentralised_scenes_are_isolated():
    has_agent = torch.tensor([[True, True, False], [True, True, True]])
    visible = visible_agents(has_agent, torch.tensor([True, False]))
    assert visible[0].tolist() == [
        [False, True, False],
        [True, False, False],
        [True, True, False],
    ]
    assert not visible[1].any()


@pytest.mark.parametrize("with_tokens", [False, True])
def test_an_agent_without_an_edge_gets_zeros(with_tokens: bool):
    attention = EdgeAttention(16, 8, 2, with_tokens=with_tokens)
    is_visible = torch.ones(1, 4, 1, 4, dtype=torch.bool)
    is_visible[:, 2] = False
    found = attention(
        torch.randn(1, 4, 16), torch.randn(1, 4, 4, 8), Mask.of(is_visible)
    )
    assert not found[0, 2].any()
    assert found[0, [0, 1, 3]].abs().sum(dim=-1).all()
