from dataclasses import replace

import torch

from pd_editor.generation.trajectory.guidance.nearest_candidate import (
    NearestCandidateGuide,
    TrajectoryGuidance,
)

STILL, CREEPS, LEAVES = 0.0, 0.3, 20.0


def guide_of_one(*, is_standing: bool) -> NearestCandidateGuide:
    """An agent with a standing candidate and two that move, told by one number."""
    candidates = torch.zeros(1, 1, 3, 10)
    candidates[0, 0, :, 0] = torch.tensor([STILL, CREEPS, LEAVES])
    return NearestCandidateGuide(
        weight=torch.ones(1, 1),
        candidates=candidates,
        allowed=torch.ones(1, 1, 3, dtype=torch.bool),
        is_standing=torch.tensor([[is_standing]]),
        stays=torch.tensor([[[True, True, False]]]),
        still=torch.zeros(1, 1, 10),
        scale=torch.ones(10),
    )


def guided(predicted: float, level: float, *, is_standing: bool) -> float:
    clean = torch.zeros(1, 1, 1, 10)
    clean[..., 0] = predicted
    return float(guide_of_one(is_standing=is_standing)(clean, level)[..., 0])


def test_the_last_step_is_guided_by_its_share_only() -> None:
    """By default what is returned is the network's own prediction."""
    guide = replace(guide_of_one(is_standing=False), last_level=0.2)
    clean = torch.full((1, 1, 1, 10), 5.0)
    assert torch.equal(guide(clean, 0.2), clean)
    assert not torch.equal(guide(clean, 0.4), clean)
    moved = guide(clean, 0.4) - clean
    guidance = TrajectoryGuidance(last_step_share=0.25)
    guide = replace(guide, config=guidance)
    torch.testing.assert_close(guide(clean, 0.2) - clean, 0.25 * moved)


def test_who_stands_is_guided_late() -> None:
    assert guided(5.0, 0.6, is_standing=True) == 5.0
    assert abs(guided(5.0, 0.6, is_standing=False) - CREEPS) < 1e-6
    assert guided(5.0, 0.9, is_standing=False) == 5.0


def test_who_stays_is_held_and_who_starts_is_let_go() -> None:
    assert guided(0.1, 0.2, is_standing=True) == STILL
    assert abs(guided(0.35, 0.2, is_standing=True) - CREEPS) < 1e-6
    # Only a little of the way: the candidate may start much faster.
    assert abs(guided(2.0, 0.2, is_standing=True) - (2.0 + 0.2 * (LEAVES - 2.0))) < 1e-5
