"""Centre lines with widths, and lane boundaries."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.scene.geometry.polyline import arc_length, without_repeats

SPACING_M: Final = 2.0
"""Largest distance between points, as in Argoverse 2 maps."""
_REPEAT_M: Final = 5e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class WideLine:
    """Line of N points with width and left unit normal at each point."""

    points_m: Float[np.ndarray, "N 2"]
    width_m: Float[np.ndarray, "N"]
    normal: Float[np.ndarray, "N 2"]


def wide_line(
    points_m: Float[np.ndarray, "N 2"], width_m: Float[np.ndarray, "N"]
) -> WideLine:
    """Make a line with its own normals, without repeated points."""
    return wide_lines([points_m], [width_m])[0]


def wide_lines(
    points_m: Sequence[Float[np.ndarray, "_ 2"]],
    width_m: Sequence[Float[np.ndarray, "_"]],
) -> list[WideLine]:
    """Make lines with their own normals, without repeated points: thousands at once."""
    if not points_m:
        return []
    points, width = np.concatenate(points_m), np.concatenate(width_m)
    of_line = np.repeat(np.arange(len(points_m)), [len(one) for one in points_m])
    moves = np.hypot(*np.diff(points, axis=0).T) > _REPEAT_M
    keep = np.append(True, moves | (np.diff(of_line) > 0))
    points, width, of_line = points[keep], width[keep], of_line[keep]
    step = np.diff(points, axis=0) * (np.diff(of_line) == 0)[:, None]
    step /= np.maximum(np.hypot(*step.T), 1e-9)[:, None]
    none = np.zeros((1, 2))
    middle = np.concatenate([none, step]) + np.concatenate([step, none])
    middle /= np.maximum(np.hypot(*middle.T), 1e-9)[:, None]
    normal = np.stack([-middle[:, 1], middle[:, 0]], axis=-1)
    starts = np.flatnonzero(np.diff(of_line)) + 1
    columns = (np.split(one, starts) for one in (points, width, normal))
    return [
        WideLine(points_m=line, width_m=wide, normal=own)
        for line, wide, own in zip(*columns, strict=True)
    ]


def borders_m(
    lines: Sequence[WideLine],
) -> list[tuple[Float[np.ndarray, "_ 2"], Float[np.ndarray, "_ 2"]]]:
    """Left and right boundaries of lines, of which all that go on are made at once."""
    sides = [_all_forward_only(lines, side) for side in (0.5, -0.5)]
    return list(zip(*sides, strict=True))


def with_end_normals(
    line: WideLine,
    first: Float[np.ndarray, "2"] | None,
    last: Float[np.ndarray, "2"] | None,
) -> WideLine:
    """Set the normals at a line's ends, so that boundaries meet there."""
    normal = line.normal.copy()
    if first is not None:
        normal[0] = first
    if last is not None:
        normal[-1] = last
    return WideLine(points_m=line.points_m, width_m=line.width_m, normal=normal)


def pieces(line: WideLine, cuts_m: list[float]) -> list[WideLine]:
    """Split a line at distances along it, and resample each piece evenly."""
    along = arc_length(line.points_m)
    bounds = [0.0, *cuts_m, float(along[-1])]
    result = []
    for start, end in pairwise(bounds):
        count = max(int(np.ceil((end - start) / SPACING_M)) + 1, 2)
        at = np.linspace(start, end, count)
        columns = np.column_stack([line.points_m, line.normal, line.width_m])
        x, y, nx, ny, width = (np.interp(at, along, column) for column in columns.T)
        normal = np.stack([nx, ny], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        result.append(
            WideLine(points_m=np.stack([x, y], axis=-1), width_m=width, normal=normal)
        )
    return result


def _all_forward_only(
    lines: Sequence[WideLine], side: float
) -> list[Float[np.ndarray, "_ 2"]]:
    if not lines:
        return []
    points, width, normal = (
        np.concatenate([getattr(one, name) for one in lines])
        for name in ("points_m", "width_m", "normal")
    )
    of_line = np.repeat(np.arange(len(lines)), [len(one.width_m) for one in lines])
    points = points + side * width[:, None] * normal
    step = np.diff(points, axis=0)
    ahead = np.stack([normal[:, 1], -normal[:, 0]], axis=-1)
    ahead = (step * (ahead[:-1] + ahead[1:])).sum(axis=-1) > 0.0
    odd = ~ahead & (np.diff(of_line) == 0)
    odd |= (np.hypot(*step.T) <= 2 * _REPEAT_M) & (np.diff(of_line) == 0)
    found = np.split(points, np.flatnonzero(np.diff(of_line)) + 1)
    for row in np.unique(of_line[:-1][odd]).tolist():
        found[row] = _forward_only(lines[row], side)
    return found


def _forward_only(line: WideLine, side: float) -> Float[np.ndarray, "M 2"]:
    """Boundary without the loops on the inner side of tight curves."""
    points = line.points_m + side * line.width_m[:, None] * line.normal
    forward = np.stack([line.normal[:, 1], -line.normal[:, 0]], axis=-1)
    keep = np.arange(len(points))
    while len(keep) > 2:
        backward = _goes_back(points[keep], forward[keep])
        if not backward.any():
            break
        keep = keep[~backward]
    return without_repeats(points[keep]) if len(keep) > 2 else points[[0, -1]]


def _goes_back(
    points: Float[np.ndarray, "N 2"], forward: Float[np.ndarray, "N 2"]
) -> Bool[np.ndarray, "N"]:
    """Which points are reached against the direction of travel, except the ends."""
    step = np.diff(points, axis=0)
    against = np.sum(step * (forward[:-1] + forward[1:]), axis=-1) <= 0.0
    dropped = np.zeros(len(points), bool)
    dropped[1:] = against
    dropped[:-1] |= against
    dropped[[0, -1]] = False
    return dropped
