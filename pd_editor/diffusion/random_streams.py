"""Random numbers that belong to a sample, whatever batch the sample is drawn in."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor


class RandomStreams:
    """One generator for each of S samples of a stage.

    Numbers are drawn on the CPU: they are the same whatever device computes. A
    sample's numbers depend on the seed, on the stage and on its own index only, so
    sample k alone equals sample k of a batch.
    """

    def __init__(self, seed: int, stage: str, samples: Sequence[int]) -> None:
        stage_key = int.from_bytes(stage.encode(), "little")
        self._generators: list[torch.Generator] = []
        for sample in samples:
            state = np.random.SeedSequence([seed, stage_key, sample]).generate_state(2)
            generator = torch.Generator("cpu")
            generator.manual_seed(int(state[0]) << 31 ^ int(state[1]))
            self._generators.append(generator)

    def normal(self, *shape: int) -> Float[Tensor, "S ..."]:
        """Standard normal numbers of shape [S, *shape]."""
        return torch.stack(
            [
                torch.randn(shape, generator=each, device="cpu")
                for each in self._generators
            ]
        )

    def uniform(self, *shape: int) -> Float[Tensor, "S ..."]:
        """Numbers from 0 to below 1, of shape [S, *shape]."""
        return torch.stack(
            [
                torch.rand(shape, generator=each, device="cpu")
                for each in self._generators
            ]
        )
