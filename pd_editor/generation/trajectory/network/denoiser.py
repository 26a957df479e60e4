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
from jaxtyping import Float
from torch import Tensor, nn

from pd_editor.base.errors import ModelError
from pd_editor.generation.core.attention import minus_infinity_unless
from pd_editor.generation.core.config_limits import check_sizes
from pd_editor.generation.core.noise_schedule import (
    Prediction,
    ScheduleKind,
    VariancePreserving,
)
from pd_editor.generation.core.sampler import Denoise
from pd_editor.generation.features.lane_tokens import PIECE_SIGNAL
from pd_editor.generation.features.scene_features import (
    LATENT_SIZE,
    NUM_FUTURE_STEPS,
    NUM_NEAR_AGENTS,
)
from pd_editor.generation.inputs.scene_batch import SceneTensors, gathered
from pd_editor.generation.inputs.trajectory_pca import TrajectoryBasis
from pd_editor.generation.trajectory.network.block import (
    AgentBlock,
    BlockContext,
    Masks,
    TokenEncoder,
    Tokens,
)
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
