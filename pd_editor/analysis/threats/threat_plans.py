"""Plans of threats: trajectories on which an agent comes close to another one.

A plan is a Frenet candidate of the attacking agent plus a smooth deviation that begins
with zero offset and velocity and reaches a *meeting*: a position and a velocity
relative to the threatened agent at some time. Plans beyond the attacker's limits, off
the road, or with another outcome than asked are left out. What is left tells whether a
threat is feasible; the best plan is what the guidance asks for.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import product
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.analysis.threats.encounter import (
    IN_FRONT,
    Approach,
    MotionLimits,
    Track,
    counted_gaps_m,
    exertion,
    gaps_m,
    hardest_braking_mps2,
    limits_of,
)
from pd_editor.scene.geometry.angles import heading_of, left_of, unit_vector, wrap_angle
from pd_editor.scene.paths.driving_paths import velocity_of
from pd_editor.scene.paths.motion_primitives import candidate_positions
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS, STATIONARY_M

GAP_TOLERANCE_M: Final = 0.5
"""A near-miss whose gap differs by more is not the asked one."""
_CONTACT_DEPTH_M: Final = 0.25
"""Depth to which boxes are planned to overlap on contact."""
_MOST_OF_LIMITS: Final = 0.95
"""Share of the limits that plans use at most."""
_WITH_CANDIDATE: Final = 1.75
"""Accelerations of a deviation may be so many times the limits: its candidate has others."""
HARD_BRAKING_MPS2: Final = 3.0
"""Least braking of a leader that "brakes"."""
_CLOSING_MPS: Final = (1.5, 3.0, 5.0)
"""Closing speeds of contacts from the rear and of cut-ins."""
_FAST_CLOSING_MPS: Final = (*_CLOSING_MPS, 8.0)
"""Closing speeds of contacts with agents that brake or start in front."""
_SETTLE_S: Final = 1.0
"""Time constant with which deviations and speed differences fade after a meeting."""
_BRAKES_AFTER_CONTACT_MPS2: Final = 6.0
_WAITS: Final = (0.0, 0.35, 0.6)
"""Cut-ins begin at once, or after this share of the time, when there is room."""
_CROSSING_COS: Final = 0.77
"""Cosine of the least angle between the headings of agents that cross."""
_GOES_MPS: Final = 1.0
"""Least speed of an agent in front of which another one can cut in, brake or pull out."""


@dataclass(frozen=True, kw_only=True)
class ThreatAim:
    """What is asked of a threat."""

    approach: Approach
    gap_m: float
    """0: contact."""

    @classmethod
    def of(cls, approach: Approach, severity: float) -> "ThreatAim":
        """What a severity asks for: a gap of 3 m at 0, contact at 1."""
        # Asked gap at severity 0; it decreases linearly with the severity.
        return cls(approach=approach, gap_m=3.0 * (1.0 - severity))

    @property
    def is_contact(self) -> bool:
        """Whether the boxes are to touch."""
        return self.gap_m <= 0


@dataclass(frozen=True, kw_only=True)
class ThreatObstacle:
    """Why there is no plan of a threat."""

    kind: Literal["course", "limits", "road", "outcome", "traffic"]
    """No candidate has the course of the approach, all plans are beyond the limits, or
    off the road, or lead to something else than asked, or hit an agent in the way."""
    times_limits: float = 1.0
    """How many times its limits the least demanding plan takes; infinite if the agent
    would have to reverse."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ThreatPlans:
    """N plans of an attacking agent, the best one first."""

    track: Track
    gap_m: Float[np.ndarray, "N"]
    """Least distance to the threatened agent."""
    meeting_step: Int[np.ndarray, "N"]
    cost: Float[np.ndarray, "N"]
    obstacle: ThreatObstacle | None
    """Why there is none; None if there are plans."""

    def __len__(self) -> int:
        return len(self.cost)

    def best(self) -> Track:
        """The plan with the least cost."""
        return self.track.taken(np.array([0]))


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelFit:
    """What a model of trajectories makes of plans."""

    reference_m: Float[np.ndarray, "H 2"]
    """Trajectory that plans should be near, such as the unguided one."""
    step_s: float
    """Time between the steps of all trajectories."""
    fitted: Callable[[Float[np.ndarray, "N H 2"]], Float[np.ndarray, "N H 2"]]
    """Maps planned positions to what the model can represent."""


def threat_plans(
    scenario: Scenario,
    row: int,
    threatened: Track,
    aim: ThreatAim,
    *,
    kept: Sequence[Track] = (),
    others: Sequence[Track] = (),
    model: ModelFit | None = None,
    most: int = 8,
) -> ThreatPlans:
    """Plans of the agent at ``row`` against a known trajectory; none if infeasible.

    Of equal plans, those closer to a model's reference come first, and those that do not
    hit ``others`` on the way: they may make way unless they stand. None hits ``kept``
    ones.

    Args:
        scenario: the scene, with the attacker's current state.
        row: row of the attacker.
        threatened: trajectory of the threatened agent.
        aim: what is asked for.
        kept: trajectories of other agents that do not make way.
        others: trajectories of other agents that may change.
        model: what a model makes of plans; None: they are at the scenario's steps.
        most: number of plans that are returned.
    """
    step_s = scenario.time_axis.step_s if model is None else model.step_s
    attacker = _Attacker.of(scenario, row, len(threatened.position_m), step_s)
    meetings = _meetings(attacker, threatened, aim)
    if not len(meetings.step):
        return _no_plans(attacker, meetings)
    tracks, at = _planned(attacker, threatened, aim, meetings)
    if model is not None:
        tracks = attacker.track(model.fitted(tracks.position_m))
    share, cost = _demand(attacker, tracks, at, meetings, aim, model)
    can = share <= (_MOST_OF_LIMITS if model is None else 1.0)
    if aim.approach == "brakes":
        can &= hardest_braking_mps2(tracks, at, attacker.step_s) > HARD_BRAKING_MPS2
    # Of so many, those with the least effort, gaps are computed.
    some = _cheapest(np.flatnonzero(can), cost, 400)
    tracks, at, cost = tracks.taken(some), at[some], cost[some]
    allowed, off_cost = _on_road(scenario, attacker, tracks, at)
    reaches, least, missed_cost = _outcome(tracks, threatened, aim, at)
    cost = cost + off_cost + missed_cost
    best = np.flatnonzero(reaches & allowed)
    fixed = [*kept, *(one for one in others if _stands(one))]
    best = best[_hits_on_the_way(tracks.taken(best), at[best], fixed) == 0]
    best = _cheapest(best, cost, 24)
    cost[best] += _hits_on_the_way(tracks.taken(best), at[best], others)
    best = _cheapest(best, cost, most)
    return ThreatPlans(
        track=tracks.taken(best),
        gap_m=least[best],
        meeting_step=at[best],
        cost=cost[best],
        obstacle=None
        if len(best)
        else _obstacle(meetings.least_demand, share, reaches, allowed),
    )


def _cheapest(
    rows: Int[np.ndarray, "N"], cost: Float[np.ndarray, "P"], most: int
) -> Int[np.ndarray, "M"]:
    return rows[np.argsort(cost[rows], kind="stable")][:most]


def _no_plans(attacker: "_Attacker", meetings: "_Meetings") -> ThreatPlans:
    none = np.zeros(0)
    return ThreatPlans(
        track=attacker.track(attacker.candidate_m[:0]),
        gap_m=none,
        meeting_step=meetings.step,
        cost=none,
        obstacle=_obstacle(meetings.least_demand, none, none > 0, none > 0),
    )


def _demand(
    attacker: "_Attacker",
    tracks: Track,
    at: Int[np.ndarray, "N"],
    meetings: "_Meetings",
    aim: ThreatAim,
    model: ModelFit | None,
) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Share of the attacker's limits that each plan takes, and cost of its motion."""
    used = exertion(
        tracks.position_m,
        attacker.velocity_mps,
        attacker.heading_rad,
        attacker.limits,
        attacker.step_s,
        until=at if aim.is_contact else None,
    )
    cost = used.effort + 0.1 * (meetings.offset_m**2).sum(axis=1) / 10.0**2
    # Meetings after this time cost more.
    late_s = np.maximum(at * attacker.step_s - 3.5, 0)
    cost += 0.05 * late_s**2
    if model is not None:
        apart = np.linalg.norm(tracks.position_m - model.reference_m, axis=-1)
        cost += (apart**2).mean(axis=1) / 10.0**2
    return used.share, cost


def _on_road(
    scenario: Scenario, attacker: "_Attacker", tracks: Track, at: Int[np.ndarray, "N"]
) -> tuple[Bool[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Whether plans stay on the road until soon after the meeting, and what it costs."""
    off = is_off_road(scenario, tracks.position_m[:, 1:])
    starts_off = is_off_road(scenario, tracks.position_m[:, 0])
    off &= np.arange(1, tracks.position_m.shape[1]) <= at[:, None] + 5
    allowed = ~off.any(axis=1) | starts_off | attacker.walks
    return allowed, np.where(starts_off, 0.0, off.mean(axis=1))


def _outcome(
    tracks: Track, threatened: Track, aim: ThreatAim, at: Int[np.ndarray, "N"]
) -> tuple[Bool[np.ndarray, "N"], Float[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Whether plans lead to what is asked, their gaps, and the cost of what they miss."""
    gap = gaps_m(tracks, threatened)[:, 1:]
    touches = (gap <= 0).any(axis=1)
    least = counted_gaps_m(tracks, threatened, gap, aim.approach)
    if aim.is_contact:
        late = np.abs(1 + np.argmax(gap <= 0, axis=1) - at)
        return touches & (late <= 8), least, 0.05 * late
    missed = least - aim.gap_m
    reaches = (np.abs(missed) <= GAP_TOLERANCE_M) & ~touches
    return reaches, least, 2.0 * (missed / GAP_TOLERANCE_M) ** 2


def _obstacle(
    least_demand: float,
    share: Float[np.ndarray, "N"],
    reaches: Bool[np.ndarray, "M"],
    allowed: Bool[np.ndarray, "M"],
) -> ThreatObstacle:
    """What no plan gets past, of those within the limits M that were compared."""
    if np.isinf(least_demand):
        return ThreatObstacle(kind="course")
    if not len(reaches):
        least = share.min(initial=np.inf) if len(share) else least_demand
        return ThreatObstacle(kind="limits", times_limits=least / _MOST_OF_LIMITS)
    if (reaches & allowed).any():
        return ThreatObstacle(kind="traffic")
    is_road = bool((reaches & ~allowed).any()) or not allowed.any()
    return ThreatObstacle(kind="road" if is_road else "outcome")


def _hits_on_the_way(
    tracks: Track, meeting_step: Int[np.ndarray, "N"], others: Sequence[Track]
) -> Float[np.ndarray, "N"]:
    """Number of other agents that each plan hits until its meeting."""
    hits = np.zeros(len(meeting_step))
    if not len(hits):
        return hits
    on_the_way = np.arange(tracks.position_m.shape[1]) <= meeting_step[:, None]
    for other in others:
        away = np.linalg.norm(other.position_m - tracks.position_m, axis=-1)
        reach = (np.hypot(*tracks.size_m) + np.hypot(*other.size_m)) / 2
        if not (away <= reach).any():
            continue
        plan, step = np.nonzero((away <= reach) & on_the_way)
        touches = np.zeros(on_the_way.shape, bool)
        touches[plan, step] = boxes_touch(tracks.at(plan, step), other.at(step))
        hits += (touches & ~touches[:, :1]).any(axis=1)
    return hits


def _stands(other: Track) -> bool:
    away = other.position_m - other.position_m[0]
    return bool(np.hypot(away[:, 0], away[:, 1]).max() < STATIONARY_M)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Attacker:
    """The current state of the attacker and its C candidates."""

    candidate_m: Float[np.ndarray, "C H 2"]
    candidate_mps: Float[np.ndarray, "C H 2"]
    velocity_mps: Float[np.ndarray, "2"]
    heading_rad: float
    around_m: Float[np.ndarray, "K 2"]
    """Where all other agents are now, the threatened one included."""
    size_m: Float[np.ndarray, "2"]
    limits: MotionLimits
    walks: bool
    step_s: float

    @classmethod
    @lru_cache(maxsize=256)
    def of(
        cls, scenario: Scenario, row: int, num_steps: int, step_s: float
    ) -> "_Attacker":
        """Cached: all approaches begin with the same candidates."""
        agents, now = scenario.agents, scenario.current_step
        position, _, _ = candidate_positions(
            scenario,
            np.array([row]),
            max_candidates=32,
            num_steps=num_steps - 1,
            step_s=step_s,
            knows_leaders=False,
        )
        first = np.broadcast_to(agents.velocity_mps[row, now], (len(position), 2))
        limits = limits_of(agents.kinds[row])
        return cls(
            candidate_m=position,
            candidate_mps=velocity_of(position, first, step_s),
            velocity_mps=agents.velocity_mps[row, now],
            heading_rad=float(agents.heading_rad[row, now]),
            around_m=agents.position_m[
                agents.is_valid[:, now] & (np.arange(len(agents)) != row), now
            ],
            size_m=agents.size_m[row],
            limits=limits,
            walks=bool(np.isinf(limits.curvature_1pm)),
            step_s=step_s,
        )

    def track(self, position_m: Float[np.ndarray, "N H 2"]) -> Track:
        return Track(
            position_m=position_m,
            heading_rad=courses(position_m, self.heading_rad),
            velocity_mps=np.gradient(position_m, self.step_s, axis=1),
            size_m=self.size_m,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Meetings:
    """N meetings: offset and velocity deviation from a candidate at a step."""

    candidate: Int[np.ndarray, "N"]
    step: Int[np.ndarray, "N"]
    offset_m: Float[np.ndarray, "N 2"]
    offset_mps: Float[np.ndarray, "N 2"]
    waits: Float[np.ndarray, "N"]
    """Share of the time before the deviation to the side begins, or the braking."""
    least_demand: float
    """Least share of the limits that leads to a meeting, such as are left out included;
    infinite if no candidate has the course."""


def _meetings(attacker: _Attacker, other: Track, aim: ThreatAim) -> _Meetings:
    """Meetings of all candidates at all times that accelerations may reach."""
    num_steps = other.position_m.shape[0]
    step = np.arange(
        round(0.8 / attacker.step_s),
        num_steps,
        max(round(0.3 / attacker.step_s), 1),
    )
    kinds = {
        "rear": partial(_in_line, end=-1),
        "cut-in": partial(_in_line, end=1),
        "brakes": partial(_in_line, end=1),
        "pulls-out": partial(_in_line, end=1),
        "side": _beside,
        "head-on": _opposite,
    }
    position, velocity, candidate = kinds[aim.approach](attacker, other, aim, step)
    # [V C T 2] -> meetings
    num_variants = len(position)
    shape = (num_variants, len(attacker.candidate_m), len(step))
    at = np.broadcast_to(step, shape)
    which = np.broadcast_to(np.arange(shape[1])[:, None], shape)
    offset = position - attacker.candidate_m[:, step]
    deviation = velocity - attacker.candidate_mps[:, step]
    time = (at * attacker.step_s)[..., None]
    most = attacker.limits.braking_mps2 * time[..., 0] ** 2
    demand = np.linalg.norm(offset, axis=-1) / (0.5 * most)
    # The accelerations of the cubic at its two ends.
    late = deviation * time
    for hardest in (6 * offset - 2 * late, 6 * offset - 4 * late):
        hard = np.linalg.norm(hardest, axis=-1) / most
        demand = np.maximum(demand, hard / _WITH_CANDIDATE)
    demand = np.where(candidate & np.isfinite(offset).all(-1), demand, np.inf)
    # Meetings with the least accelerations that are planned.
    easiest = np.sort(demand, axis=None)[:600]
    reachable = demand <= min(easiest.max(initial=0.0), 1.0)
    waits = _WAITS if aim.approach in ("cut-in", "brakes") else (0.0,)
    return _Meetings(
        candidate=np.tile(which[reachable], len(waits)),
        step=np.tile(at[reachable], len(waits)),
        offset_m=np.tile(offset[reachable], (len(waits), 1)),
        offset_mps=np.tile(deviation[reachable], (len(waits), 1)),
        waits=np.repeat(np.array(waits), np.count_nonzero(reachable)),
        least_demand=_WITH_CANDIDATE * float(demand.min(initial=np.inf)),
    )


def _planned(
    attacker: _Attacker, other: Track, aim: ThreatAim, meetings: _Meetings
) -> tuple[Track, Int[np.ndarray, "N"]]:
    """Trajectories through meetings, and what happens after each."""
    num_steps = other.position_m.shape[0]
    time = np.arange(num_steps) * attacker.step_s
    end = meetings.step * attacker.step_s
    d, e = meetings.offset_m, meetings.offset_mps
    candidate = attacker.candidate_m[meetings.candidate]
    forward = unit_vector(other.heading_rad[meetings.step])
    row = np.arange(len(d))
    position, moment, fades = candidate.copy(), time, 1.0
    first, then = 0.0 * end, meetings.waits * end
    if aim.approach == "brakes":
        first, then = then, first
    for axis, begin in ((forward, first), (left_of(forward), then)):
        way, rate = (d * axis).sum(-1), (e * axis).sum(-1) * fades
        deviation = _deviation_m(way, rate, end, begin, moment)
        position += deviation[..., None] * axis[:, None]
        if aim.approach == "pulls-out":
            # Who starts moves aside as it gets ahead, not on the spot.
            ahead = ((position - position[:, :1]) * forward[:, None]).sum(-1)
            whole = np.maximum(ahead[row, meetings.step], 1e-3)[:, None]
            moment, fades = end[:, None] * np.clip(ahead / whole, 0, 1), 0.0
    late = np.maximum(time - end[:, None], 0)[..., None]
    is_after = late[..., 0] > 0
    there = position[row, meetings.step]
    speed = attacker.candidate_mps[meetings.candidate, meetings.step] + e
    if aim.approach in ("rear", *IN_FRONT):
        after = _following(other, meetings, attacker, there, speed, time)
    elif aim.is_contact:
        after = _braking(there, speed, late)
    else:
        after = _passing(candidate, attacker, meetings, d, e, late)
    position = np.where(is_after[..., None], after, position)
    return attacker.track(position), meetings.step


def _deviation_m(
    way_m: Float[np.ndarray, "N"],
    rate_mps: Float[np.ndarray, "N"],
    end_s: Float[np.ndarray, "N"],
    begin_s: Float[np.ndarray, "N"],
    time_s: Float[np.ndarray, "*N H"],
) -> Float[np.ndarray, "N H"]:
    """Cubic from zero and at rest to an offset and a rate, constant afterwards."""
    lasts = end_s - begin_s
    square = (3 * way_m - rate_mps * lasts) / lasts**2
    cube = (rate_mps * lasts - 2 * way_m) / lasts**3
    t = np.clip(time_s - begin_s[:, None], 0, lasts[:, None])
    return square[:, None] * t**2 + cube[:, None] * t**3


def _following(
    other: Track,
    meetings: _Meetings,
    attacker: _Attacker,
    there: Float[np.ndarray, "N 2"],
    speed: Float[np.ndarray, "N 2"],
    time: Float[np.ndarray, "H"],
) -> Float[np.ndarray, "N H 2"]:
    """Keep the place in the frame of the threatened agent; speed differences fade."""
    step = meetings.step
    turn = np.exp(1j * other.heading_rad)
    path = other.position_m[:, 0] + 1j * other.position_m[:, 1]
    moves = np.gradient(path, attacker.step_s)
    offset = (there[:, 0] + 1j * there[:, 1] - path[step]) / turn[step]
    closing = (speed[:, 0] + 1j * speed[:, 1] - moves[step]) / turn[step]
    late = np.maximum(time - time[step][:, None], 0)
    fade_s = 0.5 * _SETTLE_S
    rel = offset[:, None] + closing[:, None] * fade_s * (1 - np.exp(-late / fade_s))
    place = path + rel * turn
    return np.stack([place.real, place.imag], axis=-1)


def _braking(
    there: Float[np.ndarray, "N 2"],
    speed: Float[np.ndarray, "N 2"],
    late: Float[np.ndarray, "N H 1"],
) -> Float[np.ndarray, "N H 2"]:
    """Brake to a standstill, straight on."""
    pace = np.linalg.norm(speed, axis=-1)
    stops = np.maximum(pace / _BRAKES_AFTER_CONTACT_MPS2, 1e-3)
    t = np.minimum(late[..., 0], stops[:, None])
    way = pace[:, None] * t - 0.5 * _BRAKES_AFTER_CONTACT_MPS2 * t**2
    forward = speed / np.maximum(pace, 1e-6)[:, None]
    return there[:, None] + way[..., None] * forward[:, None]


def _passing(
    candidate: Float[np.ndarray, "N H 2"],
    attacker: _Attacker,
    meetings: _Meetings,
    offset: Float[np.ndarray, "N 2"],
    deviation: Float[np.ndarray, "N 2"],
    late: Float[np.ndarray, "N H 1"],
) -> Float[np.ndarray, "N H 2"]:
    """Drive on as the candidate does; deviations to the side fade, others stay."""
    velocity = attacker.candidate_mps[meetings.candidate, meetings.step]
    forward = _courses(velocity, 0.0)
    along = (offset * forward).sum(-1, keepdims=True)
    along_mps = (deviation * forward).sum(-1, keepdims=True)
    aside, aside_mps = offset - along * forward, deviation - along_mps * forward
    tau = _SETTLE_S
    held = along[:, None] + along_mps[:, None] * tau * (1 - np.exp(-late / tau))
    fading = aside[:, None] + (aside_mps + aside / tau)[:, None] * late
    return candidate + held * forward[:, None] + fading * np.exp(-late / tau)


def _in_line(
    attacker: _Attacker,
    other: Track,
    aim: ThreatAim,
    step: Int[np.ndarray, "T"],
    end: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Meetings with the front at the other agent's rear (-1), or in front of it (1)."""
    forward, velocity = unit_vector(other.heading_rad[step]), other.velocity_mps[step]
    fast = aim.approach in ("brakes", "pulls-out")
    closing = _FAST_CLOSING_MPS if fast else _CLOSING_MPS
    closing = closing if aim.is_contact else (0.0,)
    gap_m = -_CONTACT_DEPTH_M if aim.is_contact else aim.gap_m
    reach = (other.size_m[0] + attacker.size_m[0]) / 2 + gap_m
    position = other.position_m[step] + end * reach * forward
    speeds = np.stack([velocity - end * rate * forward for rate in closing])
    comes = _course_cos(attacker, other, step) > _CROSSING_COS
    if end > 0:
        goes = (speeds * forward).sum(-1) > (0 if fast else _GOES_MPS)
        goes &= (velocity * forward).sum(-1) > _GOES_MPS
        comes = goes[:, None] & comes & _starts_well(attacker, other, aim.approach)
    if aim.approach == "pulls-out":
        way = position - attacker.candidate_m[0, 0]
        aside = np.abs((way * left_of(forward)).sum(-1))
        ahead = np.maximum((way * forward).sum(-1), 0)
        comes = comes & (6 * aside / attacker.limits.curvature_1pm <= ahead**2)
    shape = (len(closing), *comes.shape[-2:])
    return (
        np.broadcast_to(position, speeds.shape)[:, None],
        speeds[:, None],
        np.broadcast_to(comes, shape),
    )


def _beside(
    attacker: _Attacker, other: Track, aim: ThreatAim, step: Int[np.ndarray, "T"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Meetings with the front at a flank; near-misses cross behind or in front."""
    forward = unit_vector(other.heading_rad[step])
    left = left_of(forward)
    candidate = attacker.candidate_mps[:, step]
    pace = np.linalg.norm(candidate, axis=-1, keepdims=True)
    course = _courses(candidate, np.nan)
    across, along = (course * left).sum(-1), (course * forward).sum(-1)
    crosses = np.abs(along) < _CROSSING_COS
    length, width = attacker.size_m
    half = (np.abs(across) * length + np.abs(along) * width) / 2
    spots: list[tuple[np.ndarray, float]] = []
    if aim.is_contact:
        depth = other.size_m[1] / 2 + half - _CONTACT_DEPTH_M
        for place, hurry in product((-0.25, 0.0, 0.25), (1.0, 2.0)):
            middle = other.position_m[step] + place * other.size_m[0] * forward
            spot = middle - (np.sign(across) * depth)[..., None] * left
            spots.append((spot, hurry))
    else:
        wide = (np.abs(along) * length + np.abs(across) * width) / 2
        # The boxes are nearest before or after the centres are on one line.
        rate = np.linalg.norm(other.velocity_mps[step], axis=-1) / np.maximum(
            pace[..., 0] * np.abs(across), _GOES_MPS
        )
        lead = rate * (half + other.size_m[1] / 2)
        for end, extra, share, hurry in product(
            (-1.0, 1.0), (0.6, 1.0), (0.0, 0.5, 1.0), (1.0, 2.0)
        ):
            reach = other.size_m[0] / 2 + wide + extra * aim.gap_m + share * lead
            spot = other.position_m[step] + (end * reach)[..., None] * forward
            spots.append((spot, hurry))
    start, time = attacker.candidate_m[:, step], (step * attacker.step_s)[:, None]
    speeds = [candidate + hurry * (spot - start) / time for spot, hurry in spots]
    counts = np.broadcast_to(crosses, (len(spots), *crosses.shape))
    return np.stack([spot for spot, _ in spots]), np.stack(speeds), counts


def _opposite(
    attacker: _Attacker, other: Track, aim: ThreatAim, step: Int[np.ndarray, "T"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Meetings with opposite headings: fronts touch, or sides pass at the gap."""
    forward = unit_vector(other.heading_rad[step])
    left = left_of(forward)
    pace = np.linalg.norm(attacker.candidate_mps[:, step], axis=-1, keepdims=True)
    comes = _course_cos(attacker, other, step) < -_CROSSING_COS
    comes = comes & (pace[..., 0] > 0.3)
    length, width = (other.size_m + attacker.size_m) / 2
    ahead_m, asides_m = 0.0, (width + aim.gap_m) * np.array([-1.0, 1.0])
    if aim.is_contact:
        ahead_m, asides_m = (
            length - _CONTACT_DEPTH_M,
            width * np.array([-0.5, 0.0, 0.5]),
        )
    spots = other.position_m[step] + ahead_m * forward + asides_m[:, None, None] * left
    speeds = np.broadcast_to(-pace * forward, (len(spots), *comes.shape, 2))
    return spots[:, None], speeds, np.broadcast_to(comes, (len(spots), *comes.shape))


def _courses(
    velocity_mps: Float[np.ndarray, "*N 2"], at_rest: float | Float[np.ndarray, "2"]
) -> Float[np.ndarray, "*N 2"]:
    """Directions of velocities; ``at_rest`` where there is hardly any."""
    pace = np.linalg.norm(velocity_mps, axis=-1, keepdims=True)
    return np.where(pace > 0.3, velocity_mps / np.maximum(pace, 1e-6), at_rest)


def _course_cos(
    attacker: _Attacker, other: Track, step: Int[np.ndarray, "T"]
) -> Float[np.ndarray, "C T"]:
    """Cosine of the angle between the candidates' courses and the other's heading."""
    still = unit_vector(attacker.heading_rad)
    course = _courses(attacker.candidate_mps[:, step], still)
    return (course * unit_vector(other.heading_rad[step])).sum(-1)


def _starts_well(attacker: _Attacker, other: Track, approach: Approach) -> bool:
    """Whether the attacker is now where an approach that ends in front begins.

    Who cuts in or pulls out is beside the other's path, who brakes directly ahead on it.
    """
    on = unit_vector(other.heading_rad[-1:])
    # Way of the threatened agent beyond its last step on which others are looked for.
    beyond = np.arange(2.0, 60.0, 2.0)[:, None]
    path = np.concatenate([other.position_m, other.position_m[-1:] + beyond * on])
    forward = np.concatenate(
        [unit_vector(other.heading_rad), np.broadcast_to(on, (len(beyond), 2))]
    )
    points = np.concatenate([attacker.candidate_m[:1, 0], attacker.around_m])
    gap = points[:, None] - path
    place = np.argmin((gap**2).sum(-1), axis=1)
    aside = np.abs(
        (gap[np.arange(len(place)), place] * left_of(forward[place])).sum(-1)
    )
    near = 0.5 * (other.size_m[1] + attacker.size_m[1]) * 0.9
    is_aside, is_ahead = bool(aside[0] > near), bool(place[0] > 0)
    speed = float(np.hypot(*attacker.velocity_mps))
    if approach == "cut-in":
        return is_aside
    if attacker.walks or not is_ahead:
        return False
    if approach == "pulls-out":
        return is_aside and speed < STANDING_MPS
    between = (place > 0) & (place < place[0]) & (aside <= near)
    return not is_aside and speed > _GOES_MPS and not between.any()


def courses(
    position_m: Float[np.ndarray, "N H 2"], first_rad: float
) -> Float[np.ndarray, "N H"]:
    """Headings along paths, kept where an agent hardly moves; the first one is given."""
    num_steps = position_m.shape[1]
    early = np.maximum(np.arange(num_steps) - 2, 0)
    late = np.minimum(np.arange(num_steps) + 2, num_steps - 1)
    chord = position_m[:, late] - position_m[:, early]
    course = heading_of(chord)
    tells = np.hypot(chord[..., 0], chord[..., 1]) > 0.25
    tells[:, 0] = True
    course[:, 0] = first_rad
    last = np.maximum.accumulate(np.where(tells, np.arange(num_steps), 0), axis=1)
    return wrap_angle(np.take_along_axis(course, last, axis=1))
