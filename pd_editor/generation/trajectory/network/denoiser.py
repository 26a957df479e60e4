"""The trajectory network, which predicts clean latents of all agents from noisy ones.

Each agent attends to the map tokens around it, to its Frenet candidates and to its
neighbours (heterogeneous message passing, Path Diffuser section III-E). All poses are
relative, so results are invariant to rotations and translations. Interaction features
describe neighbours at the waypoints that the previous block has predicted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pd_editor.base.errors import ModelError
from pd_editor.generation.core.attention import minus_infinity_unless, scale_query_rows
from pd_editor.generation.core.noise_schedule import (
    Prediction,
    ScheduleKind,
    VariancePreserving,
)
from pd_editor.generation.core.sampler import Denoise
from pd_editor.generation.defaults import check_sizes
from pd_editor.generation.features.map_pieces import PIECE_SIGNAL
from pd_editor.generation.features.scene_features import NUM_FUTURE_STEPS
from pd_editor.generation.features.scene_fields import LATENT_SIZE, NUM_NEAR_AGENTS
from pd_editor.generation.inputs import SceneTensors, TrajectoryBasis, gathered
from pd_editor.generation.trajectory.network.decoding import TrajectoryDecoder
from pd_editor.generation.trajectory.network.features import (
    NUM_AGENT_FEATURES,
    NUM_BOUNDARY_FEATURES,
    NUM_EDGE_FEATURES,
    NUM_GAP_FEATURES,
    NUM_LEVEL_FEATURES,
    NUM_PIECE_FEATURES,
    NUM_WAYPOINT_FEATURES,
    InteractionGeometry,
    Neighbors,
    agent_features,
    boundary_features,
    level_features,
    piece_features,
    seen_boundary,
    seen_pieces,
)
from pd_editor.scene.agent_kind import Activity


class Tokens(NamedTuple):
    """Keys and values of M tokens of G agents, for each of H heads."""

    keys: Float[Tensor, "HG M D"]
    values: Float[Tensor, "HG M D"]
    mask: Float[Tensor, "HG 1 M"]
    """Term for logits: minus infinity where there is no token."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockContext:
    """Keys, values and edges of one block; G agents of all scenes, concatenated."""

    tokens: tuple[Tokens, Tokens]
    """Map tokens and candidates."""
    boundary: Float[Tensor, "B A E"] | None
    """Encoding of the drivable area's boundary near each agent, added to its hidden
    state; None for a network without it."""
    edge: Float[Tensor, "R F"]
    """Edges to the K neighbours of all G agents, before interaction features."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Masks:
    """Masks and rows of neighbours, shared by all blocks."""

    neighbors: Float[Tensor, "B 1 A K"]
    """Term for logits: minus infinity where there is no neighbour."""
    neighbor: Int[Tensor, "B 1 A K"]


class AgentBlock(nn.Module):
    """Parallel attention to map tokens, candidates and neighbours.

    All projections are one linear layer before and one after the attentions. Edges have
    no separate keys and values: queries are compared with their embeddings, and the
    result is the weighted sum of those embeddings.

    Interaction features after those of waypoints are initialised without effect, so that
    weights of a network without them can be copied.
    """

    def __init__(
        self,
        width: int,
        num_heads: int,
        edge_width: int,
        *,
        num_interactions: int,
    ) -> None:
        super().__init__()
        self.num_heads, self.edge_width = num_heads, edge_width
        # Number of token sets with separate heads: map tokens and candidates.
        to_tokens, to_edges = 2 * width, num_heads * edge_width
        self.sizes = [to_tokens, width, to_edges, width, width]
        """Queries of tokens, neighbours and edges; keys and values for neighbours."""
        self.norm = nn.LayerNorm(width)
        self.project = nn.Linear(width, sum(self.sizes))
        scale_query_rows(self.project, to_tokens + width, width // num_heads)
        scale_query_rows(
            self.project, to_edges, edge_width, first_row=to_tokens + width
        )
        self.interaction_in = nn.Linear(num_interactions, edge_width, bias=False)
        with torch.no_grad():
            self.interaction_in.weight[:, NUM_WAYPOINT_FEATURES:] = 0
        self.attended = nn.Linear(to_tokens + to_edges + width, width)
        self.feed_forward = nn.Sequential(
            nn.LayerNorm(width),
            nn.Linear(width, 4 * width),
            nn.ReLU(),
            nn.Linear(4 * width, width),
        )
        self.output = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, LATENT_SIZE))

    def forward(
        self,
        hidden: Float[Tensor, "S B A E"],
        interactions: Float[Tensor, "S R I"] | None,
        context: BlockContext,
        masks: Masks,
    ) -> tuple[Float[Tensor, "S B A E"], Float[Tensor, "S B A 10"]]:
        """Hidden states after the block, and the output of the network at this block.

        Hidden states are of S samples of B scenes of A agents.
        """
        if context.boundary is not None:
            hidden = hidden + context.boundary
        projected = self.project(self.norm(hidden))
        to_tokens, *to_neighbors = projected.split(self.sizes, dim=-1)
        if interactions is None:
            edge = context.edge.relu()
        else:
            edge = self.interaction_in(interactions).add_(context.edge).relu_()
        seen = torch.cat(
            [
                self._attend_to_tokens(to_tokens, context.tokens),
                *self._attend_to_neighbors(to_neighbors, edge, masks),
            ],
            dim=-1,
        )
        hidden = hidden + self.attended(seen)
        hidden = hidden + self.feed_forward(hidden)
        return hidden, self.output(hidden)

    def _attend_to_neighbors(
        self, projected: list[Tensor], edge: Float[Tensor, "*S R F"], masks: Masks
    ) -> tuple[Float[Tensor, "S B A HF"], Float[Tensor, "S B A E"]]:
        """Weighted sums of edge embeddings, and of the neighbours' values."""
        shape = projected[0].shape[:3]
        num_near_agents = masks.neighbor.shape[-1]
        query, keys, values = (
            part.unflatten(-1, (self.num_heads, -1)).transpose(2, 3)
            for part in (projected[0], *projected[2:])
        )
        edge = edge.view(-1, *shape[1:], num_near_agents, self.edge_width)
        to_edges = projected[1].unflatten(-1, (self.num_heads, self.edge_width))
        of_edges = (to_edges @ edge.mT).transpose(2, 3)
        among = query @ keys.mT
        row = masks.neighbor.expand(*of_edges.shape)
        logits = among.gather(-1, row) + of_edges + masks.neighbors
        weights = logits.softmax(dim=-1).to(among.dtype)
        by_row = torch.zeros_like(among).scatter_add(-1, row, weights)
        of_neighbors = (by_row @ values).transpose(2, 3)
        seen_edges = weights.transpose(2, 3) @ edge
        return seen_edges.flatten(-2), of_neighbors.flatten(-2)

    def _attend_to_tokens(
        self, queries: Float[Tensor, "S B A QE"], sets: tuple[Tokens, Tokens]
    ) -> Float[Tensor, "S B A QE"]:
        """Weighted sums of the values of tokens, of each set."""
        samples, heads = queries.shape[0], self.num_heads
        parts = queries.flatten(1, 2).unflatten(-1, (len(sets), heads, -1))
        # All samples of an agent attend to the same tokens.
        parts = parts.permute(2, 3, 1, 0, 4).flatten(1, 2)
        found: list[Tensor] = []
        for query, tokens in zip(parts.unbind(), sets, strict=True):
            logits = torch.baddbmm(tokens.mask, query, tokens.keys.mT)
            weights = logits.softmax(dim=-1).to(tokens.values.dtype)
            found.append(torch.bmm(weights, tokens.values))
        seen = torch.stack(found).view(len(sets), heads, -1, samples, parts.shape[-1])
        return seen.permute(3, 2, 0, 1, 4).reshape(queries.shape)


class TokenEncoder(nn.Module):
    """Encodes N tokens of each of G agents, once per scene."""

    def __init__(self, size: int, width: int, num_blocks: int, num_heads: int) -> None:
        super().__init__()
        self.num_heads = num_heads
        self.embed = nn.Sequential(
            nn.Linear(size, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU()
        )
        self.null_token = nn.Parameter(torch.zeros(width))
        self.keys_values = nn.Linear(width, num_blocks * 2 * width)

    def forward(
        self, tokens: Float[Tensor, "G N F"], exists: Bool[Tensor, "G N"]
    ) -> Sequence[Tokens]:
        """Keys and values for each block; the first of the N + 1 is a null token."""
        # Existing tokens alone are encoded, after the null token, which all have.
        place = exists.flatten().cumsum(0).view_as(exists) * exists
        hidden = self.embed(tokens[exists])
        hidden = torch.cat([self.null_token.to(hidden)[None], hidden])
        mask = minus_infinity_unless(nn.functional.pad(exists, (1, 0), value=True))
        mask = mask[:, None].to(hidden).repeat(self.num_heads, 1, 1)
        # One product for each head, so that nothing is rearranged in memory.
        parts = (-1, hidden.shape[-1] // self.num_heads)
        weight = self.keys_values.weight.unflatten(0, parts).mT
        bias = self.keys_values.bias.unflatten(0, parts)[:, None]
        encoded = torch.baddbmm(bias, hidden.expand(len(weight), -1, -1), weight)
        encoded = encoded.index_select(1, nn.functional.pad(place, (1, 0)).flatten())
        encoded = encoded.view(-1, 2, *mask.shape[::2], parts[1])
        return [Tokens(keys, values, mask) for keys, values in encoded]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryContext:
    """Values that do not depend on noisy trajectories, for B scenes of A agents."""

    agent: Float[Tensor, "B A E"]
    blocks: tuple[BlockContext, ...]
    masks: Masks
    neighbors: Neighbors
    interactions: InteractionGeometry | None
    """Geometry of interaction features; None for a network without them."""


class EncodedTrajectoryLevel(NamedTuple):
    """Values that depend on noise levels only, per agent or for all agents."""

    hidden: Float[Tensor, "*b NE"]
    """Terms of the first layer and of the input of each block."""
    alpha: Float[Tensor, "*b 1"]
    noisy_share: Float[Tensor, "*b 1"]
    """Factor of the noisy latents in the predicted clean ones."""
    output_share: Float[Tensor, "*b 1"]
    """Factor of the network's output in the predicted clean latents."""

    def at(self, index: int) -> "EncodedTrajectoryLevel":
        """Select one of several levels along the first axis."""
        return EncodedTrajectoryLevel(*(one[index] for one in self))


@dataclass(frozen=True, kw_only=True)
class TrajectoryConfig:
    """Size and switches of the network."""

    width: int = 128
    """Width of the embeddings of agents and tokens; a multiple of ``num_heads``."""
    num_heads: int = 4
    """Heads of each attention."""
    num_blocks: int = 2
    """Blocks of attention to map, candidates and neighbours."""
    edge_width: int = 64
    """Width of the embedding of a neighbour's pose and waypoints."""
    sees_way_points: bool = True
    """Whether there are interaction features of neighbours at predicted waypoints."""
    num_near_agents: int = 16
    """Number of the nearest other agents that each agent sees; at most those that scenes
    hold."""
    sees_gaps: bool = True
    """Whether interaction features of each block but the first include the gaps between
    boxes; requires ``sees_way_points``."""
    sees_boundary: bool = True
    """Whether the nearest pieces of the drivable area's boundary are an input."""
    sees_signals: bool = True
    """Whether the states of traffic signals ahead are an input."""
    sees_activity: bool = True
    """Whether known activities (parked, waiting, driving) are an input."""
    knows_leaders: bool = True
    """Whether some candidates follow the agent ahead of them."""
    sees_candidates: bool = True
    """Whether Frenet candidates are an input (the paper's P)."""
    sees_attributes: bool = True
    """Whether kinds, sizes and speeds of agents are an input. Latents are residuals of
    constant velocity in any case."""
    schedule: ScheduleKind = "cosine"
    """How the noise grows with the level; ``betas`` is the paper's."""
    prediction: Prediction = "velocity"
    """What the network predicts; ``noise`` is the paper's."""

    def __post_init__(self) -> None:
        check_sizes(self)
        if self.num_near_agents > NUM_NEAR_AGENTS:
            raise ModelError(
                f"num_near_agents is {self.num_near_agents}; scenes are prepared with the "
                f"{NUM_NEAR_AGENTS} nearest agents of each, expected no more."
            )


class TrajectoryDenoiser(nn.Module):
    """Predicts clean latents of its trajectory basis."""

    def __init__(
        self,
        config: TrajectoryConfig,
        basis: TrajectoryBasis | None = None,
        num_steps: int = NUM_FUTURE_STEPS,
    ) -> None:
        """Make a network; without a basis, one of so many steps must be loaded."""
        super().__init__()
        self.config = config
        self.schedule = VariancePreserving(
            kind=config.schedule, prediction=config.prediction
        )
        self.decoder = TrajectoryDecoder(basis, num_steps)
        width, blocks, heads = config.width, config.num_blocks, config.num_heads
        self.agent_in = nn.Linear(NUM_AGENT_FEATURES, width)
        self.noisy_in = nn.Linear(LATENT_SIZE, width, bias=False)
        self.level_in = nn.Linear(NUM_LEVEL_FEATURES, (1 + blocks) * width)
        """Embedding of noise levels for the first layer and for each block."""
        self.embed = nn.Linear(width, width)
        num_piece = NUM_PIECE_FEATURES + len(PIECE_SIGNAL) * config.sees_signals
        self.map_tokens = TokenEncoder(num_piece, width, blocks, heads)
        self.candidate_tokens = TokenEncoder(LATENT_SIZE, width, blocks, heads)
        self.edge_in = nn.Linear(NUM_EDGE_FEATURES, blocks * config.edge_width)
        self.blocks = nn.ModuleList(
            AgentBlock(
                width,
                heads,
                config.edge_width,
                num_interactions=NUM_WAYPOINT_FEATURES
                + NUM_GAP_FEATURES * self._sees_gaps(index),
            )
            for index in range(blocks)
        )
        if config.sees_boundary:
            self.boundary_in = nn.Sequential(
                nn.Linear(NUM_BOUNDARY_FEATURES, width),
                nn.ReLU(),
                nn.Linear(width, width),
                nn.ReLU(),
            )
            self.boundary_out = nn.Linear(width, blocks * width, bias=False)
            nn.init.zeros_(self.boundary_out.weight)
        if config.sees_activity:
            self.activity_in = _without_effect(width)
            self.neighbor_activity_in = _without_effect(blocks * config.edge_width)

    @classmethod
    def for_weights(
        cls, config: TrajectoryConfig, given: Mapping[str, Tensor]
    ) -> "TrajectoryDenoiser":
        """Make a network for weights whose basis may have fewer steps than scenes."""
        mean = given.get("decoder.mean_m")
        steps = NUM_FUTURE_STEPS if mean is None else mean.numel()
        return cls(config, num_steps=min(steps, NUM_FUTURE_STEPS))

    def encode_context(self, scene: SceneTensors) -> TrajectoryContext:
        """Compute the values that do not depend on noisy trajectories."""
        config = self.config
        if not config.sees_candidates:
            nothing = torch.zeros_like(scene.has_candidate)
            scene = replace(scene, has_candidate=nothing)
        features = agent_features(scene)
        if not config.sees_attributes:
            features = torch.zeros_like(features)
        neighbors = Neighbors.of(scene, config.num_near_agents)
        agent = self.agent_in(features)
        edges = self.edge_in(neighbors.edge_features(features))
        if config.sees_activity:
            activity = scene.agent_activity
            agent = agent + self.activity_in(activity)
            edges = edges + self.neighbor_activity_in(gathered(activity, neighbors.row))
        interactions = None
        if config.sees_way_points:
            interactions = InteractionGeometry.of(
                self.decoder, scene.agent_speed, scene.agent_size, neighbors
            )
        edges = edges.flatten(0, 2).chunk(len(self.blocks), dim=-1)
        return TrajectoryContext(
            agent=agent,
            blocks=tuple(
                BlockContext(tokens=one, boundary=two, edge=three)
                for one, two, three in zip(
                    self._tokens(scene), self._boundary(scene), edges, strict=True
                )
            ),
            masks=Masks(
                neighbors=minus_infinity_unless(neighbors.exists)[:, None],
                neighbor=neighbors.row[:, None],
            ),
            neighbors=neighbors,
            interactions=interactions,
        )

    def encode_level(self, level: Float[Tensor, "*b"]) -> EncodedTrajectoryLevel:
        """Compute the values that depend on noise levels; given agents are at level 0."""
        level = level[..., None]
        alpha, sigma = self.schedule.alpha(level), self.schedule.sigma(level)
        by_level = self.level_in(level_features(level, alpha, sigma))
        zero, one = torch.zeros_like(level), torch.ones_like(level)
        is_noisy = level > 0
        # The clean sample is linear in the noisy one and in the network's output.
        noisy_share = self.schedule.clean_of(zero, one, level)
        output_share = self.schedule.clean_of(one, zero, level)
        return EncodedTrajectoryLevel(
            hidden=by_level,
            alpha=alpha,
            noisy_share=torch.where(is_noisy, noisy_share, 1.0),
            output_share=torch.where(is_noisy, output_share, 0.0),
        )

    def at_levels(
        self, levels: Float[Tensor, "T *b"], context: TrajectoryContext
    ) -> Denoise:
        """Function that predicts clean latents at one of T noise levels."""
        encoded = self.encode_level(levels)
        return lambda noisy, step: self.denoise(noisy, encoded.at(step), context)

    def denoise(
        self,
        noisy: Float[Tensor, "S B A 10"],
        level: EncodedTrajectoryLevel,
        context: TrajectoryContext,
    ) -> Float[Tensor, "S B A 10"]:
        """Predict clean latents; those of given agents are unchanged."""
        return self.predictions(noisy, level, context)[-1]

    def predictions(
        self,
        noisy: Float[Tensor, "S B A 10"],
        level: EncodedTrajectoryLevel,
        context: TrajectoryContext,
    ) -> list[Float[Tensor, "S B A 10"]]:
        """Clean latents predicted by each block; the last prediction is the result."""
        first, *biases = level.hidden.chunk(1 + len(self.blocks), dim=-1)
        hidden = self.noisy_in(noisy) + (context.agent + first)
        hidden = self.embed(hidden.relu())
        # The best linear prediction of a latent of unit variance.
        prediction = level.alpha * noisy
        kept = level.noisy_share * noisy
        predictions: list[Tensor] = []
        for index, (block, bias, of_block) in enumerate(
            zip(self.blocks, biases, context.blocks, strict=True)
        ):
            interactions = None
            if context.interactions is not None:
                interactions = context.interactions.features(
                    prediction.detach(), with_gaps=self._sees_gaps(index)
                )
            hidden, output = block(hidden + bias, interactions, of_block, context.masks)
            prediction = torch.addcmul(kept, level.output_share, output.to(noisy))
            predictions.append(prediction)
        return predictions

    def _sees_gaps(self, block: int) -> bool:
        """Whether a block has gap features; the first one has no earlier prediction."""
        return self.config.sees_gaps and self.config.sees_way_points and block > 0

    def _boundary(self, scene: SceneTensors) -> Sequence[Float[Tensor, "B A E"] | None]:
        """Encoding of the drivable area's boundary near each agent, for each block.

        Maximum of each feature over the nearest pieces; 0 without any.
        """
        if not self.config.sees_boundary:
            return [None] * len(self.blocks)
        near = self.boundary_in(boundary_features(scene))
        near = near.masked_fill(~seen_boundary(scene)[..., None], 0.0)
        return self.boundary_out(near.amax(dim=-2)).chunk(len(self.blocks), dim=-1)

    def _tokens(self, scene: SceneTensors) -> list[tuple[Tokens, Tokens]]:
        """Map tokens and candidates for each block."""
        of_map = self.map_tokens(
            piece_features(scene, sees_signals=self.config.sees_signals).flatten(0, 1),
            seen_pieces(scene).flatten(0, 1),
        )
        candidates = self.candidate_tokens(
            scene.candidates.flatten(0, 1), scene.has_candidate.flatten(0, 1)
        )
        return list(zip(of_map, candidates, strict=True))


def _without_effect(width: int) -> nn.Embedding:
    """Embedding of activities, initialised as zero."""
    embedding = nn.Embedding(len(Activity), width)
    nn.init.zeros_(embedding.weight)
    return embedding
