"""Driving along a given path so late that nobody is run into."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.geometry.oriented_box import box_corners, boxes_overlap
from pd_editor.paths.retiming import interpolate_rows
from pd_editor.perturbation.friction_slowdown import ACCELERATION_MPS2

GAP_M: Final = 1.0
"""Room kept ahead and behind."""
PLACE_STEP_M: Final = 0.5
_BRAKING_MPS2: Final = (3.0, 8.0)
"""Deceleration that is tried first, and the hardest one."""
_MAX_CAPS: Final = 12
"""How many others can be waited for in one future."""
_RUN_ON: Final = 6
"""Cells by which a blocked stretch may move on within one step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnPath:
    """The future of one agent over H steps, as a path with a timing."""

    along_m: Float[np.ndarray, "H"]
    """How far it wants to be at each step; the plan is never ahead of this."""
    position_m: Float[np.ndarray, "H 2"]
    heading_rad: Float[np.ndarray, "H"]
    """Without jumps of a whole turn."""
    is_valid: Bool[np.ndarray, "H"]
    size_m: Float[np.ndarray, "2"]
    speed_mps: float
    """Speed at the current step."""
    allowed_mps: Float[np.ndarray, "H"]
    """Highest speed at the place of each step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherBoxes:
    """M others over the same H steps."""

    position_m: Float[np.ndarray, "M H 2"]
    heading_rad: Float[np.ndarray, "M H"]
    is_valid: Bool[np.ndarray, "M H"]
    size_m: Float[np.ndarray, "M 2"]


def blocked_places(path: OwnPath, others: OtherBoxes) -> Bool[np.ndarray, "H N"]:
    """Whether the agent could not be at each place of its path at each step.

    Places are ``PLACE_STEP_M`` apart.
    """
    num_places = int(path.along_m[-1] / PLACE_STEP_M) + 2
    grid = np.arange(num_places) * PLACE_STEP_M
    known = np.concatenate([path.position_m, path.heading_rad[:, None]], axis=1)
    pose = interpolate_rows(grid[None], path.along_m[None], known[None])[0]
    size = path.size_m + np.array([2 * GAP_M, 0.0])
    corners = box_corners(
        pose[:, :2], pose[:, 2], np.repeat(size[None], num_places, axis=0)
    )
    blocked = np.zeros((len(path.along_m), num_places), bool)
    reach = (np.hypot(*size) + np.hypot(*others.size_m.T)) / 2
    gap = others.position_m[:, :, None] - pose[:, :2]
    near = (gap**2).sum(-1) < (reach**2)[:, None, None]
    near &= (others.is_valid & path.is_valid)[..., None]
    other, step, place = np.nonzero(near)
    theirs = box_corners(
        others.position_m[other, step],
        others.heading_rad[other, step],
        others.size_m[other],
    )
    meets = boxes_overlap(corners[place], theirs)
    blocked[step[meets], place[meets]] = True
    return blocked


def waiting_distances(
    path: OwnPath, blocked: Bool[np.ndarray, "H N"], step_s: float
) -> Iterator[tuple[Float[np.ndarray, "H"], Float[np.ndarray, "H"]]]:
    """Timings (distance and speed at each step) to try, gentle braking first.

    Each stays behind what blocks the path ahead of it, as far as braking allows.
    """
    steps = np.arange(len(path.along_m))
    for braking in _BRAKING_MPS2:
        latest = path.along_m.copy()
        distance, speed = path.along_m, None
        last_hit = (-1, -1)
        for _ in range(_MAX_CAPS):
            cells = np.rint(distance / PLACE_STEP_M).astype(int)
            hits = np.flatnonzero(blocked[steps, cells][1:]) + 1
            if len(hits) == 0:
                break
            hit = int(hits[0]), int(cells[hits[0]])
            if hit == last_hit:
                break
            _stay_behind(latest, blocked, *hit)
            distance, speed = _driven(path, latest, braking, step_s)
            last_hit = hit
        if speed is not None:
            yield distance, speed


def _stay_behind(
    latest_m: Float[np.ndarray, "H"],
    blocked: Bool[np.ndarray, "H N"],
    step: int,
    cell: int,
) -> None:
    """Lower the cap to below a blocked stretch for as long as it is there."""
    low = high = cell
    for later in range(step, len(blocked)):
        stretch = np.flatnonzero(blocked[later, low : high + _RUN_ON]) + low
        if len(stretch) == 0:
            return
        free_below = np.flatnonzero(~blocked[later, : stretch[0]])
        low = int(free_below[-1]) + 1 if len(free_below) else 0
        high = int(stretch[-1]) + 1
        latest_m[later] = min(latest_m[later], max(low - 1, 0) * PLACE_STEP_M)


def _driven(
    path: OwnPath,
    latest_m: Float[np.ndarray, "H"],
    braking_mps2: float,
    step_s: float,
) -> tuple[Float[np.ndarray, "H"], Float[np.ndarray, "H"]]:
    """The fastest drive below a cap that can always still stop below it."""
    num_steps = len(latest_m)
    distance, speed = np.zeros(num_steps), np.zeros(num_steps)
    speed[0] = path.speed_mps
    changes = np.linspace(-braking_mps2, ACCELERATION_MPS2, 23) * step_s
    later = np.arange(num_steps) * step_s
    for step in range(num_steps - 1):
        now, here = speed[step], distance[step]
        allowed = np.interp(here, path.along_m, path.allowed_mps)
        new = np.clip(now + changes, 0.0, max(allowed, now + changes[0]))
        place = here + (now + new) / 2 * step_s
        until_stop = np.minimum(
            later[: num_steps - 1 - step], new[:, None] / braking_mps2
        )
        reach = new[:, None] * until_stop - braking_mps2 * until_stop**2 / 2
        can_stop = np.all(place[:, None] + reach <= latest_m[step + 1 :] + 1e-6, axis=1)
        best = int(np.flatnonzero(can_stop)[-1]) if can_stop.any() else 0
        distance[step + 1] = max(min(place[best], path.along_m[step + 1]), here)
        speed[step + 1] = new[best]
    return distance, speed
