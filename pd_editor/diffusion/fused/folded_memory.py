"""Keys and values of what agents see, laid out as drawing reads them."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import linear, pad

from pd_editor.diffusion.fused.folded_layers import linear_layers
from pd_editor.diffusion.trajectory.memory_encoder import MemoryEncoder


@dataclass(frozen=True, kw_only=True, eq=False)
class Things:
    """N things around each of G agents."""

    facts: Float[Tensor, "G N F"]
    exists: Bool[Tensor, "G N"]


@dataclass(frozen=True, kw_only=True, eq=False)
class ThingsSeen:
    """What the L blocks see; of 2 H heads H look at lane pieces, H at candidates.

    The first of the M things of each agent is nothing.
    """

    keys: Float[Tensor, "L G H2 D M"]
    values: Float[Tensor, "L G H2 M D"]
    hidden: Float[Tensor, "G H2 1 M"]
    """Added to logits: minus infinity where there is nothing."""


class FoldedMemory:
    """Both memory encoders of a network."""

    def __init__(self, pieces: MemoryEncoder, candidates: MemoryEncoder) -> None:
        """Weights are copied: the encoders may be trained on."""
        self._encoders = (_FoldedEncoder(pieces), _FoldedEncoder(candidates))

    def seen(self, pieces: Things, candidates: Things) -> ThingsSeen:
        """Keys and values for all blocks."""
        both, like = (pieces, candidates), pieces.facts
        most = 1 + max(one.exists.shape[1] for one in both)
        blocks, heads, channels = self._encoders[0].shape
        shape = (blocks, len(like), 2 * heads)
        keys = like.new_empty(*shape, channels, most)
        values = like.new_empty(*shape, most, channels)
        masks: list[Tensor] = []
        for index, things in enumerate(both):
            own = slice(index * heads, (index + 1) * heads)
            number = 1 + things.exists.shape[1]
            of_keys, of_values = self._encoders[index].keys_values(things.facts)
            keys[:, :, own, :, :number].copy_(of_keys)
            values[:, :, own, :number].copy_(of_values)
            # What is not there counts nothing, but must be finite.
            keys[:, :, own, :, number:] = 0.0
            values[:, :, own, number:] = 0.0
            exists = pad(pad(things.exists, (1, 0), value=True), (0, most - number))
            masks.append(minus_infinity_unless(exists, like))
        hidden = torch.stack(masks, dim=1).repeat_interleave(heads, 1)[:, :, None]
        return ThingsSeen(keys=keys, values=values, hidden=hidden)


class _FoldedEncoder:
    """An encoder's weights, in bfloat16 where the processor multiplies it much faster.

    Training rounds alike.
    """

    def __init__(self, encoder: MemoryEncoder) -> None:
        weight = encoder.keys_values.weight
        is_fast = weight.device.type == "cpu" and torch.cpu._is_amx_tile_supported()
        is_single = weight.dtype == torch.float32
        self._dtype = torch.bfloat16 if is_fast and is_single else weight.dtype
        blocks, _, heads, _ = encoder.shape
        self.shape = (blocks, heads, weight.shape[1] // heads)
        self._layers = [
            (self._copied(one.weight), self._copied(one.bias))
            for one in linear_layers(encoder.things)
        ]
        self._nothing = self._copied(encoder.nothing)
        by_block = (blocks, 2, -1)
        self._keys, self._values = (
            (self._copied(weights.flatten(0, 1)), self._copied(biases.flatten()))
            for weights, biases in zip(
                weight.unflatten(0, by_block).unbind(1),
                encoder.keys_values.bias.unflatten(0, by_block).unbind(1),
                strict=True,
            )
        )

    def keys_values(
        self, facts: Float[Tensor, "G N F"]
    ) -> tuple[Float[Tensor, "L G H D M"], Float[Tensor, "L G H M D"]]:
        """Views of the keys and of the values of N things and, before them, nothing."""
        hidden = facts.to(self._dtype)
        for weight, bias in self._layers:
            hidden = linear(hidden, weight, bias).relu_()
        nothing = self._nothing.expand(len(facts), 1, -1)
        hidden = torch.cat([nothing, hidden], dim=1)
        shape = hidden.shape[:2]
        flat = hidden.flatten(0, 1)
        weight, bias = self._keys
        # Turned round in its own precision, it would take twice as long.
        keys = torch.addmm(bias[:, None], weight, flat.t()).to(facts.dtype)
        values = linear(flat, *self._values)
        return (
            keys.view(*self.shape, *shape).permute(0, 3, 1, 2, 4),
            values.view(*shape, *self.shape).permute(2, 0, 3, 1, 4),
        )

    def _copied(self, values: Tensor) -> Tensor:
        return values.to(self._dtype, copy=True, memory_format=torch.contiguous_format)


def minus_infinity_unless(
    exists: Bool[Tensor, "*shape"], like: Tensor
) -> Float[Tensor, "*shape"]:
    """0 where something is, for adding to logits, in the precision of ``like``."""
    return like.new_zeros(exists.shape).masked_fill_(~exists, -torch.inf)
