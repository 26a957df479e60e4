"""Friction limit of speed in curves, to which agents are slowed (Scene-Attack, CVPR 2022)."""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import left_of, unit_vector, wrap_angle
from pd_editor.scene.paths.retiming import (
    delays_s,
    fill_gaps,
    fill_heading_gaps,
    highest_speed,
    interpolate_rows,
    rate,
    travelled_m,
)
from pd_editor.scene.road_warp import BEND_LENGTH_M, RoadWarp, WarpTerm, warped_agents
from pd_editor.scene.scenario import AppliedWarp
from pd_editor.scene.thresholds import FIRM_ACCELERATION_MPS2
from pd_editor.scene.time_axis import TimeAxis

GRAVITY_MPS2: Final = 9.81
DRY_ROAD_FRICTION: Final = 0.7
"""Friction coefficient mu that Scene-Attack assumes."""
SAMPLE_SPACING_M: Final = 0.05


@dataclass(frozen=True, kw_only=True)
class WarpSummary:
    """Effect of a warp on a road that is straight ahead of its anchor."""

    max_curvature_per_m: float
    min_radius_m: float
    """Smallest radius of curvature; infinite if the road stays straight."""
    speed_limit_mps: float
    """Highest speed within the friction limit; infinite on a straight road."""


def friction_limited_speed(
    curvature_per_m: Float[np.ndarray, "*s"], friction_coefficient: float
) -> Float[np.ndarray, "*s"]:
    """Highest speed, m/s, within the friction limit of a curvature; infinite if straight."""
    bend = np.abs(curvature_per_m)
    with np.errstate(divide="ignore", over="ignore"):
        return np.sqrt(friction_coefficient * GRAVITY_MPS2 / bend)


def _edges_m(term: WarpTerm) -> tuple[float, ...]:
    """Distances ahead of the anchor where a term's second derivative may jump."""
    end = term.border_m + term.length_m
    if term.kind == "double-turn":
        return (term.border_m, term.border_m + BEND_LENGTH_M, end, end + BEND_LENGTH_M)
    return (term.border_m, end)


def summarise(
    warp: RoadWarp, friction_coefficient: float = DRY_ROAD_FRICTION
) -> WarpSummary:
    """Sharpest bend and speed limit of a straight road under a warp."""
    end = warp.extent_m()
    x = np.linspace(0.0, end, max(int(end / SAMPLE_SPACING_M), 1) + 1)
    # The second derivative jumps where a bend ends, so both sides are evaluated.
    edges = np.array([edge for term in warp.terms for edge in _edges_m(term)])
    x = np.concatenate([x, edges - 1e-9, edges + 1e-9])
    sharpest = float(np.abs(warp.curvature(x)).max(initial=0.0))
    limit = friction_limited_speed(np.array([sharpest]), friction_coefficient)
    return WarpSummary(
        max_curvature_per_m=sharpest,
        min_radius_m=1 / sharpest if sharpest > 0 else float("inf"),
        speed_limit_mps=float(limit[0]),
    )


BRAKING_MPS2: Final = 3.0
"""Deceleration ahead of a curve: firm, but common in normal driving."""
CHORD_M: Final = 4.0
"""Half the length over which the curvature of a logged path is measured.

Tracks jitter by centimetres; shorter chords would turn that into bends.
"""
_NODES_PER_STEP: Final = 8
"""At 30 m/s a node every 0.4 m: the sharpest point of a bend is missed by under 3 %."""
_TOLERANCE: Final = 1.02
"""Ratio of speed to limit up to which an agent is not slowed."""
_WORTH_SAYING_MPS: Final = 0.05
_STRAIGHT_PER_M: Final = 1e-4
"""Second derivative of a warp below which it does not bend the road."""


@dataclass(frozen=True, kw_only=True)
class _Nodes:
    """Points along each track before the warp, several per time step; G agents, K nodes."""

    row: Int[np.ndarray, "G"]
    time_s: Float[np.ndarray, "K"]
    """Logged time, zero at the current step."""
    original_m: Float[np.ndarray, "G K 2"]
    heading_rad: Float[np.ndarray, "G K"]
    """Unwrapped."""
    speed_mps: Float[np.ndarray, "G K"]
    curvature_per_m: Float[np.ndarray, "G K"]
    exists: Bool[np.ndarray, "G K"]

    def taken(self, rows: Bool[np.ndarray, "G"]) -> "_Nodes":
        """Nodes of some of the agents."""
        names = [one.name for one in fields(self) if one.name != "time_s"]
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


@dataclass(frozen=True, kw_only=True)
class SlowedAgent:
    """Largest slowdown of an agent by the friction limit."""

    agent_id: str
    before_mps: float
    after_mps: float
    time_s: float
    """Relative to the current step."""


def slowed_agents(applied: AppliedWarp, time_axis: TimeAxis) -> tuple[SlowedAgent, ...]:
    """Agents that the applied warp has slowed, the most slowed first.

    Speeds are compared at the current step if the agent is slower there, else at the
    step of the largest difference.
    """
    before = warped_agents(applied.original_agents, applied.warp)
    after = applied.warped_agents
    now = time_axis.current_step
    moved = (before.position_m != after.position_m).any(axis=(1, 2)) | (
        before.velocity_mps != after.velocity_mps
    ).any(axis=(1, 2))
    rows = np.flatnonzero(moved)
    was, is_now = before.speed_mps()[rows], after.speed_mps()[rows]
    drop = np.where(before.is_valid[rows] & after.is_valid[rows], was - is_now, 0.0)
    at_once = drop[:, now] > _WORTH_SAYING_MPS
    step = np.where(at_once, now, drop.argmax(axis=1))
    found = [
        SlowedAgent(
            agent_id=after.ids[row],
            before_mps=float(was[index, step[index]]),
            after_mps=float(is_now[index, step[index]]),
            time_s=float((step[index] - now) * time_axis.step_s),
        )
        for index, row in enumerate(rows)
        if drop[index, step[index]] > _WORTH_SAYING_MPS
    ]
    return tuple(sorted(found, key=lambda one: one.after_mps - one.before_mps))


def slowed_to_friction_limit(
    original: AgentTracks,
    warped: AgentTracks,
    warp: RoadWarp,
    friction_coefficient: float,
    time_axis: TimeAxis,
) -> AgentTracks:
    """Retime warped agents that exceed the friction limit along their own paths.

    An agent brakes ahead of a curve and returns to its logged speed after it. Its pose
    at the current step stays; if it could not brake in time from there, its current
    speed is lowered too and its past is retimed backwards from the current pose, as
    far as the braking needs. Times at rest are kept. Only curvature that the warp
    itself causes is limited; logged turns elsewhere are unchanged.
    """
    nodes = _nodes(original, time_axis)
    bend = warp.derivative(warp.distance_ahead(nodes.original_m), 2)
    bends = nodes.exists & (np.abs(bend) > _STRAIGHT_PER_M)
    is_bent = np.any(bends, axis=1)
    if not is_bent.any():
        return warped
    nodes, bends = nodes.taken(is_bent), bends[is_bent]
    along = travelled_m(warp.apply(nodes.original_m))
    # Above the logged speed where the warp lengthens the track.
    speed = _at_nodes(rate(along[:, ::_NODES_PER_STEP], time_axis.step_s))
    curvature = np.zeros(speed.shape)
    curvature[bends] = warped_curvature(
        nodes.curvature_per_m[bends],
        nodes.heading_rad[bends],
        nodes.original_m[bends],
        warp,
    )
    limit = friction_limited_speed(curvature, friction_coefficient)
    too_fast = np.any(speed > _TOLERANCE * limit, axis=1)
    if not too_fast.any():
        return warped
    nodes = nodes.taken(too_fast)
    agents = original.taken(nodes.row)
    logged_time = _slowed_time(
        nodes,
        along[too_fast],
        speed[too_fast],
        limit[too_fast],
        _anchor_step(agents.is_valid, time_axis.current_step),
    )
    slowed = _at_times(agents, nodes, logged_time, warp, time_axis.step_s)
    return warped.with_motion_of(nodes.row, slowed, np.arange(len(slowed)))


def path_curvature(path_m: Float[np.ndarray, "G K 2"]) -> Float[np.ndarray, "G K"]:
    """Signed curvature, 1/m, of paths, estimated over chords; zero of short ones."""
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
    return np.where(is_path, 2 * cross / np.where(is_path, sides.prod(axis=0), 1), 0)


def warped_curvature(
    curvature_per_m: Float[np.ndarray, "*s"],
    heading_rad: Float[np.ndarray, "*s"],
    path_m: Float[np.ndarray, "*s 2"],
    warp: RoadWarp,
) -> Float[np.ndarray, "*s"]:
    """Signed curvature, 1/m, of warped paths, from that at points of the original paths.

    With t the unit tangent in the anchor's frame and k the original curvature, the
    warped path has curvature (k + f'' tx^3) / |J t|^3, which is exact.
    """
    tangent = unit_vector(heading_rad)
    forward = warp.anchor.turn(np.array([1.0, 0.0]))
    ahead, aside = tangent @ forward, tangent @ left_of(forward)
    x = warp.distance_ahead(path_m)
    scale = np.hypot(ahead, aside + warp.derivative(x, 1) * ahead)
    return (curvature_per_m + warp.derivative(x, 2) * ahead**3) / scale**3


@lru_cache(maxsize=4)
def _nodes(original: AgentTracks, time_axis: TimeAxis) -> _Nodes:
    """Tracks of lane followers, sampled finely enough for the curves of any warp.

    Kept, since each frame of a drag warps the same tracks.
    """
    rows = np.flatnonzero(
        original.kind_mask(LANE_FOLLOWER_KINDS) & original.is_valid.any(axis=1)
    )
    is_valid = original.is_valid[rows]
    position = fill_gaps(original.position_m[rows], is_valid)
    heading = fill_heading_gaps(original.heading_rad[rows], is_valid)
    original_m = _at_nodes(position)
    step = np.arange(original_m.shape[1]) / _NODES_PER_STEP
    exists = is_valid[:, :-1] & is_valid[:, 1:]
    return _Nodes(
        row=rows,
        time_s=(step - time_axis.current_step) * time_axis.step_s,
        original_m=original_m,
        heading_rad=_at_nodes(heading),
        speed_mps=_at_nodes(rate(travelled_m(position), time_axis.step_s)),
        curvature_per_m=path_curvature(original_m),
        exists=np.append(
            exists.repeat(_NODES_PER_STEP, axis=1), is_valid[:, -1:], axis=1
        ),
    )


def _at_nodes(values: Float[np.ndarray, "G T *d"]) -> Float[np.ndarray, "G K *d"]:
    """Values at all nodes, linear between the steps."""
    num_rows, num_steps, *size = values.shape
    share = np.arange(_NODES_PER_STEP) / _NODES_PER_STEP
    change = np.diff(values, axis=1)[:, :, None]
    between = values[:, :-1, None] + share.reshape(-1, *[1] * len(size)) * change
    flat = between.reshape(num_rows, (num_steps - 1) * _NODES_PER_STEP, *size)
    return np.concatenate([flat, values[:, -1:]], axis=1)


def _anchor_step(
    is_valid: Bool[np.ndarray, "G T"], current_step: int
) -> Int[np.ndarray, "G"]:
    """Step whose pose stays fixed: the current one, or the nearest valid one."""
    last = is_valid.shape[1] - 1 - is_valid[:, ::-1].argmax(axis=1)
    return np.clip(current_step, is_valid.argmax(axis=1), last)


def _slowed_time(
    nodes: _Nodes,
    along: Float[np.ndarray, "G K"],
    speed: Float[np.ndarray, "G K"],
    limit_mps: Float[np.ndarray, "G K"],
    anchor_step: Int[np.ndarray, "G"],
) -> Float[np.ndarray, "G T"]:
    """Logged time of the point that each slowed agent reaches at each step.

    Speed is a function of position. Where it is lowered, an agent takes longer; the
    accumulated delays make all later points later and all earlier points earlier.
    """
    allowed = highest_speed(
        along,
        np.where(limit_mps < speed, limit_mps, np.inf),
        braking_mps2=BRAKING_MPS2,
        acceleration_mps2=FIRM_ACCELERATION_MPS2,
    )
    delay = delays_s(along, speed, np.minimum(nodes.speed_mps, allowed))
    anchor = (anchor_step * _NODES_PER_STEP)[:, None]
    time = nodes.time_s + delay - np.take_along_axis(delay, anchor, axis=1)
    steps_s = np.repeat(nodes.time_s[None, ::_NODES_PER_STEP], len(along), axis=0)
    logged = np.repeat(nodes.time_s[None], len(along), axis=0)
    return interpolate_rows(steps_s, time, logged[..., None])[..., 0]


def _at_times(
    original: AgentTracks,
    nodes: _Nodes,
    logged_time_s: Float[np.ndarray, "G T"],
    warp: RoadWarp,
    step_s: float,
) -> AgentTracks:
    """Agents resampled at other logged times, warped, with their speeds scaled."""
    is_valid, mask = original.is_valid, original.is_valid[..., None]
    known = np.concatenate([nodes.original_m, nodes.heading_rad[..., None]], axis=-1)
    times = np.repeat(nodes.time_s[None], len(known), axis=0)
    reached = interpolate_rows(logged_time_s, times, known)
    velocity = interpolate_rows(
        logged_time_s,
        times[:, ::_NODES_PER_STEP],
        fill_gaps(original.velocity_mps, is_valid),
    )
    velocity *= np.gradient(logged_time_s, step_s, axis=1)[..., None]
    position = np.where(mask, reached[..., :2], 0.0)
    moved = warped_agents(
        replace(
            original,
            position_m=position,
            heading_rad=np.where(is_valid, wrap_angle(reached[..., 2]), 0.0),
            velocity_mps=np.where(mask, velocity, 0.0),
        ),
        warp,
    )
    # The retimed steps already account for the length that the warp adds to a curve.
    velocity = np.where(mask, warp.turn(position, velocity), 0.0)
    return replace(moved, velocity_mps=velocity)
