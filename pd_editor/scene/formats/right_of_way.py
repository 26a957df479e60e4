"""Right of way of lanes that cross or merge in a junction."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.scene.geometry.angles import heading_of, wrap_angle

_TURNS_RAD: Final = np.deg2rad(30.0)
_TURNS_BACK_RAD: Final = np.deg2rad(150.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """Way through a junction from one lane to another."""

    lanes: tuple[int, ...]
    """The two, and if they do not meet the lane between them."""
    line_m: Float[np.ndarray, "N 2"]
    """Of the lane through the junction, else of the one before."""
    num_lanes: int
    """Of the road that it comes from."""

    @property
    def inside(self) -> tuple[int, ...]:
        """The lane within the junction, if there is one."""
        return self.lanes[1:-1]

    @cached_property
    def headings_rad(self) -> Float[np.ndarray, "2"]:
        """Heading of the line's first and last piece."""
        return heading_of(np.diff(self.line_m, axis=0)[[0, -1]])

    @cached_property
    def turn_rad(self) -> float:
        """By how much the line turns in all, to the left."""
        return float(wrap_angle(np.diff(self.headings_rad))[0])

    @cached_property
    def direction(self) -> str:
        """SUMO's letter: straight, right, left or turning back."""
        if abs(self.turn_rad) < _TURNS_RAD:
            return "s"
        if abs(self.turn_rad) > _TURNS_BACK_RAD:
            return "t"
        return "l" if self.turn_rad > 0 else "r"

    def waits_for(self, other: "Way") -> bool:
        """Whether it waits where the two meet.

        Straight on goes before turns to the right, these before turns to the left. Of
        ways that turn alike and merge the straighter one goes first; of those that cross
        the one of the road with more lanes, else the one from the right.
        """
        if self.takes_turns_with(other):
            return True
        rank, its = ("srlt".index(one.direction) for one in (self, other))
        if rank != its:
            return rank > its
        if self.lanes[-1] == other.lanes[-1]:
            mine, its_own = ((abs(one.turn_rad), one.lanes) for one in (self, other))
            return mine > its_own
        if self.num_lanes != other.num_lanes:
            return self.num_lanes < other.num_lanes
        side = np.sin(other.headings_rad[0] - self.headings_rad[0])
        return bool(side > 0 or (side == 0 and self.lanes > other.lanes))

    def takes_turns_with(self, other: "Way") -> bool:
        """Whether both merge without lanes of the junction, so that no road is first."""
        return not self.inside and not other.inside

    def is_equal_to(self, other: "Way") -> bool:
        """Whether the one from the right goes first."""
        return (
            self.direction == other.direction
            and self.lanes[-1] != other.lanes[-1]
            and self.num_lanes == other.num_lanes
        )


def meetings(ways: Sequence[Way]) -> Bool[np.ndarray, "W W"]:
    """Which ways meet: they end in the same lane, or both lead through and cross.

    Ways from the same lane follow each other, and do not meet.
    """
    start, end = (np.array([one.lanes[k] for one in ways]) for k in (0, -1))
    lines = np.array([shapely.LineString(one.line_m) for one in ways], object)
    found = end[:, None] == end
    inside = np.flatnonzero([bool(one.inside) for one in ways])
    one, other = shapely.STRtree(lines[inside]).query(lines[inside], "intersects")
    found[inside[one], inside[other]] = True
    return found & (start[:, None] != start)
