"""Pace along a course on which speeds, times and waits are asked for at places."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

_TRIED_SHARES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
"""How far rates go from usual ones to the hardest, until what is asked for is met."""
_FOREVER_S: Final = 1e4

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
        release = -1.0 if ask.release_s is None else min(ask.release_s, _FOREVER_S)
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
