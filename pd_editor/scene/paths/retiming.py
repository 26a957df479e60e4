"""Speed profiles along paths, and retiming: moving along the same curve at other speeds."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.geometry.angles import heading_of, unit_vector, wrap_angle
from pd_editor.scene.paths.car_following import BoxesAhead, following_acceleration
from pd_editor.scene.paths.driving_paths import SPACING_M, DrivingPaths
from pd_editor.scene.thresholds import FIRM_ACCELERATION_MPS2, MOVED_M, MOVING_MPS

LEAST_PULL_S: Final = 1.0
"""Shortest time in which a pulled speed swells, and fades."""
_SLOWEST_MPS: Final = 0.1

Motion = tuple[
    Float[np.ndarray, "G H 2"], Float[np.ndarray, "G H"], Float[np.ndarray, "G H 2"]
]


def interpolate_rows(
    x: Float[np.ndarray, "G Q"],
    known_x: Float[np.ndarray, "G H"],
    known_y: Float[np.ndarray, "G H D"],
) -> Float[np.ndarray, "G Q D"]:
    """Linear interpolation with separate knots in each row, clamped to the ends.

    ``known_x`` must not decrease along a row.
    """
    num_rows, num_known = known_x.shape
    if num_known == 1:
        return np.repeat(known_y, x.shape[1], axis=1)
    # Rows are shifted to disjoint intervals, so that one search finds all knots.
    low = min(known_x.min(initial=0.0), x.min(initial=0.0))
    high = max(known_x.max(initial=0.0), x.max(initial=0.0))
    shift = (np.arange(num_rows) * (high - low + 1.0))[:, None]
    after = np.searchsorted((known_x + shift).ravel(), (x + shift).ravel(), "right")
    first = (np.arange(num_rows) * num_known)[:, None]
    after = np.clip(after.reshape(x.shape) - first, 1, num_known - 1) + first
    x0, x1 = known_x.ravel()[after - 1], known_x.ravel()[after]
    span = x1 - x0
    fraction = np.clip((x - x0) / np.where(span > 0, span, 1.0), 0.0, 1.0)[..., None]
    knots = known_y.reshape(-1, known_y.shape[-1])
    y0, y1 = knots[after - 1], knots[after]
    return np.where(fraction == 1.0, y1, y0 + fraction * (y1 - y0))


def fill_gaps(
    values: Float[np.ndarray, "G H D"], is_valid: Bool[np.ndarray, "G H"]
) -> Float[np.ndarray, "G H D"]:
    """Fill invalid steps: interpolated in time, constant before and after."""
    if is_valid.all():
        return values
    steps = np.arange(is_valid.shape[1])
    before = np.maximum.accumulate(np.where(is_valid, steps, -1), axis=1)
    reverse = np.where(is_valid, steps, len(steps))[:, ::-1]
    after = np.minimum.accumulate(reverse, axis=1)[:, ::-1]
    before = np.where(before < 0, np.minimum(after, steps[-1]), before)
    after = np.where(after > steps[-1], before, after)
    rows = np.arange(len(values))[:, None]
    start, end = values[rows, before], values[rows, after]
    fraction = (steps - before) / np.maximum(after - before, 1)
    return start + fraction[..., None] * (end - start)


def fill_heading_gaps(
    heading_rad: Float[np.ndarray, "G H"], is_valid: Bool[np.ndarray, "G H"]
) -> Float[np.ndarray, "G H"]:
    """Unwrapped headings, filled at invalid steps."""
    steps = np.arange(is_valid.shape[1])
    last = np.maximum.accumulate(np.where(is_valid, steps, -1), axis=1)
    last = np.where(last < 0, is_valid.argmax(axis=1)[:, None], last)
    held = np.take_along_axis(heading_rad, last, axis=1)
    return fill_gaps(np.unwrap(held, axis=1)[..., None], is_valid)[..., 0]


def travelled_m(position_m: Float[np.ndarray, "G H 2"]) -> Float[np.ndarray, "G H"]:
    """Distance travelled along each row of positions."""
    step = np.diff(position_m, axis=1)
    length = np.hypot(step[..., 0], step[..., 1])
    return np.concatenate(
        [np.zeros((len(length), 1)), np.cumsum(length, axis=1)], axis=1
    )


def retime(
    position_m: Float[np.ndarray, "G H 2"],
    heading_rad: Float[np.ndarray, "G H"],
    is_valid: Bool[np.ndarray, "G H"],
    distance_m: Float[np.ndarray, "G H"],
    step_s: float,
    speed_mps: Float[np.ndarray, "G H"] | None = None,
) -> Motion:
    """Position, heading and velocity at given distances along each agent's own curve.

    ``distance_m`` counts from the curve's first valid point; beyond its last one the
    agent continues straight. Headings are those of the agent at each point of the
    curve. Without ``speed_mps`` the speed is the rate of ``distance_m``. Rows are zero
    where ``is_valid`` is false.
    """
    curve = fill_gaps(position_m, is_valid)
    heading = fill_heading_gaps(heading_rad, is_valid)
    along = travelled_m(curve)
    known = np.concatenate([curve, heading[..., None]], axis=-1)
    reached = interpolate_rows(distance_m, along, known)
    beyond = np.maximum(distance_m - along[:, -1:], 0.0)
    onward = _direction_at_end(curve, heading, along)
    position = reached[..., :2] + beyond[..., None] * onward[:, None]
    if speed_mps is None:
        speed_mps = rate(distance_m, step_s)
    velocity = speed_mps[..., None] * _tangent(position, reached[..., 2])
    mask = is_valid[..., None]
    return (
        np.where(mask, position, 0.0),
        np.where(is_valid, wrap_angle(reached[..., 2]), 0.0),
        np.where(mask, velocity, 0.0),
    )


def highest_speed(
    along_m: Float[np.ndarray, "G H"],
    limit_mps: Float[np.ndarray, "G H"],
    *,
    braking_mps2: float,
    acceleration_mps2: float,
) -> Float[np.ndarray, "G H"]:
    """Highest speed at each point that keeps all limits by braking and accelerating."""
    squared = limit_mps**2
    braking, gaining = 2 * braking_mps2 * along_m, 2 * acceleration_mps2 * along_m
    ahead = np.minimum.accumulate((squared + braking)[:, ::-1], axis=1)[:, ::-1]
    behind = np.minimum.accumulate(squared - gaining, axis=1)
    return np.sqrt(np.maximum(np.minimum(ahead - braking, behind + gaining), 0.0))


def delays_s(
    along_m: Float[np.ndarray, "G H"],
    speed_mps: Float[np.ndarray, "G H"],
    slowed_mps: Float[np.ndarray, "G H"],
) -> Float[np.ndarray, "G H"]:
    """How much later each point is reached at lowered speeds; times at rest are kept."""

    def middle(values: Float[np.ndarray, "G H"]) -> Float[np.ndarray, "G H-1"]:
        return np.maximum((values[:, 1:] + values[:, :-1]) / 2, _SLOWEST_MPS)

    longer = np.maximum(1 / middle(slowed_mps) - 1 / middle(speed_mps), 0.0)
    delay = np.cumsum(np.diff(along_m, axis=1) * longer, axis=1)
    return np.concatenate([np.zeros((len(delay), 1)), delay], axis=1)


def slowed_distance(
    along_m: Float[np.ndarray, "G H"],
    speed_mps: Float[np.ndarray, "G H"],
    allowed_mps: Float[np.ndarray, "G H"],
    step_s: float,
) -> tuple[Float[np.ndarray, "G H"], Float[np.ndarray, "G H"]]:
    """Distance travelled and speed of each slowed agent at each step.

    Speed is a function of position: where it is lowered, all later points are later.
    """
    slowed = np.minimum(speed_mps, allowed_mps)
    steps = np.broadcast_to(np.arange(along_m.shape[1]) * step_s, along_m.shape)
    time = steps + delays_s(along_m, speed_mps, slowed)
    reached = interpolate_rows(steps, time, np.stack([along_m, slowed], axis=-1))
    return reached[..., 0], reached[..., 1]


def slowed_to_limits(
    position_m: Float[np.ndarray, "G H 2"],
    heading_rad: Float[np.ndarray, "G H"],
    is_valid: Bool[np.ndarray, "G H"],
    limit_mps: Float[np.ndarray, "G H"],
    step_s: float,
    *,
    braking_mps2: float,
    acceleration_mps2: float,
) -> tuple[Motion, Float[np.ndarray, "G H"]]:
    """Motion along each agent's own path that keeps limits of speed at its points.

    Also returns its speeds. Agents brake ahead of a limit and accelerate after it.
    """
    along = travelled_m(fill_gaps(position_m, is_valid))
    allowed = highest_speed(
        along,
        limit_mps,
        braking_mps2=braking_mps2,
        acceleration_mps2=acceleration_mps2,
    )
    speed = np.gradient(along, step_s, axis=1)
    distance, slowed = slowed_distance(along, speed, allowed, step_s)
    return retime(position_m, heading_rad, is_valid, distance, step_s, slowed), slowed


def with_new_speed(
    position_m: Float[np.ndarray, "G H 2"],
    heading_rad: Float[np.ndarray, "G H"],
    velocity_mps: Float[np.ndarray, "G H 2"],
    is_valid: Bool[np.ndarray, "G H"],
    new_speed_mps: Float[np.ndarray, "G"],
    step_s: float,
) -> Motion:
    """Retime trajectories from the current step on for other current speeds.

    All speeds of an agent are scaled by the same factor, up to the larger of its new
    speed and its highest logged speed. A stationary agent continues at the new speed,
    along its curve if it has one, else straight ahead.
    """
    curve = fill_gaps(position_m, is_valid)
    old_speed = np.hypot(velocity_mps[..., 0], velocity_mps[..., 1]) * is_valid
    new_speed = new_speed_mps[:, None]
    stands = old_speed[:, :1] < MOVING_MPS
    factor = new_speed / np.where(stands, 1.0, old_speed[:, :1])
    fastest = np.maximum(new_speed, old_speed.max(axis=1, keepdims=True))
    step_m = np.diff(travelled_m(curve), axis=1)
    cap = np.where(factor > 1, fastest, np.inf)
    scaled = np.minimum(factor * step_m, cap * step_s)
    moved = np.where(stands, new_speed * step_s, scaled)
    speed = np.where(stands, new_speed, np.minimum(factor * old_speed, cap))
    return _moved_on(position_m, heading_rad, is_valid, stands, moved, step_s, speed)


def with_speed_at(
    position_m: Float[np.ndarray, "G H 2"],
    heading_rad: Float[np.ndarray, "G H"],
    velocity_mps: Float[np.ndarray, "G H 2"],
    is_valid: Bool[np.ndarray, "G H"],
    step: int,
    new_speed_mps: float,
    step_s: float,
) -> Motion:
    """Retime trajectories so that the speed at a later step is another one.

    The change swells and fades as a raised cosine, as wide as ``FIRM_ACCELERATION_MPS2``
    asks for, but it begins after the first step, whose state stays. A stationary agent
    moves as in ``with_new_speed``.
    """
    speed = np.hypot(velocity_mps[..., 0], velocity_mps[..., 1]) * is_valid
    stands = speed.max(axis=1, keepdims=True) < MOVING_MPS
    speed = np.where(stands, 0.0, speed)
    change = new_speed_mps - speed[:, [step]]
    width_s = np.pi * np.abs(change) / (2 * FIRM_ACCELERATION_MPS2)
    width = np.maximum(width_s, LEAST_PULL_S) / step_s
    apart = np.arange(speed.shape[1]) - step
    share = np.abs(apart) / np.where(apart < 0, np.minimum(width, step), width)
    pulled = change * (0.5 + 0.5 * np.cos(np.pi * np.minimum(share, 1.0)))
    new_speed = np.maximum(speed + pulled, 0.0)
    step_m = np.diff(travelled_m(fill_gaps(position_m, is_valid)), axis=1)
    before, after = speed[:, 1:] + speed[:, :-1], new_speed[:, 1:] + new_speed[:, :-1]
    moved = np.where(stands, 0.0, step_m) + step_s * (after - before) / 2
    return _moved_on(
        position_m,
        heading_rad,
        is_valid,
        stands,
        np.where(after > 0, np.maximum(moved, 0.0), 0.0),
        step_s,
        new_speed,
    )


def _moved_on(
    position_m: Float[np.ndarray, "G H 2"],
    heading_rad: Float[np.ndarray, "G H"],
    is_valid: Bool[np.ndarray, "G H"],
    stands: Bool[np.ndarray, "G 1"],
    moved_m: Float[np.ndarray, "G S"],
    step_s: float,
    speed_mps: Float[np.ndarray, "G H"],
) -> Motion:
    """Move along the curves by a distance each step; the noise of a standing agent is none."""
    curve = fill_gaps(position_m, is_valid)
    distance = np.concatenate(
        [np.zeros((len(moved_m), 1)), np.cumsum(moved_m, axis=1)], axis=1
    )
    extent = np.linalg.norm(curve - curve[:, :1], axis=-1).max(axis=1)
    jitter = stands[:, 0] & (extent < MOVED_M)
    position_m = np.where(jitter[:, None, None], curve[:, :1], curve)
    heading = fill_heading_gaps(heading_rad, is_valid)
    heading = np.where(jitter[:, None], heading[:, :1], heading)
    return retime(position_m, heading, is_valid, distance, step_s, speed_mps)


def _direction_at_end(
    curve_m: Float[np.ndarray, "G H 2"],
    heading_rad: Float[np.ndarray, "G H"],
    along_m: Float[np.ndarray, "G H"],
) -> Float[np.ndarray, "G 2"]:
    """Direction of each curve's last metre, or the last heading if it is shorter."""
    before = np.maximum(along_m[:, -1:] - MOVED_M, 0.0)
    chord = curve_m[:, -1] - interpolate_rows(before, along_m, curve_m)[:, 0]
    short = np.hypot(chord[:, 0], chord[:, 1]) < MOVED_M / 2
    return unit_vector(np.where(short, heading_rad[:, -1], heading_of(chord)))


def rate(
    values: Float[np.ndarray, "G H *d"], step_s: float
) -> Float[np.ndarray, "G H *d"]:
    """Rate of change along each row; zero if there is only one step."""
    if values.shape[1] < 2:
        return np.zeros_like(values)
    return np.gradient(values, step_s, axis=1)


def _tangent(
    position_m: Float[np.ndarray, "G H 2"], heading_rad: Float[np.ndarray, "G H"]
) -> Float[np.ndarray, "G H 2"]:
    """Unit vectors of motion; of the heading where the agent does not move."""
    change = rate(position_m, 1.0)
    norm = np.hypot(change[..., 0], change[..., 1])[..., None]
    moving = norm > 1e-3
    return np.where(
        moving, change / np.where(moving, norm, 1), unit_vector(heading_rad)
    )


MAX_BRAKING_MPS2: Final = 4.0
RESPONSE_S: Final = 0.8
"""Time constant with which a speed approaches its target."""


def drive(
    paths: DrivingPaths,
    path: Int[np.ndarray, "K"],
    *,
    speed_mps: Float[np.ndarray, "K"],
    target_mps: Float[np.ndarray, "K"],
    most_mps2: Float[np.ndarray, "2 K"],
    num_steps: int,
    step_s: float,
    leaders: BoxesAhead | None = None,
) -> Float[np.ndarray, "K {num_steps}+1"]:
    """Distance travelled along a path at each step, given an initial speed.

    The speed approaches its target with at most the acceleration and braking in
    ``most_mps2``, and brakes for curves with at most ``MAX_BRAKING_MPS2``. Drivers with a leader, which
    keeps its speed, also keep a gap to it (IDM); ``leaders.driver`` indexes K.
    """
    num_points = paths.heading_rad.shape[1]
    limits = paths.speed_limit_mps.ravel()
    base = path * num_points
    speed, place = speed_mps.copy(), np.zeros(len(path))
    reached = np.zeros((num_steps + 1, len(path)))
    scale, response = 1 / SPACING_M, step_s / RESPONSE_S
    most, least = most_mps2[0] * step_s, -most_mps2[1] * step_s
    # First row: change of speed for the target; second row: for the curves.
    wanted = np.stack([target_mps, target_mps])
    lowest = np.stack([least, np.minimum(least, -MAX_BRAKING_MPS2 * step_s)])
    seen, cell = np.empty((2, len(path))), np.empty((2, len(path)), np.int64)
    for step in range(num_steps):
        np.multiply(speed, RESPONSE_S, out=seen[1])
        seen[1] += place
        seen[0] = place
        seen *= scale
        cell[...] = seen
        np.minimum(cell, num_points - 1, out=cell)
        cell += base
        limit = limits.take(cell)
        np.minimum(limit[0], limit[1], out=wanted[1])
        change = wanted - speed
        change *= response
        np.maximum(change, lowest, out=change)
        np.minimum(change[0], most, out=change[0])
        if leaders is not None:
            _keep_gap(change[0], leaders, place, speed, step * step_s, step_s)
        new = np.minimum(change[0], change[1])
        new += speed
        np.maximum(new, 0.0, out=new)
        speed += new
        speed *= step_s / 2
        place += speed
        reached[step + 1] = place
        speed = new
    return np.ascontiguousarray(reached.T)


def _keep_gap(
    change: Float[np.ndarray, "K"],
    leaders: BoxesAhead,
    place_m: Float[np.ndarray, "K"],
    speed_mps: Float[np.ndarray, "K"],
    time_s: float,
    step_s: float,
) -> None:
    """Limit the changes of speed of drivers that follow a leader (IDM), in place."""
    index = leaders.driver
    gap = leaders.gap_m + leaders.speed_mps * time_s - place_m[index]
    allowed = following_acceleration(speed_mps[index], gap, leaders.speed_mps)
    change[index] = np.minimum(change[index], allowed * step_s)
