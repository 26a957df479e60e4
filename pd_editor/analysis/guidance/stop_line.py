"""Where paths cross a stop line, and where the front of an agent is then."""

from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.angles import left_of, unit_vector

LINE_MARGIN_M: Final = 2.0
"""A stop line also counts this far beside its ends."""


def crossing(
    path_m: Float[np.ndarray, "N 2"], line_m: Float[np.ndarray, "2 2"]
) -> tuple[int, float] | None:
    """First crossing: index of the point before it, and the share of the way to the next."""
    side, place, length = _line_frame(path_m, line_m)
    near = (place > -LINE_MARGIN_M) & (place < length + LINE_MARGIN_M)
    crosses = (side[:-1] * side[1:] <= 0) & (near[:-1] | near[1:])
    crosses &= side[:-1] != side[1:]
    if not crosses.any():
        return None
    index = int(crosses.argmax())
    share = side[index] / (side[index] - side[index + 1])
    return index, float(share)


def overrun_m(
    position_m: Float[np.ndarray, "N 2"],
    heading_rad: Float[np.ndarray, "N"],
    size_m: Float[np.ndarray, "2"],
    line_m: Float[np.ndarray, "2 2"],
) -> float:
    """How far an agent's front gets beyond a line, seen from where it starts.

    Negative: the least distance before the line. Beside the line: minus infinity.
    """
    forward = unit_vector(heading_rad)
    left = left_of(forward)
    start, _, _ = _line_frame(position_m[:1], line_m)
    worst = -np.inf
    for sign in (-1.0, 0.0, 1.0):
        corner = position_m + size_m[0] / 2 * forward + sign * size_m[1] / 2 * left
        side, place, length = _line_frame(corner, line_m)
        near = (place > -LINE_MARGIN_M) & (place < length + LINE_MARGIN_M)
        beyond = -side * np.sign(start[0])
        worst = max(worst, float(beyond[near].max(initial=-np.inf)))
    return worst


def _line_frame(
    points_m: Float[np.ndarray, "N 2"], line_m: Float[np.ndarray, "2 2"]
) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N"], float]:
    """Signed distance to a line, place along it, and its length."""
    across = line_m[1] - line_m[0]
    length = float(np.hypot(*across))
    across = across / length
    gap = points_m - line_m[0]
    return gap @ left_of(across), gap @ across, length
