"""Encoded scene and noise levels of the initial-state network, for all steps."""

from dataclasses import dataclass
from typing import NamedTuple

from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.generation.core.attention import KeysValues, Mask
from pd_editor.generation.initial_state.network.features import BoxPairs, NoiseFactors
from pd_editor.generation.initial_state.network.map_tokens import MapTokens


class EncodedMap(NamedTuple):
    """Values that depend on the map tokens of B scenes only."""

    keys_values: tuple[KeysValues, ...]
    """Keys and values of all tokens, by layer."""
    near: MapTokens | None
    """Tokens for the search of those near an agent; None without relations."""


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialStateContext:
    """Values that do not depend on noisy states, for B scenes of A agents."""

    map_keys_values: tuple[KeysValues, ...]
    """Keys and values of all map tokens, by layer."""
    map_tokens: MapTokens | None
    """Map tokens for the search of those near an agent; None without relations."""
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
