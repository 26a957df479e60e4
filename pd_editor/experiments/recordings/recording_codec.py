"""Codec of recordings: JSON values and quantised states."""

from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.experiments.recordings.integer_codec import coded, decoded
from pd_editor.experiments.recordings.map_codec import coded_map, decoded_map
from pd_editor.experiments.recordings.recording import Recording
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.signals import Signal

POSITION_STEP_M: Final = 0.01
HEADING_STEP_RAD: Final = 0.001
VELOCITY_STEP_MPS: Final = 0.02
SIZE_STEP_M: Final = 0.01
_STEPS: Final = np.array(
    [POSITION_STEP_M] * 2 + [HEADING_STEP_RAD] + [VELOCITY_STEP_MPS] * 2
)
_KIND_OF: Final = {kind.value: kind for kind in AgentKind}


def coded_recording(recording: Recording) -> tuple[dict[str, Any], bytes, bytes]:
    """Encode a recording as a description, its states, and its map's points."""
    map_about, points = coded_map(recording.road_map)
    about = {
        "name": recording.name,
        "city": recording.city,
        "origin_city_m": recording.origin_city_m.tolist(),
        "step_s": recording.step_s,
        "num_steps": recording.num_steps,
        "ids": recording.ids,
        "kinds": [kind.value for kind in recording.kinds],
        "size": np.rint(recording.size_m / SIZE_STEP_M).astype(int).tolist(),
        "parked": np.flatnonzero(recording.is_parked).tolist(),
        "first_step": recording.first_step.tolist(),
        "counts": np.diff(recording.first_row).tolist(),
        "map": map_about,
        "signals": [_coded_signal(one) for one in recording.signals],
    }
    columns = np.column_stack(
        [
            recording.position_m,
            _unwrapped(recording.heading_rad, recording.first_row),
            recording.velocity_mps,
        ]
    )
    numbers = np.rint(columns / _STEPS).astype(np.int64)
    is_still = _is_still(numbers, recording.first_row)
    about["still"] = np.flatnonzero(is_still).tolist()
    numbers = numbers[_is_coded(recording.first_row, is_still)]
    first_row = _coded_first_row(np.diff(recording.first_row), is_still)
    rows = b"".join(coded(one, first_row) for one in numbers.T)
    return about, rows, points


def _is_still(
    numbers: Int[np.ndarray, "P C"], first_row: Int[np.ndarray, "A_plus_1"]
) -> Bool[np.ndarray, "A"]:
    """Whether all states of an agent are equal; then only the first one is encoded."""
    first = np.repeat(numbers[first_row[:-1]], np.diff(first_row), axis=0)
    is_other = np.concatenate([[0], np.cumsum((numbers != first).any(axis=1))])
    return is_other[first_row[1:]] == is_other[first_row[:-1]]


def _is_coded(
    first_row: Int[np.ndarray, "A_plus_1"], is_still: Bool[np.ndarray, "A"]
) -> Bool[np.ndarray, "P"]:
    keep = ~np.repeat(is_still, np.diff(first_row))
    keep[first_row[:-1]] = True
    return keep


def _coded_first_row(
    counts: Int[np.ndarray, "A"], is_still: Bool[np.ndarray, "A"]
) -> Int[np.ndarray, "A_plus_1"]:
    return np.concatenate([[0], np.cumsum(np.where(is_still, 1, counts))])


def decoded_recording(about: dict[str, Any], rows: bytes, points: bytes) -> Recording:
    """Decode a recording; inverse of ``coded_recording`` up to rounding.

    Raises:
        KeyError, TypeError, ValueError: the values are not those of a recording.
    """
    counts = np.array(about["counts"], np.int64).reshape(-1)
    first_step = np.array(about["first_step"], np.int64).reshape(-1)
    ends = first_step + counts
    if (counts < 1).any() or (first_step < 0).any() or len(counts) != len(first_step):
        raise ValueError("an agent has no steps")
    if (ends > about["num_steps"]).any():
        raise ValueError("an agent has steps after the last")
    first_row = np.concatenate([[0], np.cumsum(counts)])
    is_parked, is_still = np.zeros((2, len(counts)), bool)
    is_parked[np.array(about["parked"], int)] = True
    is_still[np.array(about["still"], int)] = True
    coded_first_row = _coded_first_row(counts, is_still)
    times = np.ones(coded_first_row[-1], int)
    times[coded_first_row[:-1][is_still]] = counts[is_still]
    size = len(rows) // len(_STEPS)
    columns = [
        np.repeat(
            decoded(rows[k * size : (k + 1) * size], coded_first_row) * step,
            times,
        )
        for k, step in enumerate(_STEPS)
    ]
    return Recording(
        name=about["name"],
        road_map=decoded_map(about["map"], points),
        city=about["city"],
        origin_city_m=np.array(about["origin_city_m"], float),
        step_s=about["step_s"],
        num_steps=about["num_steps"],
        ids=tuple(about["ids"]),
        kinds=tuple(_KIND_OF[name] for name in about["kinds"]),
        size_m=np.array(about["size"], float).reshape(-1, 2) * SIZE_STEP_M,
        is_parked=is_parked,
        first_step=first_step,
        first_row=first_row,
        position_m=np.stack(columns[:2], axis=-1),
        heading_rad=wrap_angle(columns[2]),
        velocity_mps=np.stack(columns[3:], axis=-1),
        signals=tuple(
            _decoded_signal(one, about["num_steps"]) for one in about.get("signals", ())
        ),
    )


def _coded_signal(signal: Signal) -> list[Any]:
    """Name, lanes, places of stop lines, and the steps from which states hold."""
    begins = np.flatnonzero(np.diff(signal.states, prepend=-1))
    share = signal.stop_share.round(3).tolist()
    states = signal.states[begins].tolist()
    return [signal.signal_id, signal.lane_ids, share, begins.tolist(), states]


def _decoded_signal(values: list[Any], num_steps: int) -> Signal:
    name, lanes, share, begins, states = values
    times = np.diff([*begins, num_steps])
    return Signal(
        signal_id=name,
        lane_ids=tuple(lanes),
        stop_share=np.array(share, float).reshape(-1),
        states=np.repeat(np.array(states, np.int8), times),
    )


def _unwrapped(
    heading: Float[np.ndarray, "P"], first_row: Int[np.ndarray, "A_plus_1"]
) -> Float[np.ndarray, "P"]:
    """Headings, unwrapped within each agent."""
    turns = wrap_angle(np.diff(heading, prepend=0.0))
    starts = first_row[:-1]
    turns[starts] = heading[starts]
    total = np.cumsum(turns)
    before = np.concatenate([[0.0], total])[starts]
    return total - np.repeat(before, np.diff(first_row))
