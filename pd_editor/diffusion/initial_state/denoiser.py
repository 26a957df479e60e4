"""The initial-state network: from noisy states of all agents to clean ones."""

import math
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pd_editor.diffusion.core.attention import (
    DifferentialAttention,
    EdgeAttention,
    KeysValues,
    Mask,
    visible_agents,
)
from pd_editor.diffusion.core.config_limits import check_sizes
from pd_editor.diffusion.core.noise_schedule import VarianceExploding, preconditioning
from pd_editor.diffusion.initial_state.agent_count_prior import AgentCounts
from pd_editor.diffusion.initial_state.conditioning import (
    CONDITIONED_YES,
    REACH_M,
    UNCONDITIONED,
    Conditioning,
    pieces_within,
)
from pd_editor.diffusion.initial_state.context import EncodedLevel, InitialStateContext
from pd_editor.diffusion.initial_state.features import (
    NUM_AGENT_FEATURES,
    NUM_PIECE_FEATURES,
    NUM_POSITION_FEATURES,
    POSITION_WAVELENGTHS_M,
    NoisyPoses,
    agent_relations,
    as_complex,
    fading,
    noise_factors,
    waves,
)
from pd_editor.diffusion.initial_state.lane_anchored_head import LaneAnchoredHead
from pd_editor.diffusion.initial_state.map_tokens import MapTokens
from pd_editor.diffusion.initial_state.state_encoding import (
    NUM_STATE_PARTS,
    POSITION_UNIT_M,
    STATE_SPREAD,
    encode_states,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.errors import ModelError
from pd_editor.windows.scene_features import (
    AGENT_KINDS,
    NUM_PIECE_KINDS,
    PIECE_SHAPE,
)

_NUM_TOKEN_FEATURES: Final = len(PIECE_SHAPE) + NUM_PIECE_KINDS
_NUM_LEVEL_WAVES: Final = 8
_NUM_POSE_PARTS: Final = 4


@dataclass(frozen=True, kw_only=True)
class InitialStateConfig:
    """Size and switches of the network."""

    width: int = 128
    num_heads: int = 4
    num_layers: int = 3
    num_near_pieces: int = 16
    relation_width: int = 48
    is_differential: bool = True
    """Plain attention to the map where false."""
    is_ordered: bool = True
    """Encode each sampled agent's place among its kind from left to right."""
    lowest_noise_m: float = 0.1
    """Standard deviation of the noise on positions at level 0."""
    highest_noise_m: float = 80.0
    """At level 1."""
    lowest_direction_noise: float = 0.04
    """The same of headings (unit vectors) and of speed codes; in between it is such that
    the direction is known when the lane is: 0.4 at 3.5 m."""
    highest_direction_noise: float = 3.0

    def __post_init__(self) -> None:
        check_sizes(self)
        self.schedule()

    def schedule(self) -> VarianceExploding:
        """Noise on each part of a state.

        Raises:
            ModelError: the noise does not grow.
        """
        low_m, high_m = self.lowest_noise_m, self.highest_noise_m
        low, high = self.lowest_direction_noise, self.highest_direction_noise
        if not (0 < low_m < high_m < math.inf and 0 < low < high < math.inf):
            raise ModelError(
                f"The noise goes from {low_m:g} to {high_m:g} m and from {low:g} to "
                f"{high:g}; expected finite numbers above 0, the second one larger."
            )
        return VarianceExploding(
            lowest=(low_m / POSITION_UNIT_M,) * 2 + (low,) * 3,
            highest=(high_m / POSITION_UNIT_M,) * 2 + (high,) * 3,
        )


class InitialStateDenoiser(nn.Module):
    """Denoises states of all agents of a scene together.

    Each step looks from the noisy poses: with differential attention at all map tokens,
    at the nearest tokens in their own frames, and at the other agents.
    """

    def __init__(self, config: InitialStateConfig) -> None:
        super().__init__()
        self.config = config
        self.schedule = config.schedule()
        width, relation_width = config.width, config.relation_width
        self.map_token = _mlp(_NUM_TOKEN_FEATURES + 2 + NUM_POSITION_FEATURES, width)
        self.kind_token = nn.Embedding(len(AGENT_KINDS), width)
        self.given_token = nn.Parameter(torch.zeros(width))
        self.moves_token = _attribute_token(width)
        self.on_road_token = _attribute_token(width)
        self.agent_in = nn.Linear(4, width)
        self.state_in = nn.Linear(NUM_STATE_PARTS + NUM_POSITION_FEATURES, width)
        self.level_token = _mlp(2 * _NUM_LEVEL_WAVES + 1, width)
        self.pair_in = nn.Linear(NUM_AGENT_FEATURES, relation_width, bias=False)
        self.pair_sizes_in = nn.Linear(4, relation_width)
        self.near_in = nn.Linear(NUM_PIECE_FEATURES, relation_width, bias=False)
        self.near_token_in = nn.Linear(_NUM_TOKEN_FEATURES, relation_width + width)
        """Of each map token, for relations to it and for the lane-anchored head."""
        self.layers = nn.ModuleList(
            InitialStateLayer(config, depth) for depth in range(config.num_layers)
        )
        self.register_buffer("counted", AgentCounts.none().as_tensor())
        self.norm = nn.LayerNorm(width)
        self.output = nn.Linear(width, _NUM_POSE_PARTS + NUM_STATE_PARTS + width)
        """Pose in the agent's own frame and speed, pose in the scene's frame, and what
        the lane-anchored head reads."""
        self.lane_anchored_head = LaneAnchoredHead(
            width, NUM_PIECE_FEATURES + relation_width
        )
        self.register_buffer("spread", torch.tensor(STATE_SPREAD), persistent=False)

    @property
    def agent_counts(self) -> AgentCounts:
        """How many road users the training data has; empty until it was counted."""
        return AgentCounts.from_tensor(self.get_buffer("counted"))

    def set_agent_counts(self, counts: AgentCounts) -> None:
        """Keep what was counted beside the weights."""
        self.get_buffer("counted").copy_(counts.as_tensor())

    def encode_context(
        self, scene: SceneTensors, task: Conditioning
    ) -> InitialStateContext:
        """Everything that does not depend on the noisy states."""
        scene = pieces_within(scene, REACH_M)
        has_agent = _agents_that_count(scene, task)
        kinds = nn.functional.one_hot(scene.piece_kind, NUM_PIECE_KINDS)
        features = torch.cat([scene.piece_shape, kinds], dim=-1)
        heading = scene.piece_pose[..., 2:]
        position = waves(scene.piece_pose[..., :2], POSITION_WAVELENGTHS_M)
        tokens = self.map_token(
            torch.cat([features, heading.cos(), heading.sin(), position], dim=-1)
        )
        is_token = Mask.of(scene.has_piece[:, None, None])
        num_agents = scene.agent_size.shape[1]
        size = scene.agent_size / 5
        pairs = torch.cat(
            [
                size[:, :, None].expand(-1, -1, num_agents, -1),
                size[:, None].expand(-1, num_agents, -1, -1),
            ],
            dim=-1,
        )
        return InitialStateContext(
            map_keys_values=tuple(
                layer.map_attention.encode(tokens, is_token) for layer in self._layers()
            ),
            map_tokens=MapTokens.of(scene, self.near_token_in(features)),
            agent=self._agent_token(scene, task, has_agent),
            pairs=self.pair_sizes_in(pairs)[:, None],
            is_visible=Mask.of(visible_agents(has_agent, task.is_central)[:, :, None]),
            is_given=task.is_given if bool(task.is_given.any()) else None,
            given=encode_states(scene.agent_pose, scene.agent_speed),
        )

    def encode_level(
        self, level: Float[Tensor, "*l #S #B"], context: InitialStateContext
    ) -> EncodedLevel:
        """All that depends on noise levels 0..1 only; given agents have no noise."""
        levels = level.transpose(-1, -2)[..., None]
        if context.is_given is not None:
            levels = torch.where(context.is_given[:, None], -1.0, levels)
        sigma = self.schedule.sigma(levels[..., None])
        noise_m, turn_noise = sigma[..., 0] * POSITION_UNIT_M, sigma[..., 2]

        def of_both(noise: Float[Tensor, "*b #A"]) -> Float[Tensor, "*b #A #A"]:
            square = noise.square()
            return (square[..., None] + square[..., None, :]).sqrt()

        return EncodedLevel(
            self._level_token(levels),
            *preconditioning(sigma, self.get_buffer("spread")),
            position_fading=fading(POSITION_WAVELENGTHS_M, noise_m).repeat(
                *[1] * noise_m.ndim, 2
            ),
            near=noise_factors(
                noise_m[..., None], turn_noise[..., None], num_offsets=2
            ),
            pairs=noise_factors(of_both(noise_m), of_both(turn_noise), num_offsets=1),
        )

    def denoise(
        self,
        noisy: Float[Tensor, "S B A 5"],
        level: EncodedLevel,
        context: InitialStateContext,
    ) -> Float[Tensor, "S B A 5"]:
        """Clean states predicted from encoded noisy ones; given agents as they are."""
        # Scenes first: all versions of a scene attend to its map together.
        states = noisy.transpose(0, 1)
        if context.is_given is not None:
            is_given = context.is_given[:, None, :, None]
            states = torch.where(is_given, context.given[:, None], states)
        found = self._output(states, level, context)
        clean = torch.addcmul(level.factor_skip * states, level.factor_out, found)
        if context.is_given is not None:
            is_given = context.is_given[:, None, :, None]
            clean = torch.where(is_given, context.given[:, None], clean)
        return clean.transpose(0, 1)

    def _output(
        self,
        states: Float[Tensor, "B S A 5"],
        level: EncodedLevel,
        context: InitialStateContext,
    ) -> Float[Tensor, "B S A 5"]:
        """The network's output, of about unit size at each level."""
        position_m = states[..., :2] * POSITION_UNIT_M
        poses = NoisyPoses(
            position_m=as_complex(position_m),
            direction=torch.sgn(as_complex(states[..., 2:4])),
        )
        position = waves(position_m, POSITION_WAVELENGTHS_M) * level.position_fading
        token = self.state_in(torch.cat([states * level.factor_in, position], dim=-1))
        token = token + (context.agent[:, None] + level.token)
        near = context.map_tokens.near(poses, level.near, self.config.num_near_pieces)
        of_tokens, for_head = near.encoded.split(
            [self.config.relation_width, self.config.width], dim=-1
        )
        near_edges = self.near_in(near.relations).add_(of_tokens).relu_()
        relations = agent_relations(poses, level.pairs)
        pairs = self.pair_in(relations).add_(context.pairs).relu_()
        num_versions = token.shape[1]
        edges = Edges(
            near=near_edges.flatten(0, 1),
            near_mask=near.mask.mapped(lambda one: one.flatten(0, 1)),
            pairs=pairs.flatten(0, 1),
            pairs_mask=context.is_visible.mapped(
                lambda one: one.repeat_interleave(num_versions, 0)
            ),
        )
        for layer, seen in zip(self._layers(), context.map_keys_values, strict=True):
            token = layer(token + level.token, seen, edges)
        in_own_frame, speed, in_scene, for_proposals = self.output(
            self.norm(token)
        ).split([_NUM_POSE_PARTS, 1, _NUM_POSE_PARTS, self.config.width], dim=-1)
        proposed = self.lane_anchored_head(
            for_proposals,
            torch.cat([near.relations, near_edges.to(near.relations)], dim=-1),
            for_head,
            near.axis,
            near.mask,
        )
        pose = as_complex(in_own_frame.float().unflatten(-1, (2, 2)))
        pose = pose * poses.direction[..., None] + proposed
        pose = torch.view_as_real(pose).flatten(-2) + in_scene.float()
        return torch.cat([pose, speed.float()], dim=-1)

    def _agent_token(
        self, scene: SceneTensors, task: Conditioning, has_agent: Bool[Tensor, "B A"]
    ) -> Float[Tensor, "B A D"]:
        """Kind, size, attributes, order, the square's size and number of agents."""
        count = has_agent.sum(dim=-1)
        of_scene = torch.stack(
            [task.half_side_m / POSITION_UNIT_M, (1 + count).log() / 4], dim=-1
        )
        of_scene = of_scene[:, None].expand(-1, scene.agent_size.shape[1], -1)
        facts = torch.cat([scene.agent_size / 5, of_scene], dim=-1)
        token = self.kind_token(scene.agent_kind) + self.agent_in(facts)
        token = token + task.is_given[..., None] * self.given_token
        token = token + self.moves_token(task.moves) + self.on_road_token(task.on_road)
        if self.config.is_ordered:
            is_sampled = task.order[..., None] > 0
            token = token + sinusoids(task.order, self.config.width) * is_sampled
        return token

    def _level_token(self, levels: Float[Tensor, "*b"]) -> Float[Tensor, "*b D"]:
        """Noise levels, for each layer; -1 for agents that are given."""
        rates = math.pi * torch.arange(1, _NUM_LEVEL_WAVES + 1, device=levels.device)
        phase = levels.clamp_min(0)[..., None] * rates
        is_clean = (levels < 0)[..., None].to(levels.dtype)
        return self.level_token(torch.cat([phase.sin(), phase.cos(), is_clean], dim=-1))

    def _layers(self) -> list["InitialStateLayer"]:
        return [layer for layer in self.layers if isinstance(layer, InitialStateLayer)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Edges:
    """Embedded edges of the agents of N versions of scenes, the same for all layers."""

    near: Float[Tensor, "N A M R"]
    """To the nearest map tokens."""
    near_mask: Mask
    """Of shape [N A 1 M]."""
    pairs: Float[Tensor, "N A A R"]
    """To the other agents."""
    pairs_mask: Mask
    """Of shape [N A 1 A]."""


class InitialStateLayer(nn.Module):
    """Attention to the map, to the nearest map tokens, to the agents; feed-forward."""

    def __init__(self, config: InitialStateConfig, depth: int) -> None:
        super().__init__()
        width, heads = config.width, config.num_heads
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(4))
        self.map_attention = DifferentialAttention(
            width, heads, depth=depth, is_differential=config.is_differential
        )
        self.near_attention = EdgeAttention(
            width, config.relation_width, heads, with_tokens=False
        )
        self.agent_attention = EdgeAttention(
            width, config.relation_width, heads, with_tokens=True
        )
        self.feed_forward = nn.Sequential(
            nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )

    def forward(
        self, token: Float[Tensor, "B S A D"], seen: KeysValues, edges: Edges
    ) -> Float[Tensor, "B S A D"]:
        """Tokens of S versions of B scenes after the layer."""
        shape = token.shape
        token = token.flatten(1, 2)
        token = token + self.map_attention(self.norms[0](token), seen)
        token = token.view(shape).flatten(0, 1)
        token = token + self.near_attention(
            self.norms[1](token), edges.near, edges.near_mask
        )
        token = token + self.agent_attention(
            self.norms[2](token), edges.pairs, edges.pairs_mask
        )
        return (token + self.feed_forward(self.norms[3](token))).view(shape)


def sinusoids(order: Int[Tensor, "*b"], width: int) -> Float[Tensor, "*b D"]:
    """The usual position encoding.

    Source: Vaswani et al., Attention is all you need, 2017.
    """
    half = torch.arange(width // 2, device=order.device)
    phase = order[..., None] * torch.exp(-math.log(10_000.0) * 2 * half / width)
    return torch.cat([phase.sin(), phase.cos()], dim=-1)


def _agents_that_count(scene: SceneTensors, task: Conditioning) -> Bool[Tensor, "B A"]:
    """All but given ones too far out to have been in training."""
    is_near = torch.all(scene.agent_pose[..., :2].abs() <= REACH_M, dim=-1)
    return scene.has_agent & (is_near | ~task.is_given)


def _attribute_token(width: int) -> nn.Embedding:
    """0 where an attribute is not set; 0 everywhere before training."""
    token = nn.Embedding(CONDITIONED_YES + 1, width, padding_idx=UNCONDITIONED)
    nn.init.zeros_(token.weight)
    return token


def _mlp(num_inputs: int, width: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(num_inputs, width), nn.ReLU(), nn.Linear(width, width)
    )
