import torch
from torch import nn

from pd_editor.diffusion.core.devices import lay_out_weights


def test_weights_laid_out_anew_have_the_same_values() -> None:
    torch.manual_seed(0)
    first, last = nn.Linear(5, 17), nn.Linear(17, 3)
    model = nn.Sequential(first, nn.ReLU(), last)
    values, former = torch.randn(4, 5), [one.clone() for one in model.parameters()]
    expected = model(values)
    lay_out_weights(model)
    for one, other in zip(model.parameters(), former, strict=True):
        assert torch.equal(one, other)
    assert first.weight.T.is_contiguous()
    assert last.weight.is_contiguous(), "few outputs"
    torch.testing.assert_close(model(values), expected)
