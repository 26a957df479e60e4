"""Samples the scenes of each step's batch, as a function of seed and step."""

import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from pd_editor.base.errors import TrainingError

_BATCHES_SORTED_TOGETHER = 16


class BatchSampler:
    """Samples scenes of each of R roots without replacement within an epoch.

    Scenes of similar size share a batch, since a batch is padded to its largest scene:
    the scenes of several batches are sampled, sorted by size, and their batches shuffled.
    There is no state between steps, so that a run can be resumed at any step.
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
        """Make a sampler of batches, in which each root has its share.

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
        """Rows of the scenes of a step's batch."""
        block, index = divmod(step, _BATCHES_SORTED_TOGETHER)
        return self._batches_of_block(block)[index]

    def _batches(self, block: int) -> Int[np.ndarray, "K B"]:
        """Rows of the batches of a block, whose scenes are sorted together."""
        sampled = np.concatenate(
            [
                self._sampled(
                    root,
                    block * _BATCHES_SORTED_TOGETHER * per_batch,
                    _BATCHES_SORTED_TOGETHER * per_batch,
                )
                for root, per_batch in enumerate(self._per_root)
            ]
        )
        random = np.random.default_rng([self._seed, 1, block])
        sampled = sampled[random.permutation(len(sampled))]
        by_size = sampled[np.argsort(self._size[sampled], kind="stable")]
        batches = by_size.reshape(_BATCHES_SORTED_TOGETHER, self._batch_size)
        return batches[random.permutation(_BATCHES_SORTED_TOGETHER)]

    def _sampled(self, root: int, first: int, count: int) -> Int[np.ndarray, "_"]:
        """``count`` rows from position ``first`` of a root's sequence of shuffled epochs."""
        rows, parts = self._rows[root], []
        while count:
            epoch, offset = divmod(first, len(rows))
            random = np.random.default_rng([self._seed, 0, root, epoch])
            part = rows[random.permutation(len(rows))[offset : offset + count]]
            parts.append(part)
            first, count = first + len(part), count - len(part)
        return np.concatenate(parts) if parts else rows[:0]


def _whole_parts(total: int, shares: Sequence[float]) -> list[int]:
    """Divide ``total`` into positive integers nearest to the shares."""
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
