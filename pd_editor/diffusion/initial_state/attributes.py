"""Attributes by which initial states are conditioned: moving or not, on-road or not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from pd_editor.diffusion.initial_state.agent_count_prior import (
    AgentCounts,
    cells_of,
    lane_length_m,
)
from pd_editor.diffusion.initial_state.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    Conditioning,
)
from pd_editor.diffusion.initial_state.lane_distance import follows_lanes
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.errors import GenerationError
from pd_editor.metrics.road.off_road import is_off_road
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS


@dataclass(frozen=True, kw_only=True)
class AttributeRequest:
    """Attributes that a user requests."""

    moving_share: float | None = None
    """Share of moving agents of each kind; None: as on similar roads."""
    only_on_road: bool = False
    """Whether there are no vehicles far from lanes, such as on parking lots."""


def with_attributes(
    task: Conditioning,
    scene: SceneTensors,
    counts: AgentCounts,
    random: np.random.Generator,
    request: AttributeRequest | None = None,
) -> Conditioning:
    """Add the attributes of all sampled agents to a conditioning, if any are requested.

    Attributes that the request leaves open are sampled as on similar roads. Without a
    request agents are unconditioned: the network samples which ones park.

    Args:
        task: conditioning of one scene (B = 1).
        scene: the same scene.
        counts: counts of training squares.
        random: random generator.
        request: requested attributes.

    Raises:
        GenerationError: attributes are requested, but there are no training squares.
    """
    request = AttributeRequest() if request is None else request
    if request == AttributeRequest():
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
    is_sampled = (scene.has_agent & ~task.is_given)[0].cpu().numpy()
    is_inside = (scene.agent_pose[0, :, :2].abs() <= half_side_m).all(dim=-1)
    is_present = (scene.has_agent & task.is_given)[0] & is_inside
    sampled = counts.sample_attributes(
        scene.agent_kind[0].cpu().numpy()[is_sampled],
        cells_of(scene, is_present.cpu().numpy()),
        lane_length_m(pose, shape, kind, half_side_m),
        half_side_m,
        random,
        moving_share=request.moving_share,
        only_on_road=request.only_on_road,
    )
    codes = np.zeros((2, *is_sampled.shape), int)
    codes[:, is_sampled] = np.where(
        [sampled.moves, sampled.on_road], CONDITIONED_YES, CONDITIONED_NO
    )
    moves, on_road = torch.from_numpy(codes[:, None]).to(task.moves.device)
    return replace(task, moves=moves, on_road=on_road * follows_lanes(scene))


def attribute_notes(
    placed: Sequence[tuple[Scenario, tuple[str, ...]]], request: AttributeRequest
) -> tuple[str, ...]:
    """One sentence per requested attribute on the agents placed in some samples.

    Empty if no attribute was requested, or no agent placed.
    """
    count = sum(len(ids) for _, ids in placed)
    notes: list[str] = []
    if count and request.moving_share is not None:
        moving = sum(_num_moving(*one) for one in placed)
        notes.append(
            f"{moving} of {count} placed agents move ({moving / count:.0%}; "
            f"{request.moving_share:.0%} were asked for)."
        )
    if count and request.only_on_road:
        off = sum(_num_off_road(*one) for one in placed)
        notes.append(
            f"{off or 'None'} of {count} placed agents {'is' if off < 2 else 'are'} "
            "off the road."
        )
    return tuple(notes)


def _num_moving(scenario: Scenario, ids: tuple[str, ...]) -> int:
    agents = scenario.agents
    velocity = agents.velocity_mps[agents.rows(ids), scenario.current_step]
    return int((np.linalg.norm(velocity, axis=-1) >= MOVING_MPS).sum())


def _num_off_road(scenario: Scenario, ids: tuple[str, ...]) -> int:
    agents = scenario.agents
    rows = agents.rows(ids)
    rows = rows[agents.kind_mask(LANE_FOLLOWER_KINDS)[rows]]
    position_m = agents.position_m[rows, scenario.current_step]
    return int(is_off_road(scenario, position_m).sum())
