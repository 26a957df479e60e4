"""The network of the first stage: clean initial states from noisy ones."""

import math
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pd_editor.diffusion.core.attention import (
    DifferentialAttention,
    KeysValues,
    Mask,
    NeighborAttention,
    visible_agents,
)
from pd_editor.diffusion.core.config_limits import check_sizes
from pd_editor.diffusion.initial_state.agent_count_prior import AgentCounts
from pd_editor.diffusion.initial_state.conditioning import (
    REACH_M,
    TOLD_YES,
    UNTOLD,
    PoseTask,
    pieces_within,
)
from pd_editor.diffusion.initial_state.features import (
    NUM_AGENT_FEATURES,
    NUM_PIECE_FEATURES,
    NUM_PLACE_FEATURES,
    PLACE_WAVELENGTHS_M,
    NoisyPoses,
    agent_relations,
    nearest_pieces,
    piece_relations,
    turned,
    waves,
)
from pd_editor.diffusion.initial_state.lane_anchored_head import LaneVotes, NearPieces
from pd_editor.diffusion.initial_state.noise import noise_scale, preconditioning
from pd_editor.diffusion.initial_state.state_encoding import (
    NUM_STATE_PARTS,
    POSITION_UNIT_M,
    encode_states,
    unit_vectors,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.windows.lane_pieces import CROSSWALK_KIND
from pd_editor.windows.scene_features import (
    AGENT_KINDS,
    NUM_PIECE_KINDS,
    PEDESTRIAN,
    PIECE_SHAPE,
)

_NUM_PIECE_FACTS: Final = len(PIECE_SHAPE) + NUM_PIECE_KINDS
_NUM_LEVEL_WAVES: Final = 8
PIECE_EXISTS: Final = 4
"""Place in ``PoseContext.pieces``; what a piece is comes after it."""


@dataclass(frozen=True, kw_only=True)
class PoseDenoiserConfig:
    """Size and switches of the network."""

    width: int = 128
    num_heads: int = 4
    num_layers: int = 3
    num_near_pieces: int = 16
    relation_width: int = 48
    is_differential: bool = True
    """Plain attention to the map where false."""
    is_ordered: bool = True
    """Tell each drawn agent its place among its kind from left to right."""

    def __post_init__(self) -> None:
        check_sizes(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseContext:
    """What the network needs of B scenes at each step; computed once."""

    map_seen: tuple[KeysValues, ...]
    """Per layer."""
    pieces: Float[Tensor, "B P F"]
    """x, y, cos and sin of the direction, whether there is one, then facts."""
    is_crossing: Bool[Tensor, "B P"]
    agent_token: Float[Tensor, "B A D"]
    is_walking: Bool[Tensor, "B A"]
    is_given: Bool[Tensor, "B A"]
    given: Float[Tensor, "B A 5"]
    """Encoded states of the given agents."""
    pair_facts: Float[Tensor, "B A A 4"]
    """Sizes of both."""
    is_visible: Mask
    """Other agents, of shape [B A 1 A]."""


class PoseDenoiser(nn.Module):
    """Denoises states of all agents of a scene together.

    Each step looks from the noisy poses: with differential attention at all pieces of
    the road, at the nearest pieces in their own frames, and at the other agents.
    """

    def __init__(self, config: PoseDenoiserConfig) -> None:
        super().__init__()
        self.config = config
        width, relation_width = config.width, config.relation_width
        self.piece_token = _mlp(_NUM_PIECE_FACTS + 2 + NUM_PLACE_FEATURES, width)
        self.kind_token = nn.Embedding(len(AGENT_KINDS), width)
        self.given_token = nn.Parameter(torch.zeros(width))
        self.moves_token = _trait_token(width)
        self.on_road_token = _trait_token(width)
        self.agent_facts = nn.Linear(4, width)
        self.state_token = nn.Linear(NUM_STATE_PARTS + NUM_PLACE_FEATURES, width)
        self.level_token = _mlp(2 * _NUM_LEVEL_WAVES + 1, width)
        self.pair_relation = _mlp(NUM_AGENT_FEATURES + 4, relation_width)
        self.piece_relation = _mlp(
            NUM_PIECE_FEATURES + _NUM_PIECE_FACTS, relation_width
        )
        self.layers = nn.ModuleList(
            PoseLayer(config, depth) for depth in range(config.num_layers)
        )
        self.register_buffer("counted", AgentCounts.none().as_tensor())
        self.norm = nn.LayerNorm(width)
        self.to_own_frame = nn.Linear(width, NUM_STATE_PARTS)
        self.to_scene_frame = nn.Linear(width, 4)
        self.by_pieces = LaneVotes(
            width, NUM_PIECE_FEATURES + _NUM_PIECE_FACTS, relation_width
        )

    @property
    def agent_counts(self) -> AgentCounts:
        """How many road users the training data has; empty until it was counted."""
        return AgentCounts.from_tensor(self.get_buffer("counted"))

    def set_agent_counts(self, counts: AgentCounts) -> None:
        """Keep what was counted beside the weights."""
        self.get_buffer("counted").copy_(counts.as_tensor())

    def context(self, scene: SceneTensors, task: PoseTask) -> PoseContext:
        """Everything that does not depend on the noisy states."""
        scene = pieces_within(scene, REACH_M)
        has_agent = _agents_that_count(scene, task)
        kinds = nn.functional.one_hot(scene.piece_kind, NUM_PIECE_KINDS)
        piece_facts = torch.cat([scene.piece_shape, kinds], dim=-1)
        heading = scene.piece_pose[..., 2:]
        axis = torch.cat([heading.cos(), heading.sin()], dim=-1)
        place = waves(scene.piece_pose[..., :2], PLACE_WAVELENGTHS_M)
        pieces = self.piece_token(torch.cat([piece_facts, axis, place], dim=-1))
        is_piece = Mask.of(scene.has_piece[:, None, None])
        num_agents = scene.agent_size.shape[1]
        size = scene.agent_size / 5
        pairs = torch.cat(
            [
                size[:, :, None].expand(-1, -1, num_agents, -1),
                size[:, None].expand(-1, num_agents, -1, -1),
            ],
            dim=-1,
        )
        return PoseContext(
            map_seen=tuple(
                layer.map_attention.keys_values(pieces, is_piece)
                for layer in self.blocks()
            ),
            pieces=torch.cat(
                [
                    scene.piece_pose[..., :2],
                    axis,
                    scene.has_piece[..., None].to(axis.dtype),
                    piece_facts,
                ],
                dim=-1,
            ),
            is_crossing=scene.piece_kind == CROSSWALK_KIND,
            agent_token=self._agent_token(scene, task, has_agent),
            is_walking=scene.agent_kind == PEDESTRIAN,
            is_given=task.is_given,
            given=encode_states(scene.agent_pose, scene.agent_speed),
            pair_facts=pairs,
            is_visible=Mask.of(visible_agents(has_agent, task.is_central)[:, :, None]),
        )

    def denoise(
        self,
        context: PoseContext,
        noisy: Float[Tensor, "S B A 5"],
        level: Float[Tensor, "S #B"],
    ) -> Float[Tensor, "S B A 5"]:
        """Clean states that are expected of noisy ones; given agents as they are.

        Args:
            context: of the B scenes.
            noisy: S noisy versions of the encoded states.
            level: noise level of each, 0..1, for ``noise_scale``.
        """
        is_given = context.is_given[None]
        levels = torch.where(is_given, -1.0, level[..., None])
        noisy = torch.where(is_given[..., None], context.given, noisy)
        # Scenes first: the road is looked at by all versions of a scene together.
        noisy, levels = noisy.transpose(0, 1), levels.transpose(0, 1)
        scale = noise_scale(levels)
        factor_in, factor_skip, factor_out = preconditioning(scale)
        token, near, direction = self._tokens(
            context, noisy, noisy * factor_in, levels, scale
        )
        own, speed = self.to_own_frame(token).float().split([4, 1], dim=-1)
        own = turned(own.unflatten(-1, (2, 2)), direction[..., None, :]).flatten(-2)
        by_pieces = self.by_pieces(token.flatten(1, 2), near).view(own.shape)
        pose = own + self.to_scene_frame(token).float() + by_pieces
        found = torch.cat([pose, speed], dim=-1)
        clean = factor_skip * noisy + factor_out * found
        return torch.where(is_given[..., None], context.given, clean.transpose(0, 1))

    def _tokens(
        self,
        context: PoseContext,
        noisy: Float[Tensor, "B S A 5"],
        scaled: Float[Tensor, "B S A 5"],
        levels: Float[Tensor, "B S A"],
        scale: Float[Tensor, "B S A 5"],
    ) -> tuple[Float[Tensor, "B S A D"], NearPieces, Float[Tensor, "B S A 2"]]:
        """What the network makes of each agent, its road, and its frame's direction."""
        num_scenes, num_versions, num_agents = levels.shape
        poses = NoisyPoses(
            position_m=noisy[..., :2] * POSITION_UNIT_M,
            direction=unit_vectors(noisy[..., 2:4]),
            noise_m=scale[..., 0] * POSITION_UNIT_M,
            turn_noise=scale[..., 2],
        )
        place = waves(poses.position_m, PLACE_WAVELENGTHS_M, poses.noise_m)
        level_token = self.level_tokens(levels)
        token = self.state_token(torch.cat([scaled, place], dim=-1)) + level_token
        token = token + context.agent_token[:, None]
        near = self._near_pieces(context, poses)
        pairs = agent_relations(poses.flattened(0, 1))
        facts = context.pair_facts.repeat_interleave(num_versions, 0)
        pairs = self.pair_relation(torch.cat([pairs, facts], dim=-1))
        visible = context.is_visible.repeated(num_versions)
        for layer, seen in zip(self.blocks(), context.map_seen, strict=True):
            token = layer(token + level_token, seen, near, pairs, visible)
        assert token.shape[:3] == (num_scenes, num_versions, num_agents)
        return self.norm(token), near, poses.direction

    def _near_pieces(self, context: PoseContext, poses: NoisyPoses) -> NearPieces:
        """The nearest pieces of each noisy pose, as the network sees them."""
        num_versions = poses.noise_m.shape[1]
        poses = poses.flattened(1, 2)
        nearest = nearest_pieces(
            poses.position_m,
            context.is_walking.repeat(1, num_versions),
            context.pieces[..., :2],
            context.is_crossing,
            context.pieces[..., PIECE_EXISTS] > 0,
            self.config.num_near_pieces,
        )
        scene = torch.arange(len(nearest), device=nearest.device)[:, None, None]
        near = context.pieces[scene, nearest]
        relations = piece_relations(poses, near[..., :4])
        facts = torch.cat([relations, near[..., PIECE_EXISTS + 1 :]], dim=-1)
        return NearPieces(
            axis=near[..., 2:4],
            facts=facts,
            relations=self.piece_relation(facts),
            mask=Mask.of(near[:, :, None, :, PIECE_EXISTS] > 0),
        )

    def _agent_token(
        self, scene: SceneTensors, task: PoseTask, has_agent: Bool[Tensor, "B A"]
    ) -> Float[Tensor, "B A D"]:
        """Kind, size, traits, part of the task, the square's size and number of agents."""
        count = has_agent.sum(dim=-1)
        of_scene = torch.stack(
            [task.half_side_m / POSITION_UNIT_M, (1 + count).log() / 4], dim=-1
        )
        of_scene = of_scene[:, None].expand(-1, scene.agent_size.shape[1], -1)
        facts = torch.cat([scene.agent_size / 5, of_scene], dim=-1)
        token = self.kind_token(scene.agent_kind) + self.agent_facts(facts)
        token = token + task.is_given[..., None] * self.given_token
        token = token + self.moves_token(task.moves) + self.on_road_token(task.on_road)
        if self.config.is_ordered:
            drawn = task.order[..., None] > 0
            token = token + sinusoids(task.order, self.config.width) * drawn
        return token

    def level_tokens(self, levels: Float[Tensor, "*b"]) -> Float[Tensor, "*b D"]:
        """What each layer is told of noise levels; -1 for agents that are given."""
        rates = math.pi * torch.arange(1, _NUM_LEVEL_WAVES + 1, device=levels.device)
        phase = levels.clamp_min(0)[..., None] * rates
        is_clean = (levels < 0)[..., None].to(levels.dtype)
        return self.level_token(torch.cat([phase.sin(), phase.cos(), is_clean], dim=-1))

    def blocks(self) -> list["PoseLayer"]:
        """The layers in their order."""
        return [layer for layer in self.layers if isinstance(layer, PoseLayer)]


class PoseLayer(nn.Module):
    """Looks at the whole road, at the road nearby, at the others; then thinks."""

    def __init__(self, config: PoseDenoiserConfig, depth: int) -> None:
        super().__init__()
        width, heads = config.width, config.num_heads
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(4))
        self.map_attention = DifferentialAttention(
            width, heads, depth=depth, is_differential=config.is_differential
        )
        self.piece_attention = NeighborAttention(
            width, config.relation_width, heads, with_tokens=False
        )
        self.agent_attention = NeighborAttention(
            width, config.relation_width, heads, with_tokens=True
        )
        self.think = nn.Sequential(
            nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )

    def forward(
        self,
        token: Float[Tensor, "B S A D"],
        seen: KeysValues,
        near: NearPieces,
        pairs: Float[Tensor, "N A A R"],
        is_visible: Mask,
    ) -> Float[Tensor, "B S A D"]:
        """Tokens of S versions of B scenes after the layer."""
        shape = token.shape
        token = token.flatten(1, 2)
        token = token + self.map_attention(self.norms[0](token), seen)
        token = token + self.piece_attention(
            self.norms[1](token), near.relations, near.mask
        )
        token = token.view(shape).flatten(0, 1)
        token = token + self.agent_attention(self.norms[2](token), pairs, is_visible)
        return (token + self.think(self.norms[3](token))).view(shape)


def sinusoids(order: Int[Tensor, "*b"], width: int) -> Float[Tensor, "*b D"]:
    """The usual position code.

    Source: Vaswani et al., Attention is all you need, 2017.
    """
    half = torch.arange(width // 2, device=order.device)
    phase = order[..., None] * torch.exp(-math.log(10_000.0) * 2 * half / width)
    return torch.cat([phase.sin(), phase.cos()], dim=-1)


def _agents_that_count(scene: SceneTensors, task: PoseTask) -> Bool[Tensor, "B A"]:
    """All but given ones too far out to have been in training."""
    is_near = torch.all(scene.agent_pose[..., :2].abs() <= REACH_M, dim=-1)
    return scene.has_agent & (is_near | ~task.is_given)


def _trait_token(width: int) -> nn.Embedding:
    """Nothing where a trait is not told; nothing anywhere before training."""
    token = nn.Embedding(TOLD_YES + 1, width, padding_idx=UNTOLD)
    nn.init.zeros_(token.weight)
    return token


def _mlp(num_inputs: int, width: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(num_inputs, width), nn.ReLU(), nn.Linear(width, width)
    )
