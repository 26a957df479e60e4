import pytest
import torch
from torch import nn

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.stage_objective import start_from


def network(width_in: int, width_out: int) -> nn.Module:
    return nn.Sequential(nn.Linear(width_in, 8), nn.ReLU(), nn.Linear(8, width_out))


def test_a_network_with_more_inputs_and_outputs_computes_what_the_earlier_did():
    earlier, later = network(3, 2), network(5, 4)
    fresh = later[2].weight[2:].clone()
    start_from(later, earlier.state_dict(), "model")
    x = torch.randn(6, 5)
    assert torch.allclose(later(x)[:, :2], earlier(x[:, :3]), atol=1e-6)
    assert torch.equal(later[2].weight[2:], fresh)


def test_what_the_network_does_not_have_is_left_out_and_new_layers_stay_fresh():
    later = nn.ModuleDict({"new": nn.Linear(2, 2), "old": nn.Linear(2, 2)})
    fresh = later["new"].weight.clone()
    old = torch.ones(2, 2)
    start_from(later, {"old.weight": old, "gone": torch.ones(3)}, "model")
    assert torch.equal(later["old"].weight, old)
    assert torch.equal(later["new"].weight, fresh)


def test_a_larger_network_is_refused():
    with pytest.raises(TrainingError, match="from smaller networks only"):
        start_from(network(3, 2), network(5, 2).state_dict(), "model")
