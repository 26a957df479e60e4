"""Way-points of a path: what is asked of an agent where it passes them.

Places are arc lengths of the path that the agent follows from its pose; way-points are
numbered from 1 in sentences.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.guidance.guidance_kind import (
    MAX_BRAKING_MPS2,
    OBEYED,
    AgentNow,
    Driven,
    Found,
    Measured,
)
from pd_editor.analysis.threats.encounter import Track
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.guidance_terms import Point
from pd_editor.scene.paths.drawn_path import FollowedPath
from pd_editor.scene.paths.driving_paths import SPACING_M
from pd_editor.scene.thresholds import FIRM_ACCELERATION_MPS2

_TRIED_SHARES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
"""How far rates go from usual ones to the hardest, until what is asked for is met."""

_Leg = tuple[float, float]
"""Duration and acceleration."""


@dataclass(frozen=True, kw_only=True)
class Rates:
    """Usual and hardest rates in m/s2, and the speed at which agents drive off."""

    up: float
    down: float
    hardest_up: float
    hardest_down: float
    cruise_mps: float

    def tried(self) -> list[tuple[float, float]]:
        """Pairs of acceleration and braking, the usual ones first."""
        return [
            (
                self.up + share * (self.hardest_up - self.up),
                self.down + share * (self.hardest_down - self.down),
            )
            for share in _TRIED_SHARES
        ]


@dataclass(frozen=True, kw_only=True)
class Ask:
    """What is asked for at a place of the course; None: nothing."""

    along_m: float
    speed_mps: float | None = None
    at_s: float | None = None
    release_s: float | None = None
    """The agent waits here until then, unless it arrives later."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pace:
    """Times, places and speeds between which the acceleration is constant."""

    time_s: Float[np.ndarray, "N"]
    along_m: Float[np.ndarray, "N"]
    speed_mps: Float[np.ndarray, "N"]
    arrivals: tuple[tuple[float, float, float], ...]
    """Time, place and speed at which each place that is asked for is reached, or what
    comes next to it."""

    def along_at(self, time_s: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T"]:
        """Places at times; at the last speed after the last time."""
        index = np.searchsorted(self.time_s, time_s, side="right") - 1
        index = np.clip(index, 0, len(self.time_s) - 1)
        since = time_s - self.time_s[index]
        gain = np.append(np.diff(self.speed_mps), 0.0)
        duration = np.append(np.diff(self.time_s), 1.0)
        rate = gain / np.maximum(duration, 1e-9)
        return (
            self.along_m[index]
            + self.speed_mps[index] * since
            + rate[index] * since**2 / 2
        )


def pace_of(asks: Sequence[Ask], first_mps: float, rates: Rates) -> Pace:
    """Pace of an agent that meets what is asked for, or comes as near as it can.

    Rates are the usual ones where these suffice. Speed is gained at once and lost late,
    unless a time is given; after the last place the last speed is kept, and after a wait
    the agent drives off.

    Args:
        asks: in the order of their places.
        first_mps: speed now.
        rates: usual and hardest ones.
    """
    nodes, arrivals = [(0.0, 0.0, first_mps)], []
    after_wait: float | None = None
    for ask, following in zip(asks, [*asks, None][1:], strict=True):
        time, along, speed = nodes[-1]
        gap = max(ask.along_m - along, 0.0)
        release = -1.0 if ask.release_s is None else min(ask.release_s, 1e4)
        left = None if ask.at_s is None else ask.at_s - time
        if release > time + gap / max(speed, after_wait or 0.0, 0.1):
            _drive(nodes, _legs(gap, speed, 0.0, left, rates)[0])
            arrivals.append(nodes[-1])
            # Who could not stop there does it behind the place.
            _drive(nodes, [_change(nodes[-1][2], 0.0, rates.up, rates.hardest_down)])
            _drive(nodes, [(release - nodes[-1][0], 0.0)])
            after_wait = rates.cruise_mps if ask.speed_mps is None else ask.speed_mps
            continue
        wanted = ask.speed_mps
        if wanted is None and left is None:
            wanted = speed if after_wait is None else after_wait
        legs, is_met = _legs(gap, speed, wanted, left, rates)
        if wanted is None and left and left > 0 and following and following.at_s:
            # The speed between those before and after the place, if that is possible.
            after = (following.along_m - ask.along_m) / (following.at_s - time - left)
            others = _legs(gap, speed, (gap / left + after) / 2, left, rates)
            legs = others[0] if others[1] or not is_met else legs
        _drive(nodes, legs)
        arrivals.append(nodes[-1])
        after_wait = None
    if after_wait is not None:
        up, down = rates.tried()[0]
        _drive(nodes, [_change(nodes[-1][2], after_wait, up, down)])
    time, along, speed = np.array(nodes).T
    return Pace(
        time_s=time,
        along_m=along,
        speed_mps=speed,
        arrivals=tuple(arrivals),
    )


def _drive(nodes: list[tuple[float, float, float]], legs: Sequence[_Leg]) -> None:
    """Add what is driven in legs to the nodes of a pace."""
    for duration, rate in legs:
        if duration > 0:
            time, along, speed = nodes[-1]
            after = max(speed + rate * duration, 0.0)
            nodes.append(
                (time + duration, along + (speed + after) / 2 * duration, after)
            )


def _legs(
    gap_m: float,
    first_mps: float,
    last_mps: float | None,
    duration_s: float | None,
    rates: Rates,
) -> tuple[list[_Leg], bool]:
    """Legs over a gap, to a speed, at it and to the last one, and whether they meet it."""
    legs: list[_Leg] = []
    is_met = False
    for up, down in rates.tried():
        if duration_s is None:
            assert last_mps is not None
            legs, is_met = _untimed(gap_m, first_mps, last_mps, up, down)
        else:
            legs, is_met = _timed(gap_m, first_mps, last_mps, duration_s, up, down)
        if is_met:
            break
    return legs, is_met


def _untimed(
    gap_m: float, first_mps: float, last_mps: float, up: float, down: float
) -> tuple[list[_Leg], bool]:
    """Legs that reach a speed, and whether they do within the gap."""
    gain = last_mps**2 - first_mps**2
    rate = up if gain > 0 else -down
    if gain / (2 * rate) > gap_m:
        # The speed is not reached there: what the rate gives.
        after = max(first_mps**2 + 2 * rate * gap_m, 0.0) ** 0.5
        return [((after - first_mps) / rate, rate)], gap_m <= 0
    # An agent that is slow drives up to the place first.
    peak = (first_mps**2 / up + last_mps**2 / down + 2 * gap_m) / (1 / up + 1 / down)
    # Speed up to which an agent drives on to a place where it waits or stops.
    between = max(first_mps, last_mps, min(peak**0.5, 5.0))
    legs = [
        _change(first_mps, between, up, down),
        _change(between, last_mps, up, down),
    ]
    held = max(gap_m - _length(first_mps, legs), 0.0)
    # A speed is reached so long before its place: trajectories of few latents are
    # smooth.
    early = min(held, 0.3 * last_mps)
    return [
        legs[0],
        ((held - early) / max(between, 0.01), 0.0),
        legs[1],
        (early / max(last_mps, 0.01), 0.0),
    ], True


def _timed(
    gap_m: float,
    first_mps: float,
    last_mps: float | None,
    duration_s: float,
    up: float,
    down: float,
) -> tuple[list[_Leg], bool]:
    """Legs that take a time, and whether they lead over the gap in it."""
    low, high = 0.0, 70.0
    legs: list[_Leg] = []
    for _ in range(40):
        between = (low + high) / 2
        begin = _change(first_mps, between, up, down)
        end = _change(between, between if last_mps is None else last_mps, up, down)
        held = duration_s - begin[0] - end[0]
        if held < 0:
            # Too far from the speeds at both ends for the time.
            is_fast = between > max(first_mps, last_mps or 0.0)
            low, high = (low, between) if is_fast else (between, high)
            continue
        legs = [begin, (held, 0.0), end]
        is_short = _length(first_mps, legs) < gap_m
        low, high = (between, high) if is_short else (low, between)
    if not legs:
        # Not even the speed is reached in the time.
        last = first_mps if last_mps is None else last_mps
        return _untimed(gap_m, first_mps, last, up, down)[0], False
    return legs, abs(_length(first_mps, legs) - gap_m) < 0.05


def _change(first_mps: float, last_mps: float, up: float, down: float) -> _Leg:
    rate = up if last_mps > first_mps else -down
    return (last_mps - first_mps) / rate, rate


def _length(first_mps: float, legs: Sequence[_Leg]) -> float:
    nodes = [(0.0, 0.0, first_mps)]
    _drive(nodes, legs)
    return nodes[-1][1]


@dataclass(frozen=True, kw_only=True)
class WayPoint:
    """A point of a path with what is asked there; None: nothing."""

    number: int
    point_m: Point
    speed_mps: float | None
    at_s: float | None
    waits_for: str | None

    @property
    def asks(self) -> str:
        """What is asked, in words; empty: nothing."""
        told = [] if self.waits_for is None else [f"wait for {self.waits_for}"]
        told += [] if self.speed_mps is None else [f"{self.speed_mps:g} m/s"]
        told += [] if self.at_s is None else [f"at {self.at_s:g} s"]
        return ", ".join(told)


@dataclass(frozen=True, kw_only=True, eq=False)
class WayPlan:
    """Way-points that ask for something on the path that an agent follows."""

    points: tuple[WayPoint, ...]
    place_m: tuple[float, ...]
    numbers_behind: tuple[int, ...]
    """Way-points behind the agent that ask for something."""
    course_m: Float[np.ndarray, "M 2"]
    first_mps: float
    width_m: float

    @classmethod
    def of(
        cls,
        points: Sequence[WayPoint],
        followed: FollowedPath,
        width_m: float,
    ) -> "WayPlan":
        """The plan of all points of a path; those behind the agent ask for nothing."""
        course = followed.path.points_m[0]
        line = np.array([one.point_m for one in points])
        arc = arc_length(line) - followed.start_m
        gap = np.linalg.norm(course - line[:, None], axis=-1)
        nodes = SPACING_M * np.arange(len(course))
        # Of two places as near to a way-point, the one at its arc length is meant.
        near = (gap + 0.1 * np.abs(nodes - arc[:, None])).argmin(axis=1)
        place = _along_m(course, line, near)
        asking = [
            one for one in zip(points, place.tolist(), strict=True) if one[0].asks
        ]
        found = [(one, at) for one, at in asking if at > 0]
        return cls(
            points=tuple(one for one, _ in found),
            place_m=tuple(at for _, at in found),
            numbers_behind=tuple(one.number for one, at in asking if at <= 0),
            course_m=course,
            first_mps=followed.first_mps,
            width_m=width_m,
        )

    def pace(self, rates: Rates, passed_s: Callable[[WayPoint, float], float]) -> Pace:
        """Pace that meets what is asked for, as far as it can.

        ``passed_s`` tells when the agent that a way-point names has passed its place.
        """
        asks = [
            Ask(
                along_m=place,
                speed_mps=one.speed_mps,
                at_s=one.at_s,
                release_s=None if one.waits_for is None else passed_s(one, place),
            )
            for one, place in zip(self.points, self.place_m, strict=True)
        ]
        return pace_of(asks, self.first_mps, rates)

    def cruise_mps(self) -> float:
        """Speed at which the agent drives off after a wait."""
        # Speed at which an agent drives off after a wait, if it was slower before.
        return max(self.first_mps, 8.0)

    def passed_s(
        self,
        place_m: float,
        other: Track,
        is_there: Bool[np.ndarray, "T"],
        step_s: float,
    ) -> float:
        """Time at which another agent has passed a place of the path.

        It has when it leaves the part of the path ahead of the place that it crosses
        first, or, if it crosses none, when it is nearest to the place. Infinite if it
        does not in its trajectory.
        """
        first = int(place_m / SPACING_M)
        course = self.course_m[first : first + int(40.0 / SPACING_M) + 1]
        half = other.size_m[0] / 2 * unit_vector(other.heading_rad)
        body = np.stack([other.position_m + share * half for share in (-1, 0, 1)], 1)
        gap = np.linalg.norm(body[:, :, None] - course, axis=-1).min(axis=1)
        near = (self.width_m + other.size_m[1]) / 2 + 0.3
        blocks = (gap < near) & is_there[:, None]
        there = np.flatnonzero(is_there)
        if not len(there):
            return 0.0
        if blocks.any():
            begin = int(blocks.any(axis=0).argmax())
            # Length of the part of the path that another agent has to leave to have
            # passed.
            zone = blocks[:, begin : begin + int(6.0 / SPACING_M) + 1]
            last = int(np.flatnonzero(zone.any(axis=1))[-1]) + 1
        else:
            last = int(there[gap[there, 0].argmin()])
        return np.inf if last >= there[-1] else last * step_s


def _along_m(
    course_m: Float[np.ndarray, "M 2"],
    place_m: Float[np.ndarray, "N 2"],
    node: Int[np.ndarray, "N"],
) -> Float[np.ndarray, "N"]:
    """Arc lengths of the course beside places that are near to some of its nodes."""
    ahead = np.gradient(course_m, SPACING_M, axis=0)[node]
    return SPACING_M * node + ((place_m - course_m[node]) * ahead).sum(-1)


def hardest_rates(plan: WayPlan) -> Rates:
    """Rates up to which what is asked for counts as possible."""
    return Rates(
        up=FIRM_ACCELERATION_MPS2,
        down=MAX_BRAKING_MPS2,
        hardest_up=FIRM_ACCELERATION_MPS2,
        hardest_down=MAX_BRAKING_MPS2,
        cruise_mps=plan.cruise_mps(),
    )


def way_point_problems(
    plan: WayPlan, agent: AgentNow, tracks: Callable[[str], Track | None]
) -> Found:
    """What an agent cannot meet at its way-points.

    ``tracks`` are those of agents that are kept; None: it is generated.
    """
    step_s = agent.scenario.time_axis.step_s
    passed: dict[int, float] = {}

    def passed_s(one: WayPoint, place: float) -> float:
        other = tracks(str(one.waits_for))
        if other is None:
            # Nothing is known of it: neither that the agent waits, nor for how long.
            return 0.0
        is_there = np.ones(len(other.heading_rad), bool)
        passed[one.number] = plan.passed_s(place, other, is_there, step_s)
        return passed[one.number]

    pace = plan.pace(hardest_rates(plan), passed_s)
    for number in plan.numbers_behind:
        yield (
            f"Way-point {number} of {agent.name} is behind it, so what is asked there has "
            "no effect; move it ahead."
        )
    met = zip(plan.points, plan.place_m, pace.arrivals, strict=True)
    for one, place, (at_s, along, speed) in met:
        what = f"Way-point {one.number} of {agent.name}"
        if np.isinf(passed.get(one.number, 0.0)):
            yield (
                f"Agent {one.waits_for} does not pass way-point {one.number} of "
                f"{agent.name} in the scenario, so it would wait to the end; name another "
                "agent."
            )
            return
        if one.at_s is not None and one.at_s > agent.duration_s + 1e-6:
            yield (
                f"{what} is asked for at {one.at_s:g} s, and trajectories last "
                f"{agent.duration_s:.1f} s; ask for less."
            )
            return
        # Deviation from its place up to which a way-point counts as possible.
        if one.at_s is not None and abs(place - along) > 0.5:
            side = "short of" if along < place else "beyond"
            yield (
                f"{what} is asked for at {one.at_s:g} s, when it is {abs(place - along):.0f} "
                f"m {side} it at best; allow {'more' if along < place else 'less'} time."
            )
            return
        is_held = passed.get(one.number, 0.0) > at_s
        asked = 0.0 if is_held else None if one.waits_for else one.speed_mps
        if asked is not None and abs(speed - asked) > OBEYED.speed_mps:
            yield (
                f"{what} asks for {asked:.1f} m/s, and it has {speed:.1f} m/s there at "
                "best; ask for another speed, or move it further."
            )
            return


def way_points_measured(plan: WayPlan, driven: Driven, line: Measured) -> Measured:
    """What was asked and achieved at way-points, with the worst of it.

    ``line`` is how the path was kept, which counts as well.
    """
    (row,) = driven.rows
    place = driven.sample.position_m[row]
    gap = np.linalg.norm(place[:, None] - plan.course_m, axis=-1)
    along = np.maximum.accumulate(_along_m(plan.course_m, place, gap.argmin(axis=1)))
    speed = driven.speed_mps()[row]
    step = np.arange(len(along))
    told: list[tuple[float, str, float, str]] = []
    for one, at in zip(plan.points, plan.place_m, strict=True):
        passes = along >= at
        when = float(np.interp(at, along, step)) if passes.any() else len(along) - 1.0
        name = f"way-point {one.number}"
        if one.at_s is not None:
            due = min(one.at_s / driven.step_s, len(along) - 1)
            off = abs(float(np.interp(due, step, along)) - at)
            told.append((off / OBEYED.goal_m, f"{off:.1f} m off {name}", off, "m"))
        if one.waits_for is not None:
            other = driven.track(one.waits_for)
            if other is None:
                continue
            there = np.ones(len(other.heading_rad), bool)
            passed = plan.passed_s(at, other, there, driven.step_s) / driven.step_s
            # An agent that waits may drive so far beyond its way-point.
            begun = along >= at + 1.0
            left = float(step[begun][0]) if begun.any() else np.inf
            early = max(min(passed, len(along)) - left, 0.0) * driven.step_s
            words = f"drives on {early:.1f} s early" if early else "lets it pass"
            told.append((2 * early, f"{words} at {name}", early, "s"))
        elif one.speed_mps is not None:
            mps = float(np.interp(when, step, speed))
            off = abs(mps - one.speed_mps)
            words = (
                f"{mps:.1f} m/s at {name}" if passes.any() else f"{name} not reached"
            )
            off = off if passes.any() or one.speed_mps == 0 else max(off, 1.0)
            told.append((off / OBEYED.speed_mps, words, off, "m/s"))
    worst = max(told, default=None)
    asked = "; ".join(f"{one.asks} at way-point {one.number}" for one in plan.points)
    return Measured(
        asked=f"{line.asked}, {asked}",
        achieved="; ".join([line.achieved, *(words for _, words, *_ in told)]),
        error=line.error if worst is None else worst[2],
        unit=line.unit if worst is None else worst[3],
        is_obeyed=line.is_obeyed and (worst is None or worst[0] <= 1.0),
    )
