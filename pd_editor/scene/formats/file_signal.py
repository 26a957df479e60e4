"""Traffic signals as foreign files have them, and the words for their states."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from jaxtyping import Float, Int

from pd_editor.base.plain_text import MAX_ID_CHARACTERS, one_line
from pd_editor.scene.road_map import Lane
from pd_editor.scene.signals import Signal, SignalState

WORDS: Final = {
    SignalState.UNKNOWN: ("unknown", "inactive", "O"),
    SignalState.STOP: ("stop", "red", "r", "redYellow", "u", "s"),
    SignalState.CAUTION: ("caution", "yellow", "y", "o"),
    SignalState.GO: ("go", "green", "G", "g"),
}
"""Waymo's word, CommonRoad's, SUMO's letter; then what else means the same."""
_STATE_OF: Final = {word: state for state, words in WORDS.items() for word in words}
ON_GRID_S: Final = 1e-3
"""Times this near to multiples of the step are taken as they are."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FileSignal:
    """A signal, in the file's frame and times."""

    signal_id: str
    stop_m: Mapping[int, Float[np.ndarray, "2"] | None]
    """Place of the stop line on each lane, by its id; None: the file does not tell."""
    begins_s: Sequence[float] = ()
    """Times from which the words hold."""
    words: Sequence[Any] = ()
    holds_s: float = np.inf
    """Time for which a word holds at most."""
    period_s: float | None = None
    """Time after which the words come again."""

    def states(
        self, times_s: Float[np.ndarray, "T"], unknown: set[str]
    ) -> Int[np.ndarray, "T"]:
        """State at some times; words that are not known are added to ``unknown``."""
        number = min(len(self.begins_s), len(self.words))
        if not number:
            return np.zeros(len(times_s), np.int8)
        begins = np.array(self.begins_s[:number], float)
        order = np.argsort(begins, kind="stable")
        codes = np.array(
            [_state_of(self.words[row], unknown) for row in order], np.int8
        )
        begins, times = begins[order], times_s + ON_GRID_S
        if self.period_s is not None:
            times = begins[0] + (times - begins[0]) % self.period_s
        row = np.searchsorted(begins, times, side="right") - 1
        known = (row >= 0) & (times - begins[row] < self.holds_s)
        return np.where(known, codes[row], np.int8(SignalState.UNKNOWN))


def cyclic_signal(
    signal_id: str,
    stop_m: Mapping[int, Float[np.ndarray, "2"] | None],
    phases: Sequence[tuple[float, Any]],
    offset_s: float,
) -> FileSignal:
    """A signal with phases of some seconds and a word, the first of which begins then."""
    begins = offset_s + np.cumsum([0.0, *(seconds for seconds, _ in phases)])
    return FileSignal(
        signal_id=signal_id,
        stop_m=stop_m,
        begins_s=begins[:-1].tolist(),
        words=[word for _, word in phases],
        period_s=float(begins[-1]) - offset_s if phases else None,
    )


def sampled_signals(
    found: Sequence[FileSignal],
    lanes: Sequence[Lane],
    times_s: Float[np.ndarray, "T"],
) -> tuple[tuple[Signal, ...], tuple[str, ...]]:
    """Signals of known lanes at some times, and sentences on what is left out."""
    free = {one.lane_id: one for one in lanes}
    words: set[str] = set()
    signals, nowhere = [], 0
    for one in found:
        here = [free.pop(number) for number in one.stop_m if number in free]
        nowhere += not here
        if here:
            shares = [_share(one.stop_m[lane.lane_id], lane) for lane in here]
            signals.append(
                Signal(
                    signal_id=one_line(one.signal_id, MAX_ID_CHARACTERS),
                    lane_ids=tuple(lane.lane_id for lane in here),
                    stop_share=np.array(shares),
                    states=one.states(times_s, words),
                )
            )
    uneven = sum(len(one.begins_s) != len(one.words) for one in found)
    some = ", ".join(repr(one) for one in sorted(words)[:3])
    told = (
        (nowhere, f"Signals without a lane of their own are left out: {nowhere}."),
        (uneven, f"Signals with more or fewer states than times: {uneven}."),
        (words, f"States of signals with unknown words ({some}) are unknown."),
    )
    return tuple(signals), tuple(text for holds, text in told if holds)


def _share(stop_m: Float[np.ndarray, "2"] | None, lane: Lane) -> float:
    """Share of a place on a lane; if it is not told, where the junction begins."""
    if stop_m is None or not np.isfinite(stop_m).all():
        return 0.0 if lane.is_intersection else 1.0
    line = shapely.LineString(lane.centerline_m)
    return float(line.project(shapely.Point(stop_m), normalized=True))


def _state_of(word: Any, unknown: set[str]) -> SignalState:
    text = "unknown" if word is None else str(word)[:MAX_ID_CHARACTERS]
    plain = re.sub(
        "^(lane_state_|traffic_light_)?(arrow_|flashing_)?", "", text.lower()
    )
    state = _STATE_OF.get(text, _STATE_OF.get(plain))
    if state is None:
        unknown.add(text)
    return state or SignalState.UNKNOWN
