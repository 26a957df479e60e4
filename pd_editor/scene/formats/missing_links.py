"""Links of lanes that a file lacks: lanes lead on where they end."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.scene.road_map import Lane

SAME_PLACE_M: Final = 0.6
_SAME_WAY: Final = 0.8
"""Cosine of the largest turn from one lane to the next."""


def meetings(lines: Sequence[Float[np.ndarray, "_ _"]]) -> list[tuple[int, int]]:
    """Rows of lines of which the second begins where the first ends, and goes on the same way."""
    if not lines:
        return []
    begin, end = (np.array([line[row, :2] for line in lines]) for row in (0, -1))
    arrives, leaves = (
        np.array([line[row + 1, :2] - line[row, :2] for line in lines])
        for row in (-2, 0)
    )
    begins: Any = shapely.points(begin)
    ends: Any = shapely.points(end)
    tree = shapely.STRtree(begins)
    places = tree.query(ends, predicate="dwithin", distance=SAME_PLACE_M)
    one, other = places
    ahead = (arrives[one] * leaves[other]).sum(axis=1)
    size = np.hypot(*arrives[one].T) * np.hypot(*leaves[other].T)
    goes_on = ahead > _SAME_WAY * size
    return sorted(map(tuple, places.T[goes_on].tolist()))


def with_missing_links(
    lanes: tuple[Lane, ...], is_missing: Callable[[Lane, Lane], bool] | None = None
) -> tuple[tuple[Lane, ...], list[str]]:
    """Lanes, and a note, with links where both borders meet and the file may lack them.

    Without ``is_missing`` these are all places in files without any link.
    """
    if is_missing is None and any(one.successors or one.predecessors for one in lanes):
        return lanes, []
    after: defaultdict[int, list[int]] = defaultdict(list)
    before: defaultdict[int, list[int]] = defaultdict(list)
    for row, its in meetings([one.centerline for one in lanes]):
        one, other = lanes[row], lanes[its]
        sides = np.array(
            [one.left_m[-1] - other.left_m[0], one.right_m[-1] - other.right_m[0]]
        )
        is_new = one is not other and other.lane_id not in one.successors
        if (
            is_new
            and np.hypot(*sides.T).max() < SAME_PLACE_M
            and (is_missing is None or is_missing(one, other))
        ):
            after[one.lane_id].append(other.lane_id)
            before[other.lane_id].append(one.lane_id)
    if not after:
        return lanes, []
    linked = tuple(
        replace(
            one,
            successors=(*one.successors, *after[one.lane_id]),
            predecessors=(*one.predecessors, *before[one.lane_id]),
        )
        for one in lanes
    )
    number = sum(map(len, after.values()))
    return linked, [f"{number} links that the file lacks were made where lanes meet."]
