"""Drivable paths that start smoothly at an agent's pose, equally spaced."""

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.frenet import mitred_normals
from pd_editor.scene.paths.lanes.lane_routes import SAMPLE_SPACING_M, SAMPLED_BEHIND_M
from pd_editor.scene.paths.lanes.route_choice import MAX_TURN_RAD, RouteChoice

SPACING_M: Final = 2.0
"""Distance between points of a path, along its route."""
LATERAL_ACCELERATION_MPS2: Final = 3.5
"""Lateral acceleration at the speed limit of a curve."""
CURVE_BRAKING_MPS2: Final = 2.0
"""Deceleration ahead of curves."""
_LEAST_LIMIT_MPS: Final = 1.5
_GAP_FADES_M: Final = 10.0
_LEAST_POINTS: Final = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivingPaths:
    """P paths of M points each, one every ``SPACING_M`` of arc length.

    Beyond the last point a path goes straight on.
    """

    x_m: Float[np.ndarray, "P M"]
    y_m: Float[np.ndarray, "P M"]
    heading_rad: Float[np.ndarray, "P M"]
    """Unwrapped heading of the agent at each point."""
    speed_limit_mps: Float[np.ndarray, "P M"]
    """Speed limit from the curve here and, with comfortable braking, from those ahead."""

    @property
    def points_m(self) -> Float[np.ndarray, "P M 2"]:
        """Positions of the points."""
        return np.stack([self.x_m, self.y_m], axis=-1)

    def taken(self, path: Int[np.ndarray, "K"]) -> "DrivingPaths":
        """Select paths, in that order."""
        return DrivingPaths(
            **{
                field.name: getattr(self, field.name)[path]
                for field in fields(DrivingPaths)
            }
        )

    def position_at(
        self, path: Int[np.ndarray, "K"], distance_m: Float[np.ndarray, "K H"]
    ) -> Float[np.ndarray, "K H 2"]:
        """Points on paths."""
        return self._points(*self._cell(path, distance_m))

    def pose_at(
        self, path: Int[np.ndarray, "K"], distance_m: Float[np.ndarray, "K H"]
    ) -> tuple[Float[np.ndarray, "K H 2"], Float[np.ndarray, "K H"]]:
        """Points on paths, and headings in (-pi, pi]."""
        index, fraction = self._cell(path, distance_m)
        points = self._points(index, fraction)
        np.minimum(fraction, 1.0, out=fraction)
        heading = _between(self.heading_rad, index, fraction)
        turns = heading * (0.5 / np.pi)
        turns -= 0.5
        np.ceil(turns, out=turns)
        turns *= 2 * np.pi
        heading -= turns
        return points, heading

    def _points(
        self, index: Int[np.ndarray, "K H"], fraction: Float[np.ndarray, "K H"]
    ) -> Float[np.ndarray, "K H 2"]:
        points = np.empty((*index.shape, 2))
        points[..., 0] = _between(self.x_m, index, fraction)
        points[..., 1] = _between(self.y_m, index, fraction)
        return points

    def _cell(
        self, path: Int[np.ndarray, "K"], distance_m: Float[np.ndarray, "K H"]
    ) -> tuple[Int[np.ndarray, "K H"], Float[np.ndarray, "K H"]]:
        """Flat index of the previous point, and the fraction of the way to the next."""
        num_points = self.heading_rad.shape[1]
        fraction = distance_m * (1 / SPACING_M)
        cell = fraction.astype(np.int64)
        np.minimum(cell, num_points - 2, out=cell)
        fraction -= cell
        cell += (path * num_points)[:, None]
        return cell, fraction


def _between(
    values: Float[np.ndarray, "P M"],
    index: Int[np.ndarray, "K H"],
    fraction: Float[np.ndarray, "K H"],
) -> Float[np.ndarray, "K H"]:
    flat = values.ravel()
    first = flat.take(index)
    step = flat[1:].take(index)
    step -= first
    step *= fraction
    step += first
    return step


def num_path_points(length_m: float) -> int:
    """Number of points of a path of a given length."""
    return max(int(np.ceil(length_m / SPACING_M)) + 2, _LEAST_POINTS)


def velocity_of(
    position_m: Float[np.ndarray, "K H 2"],
    first_mps: Float[np.ndarray, "K 2"],
    step_s: float,
) -> Float[np.ndarray, "K H 2"]:
    """Velocities by central differences; the first one is given."""
    velocity = np.empty_like(position_m)
    if position_m.shape[1] > 1:
        np.subtract(position_m[:, 2:], position_m[:, :-2], out=velocity[:, 1:-1])
        velocity[:, 1:-1] *= 1 / (2 * step_s)
        velocity[:, -1] = (position_m[:, -1] - position_m[:, -2]) / step_s
    velocity[:, 0] = first_mps
    return velocity


def paths_along_routes(
    choice: RouteChoice,
    route: Int[np.ndarray, "P"],
    position_m: Float[np.ndarray, "A 2"],
    heading_rad: Float[np.ndarray, "A"],
    speed_mps: Float[np.ndarray, "A"],
    final_offset_m: Float[np.ndarray, "P"],
    num_points: int,
) -> DrivingPaths:
    """Paths from agents' poses to lateral offsets from routes.

    ``route`` holds indices into the choice. The lateral offset is the quintic of the
    Path Diffuser paper's Frenet candidates, here as a function of arc length, so that
    a stationary agent does not slide sideways. It starts with the agent's heading.
    """
    agent = choice.agent[route]
    line = _route_points(choice, route, num_points)
    normal = mitred_normals(line)[:, 1:-1]
    offset = lateral_offsets(
        choice.offset_m[route],
        final_offset_m,
        choice.turn_rad[route],
        speed_mps[agent],
        num_points,
    )
    x = line[:, 1:-1, 0] + offset * normal[..., 0]
    y = line[:, 1:-1, 1] + offset * normal[..., 1]
    # The foot point on the resampled line differs slightly from that on the lane.
    gap = position_m[agent] - np.stack([x[:, 0], y[:, 0]], axis=-1)
    fade = np.maximum(1 - np.arange(num_points) * (SPACING_M / _GAP_FADES_M), 0.0)
    fade = fade**2 * (3 - 2 * fade)
    x += gap[:, :1] * fade
    y += gap[:, 1:] * fade
    x[:, 0], y[:, 0] = position_m[agent].T
    return with_limits(x, y, heading_rad[agent], heading_rad[agent])


def lateral_offsets(
    start_m: Float[np.ndarray, "P"],
    final_m: Float[np.ndarray, "P"],
    turn_rad: Float[np.ndarray, "P"],
    speed_mps: Float[np.ndarray, "P"],
    num_points: int,
) -> Float[np.ndarray, "P M"]:
    """Lateral offset: one quintic for the shift, another one for the initial slope."""
    parameter = np.arange(num_points) * SPACING_M
    shift = final_m - start_m
    shift_length = np.maximum(
        np.maximum(12.0, 3.5 * speed_mps), 9 * np.sqrt(np.abs(shift))
    )
    u = np.minimum(parameter * (1 / shift_length)[:, None], 1.0)
    offset = u * (6 * u - 15)
    offset += 10
    offset *= shift[:, None]
    offset *= u * u * u
    offset += start_m[:, None]
    turn = np.clip(turn_rad, -MAX_TURN_RAD, MAX_TURN_RAD)
    turn_length = np.maximum(8.0, 2.5 * speed_mps)
    w = np.minimum(parameter * (1 / turn_length)[:, None], 1.0)
    swing = w * (8 - 3 * w)
    swing -= 6
    swing *= w * w
    swing += 1
    swing *= w
    swing *= (np.tan(turn) * turn_length)[:, None]
    offset += swing
    return offset


def _route_points(
    choice: RouteChoice, route: Int[np.ndarray, "P"], num_points: int
) -> Float[np.ndarray, "P W 2"]:
    """Points of routes from one spacing behind each agent onwards."""
    points = np.empty((len(route), num_points + 2, 2))
    if not len(route):
        return points
    unique: dict[int, int] = {}
    pool: list[np.ndarray] = []
    slot: list[int] = []
    for one in choice.routes:
        if id(one) not in unique:
            unique[id(one)] = len(pool)
            pool.append(one.samples_m)
        slot.append(unique[id(one)])
    counts = np.array([len(samples) for samples in pool])
    picked = np.array(slot)[route]
    grid = np.arange(-1, num_points + 1) * (SPACING_M / SAMPLE_SPACING_M)
    start = (choice.along_m[route] + SAMPLED_BEHIND_M) / SAMPLE_SPACING_M
    fraction = start[:, None] + grid
    cell = fraction.astype(np.int64)
    np.minimum(cell, (counts[picked] - 2)[:, None], out=cell)
    np.maximum(cell, 0, out=cell)
    fraction -= cell
    cell += (np.cumsum(counts) - counts)[picked][:, None]
    samples = np.concatenate(pool)
    for axis in (0, 1):
        points[..., axis] = _between(samples[None, :, axis], cell, fraction)
    return points


def free_paths(
    position_m: Float[np.ndarray, "P 2"],
    heading_rad: Float[np.ndarray, "P"],
    direction_rad: Float[np.ndarray, "P"],
    curvature_1pm: Float[np.ndarray, "P"],
    num_points: int,
) -> DrivingPaths:
    """Straight lines and arcs that start in a direction.

    Arcs go straight on after half a turn.
    """
    parameter = np.arange(num_points) * SPACING_M
    bend = curvature_1pm[:, None] * (parameter[:-1] + SPACING_M / 2)
    step = SPACING_M * unit_vector(
        direction_rad[:, None] + np.clip(bend, -np.pi, np.pi)
    )
    points = np.cumsum(np.concatenate([position_m[:, None], step], axis=1), axis=1)
    return with_limits(points[..., 0], points[..., 1], heading_rad, direction_rad)


def joined_paths(first: DrivingPaths, second: DrivingPaths) -> DrivingPaths:
    """Concatenate two sets of paths."""
    return DrivingPaths(
        **{
            field.name: np.concatenate(
                [getattr(first, field.name), getattr(second, field.name)]
            )
            for field in fields(DrivingPaths)
        }
    )


def with_limits(
    x_m: Float[np.ndarray, "P M"],
    y_m: Float[np.ndarray, "P M"],
    heading_rad: Float[np.ndarray, "P"],
    direction_rad: Float[np.ndarray, "P"],
) -> DrivingPaths:
    """Add headings and speed limits to paths with given initial headings."""
    x_m, y_m = _evenly_spaced(x_m, y_m)
    dx, dy = np.diff(x_m, axis=1), np.diff(y_m, axis=1)
    before_x = np.concatenate([np.cos(direction_rad)[:, None], dx[:, :-1]], axis=1)
    before_y = np.concatenate([np.sin(direction_rad)[:, None], dy[:, :-1]], axis=1)
    turn = np.arctan2(before_x * dy - before_y * dx, before_x * dx + before_y * dy)
    turn[:, 0] += heading_rad
    segment = np.cumsum(turn, axis=1, out=turn)
    heading = np.empty_like(x_m)
    heading[:, 0], heading[:, -1] = heading_rad, segment[:, -1]
    heading[:, 1:-1] = (segment[:, 1:] + segment[:, :-1]) / 2
    return DrivingPaths(
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading,
        speed_limit_mps=_speed_limits(heading),
    )


def _evenly_spaced(
    x_m: Float[np.ndarray, "P M"], y_m: Float[np.ndarray, "P M"]
) -> tuple[Float[np.ndarray, "P M"], Float[np.ndarray, "P M"]]:
    """Resample lines to ``SPACING_M`` of arc length; the number of points stays."""
    if not len(x_m):
        return x_m, y_m
    dx, dy = np.diff(x_m, axis=1), np.diff(y_m, axis=1)
    length = np.sqrt(dx * dx + dy * dy)
    along = np.zeros_like(x_m)
    np.cumsum(length, axis=1, out=along[:, 1:])
    grid = np.arange(x_m.shape[1]) * SPACING_M
    asked = np.minimum(grid, along[:, -1:])
    excess = (grid - asked) / length[:, -1:]
    # One interpolation for all lines: each gets a separate interval of arc length.
    shift = (np.arange(len(x_m)) * (along[:, -1].max() + 1.0))[:, None]
    asked += shift
    along += shift
    asked, along = asked.ravel(), along.ravel()
    x = np.interp(asked, along, x_m.ravel()).reshape(x_m.shape)
    y = np.interp(asked, along, y_m.ravel()).reshape(y_m.shape)
    x += excess * dx[:, -1:]
    y += excess * dy[:, -1:]
    return x, y


def _speed_limits(
    heading_rad: Float[np.ndarray, "P M"],
) -> Float[np.ndarray, "P M"]:
    # Over two points to each side, so that kinks between lanes have no effect.
    bend = np.abs(heading_rad[:, 4:] - heading_rad[:, :-4])
    np.maximum(bend, 1e-6, out=bend)
    squared = np.empty_like(heading_rad)
    squared[:, 2:-2] = (4 * SPACING_M * LATERAL_ACCELERATION_MPS2) / bend
    squared[:, :2], squared[:, -2:] = squared[:, 2:3], squared[:, -3:-2]
    # Agents do not accelerate before the end of a curve.
    squared[:, 1:] = np.minimum(squared[:, 1:], squared[:, :-1])
    np.maximum(squared, _LEAST_LIMIT_MPS**2, out=squared)
    gained = 2 * CURVE_BRAKING_MPS2 * SPACING_M * np.arange(heading_rad.shape[1])
    squared += gained
    ahead = np.minimum.accumulate(squared[:, ::-1], axis=1)[:, ::-1]
    return np.sqrt(ahead - gained)
