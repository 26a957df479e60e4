"""The trajectory network: from noisy latents of all agents to clean ones.

Each agent attends to the map tokens around it, to its Frenet candidates and to its
neighbours (heterogeneous message passing, Path Diffuser section III-E). All poses are
relative, so results do not change when a scene is turned or moved. Neighbours are also
seen at the waypoints that were predicted last, which are new in each block.
"""

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import pad

from pd_editor.diffusion.core.attention import minus_infinity_unless
from pd_editor.diffusion.core.config_limits import check_sizes
from pd_editor.diffusion.core.noise_schedule import (
    Prediction,
    ScheduleKind,
    VariancePreserving,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.diffusion.inputs.trajectory_pca import TrajectoryBasis
from pd_editor.diffusion.trajectory.block import AgentBlock, BlockContext, Masks
from pd_editor.diffusion.trajectory.context import EncodedLevel, TrajectoryContext
from pd_editor.diffusion.trajectory.decoding import TrajectoryDecoder
from pd_editor.diffusion.trajectory.features import (
    NUM_AGENT_FEATURES,
    NUM_EDGE_FEATURES,
    NUM_LEVEL_FEATURES,
    NUM_PIECE_FEATURES,
    Neighbors,
    agent_features,
    level_features,
    piece_features,
    seen_pieces,
)
from pd_editor.diffusion.trajectory.interaction_features import InteractionGeometry
from pd_editor.diffusion.trajectory.token_encoder import TokenEncoder
from pd_editor.windows.packed_scene import LATENT_SIZE
from pd_editor.windows.scene_features import NUM_FUTURE_STEPS


@dataclass(frozen=True, kw_only=True)
class TrajectoryConfig:
    """What decides the shapes of the weights, and what they mean."""

    width: int = 128
    num_heads: int = 4
    num_blocks: int = 2
    num_near_agents: int = field(default=16, metadata={"when_absent": 8})
    edge_width: int = 64
    """Width of the embedding of a neighbour's pose and waypoints."""
    sees_way_points: bool = True
    """Whether neighbours are seen at their predicted waypoints."""
    schedule: ScheduleKind = "cosine"
    prediction: Prediction = "velocity"

    def __post_init__(self) -> None:
        check_sizes(self)


class TrajectoryDenoiser(nn.Module):
    """Predicts clean latents of its trajectory basis."""

    def __init__(
        self, config: TrajectoryConfig, basis: TrajectoryBasis | None = None
    ) -> None:
        """Without a basis, one is expected to be loaded with the weights."""
        super().__init__()
        self.config = config
        self.schedule = VariancePreserving(
            kind=config.schedule, prediction=config.prediction
        )
        self.decoder = TrajectoryDecoder(basis, NUM_FUTURE_STEPS)
        width, blocks, heads = config.width, config.num_blocks, config.num_heads
        self.agent_in = nn.Linear(NUM_AGENT_FEATURES, width)
        self.noisy_in = nn.Linear(LATENT_SIZE, width, bias=False)
        self.level_in = nn.Linear(NUM_LEVEL_FEATURES, (1 + blocks) * width)
        """For the first layer and for each block."""
        self.embed = nn.Linear(width, width)
        self.map_tokens = TokenEncoder(NUM_PIECE_FEATURES, width, blocks, heads)
        self.candidate_tokens = TokenEncoder(LATENT_SIZE, width, blocks, heads)
        self.edge_in = nn.Linear(NUM_EDGE_FEATURES, blocks * config.edge_width)
        self.blocks = nn.ModuleList(
            AgentBlock(width, heads, config.edge_width) for _ in range(blocks)
        )

    def encode_context(self, scene: SceneTensors) -> TrajectoryContext:
        """All that does not depend on noisy trajectories."""
        features = agent_features(scene)
        neighbors = Neighbors.of(scene, self.config.num_near_agents)
        edges = self.edge_in(neighbors.edge_features(features)).flatten(0, 2)
        keys, values, masks = self._tokens(scene)
        interactions = None
        if self.config.sees_way_points:
            interactions = InteractionGeometry.of(
                self.decoder, scene.agent_speed, neighbors
            )
        return TrajectoryContext(
            agent=self.agent_in(features),
            blocks=tuple(
                BlockContext(keys=one, values=two, edge=three)
                for one, two, three in zip(
                    keys, values, edges.chunk(len(self.blocks), dim=-1), strict=True
                )
            ),
            masks=Masks(
                tokens=masks,
                neighbors=minus_infinity_unless(neighbors.exists)[:, None],
                neighbor=neighbors.row[:, None],
            ),
            neighbors=neighbors,
            interactions=interactions,
        )

    def encode_level(self, level: Float[Tensor, "*b"]) -> EncodedLevel:
        """All that depends on noise levels only; given agents are at level 0."""
        level = level[..., None]
        alpha, sigma = self.schedule.alpha(level), self.schedule.sigma(level)
        by_level = self.level_in(level_features(level, alpha, sigma))
        zero, one = torch.zeros_like(level), torch.ones_like(level)
        is_noisy = level > 0
        # The clean sample is linear in the noisy one and in the network's output.
        noisy_share = self.schedule.clean_of(zero, one, level)
        output_share = self.schedule.clean_of(one, zero, level)
        return EncodedLevel(
            hidden=by_level,
            alpha=alpha,
            noisy_share=torch.where(is_noisy, noisy_share, 1.0),
            output_share=torch.where(is_noisy, output_share, 0.0),
        )

    def denoise(
        self,
        noisy: Float[Tensor, "S B A 10"],
        level: EncodedLevel,
        context: TrajectoryContext,
    ) -> Float[Tensor, "S B A 10"]:
        """Predicted clean latents; given agents come out as they go in."""
        return self.predictions(noisy, level, context)[-1]

    def predictions(
        self,
        noisy: Float[Tensor, "S B A 10"],
        level: EncodedLevel,
        context: TrajectoryContext,
    ) -> list[Float[Tensor, "S B A 10"]]:
        """Clean latents predicted by each block; the last one is the result."""
        first, *biases = level.hidden.chunk(1 + len(self.blocks), dim=-1)
        hidden = self.noisy_in(noisy) + (context.agent + first)
        hidden = self.embed(hidden.relu())
        # The best linear prediction of a latent of unit variance.
        prediction = level.alpha * noisy
        kept = level.noisy_share * noisy
        predictions: list[Tensor] = []
        for block, bias, of_block in zip(
            self.blocks, biases, context.blocks, strict=True
        ):
            interactions = None
            if context.interactions is not None:
                interactions = context.interactions.features(prediction.detach())
            hidden, output = block(hidden + bias, interactions, of_block, context.masks)
            prediction = torch.addcmul(kept, level.output_share, output.to(noisy))
            predictions.append(prediction)
        return predictions

    def _tokens(
        self, scene: SceneTensors
    ) -> tuple[Tensor, Tensor, Float[Tensor, "G H2 1 M"]]:
        """Keys, values and mask of map tokens and candidates, as many of each."""
        parts = [
            (self.map_tokens, piece_features(scene), seen_pieces(scene)),
            (self.candidate_tokens, scene.candidates, scene.has_candidate),
        ]
        most = max(exists.shape[-1] for _, _, exists in parts)
        encoded: list[tuple[Tensor, Tensor]] = []
        masks: list[Tensor] = []
        for encoder, tokens, exists in parts:
            missing = most - exists.shape[-1]
            encoded.append(encoder(pad(tokens.flatten(0, 1), (0, 0, 0, missing))))
            # The null token is always there.
            visible = pad(exists.flatten(0, 1), (1, 0), value=True)
            mask = minus_infinity_unless(pad(visible, (0, missing)))[:, None, None]
            masks.append(mask.expand(-1, self.config.num_heads, -1, -1))
        keys, values = (torch.cat(both, dim=2) for both in zip(*encoded, strict=True))
        return keys, values, torch.cat(masks, dim=1)
