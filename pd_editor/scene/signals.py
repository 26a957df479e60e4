"""Traffic signals: lanes that obey them, stop lines, and the state at each step."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pd_editor.scene.road_map import RoadMap

_TOGETHER_M: Final = 1.0
"""Lanes that begin so near to each other have one stop line."""


class SignalState(IntEnum):
    """What a signal tells those who arrive at it."""

    UNKNOWN = 0
    STOP = 1
    CAUTION = 2
    GO = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Signal:
    """A signal of L lanes over the T steps of a scenario; a lane obeys one at most."""

    signal_id: str
    lane_ids: tuple[int, ...]
    stop_share: Float[np.ndarray, "L"]
    """Place of the stop line on each lane, from 0, the start of its centre line, to 1.

    So stop lines go where lanes go, whatever moves or bends the road.
    """
    states: Int[np.ndarray, "T"]
    """``SignalState`` at each step."""

    def __post_init__(self) -> None:
        assert len(self.stop_share) == len(self.lane_ids)
        self.stop_share.flags.writeable = False
        self.states.flags.writeable = False

    def phases(self, step_s: float) -> list[tuple[SignalState, float]]:
        """States and the seconds for which they hold, one after the other."""
        begins = np.flatnonzero(np.diff(self.states, prepend=-1))
        seconds = np.diff(begins, append=len(self.states)) * step_s
        states = map(SignalState, self.states[begins].tolist())
        return list(zip(states, seconds.tolist(), strict=True))


def signals_of_lanes(
    signals: Iterable[Signal], lane_ids: Collection[int]
) -> tuple[Signal, ...]:
    """Signals with those of their lanes that are among some; none without lanes."""
    kept = [(one, [lane in lane_ids for lane in one.lane_ids]) for one in signals]
    return tuple(
        replace(
            one,
            lane_ids=tuple(
                n for n, stays in zip(one.lane_ids, stay, strict=True) if stays
            ),
            stop_share=one.stop_share[stay],
        )
        for one, stay in kept
        if any(stay)
    )


def states_at(signals: Iterable[Signal], step: int) -> dict[int, SignalState]:
    """State at a step of each lane that obeys a signal, in the order of ``stop_lines``."""
    return {n: SignalState(one.states[step]) for one in signals for n in one.lane_ids}


def closed_lines(
    signals: Sequence[Signal], road_map: RoadMap
) -> tuple[Float[np.ndarray, "L 3 2"], Bool[np.ndarray, "L T"]]:
    """Stop lines, and when all lanes that begin there have to stop."""
    lines = stop_lines(signals, road_map)
    states = np.array([one.states for one in signals for _ in one.lane_ids])
    stops = np.isin(states, [SignalState.STOP, SignalState.CAUTION])
    middle = lines[:, 1]
    apart = np.linalg.norm(middle[:, None] - middle, axis=-1) > _TOGETHER_M
    return lines, (stops | apart[..., None]).all(axis=1)


def stop_lines(
    signals: Sequence[Signal], road_map: RoadMap
) -> Float[np.ndarray, "L 3 2"]:
    """Stop lines across the lanes of signals in turn: left end, middle, right end."""
    lanes = [road_map.lane_of[lane] for one in signals for lane in one.lane_ids]
    if not lanes:
        return np.zeros((0, 3, 2))
    center, left, right = (
        np.array([shapely.LineString(line) for line in lines])
        for lines in zip(
            *((n.centerline_m, n.left_m, n.right_m) for n in lanes), strict=True
        )
    )
    share = np.concatenate([one.stop_share for one in signals])
    middle = shapely.line_interpolate_point(center, share, normalized=True)
    ends = [
        shapely.line_interpolate_point(side, shapely.line_locate_point(side, middle))
        for side in (left, right)
    ]
    return (
        shapely.get_coordinates([ends[0], middle, ends[1]])
        .reshape(3, -1, 2)
        .swapaxes(0, 1)
    )
