import torch

from pd_editor.diffusion.core.attention import Mask
from pd_editor.diffusion.initial_state.features import turned
from pd_editor.diffusion.initial_state.lane_anchored_head import LaneVotes, NearPieces


def votes(seed: int = 0) -> LaneVotes:
    torch.manual_seed(seed)
    return LaneVotes(16, 5, 8).eval()


def near(seed: int = 0, *, exists: torch.Tensor | None = None) -> NearPieces:
    """Six pieces near each of three agents."""
    random = torch.Generator().manual_seed(seed)
    angle = 7 * torch.rand((1, 3, 6), generator=random)
    there = torch.ones(1, 3, 6, dtype=torch.bool) if exists is None else exists
    return NearPieces(
        axis=torch.stack([angle.cos(), angle.sin()], dim=-1),
        facts=torch.randn((1, 3, 6, 5), generator=random),
        relations=torch.randn((1, 3, 6, 8), generator=random),
        mask=Mask.of(there[:, :, None]),
    )


def tokens(seed: int = 1) -> torch.Tensor:
    return torch.randn((1, 3, 16), generator=torch.Generator().manual_seed(seed))


def test_the_only_piece_is_believed_in_its_own_frame():
    exists = torch.zeros(1, 3, 6, dtype=torch.bool)
    exists[..., 2] = True
    module, pieces = votes(), near(exists=exists)
    with torch.no_grad():
        module.vote.weight.zero_()
        module.vote.bias.copy_(torch.tensor([9.0, 0.0, 2.0, 1.0, 0.0]))
        found = module(tokens(), pieces)
    axis = pieces.axis[:, :, 2]
    left = torch.stack([-axis[..., 1], axis[..., 0]], dim=-1)
    torch.testing.assert_close(found[..., :2], 2 * left)
    torch.testing.assert_close(found[..., 2:], axis)


def test_agents_without_road_get_no_vote():
    exists = torch.ones(1, 3, 6, dtype=torch.bool)
    exists[:, 1] = False
    with torch.no_grad():
        found = votes()(tokens(), near(exists=exists))
    assert (found[:, 1] == 0).all()
    assert (found[:, [0, 2]].abs().sum(dim=-1) > 0).all()


def test_votes_turn_with_the_road():
    pieces, module = near(), votes()
    turn = torch.tensor([0.6, 0.8])
    later = pieces._replace(axis=turned(pieces.axis, turn.expand_as(pieces.axis)))
    with torch.no_grad():
        before, after = module(tokens(), pieces), module(tokens(), later)
    expected = turned(before.unflatten(-1, (2, 2)), turn.expand(1, 3, 2, 2))
    torch.testing.assert_close(after, expected.flatten(-2))
