"""Paths that agents could drive, smooth from their pose, sampled alike."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.geometry.angles import left_of, unit_vector
from pd_editor.geometry.frenet import mitred_normals
from pd_editor.paths.lane_routes import SAMPLE_SPACING_M, SAMPLED_BEHIND_M
from pd_editor.paths.route_choice import RouteChoice

SPACING_M: Final = 1.5
"""Distance between points of a path, along its route."""
LATERAL_ACCELERATION_MPS2: Final = 3.5
"""Lateral acceleration that speed limits in curves allow."""
CURVE_BRAKING_MPS2: Final = 2.0
"""Deceleration with which curves ahead are prepared for."""
_LEAST_LIMIT_MPS: Final = 1.5
_MAX_START_TURN_RAD: Final = np.pi / 3


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivingPaths:
    """P paths of M points each, equally spaced in a parameter close to arc length.

    The parameter counts metres along the route; beyond the last point a path goes
    straight on.
    """

    position_m: Float[np.ndarray, "P M 2"]
    heading_rad: Float[np.ndarray, "P M"]
    """Agent's heading at each point, without jumps of a whole turn."""
    speed_limit_mps: Float[np.ndarray, "P M"]
    """Speed that the curves allow here, and ahead with comfortable braking."""
    metres_per_parameter: Float[np.ndarray, "P M"]
    """Length of the path per metre of parameter, from each point to the next."""

    def position_at(
        self, path: Int[np.ndarray, "K"], parameter_m: Float[np.ndarray, "K H"]
    ) -> Float[np.ndarray, "K H 2"]:
        """Points on paths."""
        index, fraction = self._cell(path, parameter_m)
        both = [
            _between(self.position_m[..., axis], index, fraction) for axis in (0, 1)
        ]
        return np.stack(both, axis=-1)

    def heading_at(
        self, path: Int[np.ndarray, "K"], parameter_m: Float[np.ndarray, "K H"]
    ) -> Float[np.ndarray, "K H"]:
        """Headings on paths, in (-pi, pi]."""
        index, fraction = self._cell(path, parameter_m)
        heading = _between(self.heading_rad, index, np.minimum(fraction, 1.0))
        return heading - 2 * np.pi * np.ceil(heading / (2 * np.pi) - 0.5)

    def _cell(
        self, path: Int[np.ndarray, "K"], parameter_m: Float[np.ndarray, "K H"]
    ) -> tuple[Int[np.ndarray, "K H"], Float[np.ndarray, "K H"]]:
        """Flat index of the point before, and the part of the way to the next."""
        num_points = self.heading_rad.shape[1]
        scaled = parameter_m * (1 / SPACING_M)
        cell = np.minimum(scaled.astype(np.int64), num_points - 2)
        return path[:, None] * num_points + cell, scaled - cell


def _between(
    values: Float[np.ndarray, "P M"],
    index: Int[np.ndarray, "K H"],
    fraction: Float[np.ndarray, "K H"],
) -> Float[np.ndarray, "K H"]:
    flat = values.ravel()
    first = flat.take(index)
    step = flat.take(index + 1)
    step -= first
    step *= fraction
    step += first
    return step


def num_path_points(length_m: float) -> int:
    """Points of a path of a length."""
    return int(np.ceil(length_m / SPACING_M)) + 2


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

    ``route`` picks from the choice. The lateral offset is the quintic of the Path
    Diffuser paper's Frenet candidates, here in arc length, so that an agent that
    stands does not slide sideways; it also takes up the agent's heading.
    """
    agent = choice.agent[route]
    line = _route_points(choice, route, num_points)
    normal = mitred_normals(line)[:, 1:-1]
    line = line[:, 1:-1]
    parameter = np.arange(num_points) * SPACING_M
    speed = speed_mps[agent]
    start_offset = choice.offset_m[route]
    shift = final_offset_m - start_offset
    shift_length = np.maximum(np.maximum(12.0, 3.5 * speed), 9 * np.sqrt(np.abs(shift)))
    turn_length = np.maximum(8.0, 2.5 * speed)
    u = np.minimum(parameter / shift_length[:, None], 1.0)
    blend = u**3 * (10 - 15 * u + 6 * u**2)
    turn = np.clip(choice.turn_rad[route], -_MAX_START_TURN_RAD, _MAX_START_TURN_RAD)
    w = np.minimum(parameter / turn_length[:, None], 1.0)
    swing = (
        w * (1 - w**2 * (6 - 8 * w + 3 * w**2)) * (np.tan(turn) * turn_length)[:, None]
    )
    offset = start_offset[:, None] + shift[:, None] * blend + swing
    points = line + offset[..., None] * normal
    # The foot on the sampled line differs a little from the foot on the lane.
    gap = position_m[agent] - points[:, 0]
    points += (1 - blend)[..., None] * gap[:, None]
    points[:, 0] = position_m[agent]
    return _with_limits(points, heading_rad[agent], heading_rad[agent])


def _route_points(
    choice: RouteChoice, route: Int[np.ndarray, "P"], num_points: int
) -> Float[np.ndarray, "P M+2 2"]:
    """Points of routes from one spacing behind each agent onwards."""
    unique: dict[int, int] = {}
    pool: list[np.ndarray] = []
    slot = np.array(
        [unique.setdefault(id(one), len(unique)) for one in choice.routes], int
    )
    for one in choice.routes:
        if unique[id(one)] == len(pool):
            pool.append(one.samples_m)
    if not pool:
        return np.zeros((0, num_points + 2, 2))
    counts = np.array([len(samples) for samples in pool])
    offset = (np.cumsum(counts) - counts)[slot][route]
    last = counts[slot][route] - 2
    grid = np.arange(-1, num_points + 1) * SPACING_M
    scaled = (choice.along_m[route, None] + grid + SAMPLED_BEHIND_M) / SAMPLE_SPACING_M
    cell = np.clip(scaled.astype(np.int64), 0, last[:, None])
    fraction = (scaled - cell)[..., None]
    samples = np.concatenate(pool)
    index = offset[:, None] + cell
    first = samples.take(index, axis=0)
    return first + fraction * (samples.take(index + 1, axis=0) - first)


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
    points = position_m[:, None] + np.concatenate(
        [np.zeros((len(step), 1, 2)), np.cumsum(step, axis=1)], axis=1
    )
    return _with_limits(points, heading_rad, direction_rad)


def joined_paths(first: DrivingPaths, second: DrivingPaths) -> DrivingPaths:
    """These paths, then the others."""
    return DrivingPaths(
        position_m=np.concatenate([first.position_m, second.position_m]),
        heading_rad=np.concatenate([first.heading_rad, second.heading_rad]),
        speed_limit_mps=np.concatenate([first.speed_limit_mps, second.speed_limit_mps]),
        metres_per_parameter=np.concatenate(
            [first.metres_per_parameter, second.metres_per_parameter]
        ),
    )


def _with_limits(
    points_m: Float[np.ndarray, "P M 2"],
    heading_rad: Float[np.ndarray, "P"],
    direction_rad: Float[np.ndarray, "P"],
) -> DrivingPaths:
    """Headings and speed limits of paths whose agents face and start as given."""
    step = np.diff(points_m, axis=1)
    length = np.sqrt(step[..., 0] ** 2 + step[..., 1] ** 2)
    before = np.concatenate([unit_vector(direction_rad)[:, None], step[:, :-1]], axis=1)
    turn = np.arctan2((left_of(before) * step).sum(-1), (before * step).sum(-1))
    segment = heading_rad[:, None] + np.cumsum(turn, axis=1)
    middle = (segment[:, 1:] + segment[:, :-1]) / 2
    heading = np.concatenate([heading_rad[:, None], middle, segment[:, -1:]], axis=1)
    along = np.concatenate(
        [np.zeros((len(step), 1)), np.cumsum(length, axis=1)], axis=1
    )
    # Over two points to each side, so that kinks where lanes join do not count.
    bend = np.abs(heading[:, 4:] - heading[:, :-4]) / (along[:, 4:] - along[:, :-4])
    bend = np.concatenate(
        [bend[:, :1], bend[:, :1], bend, bend[:, -1:], bend[:, -1:]], 1
    )
    limit = np.maximum(
        LATERAL_ACCELERATION_MPS2 / np.maximum(bend, 1e-6), _LEAST_LIMIT_MPS**2
    )
    ahead = limit + 2 * CURVE_BRAKING_MPS2 * along
    ahead = np.minimum.accumulate(ahead[:, ::-1], axis=1)[:, ::-1]
    return DrivingPaths(
        position_m=points_m,
        heading_rad=heading,
        speed_limit_mps=np.sqrt(ahead - 2 * CURVE_BRAKING_MPS2 * along),
        metres_per_parameter=np.concatenate([length, length[:, -1:]], 1) / SPACING_M,
    )
