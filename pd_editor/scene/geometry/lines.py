"""Many polylines in one array, for work in one pass."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int


def numbered(
    count: Int[np.ndarray, "L"],
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"]]:
    """Owner of each of N things, of which each owner has some, and its number there."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - (np.cumsum(count) - count)[owner]


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines:
    """L polylines of P points in all, one after another; distances are in the plane."""

    points_m: Float[np.ndarray, "P D"]
    count: Int[np.ndarray, "L"]
    """Number of points of each, at least one."""

    @classmethod
    def of(cls, lines: Sequence[Float[np.ndarray, "_ D"]]) -> "Lines":
        """Put lines together."""
        return cls(
            points_m=np.concatenate(lines) if lines else np.zeros((0, 2)),
            count=np.array([len(line) for line in lines], int),
        )

    @cached_property
    def line(self) -> Int[np.ndarray, "P"]:
        """Line of each point."""
        return numbered(self.count)[0]

    @cached_property
    def ends(self) -> Int[np.ndarray, "2 L"]:
        """Index of the first and of the last point of each line."""
        end = np.cumsum(self.count)
        return np.stack([end - self.count, end - 1])

    @cached_property
    def _step_m(self) -> Float[np.ndarray, "S"]:
        # Between the end of a line and the next one 1 m, so that no place is on both.
        step = np.linalg.norm(np.diff(self.points_m[:, :2], axis=0), axis=-1)
        return np.where(np.diff(self.line), 1.0, step)

    @cached_property
    def _along_m(self) -> Float[np.ndarray, "P"]:
        return np.append(0.0, np.cumsum(self._step_m))[: len(self.points_m)]

    @property
    def length_m(self) -> Float[np.ndarray, "L"]:
        """Length of each line."""
        return np.ptp(self._along_m[self.ends], axis=0)

    def apart(self) -> list[Float[np.ndarray, "_ D"]]:
        """The lines one by one."""
        end = np.cumsum(self.count)
        return [self.points_m[a:b] for a, b in zip(end - self.count, end, strict=True)]

    def taken(self, which: Bool[np.ndarray, "L"]) -> "Lines":
        """Some of the lines."""
        return Lines(points_m=self.points_m[which[self.line]], count=self.count[which])

    def without_repeats(self, tolerance_m: float = 1e-6) -> "Lines":
        """Remove points that repeat the previous one of their line."""
        keep = np.append(True, self._step_m > tolerance_m)[: len(self.points_m)]
        count = np.bincount(self.line[keep], minlength=len(self.count))
        return Lines(points_m=self.points_m[keep], count=count)

    def densified(self, max_spacing_m: float) -> "Lines":
        """Add points so that neighbours are at most ``max_spacing_m`` apart.

        All given points are kept exactly; further coordinates are interpolated.
        """
        pieces = np.ones(len(self.points_m), int)
        within = np.where(np.diff(self.line), 0.0, self._step_m)
        pieces[:-1] = np.maximum(np.ceil(within / max_spacing_m), 1)
        segment, index = numbered(pieces)
        start = self.points_m[segment]
        after = self.points_m[np.minimum(segment + 1, len(pieces) - 1)]
        fraction = (index / pieces[segment])[:, None]
        return Lines(
            points_m=start + fraction * (after - start),
            count=np.bincount(self.line[segment], minlength=len(self.count)),
        )

    def at(
        self, line: Int[np.ndarray, "N"], distance_m: Float[np.ndarray, "N"]
    ) -> Float[np.ndarray, "N 2"]:
        """Points at distances along some lines; clamped to the ends of each."""
        if not len(line):
            return np.zeros((0, 2))
        low, high = self._along_m[self.ends[:, line]]
        place = np.clip(low + distance_m, low, high)
        x, y = (np.interp(place, self._along_m, one) for one in self.points_m.T[:2])
        return np.stack([x, y], axis=-1)

    def offset(self, distance_m: float) -> "Lines":
        """Offset all lines to their left: see ``offset_line``."""
        direction = np.diff(self.points_m, axis=0)
        norm = np.linalg.norm(direction, axis=-1, keepdims=True)
        direction = direction / np.maximum(norm, 1e-12)
        normal = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
        before, after = (np.pad(normal, (one, (0, 0))) for one in ((1, 0), (0, 1)))
        first, last = self.ends
        before[first], after[last] = after[first], before[last]
        middle = before + after
        scale = np.sum(middle * middle, axis=-1, keepdims=True) / 2
        moved = self.points_m + distance_m * middle / np.maximum(scale, 0.5)
        return Lines(points_m=moved, count=self.count)
