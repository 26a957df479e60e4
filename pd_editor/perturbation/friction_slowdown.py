"""Slowing agents to the friction limit of the curves that they drive."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.geometry.angles import left_of, unit_vector
from pd_editor.paths.retiming import (
    fill_gaps,
    fill_heading_gaps,
    interpolate_rows,
    retime,
    travelled_m,
)
from pd_editor.perturbation.friction_limit import friction_limited_speed
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.road_warp import RoadWarp
from pd_editor.scene.time_axis import TimeAxis

BRAKING_MPS2: Final = 3.0
"""Deceleration ahead of a bend: firm, but what drivers choose when they see it."""
ACCELERATION_MPS2: Final = 2.5
"""Acceleration back to the logged speed after a bend."""
CHORD_M: Final = 4.0
"""Half the length over which the curvature of a logged path is measured.

Tracks jitter by centimetres; shorter chords would turn that into bends.
"""
_NODES_PER_STEP: Final = 4
_TOLERANCE: Final = 1.01
"""Ratio of speed to limit up to which an agent is left alone."""
_SLOWEST_MPS: Final = 0.1


@dataclass(frozen=True, kw_only=True)
class _Nodes:
    """Places along each track, several per time step; G agents, K nodes."""

    time_s: Float[np.ndarray, "K"]
    original_m: Float[np.ndarray, "G K 2"]
    heading_rad: Float[np.ndarray, "G K"]
    along_m: Float[np.ndarray, "G K"]
    """Distance along the warped track."""
    speed_mps: Float[np.ndarray, "G K"]
    """Rate of that distance."""
    exists: Bool[np.ndarray, "G K"]


def slowed_to_friction_limit(
    original: AgentTracks,
    warped: AgentTracks,
    warp: RoadWarp,
    friction_coefficient: float,
    time_axis: TimeAxis,
) -> AgentTracks:
    """Warped agents, those too fast for the warp re-timed along their own curves.

    An agent brakes ahead of a bend and picks up its logged speed after it. Its pose
    at the current step stays; if it could not brake in time from there, its current
    speed is lowered too and its past is re-timed backwards from the current pose,
    just as far back as the braking needs. Standing times are kept.
    """
    follows = original.kind_mask(LANE_FOLLOWER_KINDS) & original.is_valid.any(axis=1)
    ahead = original.is_valid & (
        warp.distance_ahead(original.position_m) > warp.border_m()
    )
    rows = np.flatnonzero(follows & ahead.any(axis=1))
    if len(rows) == 0:
        return warped
    nodes = _nodes(original, warped, rows, time_axis)
    curvature = path_curvature(nodes.original_m, nodes.heading_rad, warp)
    bends = nodes.exists & (warp.distance_ahead(nodes.original_m) > warp.border_m())
    limit = friction_limited_speed(np.where(bends, curvature, 0), friction_coefficient)
    too_fast = (bends & (nodes.speed_mps > _TOLERANCE * limit)).any(axis=1)
    if not too_fast.any():
        return warped
    rows = rows[too_fast]
    distance = _slowed_distance(
        nodes.time_s,
        nodes.along_m[too_fast],
        nodes.speed_mps[too_fast],
        limit[too_fast],
        _anchor_step(original.is_valid[rows], time_axis.current_step),
    )
    position, heading, velocity = retime(
        warped.position_m[rows],
        warped.heading_rad[rows],
        warped.is_valid[rows],
        distance,
        time_axis.step_s,
    )
    return warped.with_rows(
        rows, position_m=position, heading_rad=heading, velocity_mps=velocity
    )


def path_curvature(
    path_m: Float[np.ndarray, "G K 2"],
    heading_rad: Float[np.ndarray, "G K"],
    warp: RoadWarp,
) -> Float[np.ndarray, "G K"]:
    """Signed curvature, 1/m, of paths after a warp, at points of them before it.

    With t the unit tangent in the anchor's frame and k the curvature before, the
    warped path has curvature (k + f'' tx^3) / |J t|^3: only k is measured (over
    chords), the warp's own share is exact.
    """
    along = travelled_m(path_m)
    middle = np.minimum(np.maximum(along, CHORD_M), along[:, -1:] - CHORD_M)
    back, here, on = (
        interpolate_rows(np.maximum(middle + offset, 0.0), along, path_m)
        for offset in (-CHORD_M, 0.0, CHORD_M)
    )
    first, second, chord = here - back, on - here, on - back
    sides = np.linalg.norm(np.stack([first, second, chord]), axis=-1)
    cross = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    is_path = (sides.min(axis=0) > CHORD_M / 2) & (along[:, -1:] > 2 * CHORD_M)
    before = np.where(is_path, 2 * cross / np.where(is_path, sides.prod(axis=0), 1), 0)

    tangent = unit_vector(heading_rad)
    forward = warp.anchor.turn(np.array([1.0, 0.0]))
    ahead, aside = tangent @ forward, tangent @ left_of(forward)
    x = warp.distance_ahead(path_m)
    stretch = np.hypot(ahead, aside + warp.derivative(x, 1) * ahead)
    return (before + warp.derivative(x, 2) * ahead**3) / stretch**3


def _nodes(
    original: AgentTracks, warped: AgentTracks, rows: np.ndarray, time_axis: TimeAxis
) -> _Nodes:
    """Tracks sampled finely enough for the bends of a warp."""
    is_valid = original.is_valid[rows]
    last = time_axis.num_steps - 1
    step = np.linspace(0, last, _NODES_PER_STEP * last + 1)
    before = np.floor(step).astype(int)
    after = np.minimum(before + 1, last)
    share = (step - before)[:, None]

    def sampled(values: Float[np.ndarray, "G T D"]) -> Float[np.ndarray, "G K D"]:
        return values[:, before] + share * (values[:, after] - values[:, before])

    along = travelled_m(fill_gaps(warped.position_m[rows], is_valid))
    speed = np.gradient(along, time_axis.step_s, axis=1)
    heading = fill_heading_gaps(original.heading_rad[rows], is_valid)
    return _Nodes(
        time_s=(step - time_axis.current_step) * time_axis.step_s,
        original_m=sampled(fill_gaps(original.position_m[rows], is_valid)),
        heading_rad=sampled(heading[..., None])[..., 0],
        along_m=sampled(along[..., None])[..., 0],
        speed_mps=sampled(speed[..., None])[..., 0],
        exists=is_valid[:, before] & is_valid[:, after],
    )


def _anchor_step(
    is_valid: Bool[np.ndarray, "G T"], current_step: int
) -> Float[np.ndarray, "G"]:
    """The step whose pose stays: the current one, or the nearest in the track."""
    last = is_valid.shape[1] - 1 - is_valid[:, ::-1].argmax(axis=1)
    return np.clip(current_step, is_valid.argmax(axis=1), last).astype(float)


def _slowed_distance(
    time_s: Float[np.ndarray, "K"],
    along_m: Float[np.ndarray, "G K"],
    speed_mps: Float[np.ndarray, "G K"],
    limit_mps: Float[np.ndarray, "G K"],
    anchor_step: Float[np.ndarray, "G"],
) -> Float[np.ndarray, "G T"]:
    """Distance along each curve at each time step, under a limit of its speed.

    Speed is seen as a function of place. Where it is lowered, driving takes longer;
    those delays, summed, move everything after later, and everything before earlier.
    """
    squared = np.minimum(speed_mps, limit_mps) ** 2
    braking = 2 * BRAKING_MPS2 * along_m
    ahead = np.minimum.accumulate((squared + braking)[:, ::-1], axis=1)[:, ::-1]
    gaining = 2 * ACCELERATION_MPS2 * along_m
    behind = np.minimum.accumulate(squared - gaining, axis=1)
    allowed = np.sqrt(np.maximum(np.minimum(ahead - braking, behind + gaining), 0.0))
    allowed = np.maximum(allowed, np.minimum(speed_mps, _SLOWEST_MPS))

    step_m = np.diff(along_m, axis=1)
    old = np.maximum(speed_mps[:, 1:] + speed_mps[:, :-1], 2 * _SLOWEST_MPS) / 2
    new = np.maximum(allowed[:, 1:] + allowed[:, :-1], 2 * _SLOWEST_MPS) / 2
    delay = np.cumsum(step_m * np.maximum(1 / new - 1 / old, 0.0), axis=1)
    delay = np.concatenate([np.zeros((len(delay), 1)), delay], axis=1)
    anchor = (anchor_step * _NODES_PER_STEP).astype(int)[:, None]
    delay = delay - np.take_along_axis(delay, anchor, axis=1)
    steps_s = np.repeat(time_s[None, ::_NODES_PER_STEP], len(along_m), axis=0)
    return interpolate_rows(steps_s, time_s + delay, along_m[..., None])[..., 0]
