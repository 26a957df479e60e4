"""The pieces of road near noisy poses, and their votes, in few operations."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor, nn

from pd_editor.diffusion.fused.folded_layers import Affine, linear_layers
from pd_editor.diffusion.fused.folded_relations import FoldedRelations, NoiseFactors
from pd_editor.diffusion.initial_state.denoiser import PIECE_EXISTS, PoseContext
from pd_editor.diffusion.initial_state.features import (
    NUM_PIECE_FEATURES,
    as_complex,
    crossing_factors,
)
from pd_editor.diffusion.initial_state.lane_anchored_head import LaneVotes


@dataclass(frozen=True, kw_only=True, eq=False)
class NearRoad:
    """The M pieces of road near each of Z agents."""

    features: Float[Tensor, "N F"]
    """Of all agents and pieces in a row, and then the hidden layer."""
    hidden_layer: Float[Tensor, "Z M R"]
    facts: Float[Tensor, "N D"]
    """What votes know of each piece."""
    axis: Complex[Tensor, "Z M"]
    """Directions in the frame of the scene."""
    hidden: Float[Tensor, "Z 1 M"] | None
    """Added to logits; None where no piece is missing."""
    sees_any: Float[Tensor, "Z 1"] | None
    """0 for agents without a piece; None where all have some."""


class FoldedPieces:
    """The weights of relations to pieces, and of their votes."""

    def __init__(
        self, relation: nn.Sequential, votes: LaneVotes, num_nearest: int
    ) -> None:
        """Weights are copied."""
        first, last = linear_layers(relation)
        self.num_nearest = num_nearest
        self._width = last.out_features
        weight = votes.from_piece.weight
        self._features = FoldedRelations(weight, sees_middle=True)
        self._layer = self._features.layer(first.weight[:, :NUM_PIECE_FEATURES])
        features, facts, relations = weight.split(
            [
                NUM_PIECE_FEATURES,
                weight.shape[1] - NUM_PIECE_FEATURES - self._width,
                self._width,
            ],
            dim=1,
        )
        of_hidden = (relations.double() @ last.weight.double()).to(weight)
        self._votes = torch.cat([self._features.layer(features), of_hidden.t()])
        self._facts = Affine(
            (
                torch.cat([first.weight[:, NUM_PIECE_FEATURES:], facts]),
                torch.cat([first.bias, relations @ last.bias]),
            ),
            weight,
        )
        self._vote = Affine((votes.vote.weight, votes.vote.bias), weight)

    def noise_factors(
        self, noise_m: Float[Tensor, "*b"], turn_noise: Float[Tensor, "*b"]
    ) -> NoiseFactors:
        """What the noise of agents makes of features; pieces have none."""
        return self._features.noise_factors(noise_m, turn_noise)

    def of(self, context: PoseContext, num_samples: int) -> "RoadPieces":
        """The pieces of some scenes."""
        facts = self._facts(context.pieces[..., PIECE_EXISTS + 1 :].flatten(0, 1))
        return RoadPieces(self, facts, context, num_samples)

    def near(
        self,
        parts: list[Complex[Tensor, "B S A M"]],
        facts: Float[Tensor, "N RD"],
        factors: NoiseFactors,
    ) -> tuple[Float[Tensor, "N F"], Float[Tensor, "N R"], Float[Tensor, "N D"]]:
        """Features with the hidden layer, that layer alone, and facts for votes."""
        features = self._features(parts, factors)
        hidden = (features @ self._layer).add_(facts[:, : self._width]).relu_()
        return torch.cat([features, hidden], 1), hidden, facts[:, self._width :]

    def votes(
        self, token: Float[Tensor, "Z D"], near: NearRoad
    ) -> Complex[Tensor, "Z 2"]:
        """Shift and turn in the frame of the scene; 0 where no piece is near."""
        num_agents, num_pieces = near.axis.shape
        inner = torch.addmm(near.facts, near.features, self._votes)
        inner = inner.view(num_agents, num_pieces, -1).add_(token[:, None]).relu_()
        found = self._vote(inner.flatten(0, 1))
        logits = found[:, 0].view(num_agents, num_pieces)
        if near.hidden is not None:
            logits = logits + near.hidden[:, 0]
        weights = logits.softmax(dim=-1)
        if near.sees_any is not None:
            weights = weights * near.sees_any
        poses = as_complex(found[:, 1:].unflatten(-1, (2, 2)))
        poses = poses.view(num_agents, num_pieces, 2)
        return ((weights * near.axis)[..., None] * poses).sum(dim=1)


class RoadPieces:
    """The pieces of B scenes, to be looked up by S samples."""

    def __init__(
        self,
        folded: FoldedPieces,
        facts: Float[Tensor, "BP RD"],
        context: PoseContext,
        num_samples: int,
    ) -> None:
        self._folded, self._facts = folded, facts
        pieces = context.pieces
        exists = pieces[..., PIECE_EXISTS] > 0
        self._middle_m = pieces[..., :2].contiguous()
        pose = as_complex(pieces[..., :4].unflatten(-1, (2, 2)))
        self._pose = pose.flatten(0, 1)
        self._num_nearest = min(folded.num_nearest, exists.shape[1])
        crossings = crossing_factors(context.is_walking, context.is_crossing)
        self._factors = crossings[:, None] if bool(context.is_crossing.any()) else None
        self._far = None if bool(exists.all()) else _nowhere(exists)
        self._first = exists.shape[1] * torch.arange(len(exists), device=exists.device)
        self._sees_any, self._hidden = None, None
        if self._far is not None:
            sees = exists.any(dim=1)
            hidden = torch.zeros_like(pieces[..., 0])
            hidden = hidden.masked_fill(~exists & sees[:, None], -math.inf)
            self._hidden = hidden.flatten()
            each = sees.repeat_interleave(num_samples * context.is_given.shape[1])
            self._sees_any = None if bool(sees.all()) else each[:, None].to(pieces)

    def near(
        self,
        position_m: Float[Tensor, "B S A 2"],
        place: Complex[Tensor, "B S A"],
        own: Complex[Tensor, "B S A"],
        factors: NoiseFactors,
    ) -> NearRoad:
        """The nearest pieces, as ``nearest_pieces`` finds them, and how they lie."""
        distance = torch.cdist(position_m.flatten(1, 2), self._middle_m)
        distance = distance.view(*place.shape, -1)
        if self._factors is not None:
            distance = distance * self._factors
        if self._far is not None:
            distance = distance + self._far
        nearest = distance.topk(self._num_nearest, dim=-1, largest=False, sorted=False)
        index = nearest.indices
        if len(self._first) > 1:
            index = index + self._first[:, None, None, None]
        index = index.flatten()
        shape = (*place.shape, self._num_nearest)
        near = self._pose.index_select(0, index).view(*shape, 2)
        middle, axis = near.unbind(-1)
        across, offset = axis.conj_physical(), place[..., None] - middle
        turn = own[..., None]
        parts = [offset * across, turn * across, -offset * turn.conj_physical()]
        features, hidden_layer, facts = self._folded.near(
            parts, self._facts.index_select(0, index), factors
        )
        num_rows, num_nearest = place.numel(), self._num_nearest
        hidden = None
        if self._hidden is not None:
            hidden = self._hidden[index].view(num_rows, 1, num_nearest)
        return NearRoad(
            features=features,
            hidden_layer=hidden_layer.view(num_rows, num_nearest, -1),
            facts=facts,
            axis=axis.reshape(num_rows, num_nearest),
            hidden=hidden,
            sees_any=self._sees_any,
        )


def _nowhere(exists: Bool[Tensor, "B P"]) -> Float[Tensor, "B 1 1 P"]:
    """Added to distances: missing pieces are nowhere."""
    far = torch.zeros(exists.shape, device=exists.device)
    return far.masked_fill(~exists, math.inf)[:, None, None]
