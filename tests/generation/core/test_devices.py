import torch
from torch import nn

from pd_editor.generation.core.devices import constant, is_known, lay_out_weights


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


def test_constants_take_type_and_device() -> None:
    like = torch.zeros(1, dtype=torch.float64)
    assert torch.equal(constant([1, 0.5], like), torch.tensor([1, 0.5]).double())
    assert constant([1], torch.zeros(1, device="meta")).is_meta


def test_a_device_that_would_have_to_be_waited_for_is_not_asked() -> None:
    """Tensors of the device meta, like those of a GPU, are not on the CPU."""
    yes = torch.ones((), dtype=torch.bool)
    assert is_known(yes)
    assert not is_known(~yes)
    assert not is_known(yes.to("meta"))
