"""Codec of integer series: differences, zigzag encoding, byte planes.

A smooth series has small differences. Those are mapped to non-negative numbers (0, -1,
1, -2, ... to 0, 1, 2, 3, ...) and written byte plane by byte plane, the lowest first,
so that the higher planes are mostly zeros and compress well.
"""

from typing import Final

import numpy as np
from jaxtyping import Int

MAX_MAGNITUDE: Final = 2**31 - 1
_PLANES: Final = 4
_ORDER: Final = 2
"""How often differences are taken."""


def coded(
    values: Int[np.ndarray, "P"], first_row: Int[np.ndarray, "S_plus_1"]
) -> bytes:
    """Encode series s, the rows from ``first_row[s]`` to before ``first_row[s + 1]``."""
    assert np.abs(values, dtype=np.int64).max(initial=0) < MAX_MAGNITUDE // 4**_ORDER
    numbers = values.astype(np.int64)
    starts = first_row[:-1][np.diff(first_row) > 0]
    for _ in range(_ORDER):
        before = np.concatenate([numbers[:1], numbers[:-1]])
        before[starts] = 0
        numbers = numbers - before
    folded = np.where(numbers < 0, -2 * numbers - 1, 2 * numbers).astype("<u4")
    planes = folded.view(np.uint8).reshape(-1, _PLANES)
    return planes.T.tobytes()


def num_coded_bytes(count: int) -> int:
    """Number of bytes of ``count`` coded numbers."""
    return count * _PLANES


def decoded(
    data: bytes, first_row: Int[np.ndarray, "S_plus_1"]
) -> Int[np.ndarray, "P"]:
    """Decode series; inverse of ``coded``.

    Raises:
        ValueError: the number of bytes is not that of the series.
    """
    count = int(first_row[-1])
    if len(data) != num_coded_bytes(count):
        raise ValueError(f"{len(data)} bytes do not hold {count} numbers")
    planes = np.frombuffer(data, np.uint8).reshape(_PLANES, count)
    folded = np.ascontiguousarray(planes.T).view("<u4")[:, 0].astype(np.int64)
    numbers = np.where(folded & 1, -(folded + 1) // 2, folded // 2)
    lengths = np.diff(first_row)
    for _ in range(_ORDER):
        total = np.cumsum(numbers)
        before = np.concatenate([[0], total])[first_row[:-1]]
        numbers = total - np.repeat(before, lengths)
    return numbers
