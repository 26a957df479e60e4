"""The initial-state network's encoded scene and noise levels, for all steps."""

from dataclasses import dataclass
from typing import NamedTuple

from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.diffusion.core.attention import KeysValues, Mask
from pd_editor.diffusion.initial_state.features import BoxPairs, NoiseFactors
from pd_editor.diffusion.initial_state.map_tokens import MapTokens


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialStateContext:
    """All that does not depend on noisy states, of B scenes of A agents."""

    map_keys_values: tuple[KeysValues, ...]
    """Of all map tokens, for each layer."""
    map_tokens: MapTokens
    """For looking up those near an agent."""
    agent: Float[Tensor, "B A D"]
    pairs: Float[Tensor, "B 1 A A R"]
    """Share of both agents' sizes in the embedding of each pair."""
    boxes: BoxPairs | None
    """For the gaps between agents."""
    is_visible: Mask
    """Other agents, of shape [B A 1 A]."""
    is_given: Bool[Tensor, "B A"] | None
    """None where no agent is given."""
    given: Float[Tensor, "B A P"]
    """Encoded states of the given agents."""


class EncodedLevel(NamedTuple):
    """All that depends on noise levels only; of agents, or of all of them alike."""

    token: Float[Tensor, "*b D"]
    factor_in: Float[Tensor, "*b P"]
    """Of the noisy states in the network's input."""
    factor_skip: Float[Tensor, "*b P"]
    """Of the noisy states in the result."""
    factor_out: Float[Tensor, "*b P"]
    """Of the network's output in the result."""
    position_fading: Float[Tensor, "*b F"]
    near: NoiseFactors
    """Of relations to map tokens."""
    pairs: NoiseFactors
    """Of relations to other agents."""

    def at(self, index: int) -> "EncodedLevel":
        """One of several levels along the first axis."""
        *plain, near, pairs = self
        return EncodedLevel(
            *(one[index] for one in plain),
            near=NoiseFactors(*(one[index] for one in near)),
            pairs=NoiseFactors(*(one[index] for one in pairs)),
        )
