"""Attributes by which initial states are conditioned: moving or not, on-road or not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Int

from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.base.errors import GenerationError
from pd_editor.generation.initial_state.network.agent_count_prior import (
    AgentCounts,
    cells_of,
    lane_length_m,
)
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    Conditioning,
)
from pd_editor.generation.initial_state.network.lane_distance import follows_lanes
from pd_editor.generation.inputs import SceneTensors
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.generation import GenerationRequest
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS


@dataclass(frozen=True, kw_only=True)
class AttributeRequest:
    """Attributes that a user requests."""

    moving_share: float | None = None
    """Share of moving agents of each kind; None: as on similar roads."""
    only_on_road: bool = False
    """Whether there are no vehicles far from lanes, such as on parking lots."""

    @classmethod
    def of(cls, request: GenerationRequest) -> "AttributeRequest":
        """What placed agents of a request are to be."""
        return cls(moving_share=request.moving_share, only_on_road=request.only_on_road)


def with_attributes(
    task: Conditioning,
    scene: SceneTensors,
    counts: AgentCounts,
    randoms: Sequence[np.random.Generator],
    request: AttributeRequest | None = None,
) -> Conditioning:
    """Add the attributes of all sampled agents to a conditioning, if any are requested.

    Attributes that the request leaves open are sampled as on similar roads. Without a
    request agents are unconditioned: the network samples which ones park.

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
    half_side_m = task.half_side_m.cpu().numpy().astype(float)
    pieces = [
        one.cpu().numpy()
        for one in (scene.piece_pose, scene.piece_shape, scene.piece_kind)
    ]
    has_piece = scene.has_piece.cpu().numpy()
    is_sampled = _is_sampled(scene, task)
    offset = scene.agent_pose[..., :2].abs().amax(dim=-1)
    is_inside = offset <= task.half_side_m[:, None]
    is_present = scene.has_agent & task.is_given & is_inside
    present = cells_of(scene, is_present.cpu().numpy())
    kinds = scene.agent_kind.cpu().numpy()
    codes = np.zeros((2, *is_sampled.shape), int)
    for index, random in enumerate(randoms):
        counted = is_sampled[index]
        of_map = index if len(has_piece) > 1 else 0
        pose, shape, kind = (one[of_map][has_piece[of_map]] for one in pieces)
        sampled = counts.sample_attributes(
            kinds[index][counted],
            present[index],
            lane_length_m(pose, shape, kind, half_side_m[index]),
            half_side_m[index],
            random,
            moving_share=request.moving_share,
            only_on_road=request.only_on_road,
        )
        codes[:, index, counted] = np.where(
            [sampled.moves, sampled.on_road], CONDITIONED_YES, CONDITIONED_NO
        )
    return _with_codes(task, scene, codes)


def with_attributes_of(
    task: Conditioning,
    scene: SceneTensors,
    placed: Sequence[tuple[Scenario, AgentTracks]],
) -> Conditioning:
    """Condition the sampled agents of each scene on the attributes that they have now.

    Agents that are sampled again stay moving or not, and on the road or not; so the shares
    that were requested are kept. ``placed`` are each scene's sampled agents, in order.
    """
    is_sampled = _is_sampled(scene, task)
    codes = np.zeros((2, *is_sampled.shape), int)
    for index, (scenario, agents) in enumerate(placed):
        step = scenario.current_step
        speed = np.linalg.norm(agents.velocity_mps[:, step], axis=-1)
        is_on_road = ~is_off_road(scenario, agents.position_m[:, step])
        codes[:, index, is_sampled[index]] = np.where(
            [speed >= MOVING_MPS, is_on_road], CONDITIONED_YES, CONDITIONED_NO
        )
    return _with_codes(task, scene, codes)


def _is_sampled(scene: SceneTensors, task: Conditioning) -> Bool[np.ndarray, "B A"]:
    return (scene.has_agent & ~task.is_given).cpu().numpy()


def _with_codes(
    task: Conditioning, scene: SceneTensors, codes: Int[np.ndarray, "2 B A"]
) -> Conditioning:
    moves, on_road = torch.from_numpy(codes).to(task.moves.device)
    return replace(task, moves=moves, on_road=on_road * follows_lanes(scene))


def attribute_notes(
    placed: Sequence[tuple[Scenario, tuple[str, ...]]], request: AttributeRequest
) -> tuple[str, ...]:
    """One sentence per requested attribute on agents placed in some samples, at t = 0.

    Empty if no attribute was requested, or no agent placed.
    """
    count = sum(len(ids) for _, ids in placed)
    where = f" in {len(placed)} samples" if len(placed) > 1 else ""
    notes: list[str] = []
    if count and request.moving_share is not None:
        moving = sum(_num_moving(*one) for one in placed)
        notes.append(
            f"{moving} of {count} placed agents{where} move at t = 0 "
            f"({moving / count:.0%}; {request.moving_share:.0%} were asked for)."
        )
    if count and request.only_on_road:
        off = sum(_num_off_road(*one) for one in placed)
        notes.append(
            f"{off or 'None'} of {count} placed agents{where} "
            f"{'is' if off < 2 else 'are'} off the road at t = 0."
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
