"""Which scenes make up each step's batch: a function of the seed and the step."""

import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from pd_editor.errors import TrainingError

_BATCHES_SORTED_TOGETHER = 16


class BatchSampler:
    """Draws scenes without replacement, epoch after epoch, from each of R roots.

    Scenes of like size share a batch, since a batch is padded to its largest scene:
    several batches' worth of scenes are drawn, sorted by size, and their batches
    shuffled. Nothing is remembered between steps, so a run goes on anywhere.
    """

    def __init__(
        self,
        rows_of_root: Sequence[Int[np.ndarray, "_"]],
        size: Int[np.ndarray, "N"],
        *,
        shares: Sequence[float],
        batch_size: int,
        seed: int,
    ) -> None:
        """Args are the scenes of each root, sizes of all N scenes, and the mixture.

        Raises:
            TrainingError: the batch is too small for the number of roots.
        """
        self._rows = [np.asarray(rows) for rows in rows_of_root]
        self._size = size
        self._seed = seed
        self._per_root = _whole_parts(batch_size, shares)
        self._batch_size = batch_size
        self._batches_of_block = functools.lru_cache(maxsize=2)(self._batches)

    def rows(self, step: int) -> Int[np.ndarray, "B"]:
        """The scenes of a step's batch."""
        block, index = divmod(step, _BATCHES_SORTED_TOGETHER)
        return self._batches_of_block(block)[index]

    def _batches(self, block: int) -> Int[np.ndarray, "K B"]:
        """Batches that are sorted together."""
        drawn = np.concatenate(
            [
                self._drawn(
                    root,
                    block * _BATCHES_SORTED_TOGETHER * per_batch,
                    _BATCHES_SORTED_TOGETHER * per_batch,
                )
                for root, per_batch in enumerate(self._per_root)
            ]
        )
        random = np.random.default_rng([self._seed, 1, block])
        drawn = drawn[random.permutation(len(drawn))]
        by_size = drawn[np.argsort(self._size[drawn], kind="stable")]
        batches = by_size.reshape(_BATCHES_SORTED_TOGETHER, self._batch_size)
        return batches[random.permutation(_BATCHES_SORTED_TOGETHER)]

    def _drawn(self, root: int, first: int, count: int) -> Int[np.ndarray, "_"]:
        """Items from ``first`` on of a root's endless row of shuffled epochs."""
        rows, parts = self._rows[root], []
        while count:
            epoch, offset = divmod(first, len(rows))
            random = np.random.default_rng([self._seed, 0, root, epoch])
            part = rows[random.permutation(len(rows))[offset : offset + count]]
            parts.append(part)
            first, count = first + len(part), count - len(part)
        return np.concatenate(parts) if parts else rows[:0]


def _whole_parts(total: int, shares: Sequence[float]) -> list[int]:
    """``total`` in whole parts nearest to the shares, none of them 0."""
    if total < len(shares):
        raise TrainingError(
            f"A batch of {total} scenes cannot hold some of each of {len(shares)} data "
            "roots; expected a larger batch or fewer roots."
        )
    exact = np.asarray(shares, dtype=np.float64) / np.sum(shares) * total
    parts = np.maximum(1, np.floor(exact).astype(np.int64))
    while parts.sum() < total:
        parts[np.argmax(exact - parts)] += 1
    while parts.sum() > total:
        parts[np.argmax(np.where(parts > 1, parts - exact, -np.inf))] -= 1
    return parts.tolist()
