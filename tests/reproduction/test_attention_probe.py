import pytest
import torch

from pd_editor.generation.core.attention import DifferentialAttention, Mask
from reproduction.attention_probe import AttentionProbe, attention_variance
from tests.generation.initial_state.scenes import (
    scene_batch,
    small_model,
    trained_a_little,
)


def test_equal_scores_do_not_vary_and_one_sided_ones_do():
    model, scene = small_model(), scene_batch(5)
    with torch.no_grad():
        for layer in model.layers:
            layer.map_attention.to_queries.weight.zero_()
    flat = attention_variance(model, [scene], [0.5])[0]
    assert flat.over_map == pytest.approx(0.0, abs=1e-12)
    model = trained_a_little(small_model())
    with torch.no_grad():
        for layer in model.layers:
            layer.map_attention.to_queries.weight *= 50
    found = attention_variance(model, [scene], [0.0, 0.5, 1.0])
    assert len(found) == 3
    assert all(one.over_map > 1e-4 for one in found)
    assert all(one.over_agents > 0 for one in found)


@pytest.mark.parametrize("is_differential", [True, False])
def test_scores_are_the_weights_of_the_result(is_differential: bool):
    torch.manual_seed(0)
    layer = DifferentialAttention(16, 2, depth=0, is_differential=is_differential)
    tokens, queries = torch.randn(1, 7, 16), torch.randn(1, 3, 16)
    seen = layer.encode(tokens, Mask(None, None))
    scores = layer.scores(queries, seen)
    share = -float(seen.second_share.detach()) if is_differential else 0.0
    torch.testing.assert_close(
        scores.sum(dim=-1), torch.full((1, 2, 3), 1 - share), atol=1e-5, rtol=1e-5
    )


def test_a_probe_that_is_gone_records_nothing():
    model, scene = small_model(), scene_batch(4)
    probe = AttentionProbe()
    with probe.attached(model):
        attention_variance(model, [scene], [0.5])
    number = len(probe.over_map)
    assert number == len(model.layers)
    attention_variance(model, [scene], [0.5])
    assert len(probe.over_map) == number
    assert not any(one._forward_pre_hooks for one in model.modules())


def test_padding_and_lonely_agents_do_not_count():
    model = trained_a_little(small_model())
    alone = attention_variance(model, [scene_batch(1)], [0.5])[0]
    assert alone.over_agents != alone.over_agents
