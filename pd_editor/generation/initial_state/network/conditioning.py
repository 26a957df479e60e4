"""Conditioning of initial states: given agents, order, attributes, square."""

from dataclasses import dataclass, replace
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.generation.features.scene_fields import (
    CANDIDATE_FIELDS,
    SCENE_FIELDS,
    Axis,
)
from pd_editor.generation.initial_state.network.state_encoding import POSITION_UNIT_M
from pd_editor.generation.inputs import SceneTensors

REACH_M: Final = POSITION_UNIT_M + 16.0
"""Agents and map tokens further from the centre, along x or y, are left out."""


UNCONDITIONED: Final = 0
CONDITIONED_NO: Final = 1
CONDITIONED_YES: Final = 2
"""Codes of an attribute of a sampled agent: not set, no, yes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Conditioning:
    """Conditioning of the states of A agents in B scenes."""

    is_given: Bool[Tensor, "B A"]
    """Given agents, whose ``agent_pose`` and ``agent_speed`` are fixed."""
    order: Int[Tensor, "B A"]
    """Rank of each sampled agent among those of its kind, from 1; else 0."""
    moves: Int[Tensor, "B A"]
    """Attribute of each sampled agent: whether it moves."""
    on_road: Int[Tensor, "B A"]
    """Attribute: whether it is within ``OFF_LANE_M`` of a centre line."""
    half_side_m: Float[Tensor, "B"]
    """Half side of the square around the centre in which agents are sampled."""
    is_central: Bool[Tensor, "B"]
    """Whether agents attend to each other; in generation they always do."""


def attribute_codes(
    attribute: Bool[Tensor, "*b"], is_set: Bool[Tensor, "*b"]
) -> Int[Tensor, "*b"]:
    """Codes of an attribute; ``UNCONDITIONED`` where it is not set."""
    return torch.where(attribute, CONDITIONED_YES, CONDITIONED_NO) * is_set


def sampling_conditioning(
    scene: SceneTensors,
    is_given: Bool[Tensor, "B A"] | None = None,
    half_side_m: Float[Tensor, "B"] | None = None,
    *,
    within_kinds: bool = True,
) -> Conditioning:
    """Conditioning for generation: agents, of each kind or all, are ordered by rows.

    Attributes are unconditioned.
    """
    num_scenes, device = scene.num_scenes, scene.has_agent.device
    given = torch.zeros_like(scene.has_agent) if is_given is None else is_given
    sides = torch.full((num_scenes,), POSITION_UNIT_M, device=device)
    rows = torch.arange(scene.has_agent.shape[1], device=device)
    return Conditioning(
        is_given=given,
        order=order_by(
            rows.expand_as(scene.agent_kind), scene, given, within_kinds=within_kinds
        ),
        moves=torch.full_like(scene.agent_kind, UNCONDITIONED),
        on_road=torch.full_like(scene.agent_kind, UNCONDITIONED),
        half_side_m=sides if half_side_m is None else half_side_m,
        is_central=torch.ones(num_scenes, dtype=torch.bool, device=device),
    )


def order_by(
    key: Float[Tensor, "B A"] | Int[Tensor, "B A"],
    scene: SceneTensors,
    is_given: Bool[Tensor, "B A"],
    *,
    within_kinds: bool = True,
) -> Int[Tensor, "B A"]:
    """Rank of each sampled agent among those of its kind, or all, by a key.

    0 for given agents.
    """
    is_sampled = scene.has_agent & ~is_given
    same_kind = scene.agent_kind[:, :, None] == scene.agent_kind[:, None]
    counts = (same_kind | (not within_kinds)) & is_sampled[:, None]
    not_after = key[:, None] <= key[:, :, None]
    return (counts & not_after).sum(dim=-1) * is_sampled


def pieces_within(scene: SceneTensors, reach_m: float) -> SceneTensors:
    """Remove map tokens further than ``reach_m`` along x or y, and reduce the padding."""
    is_piece = scene.has_piece & _is_within(scene.piece_pose, reach_m)
    pieces = _first(scene, "piece", is_piece)
    is_boundary = scene.has_boundary & _is_within(scene.boundary_pose, reach_m)
    boundary = _first(scene, "boundary", is_boundary)
    return replace(
        scene,
        has_piece=pieces.pop("is_kept"),
        has_boundary=boundary.pop("is_kept"),
        **pieces,
        **boundary,
        near_pieces=torch.full_like(scene.near_pieces, -1),
        near_boundary=torch.full_like(scene.near_boundary, -1),
    )


def _is_within(pose: Float[Tensor, "B N 3"], reach_m: float) -> Bool[Tensor, "B N"]:
    return torch.all(pose[..., :2].abs() <= reach_m, dim=-1)


def only_agents(scene: SceneTensors, is_kept: Bool[Tensor, "B A"]) -> SceneTensors:
    """Keep some agents only, and reduce the padding; neighbours become unset."""
    kept = _first(scene, "agent", scene.has_agent & is_kept)
    has_agent = kept.pop("is_kept")
    for name in ("near_pieces", "near_boundary", "near_agents"):
        kept[name] = torch.full_like(kept[name], -1)
    return replace(scene, **kept, has_agent=has_agent)


def in_square(scene: SceneTensors) -> SceneTensors:
    """Keep the agents in the training square only."""
    distance = scene.agent_pose[..., :2].abs().amax(dim=-1)
    return only_agents(scene, distance <= POSITION_UNIT_M)


def _first(
    scene: SceneTensors, axis: Axis, is_kept: Bool[Tensor, "B N"]
) -> dict[str, Tensor]:
    """An axis' fields with the kept rows moved to the front; their mask ``is_kept``."""
    num_kept = max(int(is_kept.sum(dim=-1).max()), 1)
    index = torch.argsort(~is_kept, dim=-1, stable=True)[:, :num_kept]
    row = torch.arange(len(index), device=index.device)[:, None]
    fields = {
        one.name: getattr(scene, one.name)[row, index]
        for one in (*SCENE_FIELDS, *CANDIDATE_FIELDS)
        if one.axis == axis
    }
    return {**fields, "is_kept": is_kept[row, index]}
