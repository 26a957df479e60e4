"""The initial-state network, which predicts clean states of all agents from noisy ones."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pd_editor.base.errors import ModelError
from pd_editor.generation.core.attention import (
    DifferentialAttention,
    EdgeAttention,
    KeysValues,
    Mask,
    visible_agents,
)
from pd_editor.generation.core.noise_schedule import (
    DiffusionSteps,
    NoiseSchedule,
    StatePrediction,
    StateScheduleKind,
    VarianceExploding,
    output_factors,
    relative_noise,
)
from pd_editor.generation.defaults import check_sizes
from pd_editor.generation.features.map_pieces import (
    BOUNDARY_SHAPE,
    NUM_PIECE_KINDS,
    PIECE_SHAPE,
    PIECE_SIGNAL,
)
from pd_editor.generation.features.scene_features import AGENT_KINDS
from pd_editor.generation.initial_state.network.agent_count_prior import AgentCounts
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_YES,
    REACH_M,
    UNCONDITIONED,
    Conditioning,
    pieces_within,
)
from pd_editor.generation.initial_state.network.features import (
    NUM_AGENT_FEATURES,
    NUM_FOLDED_FEATURES,
    NUM_GAP_FEATURES,
    NUM_PIECE_FEATURES,
    NUM_POSITION_FEATURES,
    POSITION_WAVELENGTHS_M,
    BoxPairs,
    NoisyPoses,
    agent_relations,
    as_complex,
    fading,
    noise_factors,
    waves,
)
from pd_editor.generation.initial_state.network.map_tokens import (
    EncodedMap,
    EncodedStateLevel,
    InitialStateContext,
    LaneAnchoredHead,
    MapLayer,
    MapTokens,
    NearTokens,
    TokenGroup,
)
from pd_editor.generation.initial_state.network.state_encoding import (
    ACTIVITIES,
    NUM_MOTION_PARTS,
    NUM_POSE_PARTS,
    POSITION_UNIT_M,
    encode_states,
    state_spread,
)
from pd_editor.generation.inputs import SceneTensors

_NUM_TOKEN_FEATURES: Final = len(PIECE_SHAPE) + NUM_PIECE_KINDS
_NUM_LEVEL_WAVES: Final = 8
NUM_ATTRIBUTE_CODES: Final = CONDITIONED_YES + 1
"""Number of codes of an attribute: not set, no, yes."""


@dataclass(frozen=True, kw_only=True)
class InitialStateConfig:
    """Size and switches of the network."""

    width: int = 128
    """Width of the embeddings of agents and map tokens; a multiple of ``num_heads``."""
    num_heads: int = 4
    """Heads of each attention."""
    num_layers: int = 3
    """Layers, each with attention to the map and among agents."""
    num_near_pieces: int = 16
    """Number of the nearest lane pieces to which each agent attends in relative poses."""
    relation_width: int = 48
    """Width of the embedding of a relative pose."""
    is_differential: bool = True
    """Whether map attention is differential; false is standard attention."""
    is_ordered: bool = True
    """Whether each sampled agent's rank among its kind is encoded."""
    lowest_noise_m: float = 0.1
    """Standard deviation of the noise on positions at level 0."""
    highest_noise_m: float = 80.0
    """Standard deviation of the noise on positions at level 1."""
    lowest_direction_noise: float = 0.04
    """The same for headings (unit vectors) and speed codes at level 0. In between, noise is
    such that headings are resolved together with lanes: 0.4 at 3.5 m."""
    highest_direction_noise: float = 3.0
    """Standard deviation of the noise on headings and speed codes at level 1."""
    sees_boundary: bool = True
    """Whether agents attend to the nearest pieces of the drivable area's boundary, and
    the lane-anchored head proposes poses in their frames."""
    num_near_boundary: int = 8
    """Number of the nearest boundary pieces to which each agent attends."""
    relates_map_tokens: bool = True
    """Whether map tokens attend to their neighbours in one layer, once per scene."""
    num_map_neighbors: int = 12
    """Number of the nearest other tokens to which each map token attends."""
    sees_box_gaps: bool = True
    """Whether relations of agents include the gaps between boxes."""
    folds_turns: bool = True
    """Whether relations include directions modulo a half and a quarter turn."""
    sees_signals: bool = True
    """Whether the states of traffic signals ahead are an input."""
    samples_activity: bool = True
    """Whether states include activities: parked, waiting or driving."""
    sees_relations: bool = True
    """Whether agents see map tokens and each other in relative poses. Without it, poses
    are known and predicted in the frame of the scene only, as in the paper; then nothing
    that builds on relations (``sees_boundary``, ``sees_box_gaps``) may be set."""
    orders_all_kinds: bool = False
    """Whether an agent's rank is among all agents, as in the paper."""
    noise_schedule: StateScheduleKind = "exploding"
    """``betas`` is the paper's; it has no use for the noise limits."""
    prediction: StatePrediction = "preconditioned"
    """What the network predicts: a mixture of clean state and noise that is of unit size
    at each level, or the noise, as in the paper."""

    @property
    def num_state_parts(self) -> int:
        """Size of an encoded state."""
        return NUM_MOTION_PARTS + len(ACTIVITIES) * self.samples_activity

    def __post_init__(self) -> None:
        check_sizes(self)
        self.schedule()
        if not self.sees_relations and (self.sees_boundary or self.sees_box_gaps):
            raise ModelError(
                "sees_relations is false; expected sees_boundary and sees_box_gaps to be "
                "false as well, which need relations."
            )

    def schedule(self) -> NoiseSchedule:
        """Noise schedule of each part of a state.

        Raises:
            ModelError: the noise does not increase.
        """
        low_m, high_m = self.lowest_noise_m, self.highest_noise_m
        low, high = self.lowest_direction_noise, self.highest_direction_noise
        if not (0 < low_m < high_m < math.inf and 0 < low < high < math.inf):
            raise ModelError(
                f"The noise goes from {low_m:g} to {high_m:g} m and from {low:g} to "
                f"{high:g}; expected finite numbers above 0, the second one larger."
            )
        if self.noise_schedule == "betas":
            return DiffusionSteps()
        num_others = self.num_state_parts - 2
        return VarianceExploding(
            lowest=(low_m / POSITION_UNIT_M,) * 2 + (low,) * num_others,
            highest=(high_m / POSITION_UNIT_M,) * 2 + (high,) * num_others,
        )


class InitialStateDenoiser(nn.Module):
    """Denoises the states of all agents of a scene jointly.

    From their noisy poses, agents attend to all map tokens (differential attention), to
    the nearest tokens in the tokens' frames, and to the other agents.
    """

    def __init__(self, config: InitialStateConfig) -> None:
        super().__init__()
        self.config = config
        self.schedule = config.schedule()
        width, relation_width = config.width, config.relation_width
        num_signal = len(PIECE_SIGNAL) * config.sees_signals
        num_token = _NUM_TOKEN_FEATURES + 2 + NUM_POSITION_FEATURES + num_signal
        self.map_token = _mlp(num_token, width)
        self.kind_token = nn.Embedding(len(AGENT_KINDS), width)
        self.given_token = nn.Parameter(torch.zeros(width))
        self.moves_token = _attribute_token(width)
        self.on_road_token = _attribute_token(width)
        self.agent_in = nn.Linear(4, width)
        self.state_in = nn.Linear(config.num_state_parts + NUM_POSITION_FEATURES, width)
        """Input layer of motion, sinusoids of the position, and activity."""
        self.level_token = _mlp(2 * _NUM_LEVEL_WAVES + 1, width)
        num_folded = NUM_FOLDED_FEATURES * config.folds_turns
        num_pair = NUM_AGENT_FEATURES + num_folded
        num_pair += NUM_GAP_FEATURES * config.sees_box_gaps
        num_near = NUM_PIECE_FEATURES + num_folded
        relates = config.sees_relations
        if relates:
            self.pair_in = nn.Linear(num_pair, relation_width, bias=False)
        self.pair_sizes_in = nn.Linear(4, relation_width)
        if relates:
            self.near_in = nn.Linear(num_near, relation_width, bias=False)
            self.near_token_in = nn.Linear(
                _NUM_TOKEN_FEATURES + num_signal, relation_width + width
            )
            """Embedding of each map token for relations to it and for the lane-anchored
            head."""
        self.layers = nn.ModuleList(
            InitialStateLayer(config, depth) for depth in range(config.num_layers)
        )
        self.register_buffer("counted", AgentCounts.none().as_tensor())
        self.norm = nn.LayerNorm(width)
        num_own = NUM_POSE_PARTS * relates
        self._output_ends = (
            num_own,
            num_own + 1,
            num_own + 1 + NUM_POSE_PARTS,
            num_own + 1 + NUM_POSE_PARTS + width * relates,
        )
        num_outputs = num_own + config.num_state_parts + width * relates
        self.output = nn.Linear(width, num_outputs)
        """Output layer: pose in the agent's frame and speed, pose in the scene's frame,
        input of the lane-anchored head, and activity."""
        if relates:
            self.lane_anchored_head = LaneAnchoredHead(
                width,
                NUM_PIECE_FEATURES + relation_width,
                has_boundary=config.sees_boundary,
            )
        self._add_map_layers(num_near)
        self._add_statistics()

    def _add_map_layers(self, num_near: int) -> None:
        """Layers of boundaries and of relations between tokens, if there are any."""
        config = self.config
        width, relation_width = config.width, config.relation_width
        if config.sees_boundary:
            num_shape = len(BOUNDARY_SHAPE)
            self.boundary_token = _mlp(num_shape + 2 + NUM_POSITION_FEATURES, width)
            self.boundary_in = nn.Linear(num_near, relation_width, bias=False)
            self.boundary_token_in = nn.Linear(num_shape, relation_width + width)
        if config.relates_map_tokens:
            self.map_layer = MapLayer(
                width, relation_width, config.num_heads, config.num_map_neighbors
            )
        if config.relates_map_tokens and config.sees_relations:
            self.near_context_in = nn.Linear(width, relation_width + width, bias=False)
            """Context of each token, for relations to it and for the heads."""
            nn.init.zeros_(self.near_context_in.weight)

    def _add_statistics(self) -> None:
        """Statistics of the training data, before they are measured."""
        spread = state_spread(samples_activity=self.config.samples_activity)
        self.register_buffer("spread", torch.tensor(spread), persistent=False)
        of_others = np.diag(spread[NUM_POSE_PARTS:])
        moments = np.concatenate([np.zeros((1, len(of_others))), of_others])
        moments = np.tile(moments, (len(AGENT_KINDS), NUM_ATTRIBUTE_CODES, 1, 1))
        self.register_buffer(
            "state_moments", torch.tensor(moments, dtype=torch.float32)
        )
        errors = torch.zeros(21, len(spread))
        self.register_buffer("clean_variance", errors)

    @property
    def agent_counts(self) -> AgentCounts:
        """Counts of road users in the training data; empty before they are fitted."""
        return AgentCounts.from_tensor(self.get_buffer("counted"))

    def set_agent_counts(self, counts: AgentCounts) -> None:
        """Store counts beside the weights."""
        self.get_buffer("counted").copy_(counts.as_tensor())

    def encode_context(
        self,
        scene: SceneTensors,
        task: Conditioning,
        road_map: EncodedMap | None = None,
    ) -> InitialStateContext:
        """Compute the values that do not depend on noisy states.

        ``road_map`` is the encoded map of the scene, if it is known already.
        """
        road_map = self.encode_map(scene) if road_map is None else road_map
        has_agent = _agents_that_count(scene, task)
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
            road_map=road_map.seen_by(scene.agent_kind),
            agent=self._agent_token(scene, task, has_agent),
            pairs=self.pair_sizes_in(pairs)[:, None],
            boxes=BoxPairs.of(scene.agent_size) if self.config.sees_box_gaps else None,
            is_visible=Mask.of(visible_agents(has_agent, task.is_central)[:, :, None]),
            is_given=task.is_given,
            given=self.encode_states(scene),
        )

    def encode_states(self, scene: SceneTensors) -> Float[Tensor, "B A P"]:
        """Encode the scene's own states."""
        activity = scene.agent_activity if self.config.samples_activity else None
        return encode_states(scene.agent_pose, scene.agent_speed, activity)

    def encode_map(self, scene: SceneTensors) -> EncodedMap:
        """Compute the values that depend on the map only, within reach of the square."""
        scene = pieces_within(scene, REACH_M)
        of_lanes, near = self._map_tokens(scene)
        is_token = Mask.of(scene.has_piece[:, None, None])
        return EncodedMap(
            tuple(
                layer.map_attention.encode(of_lanes, is_token)
                for layer in self._layers()
            ),
            near,
        )

    def _map_tokens(
        self, scene: SceneTensors
    ) -> tuple[Float[Tensor, "B P D"], MapTokens | None]:
        """Embed lanes, and all map tokens for the search of near ones, with context."""
        config = self.config
        relates = config.sees_relations
        kinds = nn.functional.one_hot(scene.piece_kind, NUM_PIECE_KINDS)
        features = torch.cat([scene.piece_shape, kinds], dim=-1)
        inputs = [_token_inputs(features, scene.piece_pose), features]
        if config.sees_signals:
            inputs = [torch.cat([one, scene.piece_signal], dim=-1) for one in inputs]
        tokens = [self.map_token(inputs[0])]
        near = [self.near_token_in(inputs[1])] if relates else []
        if config.sees_boundary:
            shape, pose = scene.boundary_shape, scene.boundary_pose
            tokens.append(self.boundary_token(_token_inputs(shape, pose)))
            near.append(self.boundary_token_in(shape))
        if config.relates_map_tokens:
            number = len(tokens)
            poses = torch.cat([scene.piece_pose, scene.boundary_pose][:number], dim=1)
            exists = torch.cat([scene.has_piece, scene.has_boundary][:number], dim=1)
            found = self.map_layer(torch.cat(tokens, dim=1), poses, exists)
            sizes = [one.shape[1] for one in tokens]
            tokens = found.split(sizes, dim=1)
            if relates:
                aware = self.near_context_in(found).split(sizes, dim=1)
                near = [one + more for one, more in zip(near, aware, strict=True)]
        if not relates:
            return tokens[0], None
        groups = [TokenGroup.of_lanes(scene, near[0], config.num_near_pieces)]
        if config.sees_boundary:
            groups.append(
                TokenGroup.of_boundary(scene, near[1], config.num_near_boundary)
            )
        return tokens[0], MapTokens.of(*groups)

    def encode_level(
        self, level: Float[Tensor, "*l #S #B"], context: InitialStateContext
    ) -> EncodedStateLevel:
        """Compute the values that depend on noise levels 0..1; given agents have no noise."""
        levels = level.transpose(-1, -2)[..., None]
        levels = torch.where(context.is_given[:, None], -1.0, levels)
        sigma = relative_noise(self.schedule, levels[..., None])
        noise_m = sigma[..., 0] * POSITION_UNIT_M
        turn_noise = sigma[..., min(2, sigma.shape[-1] - 1)]
        # Noisy states are scaled to signal 1, where one network serves all schedules.
        gain = 1 / self.schedule.alpha(levels[..., None])
        factor_in, factor_skip, factor_out = self.output_factors(sigma)

        def of_both(noise: Float[Tensor, "*b #A"]) -> Float[Tensor, "*b #A #A"]:
            square = noise.square()
            return (square[..., None] + square[..., None, :]).sqrt()

        return EncodedStateLevel(
            self._level_token(levels),
            factor_in=gain * factor_in,
            factor_skip=gain * factor_skip,
            factor_out=factor_out,
            position_m=gain * POSITION_UNIT_M,
            position_fading=fading(POSITION_WAVELENGTHS_M, noise_m).repeat(
                *[1] * noise_m.ndim, 2
            ),
            near=noise_factors(
                noise_m[..., None],
                turn_noise[..., None],
                num_offsets=2,
                folds_turns=self.config.folds_turns,
            ),
            pairs=noise_factors(
                of_both(noise_m),
                of_both(turn_noise),
                num_offsets=1,
                folds_turns=self.config.folds_turns,
                sees_gaps=self.config.sees_box_gaps,
            ),
        )

    def output_factors(
        self, sigma: Float[Tensor, "*b #P"]
    ) -> tuple[Float[Tensor, "*b P"], Float[Tensor, "*b P"], Float[Tensor, "*b P"]]:
        """Factors of input, skipped input and output at a noise relative to the signal."""
        return output_factors(self.config.prediction, sigma, self.get_buffer("spread"))

    def denoise(
        self,
        noisy: Float[Tensor, "S B A P"],
        level: EncodedStateLevel,
        context: InitialStateContext,
    ) -> Float[Tensor, "S B A P"]:
        """Predict clean states from encoded noisy ones; given agents are unchanged."""
        # Scenes first, so that all versions of a scene attend to its map in one product.
        states = noisy.transpose(0, 1)
        is_given = context.is_given[:, None, :, None]
        states = torch.where(is_given, context.given[:, None], states)
        found = self._output(states, level, context)
        clean = torch.addcmul(level.factor_skip * states, level.factor_out, found)
        clean = torch.where(is_given, context.given[:, None], clean)
        return clean.transpose(0, 1)

    def _output(
        self,
        states: Float[Tensor, "B S A P"],
        level: EncodedStateLevel,
        context: InitialStateContext,
    ) -> Float[Tensor, "B S A P"]:
        """Output of the network, of about unit scale at each level."""
        position_m = states[..., :2] * level.position_m
        poses = NoisyPoses(
            position_m=as_complex(position_m),
            direction=as_complex(_directions(states[..., 2:4])),
        )
        position = waves(position_m, POSITION_WAVELENGTHS_M) * level.position_fading
        scaled = states * level.factor_in
        motion, activity = scaled.tensor_split([NUM_MOTION_PARTS], dim=-1)
        token = self.state_in(torch.cat([motion, position, activity], dim=-1))
        token = token + (context.agent[:, None] + level.token)
        folds, num_versions = self.config.folds_turns, token.shape[1]
        near, of_groups, near_edges, near_mask = None, [], None, None
        if context.road_map.near is not None:
            near = context.road_map.near.near(poses, level.near, folds_turns=folds)
            of_groups, near_edges = self._near_edges(near)
            near_mask = near.mask.mapped(self._for_heads)
            relations = agent_relations(
                poses, level.pairs, folds_turns=folds, boxes=context.boxes
            )
            pairs = self.pair_in(relations).add_(context.pairs).relu_()
        else:
            pairs = context.pairs.relu().expand(-1, num_versions, -1, -1, -1)
        edges = Edges(
            near=None if near_edges is None else near_edges.flatten(0, 1),
            near_mask=near_mask,
            pairs=pairs.flatten(0, 1),
            pairs_mask=context.is_visible.mapped(
                lambda one: one.repeat_interleave(num_versions, 0)
            ),
        )
        for layer, seen in zip(
            self._layers(), context.road_map.keys_values, strict=True
        ):
            token = layer(token + level.token, seen, edges)
        in_own_frame, speed, in_scene, for_proposals, activity = self.output(
            self.norm(token)
        ).tensor_split(self._output_ends, dim=-1)
        pose = in_scene.float()
        if near is not None and near_edges is not None:
            proposed = self.lane_anchored_head(
                for_proposals,
                of_groups,
                near,
                near.encoded[..., near_edges.shape[-1] :],
            )
            own = as_complex(in_own_frame.float().unflatten(-1, (2, 2)))
            own = own * poses.direction[..., None] + proposed
            pose = torch.view_as_real(own).flatten(-2) + pose
        return torch.cat([pose, speed.float(), activity.float()], dim=-1)

    def _near_edges(
        self, near: NearTokens
    ) -> tuple[list[Float[Tensor, "B S A _ E"]], Float[Tensor, "B S A M R"]]:
        """What the head reads of relations to the tokens of each group; their edges."""
        layers = [self.near_in]
        if self.config.sees_boundary:
            layers.append(self.boundary_in)
        # Linear layers are slow on slices.
        relations = [
            one.contiguous() for one in near.relations.split(near.numbers, dim=-2)
        ]
        found = [layer(one) for layer, one in zip(layers, relations, strict=True)]
        edges = found[0] if len(found) == 1 else torch.cat(found, dim=-2)
        edges = edges.add_(near.encoded[..., : edges.shape[-1]]).relu_()
        of_groups = [
            torch.cat([one[..., :NUM_PIECE_FEATURES], edge.to(one)], dim=-1)
            for one, edge in zip(
                relations, edges.split(near.numbers, dim=-2), strict=True
            )
        ]
        return of_groups, edges

    def _for_heads(self, mask: Float[Tensor, "B S A G _"]) -> Float[Tensor, "N A H _"]:
        """The part of a mask for the heads of all groups, scenes in a row."""
        mask = mask.flatten(0, 1)
        if not self.config.sees_boundary:
            return mask
        return mask.repeat_interleave(self.config.num_heads, dim=2)

    def _agent_token(
        self, scene: SceneTensors, task: Conditioning, has_agent: Bool[Tensor, "B A"]
    ) -> Float[Tensor, "B A D"]:
        """Embed kind, size, attributes, rank, the square's size and number of agents."""
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
        """Embed noise levels for each layer; -1 for given agents."""
        rates = math.pi * torch.arange(1, _NUM_LEVEL_WAVES + 1, device=levels.device)
        phase = levels.clamp_min(0)[..., None] * rates
        is_clean = (levels < 0)[..., None].to(levels.dtype)
        return self.level_token(torch.cat([phase.sin(), phase.cos(), is_clean], dim=-1))

    def _layers(self) -> list["InitialStateLayer"]:
        return [layer for layer in self.layers if isinstance(layer, InitialStateLayer)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Edges:
    """Embedded edges of the agents in N versions of scenes, shared by all layers."""

    near: Float[Tensor, "N A M R"] | None
    """Edges to the nearest map tokens; None without relations."""
    near_mask: Mask | None
    """Of shape [N A #H M]."""
    pairs: Float[Tensor, "N A A R"]
    """Edges to the other agents."""
    pairs_mask: Mask
    """Mask of shape [N A 1 A]."""


class InitialStateLayer(nn.Module):
    """Layer: attention to the map, the nearest map tokens and agents, then feed-forward."""

    def __init__(self, config: InitialStateConfig, depth: int) -> None:
        super().__init__()
        width, heads = config.width, config.num_heads
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(4))
        self.map_attention = DifferentialAttention(
            width, heads, depth=depth, is_differential=config.is_differential
        )
        if config.sees_relations:
            self.near_attention = EdgeAttention(
                width,
                config.relation_width,
                heads,
                num_groups=2 if config.sees_boundary else 1,
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
        """Apply the layer to the tokens of S versions of B scenes."""
        shape = token.shape
        # One row of agents per map, which several scenes may share.
        num_maps = seen.values.shape[0] // self.map_attention.num_heads
        token = token.reshape(num_maps, -1, shape[-1])
        token = token + self.map_attention(self.norms[0](token), seen)
        token = token.view(shape).flatten(0, 1)
        if edges.near is not None and edges.near_mask is not None:
            token = token + self.near_attention(
                self.norms[1](token), edges.near, edges.near_mask
            )
        token = token + self.agent_attention(
            self.norms[2](token), edges.pairs, edges.pairs_mask
        )
        return (token + self.feed_forward(self.norms[3](token))).view(shape)


def sinusoids(order: Int[Tensor, "*b"], width: int) -> Float[Tensor, "*b D"]:
    """Sinusoidal position encoding.

    Source: Vaswani et al., Attention is all you need, 2017.
    """
    half = torch.arange(width // 2, device=order.device)
    phase = order[..., None] * torch.exp(-math.log(10_000.0) * 2 * half / width)
    return torch.cat([phase.sin(), phase.cos()], dim=-1)


def _agents_that_count(scene: SceneTensors, task: Conditioning) -> Bool[Tensor, "B A"]:
    """All agents but given ones that are further out than in training."""
    is_near = torch.all(scene.agent_pose[..., :2].abs() <= REACH_M, dim=-1)
    return scene.has_agent & (is_near | ~task.is_given)


def _directions(vectors: Float[Tensor, "*b 2"]) -> Float[Tensor, "*b 2"]:
    """Unit vectors, and 0 for 0.

    Unlike ``torch.sgn`` of complex numbers, which rounds the last numbers of a tensor
    differently, the result does not depend on the batch.
    """
    length = vectors.square().sum(dim=-1, keepdim=True).sqrt()
    return vectors / length.clamp_min(1e-12)


def _token_inputs(
    features: Float[Tensor, "B P F"], pose: Float[Tensor, "B P 3"]
) -> Float[Tensor, "B P G"]:
    """Features of map tokens, with their poses in the square."""
    heading = pose[..., 2:]
    position = waves(pose[..., :2], POSITION_WAVELENGTHS_M)
    return torch.cat([features, heading.cos(), heading.sin(), position], dim=-1)


def _attribute_token(width: int) -> nn.Embedding:
    """Embedding of an attribute: 0 if unconditioned, and initially 0 for all values."""
    token = nn.Embedding(NUM_ATTRIBUTE_CODES, width, padding_idx=UNCONDITIONED)
    nn.init.zeros_(token.weight)
    return token


def _mlp(num_inputs: int, width: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(num_inputs, width), nn.ReLU(), nn.Linear(width, width)
    )
