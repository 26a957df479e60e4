import torch
from torch import nn

from pd_editor.generation.core.devices import lay_out_weights


def test_weights_laid_out_anew_have_the_same_values() -> None:
    torch.manual_seed(0)
    first = nn.Linear(5, 7)
    model = nn.Sequential(first, nn.ReLU(), nn.Linear(7, 3))
    values, former = torch.randn(4, 5), [one.clone() for one in model.parameters()]
    expected = model(values)
    lay_out_weights(model)
    for one, other in zip(model.parameters(), former, strict=True):
        assert torch.equal(one, other)
    assert first.weight.T.is_contiguous()
    torch.testing.assert_close(model(values), expected)
