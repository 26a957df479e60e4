"""Map tokens: encoded once per scene, searched near noisy poses, and what they propose."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import torch
from jaxtyping import Bool, Complex, Float, Int
from torch import Tensor, nn

from pd_editor.generation.core.attention import EdgeAttention, KeysValues, Mask, grouped
from pd_editor.generation.core.devices import is_known
from pd_editor.generation.features.map_pieces import CROSSWALK_KIND
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.initial_state.network.features import (
    NUM_FOLDED_FEATURES,
    NUM_PIECE_FEATURES,
    BoxPairs,
    NoiseFactors,
    NoisyPoses,
    as_complex,
    noise_factors,
    piece_relations,
)
from pd_editor.generation.inputs import SceneTensors, selected


class TokenGroup(NamedTuple):
    """Map tokens of one type in B scenes."""

    middle_m: Float[Tensor, "B P 2"]
    axis: Complex[Tensor, "B P"]
    """Directions, of length one."""
    encoded: Float[Tensor, "B P C"]
    """Embeddings, which do not depend on poses."""
    exists: Bool[Tensor, "B P"] | None
    """Mask of tokens; None if there is no padding."""
    num_near: int
    """Number of tokens near an agent."""
    can_lack: bool
    """Whether a scene may have fewer tokens than that."""
    first: Int[Tensor, "B 1 1 1"]
    """Row of each scene's first token in the table of all groups."""
    is_crossing: Bool[Tensor, "B P"] | None = None
    """Crosswalks; None for groups of other tokens."""
    factors: Float[Tensor, "_ 1 A P"] | None = None
    """Factors of squared distances between agents and tokens; None if all are 1."""

    @classmethod
    def of_lanes(
        cls, scene: SceneTensors, encoded: Float[Tensor, "B P C"], most_near: int
    ) -> "TokenGroup":
        """Tokens of lanes and crosswalks, of which an agent is near ``most_near``."""
        is_crossing = scene.piece_kind == CROSSWALK_KIND
        group = cls._of(scene.piece_pose, scene.has_piece, encoded, most_near)
        return group._replace(is_crossing=is_crossing)

    @classmethod
    def of_boundary(
        cls, scene: SceneTensors, encoded: Float[Tensor, "B E C"], most_near: int
    ) -> "TokenGroup":
        """Tokens of the drivable area's boundary, of which an agent is near ``most_near``."""
        return cls._of(scene.boundary_pose, scene.has_boundary, encoded, most_near)

    @classmethod
    def _of(
        cls,
        pose: Float[Tensor, "B P 3"],
        exists: Bool[Tensor, "B P"],
        encoded: Float[Tensor, "B P C"],
        most_near: int,
    ) -> "TokenGroup":
        num_scenes, num_tokens = exists.shape
        first = torch.arange(num_scenes, device=exists.device) * num_tokens
        num_near = min(most_near, num_tokens)
        least = int(exists.sum(dim=-1).min()) if exists.is_cpu else 0
        is_full = is_known(exists.all())
        return cls(
            middle_m=pose[..., :2].contiguous(),
            axis=torch.complex(pose[..., 2].cos(), pose[..., 2].sin()),
            encoded=encoded,
            exists=None if is_full else exists,
            num_near=num_near,
            can_lack=not is_full and num_near > least,
            first=first[:, None, None, None],
        )

    def seen_by(self, agent_kind: Int[Tensor, "B A"]) -> "TokenGroup":
        """The tokens with the distances of agents of some kinds.

        Crosswalks count at half the distance for pedestrians, at twice for others.
        """
        if self.is_crossing is None:
            return self
        factor = torch.where(agent_kind == PEDESTRIAN, 0.25, 4.0)[:, None, :, None]
        factors = torch.where(self.is_crossing[:, None, None], factor, 1.0)
        return self._replace(factors=factors)

    def nearest(self, poses: NoisyPoses) -> Int[Tensor, "B S A M"]:
        """Rows of the tokens nearest to each pose, in any order."""
        own_x, own_y = torch.view_as_real(poses.position_m)[..., None, :].unbind(-1)
        x, y = self.middle_m[:, None, None].unbind(-1)
        x, y = own_x - x, own_y - y
        square = torch.addcmul(x * x, y, y)
        if self.factors is not None:
            square = square * self.factors
        if self.exists is not None:
            square = square.masked_fill(~self.exists[:, None, None], math.inf)
        nearest = square.topk(self.num_near, dim=-1, largest=False, sorted=False)
        return nearest.indices + self.first


class NearTokens(NamedTuple):
    """The M map tokens nearest to each of A agents in S versions of B scenes.

    Tokens of the first group come first.
    """

    relations: Float[Tensor, "B S A M F"]
    encoded: Float[Tensor, "B S A M C"]
    """Rows of ``TokenGroup.encoded``."""
    axis: Complex[Tensor, "B S A M"]
    """Direction of each, in the frame of the scene."""
    numbers: tuple[int, ...]
    mask: Mask
    """Of shape [B S A G M]: row g sees the tokens of group g."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MapTokens:
    """The map tokens of B scenes, in groups."""

    groups: tuple[TokenGroup, ...]
    pose: Complex[Tensor, "T 2"]
    """Midpoint and direction, of all groups and scenes, concatenated."""
    encoded: Float[Tensor, "T C"]
    exists: Bool[Tensor, "T"] | None
    """Mask of tokens; None if no agent can be near padding."""

    @classmethod
    def of(cls, *groups: TokenGroup) -> "MapTokens":
        """Concatenate groups of tokens."""
        sizes = [one.axis.numel() for one in groups]
        groups = tuple(
            one._replace(first=one.first + sum(sizes[:index]))
            for index, one in enumerate(groups)
        )
        exists = [
            torch.ones_like(one.axis, dtype=torch.bool)
            if one.exists is None
            else one.exists
            for one in groups
        ]
        pose = [
            torch.stack([as_complex(one.middle_m), one.axis], dim=-1).flatten(0, 1)
            for one in groups
        ]
        encoded = [one.encoded.flatten(0, 1) for one in groups]
        return cls(
            groups=groups,
            pose=torch.cat(pose),
            encoded=torch.cat(encoded),
            exists=(
                torch.cat([one.flatten() for one in exists])
                if any(one.can_lack for one in groups)
                else None
            ),
        )

    def seen_by(self, agent_kind: Int[Tensor, "B A"]) -> "MapTokens":
        """The tokens with the distances of agents of some kinds."""
        groups = tuple(one.seen_by(agent_kind) for one in self.groups)
        return replace(self, groups=groups)

    def near(
        self,
        poses: NoisyPoses,
        noise: NoiseFactors,
        *,
        folds_turns: bool = False,
    ) -> NearTokens:
        """The tokens of each group that are nearest to each pose, in any order."""
        rows = [one.nearest(poses) for one in self.groups]
        row = rows[0] if len(rows) == 1 else torch.cat(rows, dim=-1)
        masks = [
            Mask.of(selected(self.exists, of_group)[..., None, :])
            if self.exists is not None and group.can_lack
            else Mask(None, None)
            for group, of_group in zip(self.groups, rows, strict=True)
        ]
        middle_m, axis = selected(self.pose, row).unbind(-1)
        numbers = tuple(one.num_near for one in self.groups)
        return NearTokens(
            relations=piece_relations(
                poses, middle_m, axis, noise, folds_turns=folds_turns
            ),
            encoded=selected(self.encoded, row),
            axis=axis,
            numbers=numbers,
            mask=grouped(masks, numbers, self.encoded),
        )


_NUM_PARTS: Final = 4
"""Offset and direction, both as vectors in the token's frame."""


class LaneAnchoredHead(nn.Module):
    """Weighted mean of poses that nearby map tokens propose in their own frames.

    A car's offset from its lane and its direction are simple in the frame of that lane,
    but attention averages over lanes. A car parked along a kerb is as simple in the frame
    of the kerb, for which boundary pieces propose an additional term, initially zero.
    """

    def __init__(
        self, width: int, num_features: int, *, has_boundary: bool = False
    ) -> None:
        super().__init__()
        self.from_relation = nn.Linear(num_features, width, bias=False)
        self.propose = nn.Linear(width, 1 + _NUM_PARTS)
        if has_boundary:
            self.from_boundary = nn.Linear(num_features, width, bias=False)
            self.propose_boundary = nn.Linear(width, 1 + _NUM_PARTS)
            for parameter in self.propose_boundary.parameters():
                nn.init.zeros_(parameter)

    def forward(
        self,
        agent: Float[Tensor, "B S A D"],
        relations: Sequence[Float[Tensor, "B S A _ F"]],
        near: NearTokens,
        tokens: Float[Tensor, "B S A M D"],
    ) -> Complex[Tensor, "B S A 2"]:
        """Offset and direction in the frame of the scene; 0 without a near token."""
        agent = agent[..., None, :]
        layers = [(self.from_relation, self.propose)]
        if len(relations) > 1:
            layers.append((self.from_boundary, self.propose_boundary))
        found = [
            propose(from_relation(one).add_(more).add_(agent).relu_())
            for (from_relation, propose), one, more in zip(
                layers, relations, tokens.split(near.numbers, dim=-2), strict=True
            )
        ]
        joined = found[0] if len(found) == 1 else torch.cat(found, dim=-2)
        logits, proposals = joined.float().tensor_split([1], dim=-1)
        # Each group has a mean of its own.
        weights = near.mask.weights(logits.mT).sum(dim=-2)
        proposals = as_complex(proposals.unflatten(-1, (2, 2)))
        return ((weights * near.axis)[..., None] * proposals).sum(dim=-2)


class MapLayer(nn.Module):
    """Attention of each map token to its nearest neighbours, then a feed-forward part.

    It is initialised as the identity.
    """

    def __init__(
        self, width: int, edge_width: int, num_heads: int, num_neighbors: int
    ) -> None:
        super().__init__()
        self.num_neighbors = num_neighbors
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(2))
        num_features = NUM_PIECE_FEATURES + NUM_FOLDED_FEATURES
        self.relation_in = nn.Linear(num_features, edge_width, bias=False)
        self.token_in = nn.Linear(width, edge_width)
        self.attention = EdgeAttention(width, edge_width, num_heads)
        self.feed_forward = nn.Sequential(
            nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )
        for last in (self.attention.to_output, self.feed_forward[2]):
            for parameter in last.parameters():
                nn.init.zeros_(parameter)

    def forward(
        self,
        tokens: Float[Tensor, "B T D"],
        pose: Float[Tensor, "B T 3"],
        exists: Bool[Tensor, "B T"],
    ) -> Float[Tensor, "B T D"]:
        """Tokens with the context of their neighbours; arbitrary for padding."""
        num_scenes, num_tokens = exists.shape
        number = min(self.num_neighbors, num_tokens)
        distance = torch.cdist(pose[..., :2], pose[..., :2])
        distance = distance.masked_fill(~exists[:, None], math.inf)
        # A token's nearest neighbour is itself, which is left out.
        distance.diagonal(dim1=1, dim2=2).fill_(math.inf)
        nearest, index = distance.topk(number, dim=-1, largest=False, sorted=False)
        first = torch.arange(num_scenes, device=index.device) * num_tokens
        row = index + first[:, None, None]
        relations = _relations(pose, selected(pose.flatten(0, 1), row))
        normed = self.norms[0](tokens)
        of_tokens = selected(self.token_in(normed).flatten(0, 1), row)
        edges = self.relation_in(relations).add_(of_tokens).relu_()
        mask = Mask.of(nearest.isfinite()[:, :, None])
        tokens = tokens + self.attention(normed, edges, mask)
        return tokens + self.feed_forward(self.norms[1](tokens))


def _relations(
    pose: Float[Tensor, "B T 3"], others: Float[Tensor, "B T K 3"]
) -> Float[Tensor, "B T K F"]:
    """Relations of each token to its neighbours, without noise."""

    def axis(heading: Float[Tensor, "*b"]) -> Tensor:
        return torch.complex(heading.cos(), heading.sin())

    own = NoisyPoses(
        position_m=as_complex(pose[:, None, :, :2]),
        direction=axis(pose[:, None, :, 2]),
    )
    nothing = pose.new_zeros(1)
    clean: NoiseFactors = noise_factors(
        nothing, nothing, num_offsets=2, folds_turns=True
    )
    return piece_relations(
        own,
        as_complex(others[:, None, ..., :2]),
        axis(others[:, None, ..., 2]),
        clean,
        folds_turns=True,
    )[:, 0]


class EncodedMap(NamedTuple):
    """Values that depend on the map tokens of B scenes."""

    keys_values: tuple[KeysValues, ...]
    """Keys and values of all tokens, by layer."""
    near: MapTokens | None
    """Tokens for the search of those near an agent; None without relations."""

    def seen_by(self, agent_kind: Int[Tensor, "B A"]) -> "EncodedMap":
        """The map with the distances of agents of some kinds."""
        near = None if self.near is None else self.near.seen_by(agent_kind)
        return self._replace(near=near)


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialStateContext:
    """Values that do not depend on noisy states, for B scenes of A agents."""

    road_map: EncodedMap
    """The map, as its agents see it."""
    agent: Float[Tensor, "B A D"]
    pairs: Float[Tensor, "B 1 A A R"]
    """Contribution of both agents' sizes to the embedding of each pair."""
    boxes: BoxPairs | None
    """Box sizes for the gaps between agents."""
    is_visible: Mask
    """Mask of the other agents, of shape [B A 1 A]."""
    is_given: Bool[Tensor, "B A"]
    given: Float[Tensor, "B A P"]


class EncodedStateLevel(NamedTuple):
    """Values that depend on noise levels only, per agent or for all agents."""

    token: Float[Tensor, "*b D"]
    factor_in: Float[Tensor, "*b P"]
    """Factor of the noisy states in the network's input."""
    factor_skip: Float[Tensor, "*b P"]
    """Factor of the noisy states in the result."""
    factor_out: Float[Tensor, "*b P"]
    """Factor of the network's output in the result."""
    position_m: Float[Tensor, "*b #P"]
    """Metres per unit of noisy positions."""
    position_fading: Float[Tensor, "*b F"]
    near: NoiseFactors
    """Noise factors of relations to map tokens."""
    pairs: NoiseFactors
    """Noise factors of relations to other agents."""

    def at(self, index: int) -> "EncodedStateLevel":
        """Select one of several levels along the first axis."""
        *plain, near, pairs = self
        return EncodedStateLevel(
            *(one[index] for one in plain),
            near=NoiseFactors(*(one[index] for one in near)),
            pairs=NoiseFactors(*(one[index] for one in pairs)),
        )
