"""Surrogate safety measures: gap, time to collision, post-encroachment time."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import (
    boxes_touch,
    pairs_that_matter,
    pairs_that_meet,
)
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues, by_name, measured
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.oriented_box import Boxes, box_corners
from pd_editor.scene.geometry.path_pieces import (
    PIECE_STEPS,
    bounds_m,
    in_pieces,
    rectangles_meet,
)
from pd_editor.scene.thresholds import MOVED_M

HORIZON_S: Final = 5.0
"""Longer times to collision do not count."""
CRITICAL_S: Final = 0.95
NUM_NEAREST: Final = 4
"""Number of boxes among which the nearest one is looked for."""


def safety_values(view: TrafficView) -> dict[str, MetricValues]:
    """Gap and times by name, each [A].

    Pairs of pedestrians do not count. Pairs whose boxes touch at the current step are
    left out of the times: default box sizes cause many of them.
    """
    pairs = _Pairs.of(view)
    to_collision = pairs.least(*_times_to_collision_s(pairs)[:2])
    encroachment = pairs.least(*_post_encroachment_s(pairs, view.step_s))
    gap = pairs.least(*_gaps_m(pairs))
    exists = view.agents.is_valid[:, 0]
    has_course, has_conflict = np.isfinite(to_collision), np.isfinite(encroachment)
    return by_name(
        _finite("time_to_collision", to_collision, has_course),
        measured("critical_time_to_collision", to_collision < CRITICAL_S, exists),
        _finite("post_encroachment_time", encroachment, has_conflict),
        _finite("minimum_gap", gap, np.isfinite(gap)),
    )


def least_times_s(
    view: TrafficView, is_left_out: Bool[np.ndarray, "N N"]
) -> tuple[Float[np.ndarray, "A"], Int[np.ndarray, "A"]]:
    """Shortest time to collision of each agent, infinite if not critical, and its step.

    Pairs of the view's N agents may be left out.
    """
    pairs = _Pairs.of(view, within_s=CRITICAL_S)
    pair, time, at = _times_to_collision_s(pairs)
    counts = ~is_left_out[pairs.a[pair], pairs.b[pair]]
    pair, time, at = pair[counts], time[counts], at[counts]
    least, step = np.full(len(pairs.agents), np.inf), np.zeros(len(pairs.agents), int)
    # Of several writes to an agent the last one stays: the shortest time.
    order = np.argsort(-time, kind="stable")
    for side in (pairs.a, pairs.b):
        row = side[pair[order]]
        shorter = time[order] < least[row]
        least[row[shorter]] = time[order][shorter]
        step[row[shorter]] = at[order][shorter]
    return least[: len(view)], step[: len(view)]


def encroachments(
    agents: AgentStates,
) -> tuple[Int[np.ndarray, "N"], ...]:
    """Rows and steps of two agents, N each, whose boxes are at one place then.

    Pairs are left out that ``safety_values`` leaves out.

    Returns:
        row and step of the one, row and step of the other.
    """
    pairs = _Pairs.of_everyone(agents)
    pair, at, other = _encroachments(pairs)
    return pairs.a[pair], at, pairs.b[pair], other


def times_to_touch(
    agents: AgentStates, within_s: float
) -> tuple[
    Int[np.ndarray, "N"],
    Int[np.ndarray, "N"],
    Int[np.ndarray, "N"],
    Float[np.ndarray, "N"],
]:
    """Rows of two agents, steps, and times after which their boxes would touch.

    Velocities stay as they are at these steps; longer times are left out.
    """
    pairs = _Pairs.of_everyone(agents, within_s=within_s)
    pair, time, at = _times_to_collision_s(pairs)
    soon = time < within_s
    pair, time, at = pair[soon], time[soon], at[soon]
    return pairs.a[pair], pairs.b[pair], at, time


def times_s(view: TrafficView) -> Float[np.ndarray, "A H"]:
    """Time to collision of each agent at each step, at most ``HORIZON_S``."""
    pairs = _Pairs.of(view)
    pair, time, at = _times_to_collision_s(pairs)
    least = np.full((len(pairs.agents), view.num_steps), HORIZON_S)
    for side in (pairs.a, pairs.b):
        np.minimum.at(least, (side[pair], at), time)
    return least[: len(view)]


def nearest_box_m(view: TrafficView) -> Float[np.ndarray, "A H"]:
    """Distance to the nearest other box, negative if both overlap; infinite without any.

    Exact for the boxes whose circumcircles are nearest.
    """
    everyone, count = view.everyone, len(view)
    offset = everyone.position_m[None] - everyone.position_m[:count, None]
    bound = np.hypot(offset[..., 0], offset[..., 1])
    bound = bound - everyone.radius_m[:count, None, None] - everyone.radius_m[:, None]
    there = everyone.is_valid[:count, None] & everyone.is_valid
    there[np.arange(count), np.arange(count)] = False
    bound = np.where(there, bound, np.inf)
    tried = min(NUM_NEAREST, len(everyone) - 1)
    near = np.argpartition(bound, max(tried - 1, 0), axis=1)[:, :tried]
    agent, place, step = np.nonzero(
        np.isfinite(np.take_along_axis(bound, near, axis=1))
    )
    other = near[agent, place, step]
    gap = signed_gap_m(everyone.at(agent, step), everyone.at(other, step))
    least = np.full((count, view.num_steps), np.inf)
    np.minimum.at(least, (agent, step), gap)
    return least


def _finite(
    name: str, value: Float[np.ndarray, "A"], is_valid: Bool[np.ndarray, "A"]
) -> MetricValues:
    return measured(name, np.where(is_valid, value, 0.0), is_valid)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pairs:
    """P pairs (a, b) of agents at H steps that may meet in a time; agent a is evaluated."""

    agents: AgentStates
    num_evaluated: int
    a: Int[np.ndarray, "P"]
    b: Int[np.ndarray, "P"]
    is_valid: Bool[np.ndarray, "P H"]
    offset_m: Float[np.ndarray, "P H 2"]
    """Vector from a to b."""
    distance_m: Float[np.ndarray, "P H"]
    radius_m: Float[np.ndarray, "P"]
    """Sum of the circumradii of the boxes."""
    touches_at_state: Bool[np.ndarray, "P"]

    @classmethod
    def of(cls, view: TrafficView, within_s: float = np.inf) -> "_Pairs":
        return cls.of_everyone(view.everyone, len(view), within_s)

    @classmethod
    def of_everyone(
        cls,
        agents: AgentStates,
        num_evaluated: int | None = None,
        within_s: float = np.inf,
    ) -> "_Pairs":
        num_evaluated = len(agents) if num_evaluated is None else num_evaluated
        pairs = np.argwhere(np.triu(np.ones((len(agents), len(agents)), bool), 1))
        if np.isfinite(within_s):
            later = agents.position_m + within_s * agents.velocity_mps
            pairs = pairs_that_meet(
                np.concatenate([agents.position_m, later], axis=1),
                np.tile(agents.is_valid, 2),
                agents.radius_m,
            )
        pairs = pairs[(pairs[:, 0] < num_evaluated) & pairs_that_matter(agents, pairs)]
        a, b = pairs.T
        radius = agents.radius_m
        offset = agents.position_m[b] - agents.position_m[a]
        is_valid = agents.is_valid[a] & agents.is_valid[b]
        touches = boxes_touch(agents.at(a, 0), agents.at(b, 0))
        return cls(
            agents=agents,
            num_evaluated=num_evaluated,
            a=a,
            b=b,
            is_valid=is_valid,
            offset_m=offset,
            distance_m=np.hypot(offset[..., 0], offset[..., 1]),
            radius_m=radius[a] + radius[b],
            touches_at_state=touches & is_valid[:, 0],
        )

    def least(
        self, pair: Int[np.ndarray, "N"], value: Float[np.ndarray, "N"]
    ) -> Float[np.ndarray, "A"]:
        """Least value of each evaluated agent among its pairs; infinite without pairs."""
        result = np.full(len(self.agents), np.inf)
        np.minimum.at(result, self.a[pair], value)
        np.minimum.at(result, self.b[pair], value)
        return result[: self.num_evaluated]


def _times_to_collision_s(
    pairs: _Pairs,
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N"], Int[np.ndarray, "N"]]:
    """Pairs, times until their boxes would touch at constant velocity, and the steps."""
    agents, a, b = pairs.agents, pairs.a, pairs.b
    velocity = agents.velocity_mps[b] - agents.velocity_mps[a]
    offset = pairs.offset_m
    speed_squared = np.einsum("phd,phd->ph", velocity, velocity)
    closing = -np.einsum("phd,phd->ph", offset, velocity)
    # Least closing speed of agents on a collision course.
    is_closing = closing > 0.5 * pairs.distance_m
    is_closing &= pairs.is_valid & ~pairs.touches_at_state[:, None]
    pair, at = np.nonzero(is_closing)
    offset, velocity = offset[pair, at], velocity[pair, at]
    time = np.minimum(closing[pair, at] / speed_squared[pair, at], HORIZON_S)
    nearest = offset + time[:, None] * velocity
    near = np.hypot(nearest[:, 0], nearest[:, 1]) < pairs.radius_m[pair]
    pair, at, offset, velocity = pair[near], at[near], offset[near], velocity[near]
    enter, leave = sweep_times_s(
        agents.at(a[pair], at), agents.at(b[pair], at), velocity
    )
    meets = (enter < leave) & (leave > 0) & (enter <= HORIZON_S)
    return pair[meets], np.maximum(enter[meets], 0.0), at[meets]


def sweep_times_s(
    one: Boxes, other: Boxes, velocity_mps: Float[np.ndarray, "N 2"]
) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Times at which boxes start and stop touching; they never touch if start >= stop.

    The velocity is that of the second box relative to the first. The result is the
    intersection of the overlap intervals along the four separating axes.
    """
    offset_m = other.position_m - one.position_m
    enter = np.full(len(offset_m), -np.inf)
    leave = np.full(len(offset_m), np.inf)
    for axis, half in _separating_axes(one, other):
        away = (offset_m * axis).sum(-1)
        rate = (velocity_mps * axis).sum(-1)
        moves = np.abs(rate) > 1e-9
        middle = -away / np.where(moves, rate, 1.0)
        width = half / 2 / np.where(moves, np.abs(rate), 1.0)
        always = np.where(np.abs(away) < half / 2, np.inf, -np.inf)
        enter = np.maximum(enter, np.where(moves, middle - width, -always))
        leave = np.minimum(leave, np.where(moves, middle + width, always))
    return enter, leave


def _separating_axes(
    one: Boxes, other: Boxes
) -> Iterator[tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N"]]]:
    """The four axes along which disjoint boxes are apart, and the sums of their widths."""
    turn = other.heading_rad - one.heading_rad
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    for own, their in ((one, other), (other, one)):
        forward = unit_vector(own.heading_rad)
        mine, theirs = own.size_m, their.size_m
        yield forward, mine[:, 0] + theirs[:, 0] * cos + theirs[:, 1] * sin
        yield (
            left_of(forward),
            mine[:, 1] + theirs[:, 0] * sin + theirs[:, 1] * cos,
        )


def _post_encroachment_s(
    pairs: _Pairs, step_s: float
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Pairs, and times between the presence of their boxes at the same place."""
    pair, at, other = _encroachments(pairs)
    return pair, np.abs(at - other) * step_s


def _encroachments(
    pairs: _Pairs,
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"], Int[np.ndarray, "N"]]:
    """Pairs, and steps of a and of b at which their boxes are at the same place."""
    agents = pairs.agents
    position, is_valid = agents.position_m, agents.is_valid
    offset = position - position[:, :1]
    away = np.hypot(offset[..., 0], offset[..., 1]) > MOVED_M
    moves = np.any(away & is_valid, axis=1)
    meet = np.zeros((len(agents), len(agents)), bool)
    meet[tuple(pairs_that_meet(position, is_valid, agents.radius_m).T)] = True
    chosen = meet[pairs.a, pairs.b] & moves[pairs.a] & moves[pairs.b]
    chosen = np.flatnonzero(chosen & ~pairs.touches_at_state)
    if not len(chosen):
        return np.zeros(0, int), np.zeros(0, int), np.zeros(0, int)
    row, at, other = _steps_nearby(pairs, chosen)
    a, b = pairs.a[chosen[row]], pairs.b[chosen[row]]
    touches = boxes_touch(agents.at(a, at), agents.at(b, other))
    return chosen[row[touches]], at[touches], other[touches]


def _steps_nearby(
    pairs: _Pairs, chosen: Int[np.ndarray, "Q"]
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"], Int[np.ndarray, "N"]]:
    """Pairs, steps of a and steps of b at which the boxes' circumcircles intersect.

    The search tests bounding boxes of path segments first, then single steps.
    """
    agents = pairs.agents
    position, is_valid = in_pieces(agents.position_m), in_pieces(agents.is_valid)
    a, b = pairs.a[chosen], pairs.b[chosen]
    low, high = bounds_m(position, is_valid)
    reach = pairs.radius_m[chosen]
    spare = reach[:, None, None, None]
    meet = rectangles_meet(
        low[a][:, :, None] - spare,
        high[a][:, :, None] + spare,
        low[b][:, None],
        high[b][:, None],
    )
    row, first, second = np.nonzero(meet)
    a, b = a[row], b[row]
    one, two = position[a, first][:, :, None], position[b, second][:, None]
    squared = (two[..., 0] - one[..., 0]) ** 2
    squared += (two[..., 1] - one[..., 1]) ** 2
    near = squared < reach[row, None, None] ** 2
    near &= is_valid[b, second][:, None] & is_valid[a, first][:, :, None]
    pair, at, other = np.nonzero(near)
    return (
        row[pair],
        first[pair] * PIECE_STEPS + at,
        second[pair] * PIECE_STEPS + other,
    )


def _gaps_m(pairs: _Pairs) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Pairs and box distances, for the pairs and steps that can have the minimum."""
    agents, a, b = pairs.agents, pairs.a, pairs.b
    half_width = agents.size_m.min(axis=1) / 2
    distance = np.where(pairs.is_valid, pairs.distance_m, np.inf)
    at_most = np.min(distance, axis=1, initial=np.inf) - half_width[a] - half_width[b]
    least = np.full(len(agents), np.inf)
    np.minimum.at(least, a, at_most)
    np.minimum.at(least, b, at_most)
    bound = np.maximum(least[a], least[b])
    pair, at = np.nonzero(distance - pairs.radius_m[:, None] <= bound[:, None])
    pair, at = pair[pairs.is_valid[pair, at]], at[pairs.is_valid[pair, at]]
    return pair, box_gap_m(agents.at(a[pair], at), agents.at(b[pair], at))


def box_gap_m(one: Boxes, other: Boxes) -> Float[np.ndarray, "N"]:
    """Distance between N pairs of boxes; 0 if they touch.

    The least distance between disjoint rectangles involves a corner of one of them.
    """
    gap = np.full(len(one.position_m), np.inf)
    offset_m = other.position_m - one.position_m
    centers = (np.zeros_like(offset_m), offset_m)
    boxes = (one, other)
    for own, their in ((0, 1), (1, 0)):
        corners = box_corners(
            centers[their], boxes[their].heading_rad, boxes[their].size_m
        )
        rel = corners - centers[own][:, None]
        forward = unit_vector(boxes[own].heading_rad)[:, None]
        half = boxes[own].size_m[:, None] / 2
        ahead = np.maximum(np.abs((rel * forward).sum(-1)) - half[..., 0], 0)
        aside = np.maximum(np.abs((rel * left_of(forward)).sum(-1)) - half[..., 1], 0)
        gap = np.minimum(gap, np.hypot(ahead, aside).min(axis=1, initial=np.inf))
    return np.where(boxes_touch(one, other), 0.0, gap)


def signed_gap_m(one: Boxes, other: Boxes) -> Float[np.ndarray, "N"]:
    """Distance between N pairs of boxes; of those that touch, minus their depth."""
    offset_m = other.position_m - one.position_m
    depth = np.full(len(offset_m), np.inf)
    for axis, width in _separating_axes(one, other):
        depth = np.minimum(depth, width / 2 - np.abs((offset_m * axis).sum(-1)))
    return np.where(depth > 0, -depth, box_gap_m(one, other))
