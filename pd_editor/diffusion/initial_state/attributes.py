"""Deciding, before agents are placed, who of them moves and who is on the road."""

from dataclasses import dataclass, replace

import numpy as np
import torch

from pd_editor.diffusion.initial_state.agent_count_prior import (
    AgentCounts,
    cells_of,
    lane_length_m,
)
from pd_editor.diffusion.initial_state.conditioning import TOLD_NO, TOLD_YES, PoseTask
from pd_editor.diffusion.initial_state.lane_distance import follows_lanes
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.errors import GenerationError


@dataclass(frozen=True, kw_only=True)
class TraitWishes:
    """What a user wants of the agents that are placed."""

    moving_share: float | None = None
    """Of those of each kind; None: as many as on roads alike."""
    only_on_road: bool = False
    """No vehicles far from lanes, as they are on parking lots."""


def with_traits(
    task: PoseTask,
    scene: SceneTensors,
    counts: AgentCounts,
    random: np.random.Generator,
    wishes: TraitWishes | None = None,
) -> PoseTask:
    """The task with the traits of all drawn agents told, if anything is wished.

    What no wish decides is drawn as on roads alike. Without wishes the network is left
    to itself: it judges from the road who parks beside it.

    Args:
        task: of one scene (B = 1).
        scene: the same one.
        counts: what training squares hold.
        random: random numbers.
        wishes: instead of what is usual.

    Raises:
        GenerationError: there are wishes, but no training squares.
    """
    wishes = TraitWishes() if wishes is None else wishes
    if wishes == TraitWishes():
        return task
    if not len(counts.lane_m):
        raise GenerationError(
            "These weights do not know moving and parked agents apart; leave out the "
            "share that moves, and where they may be."
        )
    half_side_m = float(task.half_side_m[0])
    pose, shape, kind = (
        one[scene.has_piece].cpu().numpy()
        for one in (scene.piece_pose, scene.piece_shape, scene.piece_kind)
    )
    is_drawn = (scene.has_agent & ~task.is_given)[0].cpu().numpy()
    is_inside = (scene.agent_pose[0, :, :2].abs() <= half_side_m).all(dim=-1)
    is_present = (scene.has_agent & task.is_given)[0] & is_inside
    drawn = counts.draw_traits(
        scene.agent_kind[0].cpu().numpy()[is_drawn],
        cells_of(scene, is_present.cpu().numpy()),
        lane_length_m(pose, shape, kind, half_side_m),
        half_side_m,
        random,
        moving_share=wishes.moving_share,
        only_on_road=wishes.only_on_road,
    )
    codes = np.zeros((2, *is_drawn.shape), int)
    codes[:, is_drawn] = np.where([drawn.moves, drawn.on_road], TOLD_YES, TOLD_NO)
    moves, on_road = torch.from_numpy(codes[:, None]).to(task.moves.device)
    return replace(task, moves=moves, on_road=on_road * follows_lanes(scene))
