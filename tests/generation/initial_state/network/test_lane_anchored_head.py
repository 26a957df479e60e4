import torch

from pd_editor.generation.core.attention import Mask, grouped
from pd_editor.generation.initial_state.network.map_tokens import (
    LaneAnchoredHead,
    NearTokens,
)


def proposals(
    module: LaneAnchoredHead,
    exists: torch.Tensor | None = None,
    turn: complex = 1.0,
    num_boundary: int = 0,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Of six tokens near each of three agents: the result, and the tokens' axes."""
    random = torch.Generator().manual_seed(0)
    angle = 7 * torch.rand((1, 1, 3, 6), generator=random)
    axis = torch.polar(torch.ones_like(angle), angle) * turn
    there = torch.ones(1, 1, 3, 6, dtype=torch.bool) if exists is None else exists
    relations = torch.randn((1, 1, 3, 6, 5), generator=random)
    tokens = torch.randn((1, 1, 3, 6, 16), generator=random)
    numbers = (6 - num_boundary, num_boundary) if num_boundary else (6,)
    masks = [Mask.of(one[..., None, :]) for one in there.split(numbers, -1)]
    near = NearTokens(
        relations, tokens, axis, numbers, grouped(masks, numbers, relations)
    )
    of_groups = relations.split(numbers, dim=-2)
    with torch.no_grad():
        found = module(
            torch.randn((1, 1, 3, 16), generator=random), of_groups, near, tokens
        )
    return found, axis


def head(*, has_boundary: bool = False) -> LaneAnchoredHead:
    torch.manual_seed(0)
    return LaneAnchoredHead(16, 5, has_boundary=has_boundary).eval()


def test_the_pose_proposed_by_the_only_token_is_in_its_frame():
    exists = torch.zeros(1, 1, 3, 6, dtype=torch.bool)
    exists[..., 2] = True
    module = head()
    with torch.no_grad():
        module.propose.weight.zero_()
        module.propose.bias.copy_(torch.tensor([9.0, 0.0, 2.0, 1.0, 0.0]))
    found, axis = proposals(module, exists)
    torch.testing.assert_close(found[..., 0], 2j * axis[..., 2])
    torch.testing.assert_close(found[..., 1], axis[..., 2])


def test_agents_without_map_tokens_get_no_proposal():
    exists = torch.ones(1, 1, 3, 6, dtype=torch.bool)
    exists[:, :, 1] = False
    found, _ = proposals(head(), exists)
    assert (found[:, :, 1] == 0).all()
    assert (found[:, :, [0, 2]].abs().sum(dim=-1) > 0).all()


def test_proposals_turn_with_the_road():
    module, turn = head(), 0.6 + 0.8j
    before, _ = proposals(module)
    after, _ = proposals(module, turn=turn)
    torch.testing.assert_close(after, before * turn)


def test_a_car_at_a_kerb_is_placed_in_the_frame_of_the_kerb():
    module = head(has_boundary=True)
    with torch.no_grad():
        module.propose.weight.zero_()
        module.propose.bias.zero_()
        assert (proposals(module, num_boundary=2)[0] == 0).all()
        module.propose_boundary.bias.copy_(torch.tensor([9.0, 0.0, 2.0, 1.0, 0.0]))
    exists = torch.ones(1, 1, 3, 6, dtype=torch.bool)
    exists[..., 5] = False
    found, axis = proposals(module, exists, num_boundary=2)
    torch.testing.assert_close(found[..., 0], 2j * axis[..., 4])
    torch.testing.assert_close(found[..., 1], axis[..., 4])
