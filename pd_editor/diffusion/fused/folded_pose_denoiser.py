"""The first stage's network made ready for drawing: the same in fewer operations.

At a few agents it is the number of operations that takes the time. What depends on the
scene only is computed before the first step, and what depends on the noise levels too,
unless agents are given: they have no noise.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor, nn

from pd_editor.diffusion.fused.folded_layers import (
    Affine,
    Norm,
    PlaneWaves,
    linear_layers,
)
from pd_editor.diffusion.fused.folded_pieces import FoldedPieces, NearRoad
from pd_editor.diffusion.fused.folded_pose_layer import (
    Around,
    FoldedPoseLayer,
    RoadSeen,
)
from pd_editor.diffusion.fused.folded_relations import FoldedRelations, NoiseFactors
from pd_editor.diffusion.initial_state.conditioning import PoseTask
from pd_editor.diffusion.initial_state.denoiser import PoseContext, PoseDenoiser
from pd_editor.diffusion.initial_state.features import (
    NUM_AGENT_FEATURES,
    PLACE_WAVELENGTHS_M,
    as_complex,
)
from pd_editor.diffusion.initial_state.noise import noise_scale, preconditioning
from pd_editor.diffusion.initial_state.state_encoding import (
    NUM_STATE_PARTS,
    POSITION_UNIT_M,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors

_GIVEN: Final = -1.0
"""The level of agents that are given."""


class FoldedPoseDenoiser:
    """Weights of a denoiser, put together so that a step is few operations."""

    def __init__(self, model: PoseDenoiser) -> None:
        """Drawings that are made keep the weights of now; fold again after training."""
        self.model = model
        with torch.no_grad():
            like = model.state_token.weight
            self.pieces = FoldedPieces(
                model.piece_relation, model.by_pieces, model.config.num_near_pieces
            )
            self.others = FoldedRelations(like, sees_middle=False)
            _, of_pieces = linear_layers(model.piece_relation)
            first, last = linear_layers(model.pair_relation)
            features, facts = first.weight.split(
                [NUM_AGENT_FEATURES, first.in_features - NUM_AGENT_FEATURES], dim=1
            )
            self.other_in = self.others.layer(features)
            self.other_facts = Affine((facts, first.bias), like)
            self.layers = [
                FoldedPoseLayer(layer, of_pieces, last) for layer in model.blocks()
            ]
            self._fold_state(model.state_token)
            self._norm = Norm(model.norm)
            ends = [
                model.to_own_frame,
                model.to_scene_frame,
                model.by_pieces.from_token,
            ]
            self._ends = Affine(
                (
                    torch.cat([one.weight for one in ends]),
                    torch.cat([one.bias for one in ends]),
                ),
                like,
            )

    def _fold_state(self, layer: nn.Linear) -> None:
        """The first layer, for waves in the order in which they come here."""
        like = layer.weight
        self.place_waves = PlaneWaves(PLACE_WAVELENGTHS_M, like)
        waves = [NUM_STATE_PARTS + one for one in self.place_waves.order]
        order = [*range(NUM_STATE_PARTS), *waves]
        self._state_in = Affine((like[:, order], layer.bias), like)

    def drawing(
        self,
        scene: SceneTensors,
        task: PoseTask,
        levels: Sequence[float],
        num_samples: int,
    ) -> "PoseDrawing":
        """Make ready to denoise samples of some scenes at some noise levels."""
        context = self.model.context(scene, task)
        return PoseDrawing(self, context, levels, num_samples)

    def first_tokens(
        self,
        states: Float[Tensor, "B S A 5"],
        position_m: Float[Tensor, "B S A 2"],
        level: "_Level",
    ) -> Float[Tensor, "Z D"]:
        """What noisy states are taken for, by themselves."""
        place = self.place_waves(position_m.flatten(0, 2))
        place = place.view(*states.shape[:-1], -1) * level.place_fading
        given = torch.cat([states * level.factor_in, place], dim=-1)
        return self._state_in(given.flatten(0, 2))

    def found(
        self,
        token: Float[Tensor, "Z D"],
        own: Complex[Tensor, "Z"],
        near: NearRoad,
    ) -> Float[Tensor, "Z 5"]:
        """The network's output: by oneself, in the scene, and by pieces of road."""
        ends = self._ends(self._norm(token))
        by_oneself, speed, in_scene, to_votes = ends.split(
            [4, 1, 4, ends.shape[1] - 9], dim=-1
        )
        pose = as_complex(by_oneself.unflatten(-1, (2, 2))) * own[:, None]
        pose = pose + self.pieces.votes(to_votes, near)
        pose = torch.view_as_real(pose).flatten(1).add_(in_scene)
        return torch.cat([pose, speed], dim=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Level:
    """What depends on the noise level only; agents that are given have their own."""

    token: Float[Tensor, "*b D"]
    factor_in: Float[Tensor, "*b 5"]
    factor_skip: Float[Tensor, "*b 5"]
    factor_out: Float[Tensor, "*b 5"]
    place_fading: Float[Tensor, "*b 20"]
    to_pieces: NoiseFactors
    to_others: NoiseFactors

    @classmethod
    def of(
        cls,
        network: FoldedPoseDenoiser,
        token: Float[Tensor, "*b D"],
        scale: Float[Tensor, "*b 5"],
        noise_m: tuple[Float[Tensor, "*c"], Float[Tensor, "*d"]],
        turn_noise: tuple[Float[Tensor, "*c"], Float[Tensor, "*d"]],
    ) -> "_Level":
        """Of agents with some noise, in what they see of pieces, and of others."""
        factor_in, factor_skip, factor_out = preconditioning(scale)
        place_noise_m = scale[..., 0] * POSITION_UNIT_M
        return cls(
            token=token,
            factor_in=factor_in,
            factor_skip=factor_skip,
            factor_out=factor_out,
            place_fading=network.place_waves.fading(place_noise_m),
            to_pieces=network.pieces.noise_factors(noise_m[0], turn_noise[0]),
            to_others=network.others.noise_factors(noise_m[1], turn_noise[1]),
        )

    def at(self, index: int) -> "_Level":
        """One of several levels."""
        return _Level(
            token=self.token[index],
            factor_in=self.factor_in[index],
            factor_skip=self.factor_skip[index],
            factor_out=self.factor_out[index],
            place_fading=self.place_fading[index],
            to_pieces=NoiseFactors(*(one[index] for one in self.to_pieces)),
            to_others=NoiseFactors(*(one[index] for one in self.to_others)),
        )


class _Levels:
    """The levels of a drawing, one after the other."""

    def __init__(
        self,
        network: FoldedPoseDenoiser,
        levels: Sequence[float],
        is_given: Bool[Tensor, "B A"],
    ) -> None:
        self._network = network
        like = network.place_waves.rate
        level = torch.tensor([*levels, _GIVEN], dtype=like.dtype, device=like.device)
        self._token = network.model.level_tokens(level)
        self._scale = noise_scale(level).to(like)
        self._given = is_given[:, None, :, None] if bool(is_given.any()) else None
        self._of_all = None
        if self._given is None:
            noise_m, turn = self._scale[:, 0] * POSITION_UNIT_M, self._scale[:, 2]
            both = math.sqrt(2)
            self._of_all = _Level.of(
                network,
                self._token,
                self._scale,
                (noise_m, both * noise_m),
                (turn, both * turn),
            )

    def at(self, index: int) -> _Level:
        """Of the agents of all scenes [B 1 A], or of anybody where none is given."""
        if self._given is None:
            assert self._of_all is not None
            return self._of_all.at(index)
        scale = torch.where(self._given, self._scale[-1], self._scale[index])
        noise_m, turn = scale[..., 0] * POSITION_UNIT_M, scale[..., 2]

        def of_both(noise: Float[Tensor, "B 1 A"]) -> Float[Tensor, "B 1 A A"]:
            square = noise.square()
            return (square[..., None] + square[..., None, :]).sqrt()

        return _Level.of(
            self._network,
            torch.where(self._given, self._token[-1], self._token[index]),
            scale,
            (noise_m[..., None], of_both(noise_m)),
            (turn[..., None], of_both(turn)),
        )


class PoseDrawing:
    """Denoises S samples of B scenes, at levels that are known beforehand."""

    def __init__(
        self,
        network: FoldedPoseDenoiser,
        context: PoseContext,
        levels: Sequence[float],
        num_samples: int,
    ) -> None:
        """Given agents come out as they are given."""
        self._network = network
        self._levels = _Levels(network, levels, context.is_given)
        self._given = None
        if bool(context.is_given.any()):
            self._given = context.is_given[:, None, :, None], context.given[:, None]
        is_differential = network.model.config.is_differential
        self._road = [RoadSeen.of(seen, is_differential) for seen in context.map_seen]
        self._agent = context.agent_token[:, None]
        facts = network.other_facts(context.pair_facts.flatten(0, 2))
        self._pairs = facts.view(*context.pair_facts.shape[:3], -1)[:, None]
        added, sees_any = context.is_visible
        self._hidden_others = added.transpose(1, 2).repeat_interleave(num_samples, 0)
        self._sees_others = None
        if sees_any is not None:
            each = sees_any[:, :, 0].repeat_interleave(num_samples, 0)
            self._sees_others = each.flatten(0, 1).to(added)
        self._pieces = network.pieces.of(context, num_samples)

    def denoise(
        self, noisy: Float[Tensor, "S B A 5"], index: int
    ) -> Float[Tensor, "S B A 5"]:
        """Clean states expected of noisy ones at one of the levels."""
        network, level = self._network, self._levels.at(index)
        states = noisy.transpose(0, 1)
        if self._given is not None:
            states = torch.where(*self._given, states)
        position_m = states[..., :2] * POSITION_UNIT_M
        place = as_complex(position_m)
        # A direction of no length, which nobody has, would stay one.
        own = torch.sgn(as_complex(states[..., 2:4]))
        token = network.first_tokens(states, position_m, level)
        token = token.view(*place.shape, -1).add_(self._agent).add_(level.token)
        near = self._pieces.near(position_m, place, own, level.to_pieces)
        around = Around(
            pieces=near.hidden_layer,
            hidden_pieces=near.hidden,
            others=self._others(place, own, level.to_others),
            hidden_others=self._hidden_others,
            sees_pieces=near.sees_any,
            sees_others=self._sees_others,
        )
        for layer, road in zip(network.layers, self._road, strict=True):
            token.add_(level.token)
            token = layer(token.flatten(0, 2), road, around).view(*place.shape, -1)
        found = network.found(token.flatten(0, 2), own.flatten(), near)
        found = found.view(states.shape)
        clean = torch.addcmul(level.factor_skip * states, level.factor_out, found)
        if self._given is not None:
            clean = torch.where(*self._given, clean)
        return clean.transpose(0, 1)

    def _others(
        self,
        place: Complex[Tensor, "B S A"],
        own: Complex[Tensor, "B S A"],
        factors: NoiseFactors,
    ) -> Float[Tensor, "Z A R"]:
        """Hidden layers of relations to all agents."""
        network = self._network
        back = own.conj_physical()[..., None]
        gap = place[..., None, :] - place[..., None]
        features = network.others([gap * back, own[..., None, :] * back], factors)
        found = (features @ network.other_in).view(*gap.shape, -1)
        return found.add_(self._pairs).relu_().flatten(0, 2)
