"""Random numbers of each sample, independent of the batch that contains it."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

_GOLDEN_RATIO: Final = (5**0.5 - 1) / 2
_SHIFT_KEY: Final = (1 << 31, 1)
"""Key of the random numbers that all samples share."""


class RandomStreams:
    """One generator for each of S samples of a stage.

    Numbers are generated on the CPU, so that they do not depend on the device. A sample's
    numbers depend on the seed, the stage and its index only, so sample k alone equals
    sample k of a batch.
    """

    def __init__(self, seed: int, stage: str, samples: Sequence[int]) -> None:
        self._seed, self._stage = seed, stage
        self._key = [seed, int.from_bytes(stage.encode(), "little")]
        self._samples = tuple(samples)
        self._generators = [
            _generator([*self._key, sample]) for sample in self._samples
        ]

    @property
    def num_samples(self) -> int:
        """Number S of samples."""
        return len(self._samples)

    def normal(self, *shape: int) -> Float[Tensor, "S ..."]:
        """Standard normal numbers of shape [S, *shape]."""
        return torch.stack(
            [
                torch.randn(shape, generator=each, device="cpu")
                for each in self._generators
            ]
        )

    def spread_normal(self, *shape: int, num_tries: int = 1) -> Float[Tensor, "S ..."]:
        """Low-discrepancy standard normal numbers: each sample fills gaps of the others.

        The first numbers of each row differ most between samples, so that a few samples
        cover the distribution. With several tries, each ``num_tries`` consecutive samples
        are tries of one; first tries are spread first, then second ones.

        Source: Kronecker sequence of the golden ratio, shifted at random (Cranley and
        Patterson, 1976), so that each sample by itself is normal.
        """
        normal = self.normal(*shape)
        shifts = [
            torch.rand(
                shape[:-1],
                generator=_generator([*self._key, *_SHIFT_KEY, attempt]),
                dtype=torch.float64,
                device="cpu",
            )
            for attempt in range(num_tries)
        ]
        for row, sample in zip(normal, self._samples, strict=True):
            place = shifts[sample % num_tries] + sample // num_tries * _GOLDEN_RATIO
            row[..., 0] = torch.special.ndtri(place.frac().clamp(1e-12, 1 - 1e-12))
        return normal

    def drifted(
        self, place: float, *shape: int, num_tries: int = 1
    ) -> Float[Tensor, "S ..."]:
        """``spread_normal`` at place 0, and on the way to independent numbers at 1, 2, ...

        The numbers of each place are standard normal: between two whole places they turn
        from the ones to the others.
        """
        whole, share = int(place // 1), place % 1
        ends = [
            RandomStreams(self._seed, f"{self._stage}{end}", self._samples)
            if end
            else self
            for end in (whole, whole + 1)[: 1 + (share > 0)]
        ]
        numbers = [one.spread_normal(*shape, num_tries=num_tries) for one in ends]
        turn = share * math.pi / 2
        if len(numbers) == 1:
            return numbers[0]
        return math.cos(turn) * numbers[0] + math.sin(turn) * numbers[1]


class SceneStreams(RandomStreams):
    """One generator for each of B scenes, each of which is a sample of its own.

    A scene's numbers depend neither on the padding of the batch nor on the agents that
    were left out of it.
    """

    def __init__(
        self,
        seed: int,
        stage: str,
        samples: Sequence[int],
        rows: Sequence[tuple[int, Int[np.ndarray, "_"]]],
    ) -> None:
        """Make the generators of a stage, one per sample.

        ``rows`` are the number of agents of each whole scene, and which of them it
        keeps.
        """
        super().__init__(seed, stage, samples)
        self._rows = tuple(rows)

    @property
    def num_samples(self) -> int:
        """1: the scenes are the samples."""
        return 1

    def normal(self, *shape: int) -> Float[Tensor, "1 B A ..."]:
        """Standard normal numbers of shape [1, *shape], 0 for padding."""
        table = torch.zeros((1, *shape), device="cpu")
        for scene, (generator, (count, kept)) in enumerate(
            zip(self._generators, self._rows, strict=True)
        ):
            numbers = torch.randn(
                (1, count, *shape[2:]), generator=generator, device="cpu"
            )
            table[0, scene, : len(kept)] = numbers[0, torch.from_numpy(kept)]
        return table


def _generator(key: Sequence[int]) -> torch.Generator:
    state = np.random.SeedSequence(key).generate_state(2)
    generator = torch.Generator("cpu")
    generator.manual_seed(int(state[0]) << 31 ^ int(state[1]))
    return generator
