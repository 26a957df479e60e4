"""Oriented boxes: values, corners and overlap area."""

from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float

_States = TypeVar("_States", bound="BoxStates")
_CORNER_SIGNS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) / 2


def box_corners(
    center_m: Float[np.ndarray, "*shape 2"],
    heading_rad: Float[np.ndarray, "*shape"],
    size_m: Float[np.ndarray, "*shape 2"],
) -> Float[np.ndarray, "*shape 4 2"]:
    """Corners, counter-clockwise from front left; size is length, width."""
    local = _CORNER_SIGNS * size_m[..., None, :]
    cos, sin = np.cos(heading_rad)[..., None], np.sin(heading_rad)[..., None]
    x = cos * local[..., 0] - sin * local[..., 1]
    y = sin * local[..., 0] + cos * local[..., 1]
    return center_m[..., None, :] + np.stack([x, y], axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """Oriented boxes at one time; one size may be given for all."""

    position_m: Float[np.ndarray, "*s 2"]
    """Centres."""
    heading_rad: Float[np.ndarray, "*s"]
    size_m: Float[np.ndarray, "*#s 2"]
    """Length and width."""

    def __post_init__(self) -> None:
        size = np.broadcast_to(self.size_m, self.position_m.shape)
        object.__setattr__(self, "size_m", size)

    def __getitem__(self, index: Any) -> "Boxes":
        """Some of the boxes, or all with more dimensions."""
        return Boxes(
            position_m=self.position_m[index],
            heading_rad=self.heading_rad[index],
            size_m=self.size_m[index],
        )

    def broadcast_to(self, shape: tuple[int, ...]) -> "Boxes":
        """Repeat boxes to a shape."""
        return Boxes(
            position_m=np.broadcast_to(self.position_m, (*shape, 2)),
            heading_rad=np.broadcast_to(self.heading_rad, shape),
            size_m=np.broadcast_to(self.size_m, (*shape, 2)),
        )

    @property
    def radius_m(self) -> Float[np.ndarray, "*s"]:
        """Circumradius of each box."""
        return np.hypot(self.size_m[..., 0], self.size_m[..., 1]) / 2

    def corners_m(self) -> Float[np.ndarray, "*s 4 2"]:
        """Corners, counter-clockwise from front left."""
        return box_corners(self.position_m, self.heading_rad, self.size_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxStates:
    """Oriented boxes of A agents at T steps."""

    position_m: Float[np.ndarray, "A T 2"]
    heading_rad: Float[np.ndarray, "A T"]
    size_m: Float[np.ndarray, "A 2"]
    """Length and width."""
    is_valid: Bool[np.ndarray, "A T"]
    """Whether the agent exists at a step."""

    @property
    def num_steps(self) -> int:
        """Number of time steps T."""
        return self.is_valid.shape[1]

    @property
    def radius_m(self) -> Float[np.ndarray, "A"]:
        """Circumradius of each box."""
        return np.hypot(self.size_m[:, 0], self.size_m[:, 1]) / 2

    @property
    def boxes(self) -> Boxes:
        """All boxes [A T]."""
        return Boxes(
            position_m=self.position_m,
            heading_rad=self.heading_rad,
            size_m=self.size_m[:, None],
        )

    def at(self, row: Any, step: Any) -> Boxes:
        """Boxes at pairs of a row and a step, or of some rows at one step."""
        return self.boxes[row, step]

    def at_steps(self, steps: Any) -> "BoxStates":
        """The boxes at some steps."""
        return BoxStates(
            position_m=self.position_m[:, steps],
            heading_rad=self.heading_rad[:, steps],
            size_m=self.size_m,
            is_valid=self.is_valid[:, steps],
        )

    def taken(self: _States, rows: Any) -> _States:
        """Select agents by indices, in that order, or by a mask."""
        index = np.asarray(rows)
        index = np.flatnonzero(index) if index.dtype == bool else index.astype(int)
        values: dict[str, Any] = {}
        for one in fields(self):
            value = getattr(self, one.name)
            values[one.name] = (
                value[index]
                if isinstance(value, np.ndarray)
                else tuple(value[row] for row in index)
            )
        return type(self)(**values)

    def joined(self: _States, other: _States) -> _States:
        """Concatenate: these agents, then the other ones."""
        values: dict[str, Any] = {}
        for one in fields(self):
            mine, theirs = getattr(self, one.name), getattr(other, one.name)
            values[one.name] = (
                np.concatenate([mine, theirs])
                if isinstance(mine, np.ndarray)
                else mine + theirs
            )
        return type(self)(**values)


def overlap_area(
    corners_a_m: Float[np.ndarray, "P 4 2"], corners_b_m: Float[np.ndarray, "P 4 2"]
) -> Float[np.ndarray, "P"]:
    """Area in m^2 that pairs of boxes share; corners as ``box_corners`` orders them.

    Seen from box b, box a is clipped at two pairs of parallel lines. Points outside
    are moved onto the line rather than dropped, which encloses the same area.
    """
    corners_a, corners_b = (
        np.ascontiguousarray(one).view(complex)[..., 0]
        for one in (corners_a_m, corners_b_m)
    )
    ahead, left = (corners_b[:, [0, 1]] - corners_b[:, [1, 2]]).T
    length, width = np.abs(ahead), np.abs(left)
    back = (ahead / np.maximum(length, 1e-12)).conj()
    points = (corners_a - corners_b.mean(axis=1, keepdims=True)) * back[:, None]
    x, y = _clipped_to_strip(points.real, points.imag, length / 2)
    y, x = _clipped_to_strip(y, x, width / 2)
    cross = x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)
    return np.maximum(cross.sum(axis=1) / 2, 0.0)


def _clipped_to_strip(
    across: Float[np.ndarray, "P V"],
    along: Float[np.ndarray, "P V"],
    half_width: Float[np.ndarray, "P"],
) -> tuple[Float[np.ndarray, "P W"], Float[np.ndarray, "P W"]]:
    """Rings clipped to |across| <= half width; each edge gives three points."""
    bound = half_width[:, None]
    rise = np.roll(across, -1, axis=1) - across
    step = np.roll(along, -1, axis=1) - along
    flat = np.abs(rise) < 1e-12
    slope = np.where(flat, 0.0, 1.0) / np.where(flat, 1.0, rise)
    low, high = (np.clip((end - across) * slope, 0.0, 1.0) for end in (-bound, bound))
    first, second = np.minimum(low, high), np.maximum(low, high)
    rings = [
        np.stack([ring, ring + first * change, ring + second * change], axis=-1)
        for ring, change in ((across, rise), (along, step))
    ]
    shape = (len(bound), 3 * rise.shape[1])
    across, along = (one.reshape(shape) for one in rings)
    return np.clip(across, -bound, bound), along
