"""Samples the windows of a recording: moving focal agents, spread in time and space."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.experiments.recordings.clip import FUTURE_STEPS, PAST_STEPS
from pd_editor.experiments.recordings.recording import Recording, Window
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.thresholds import STANDING_MPS

MIN_FOCAL_PATH_M: Final = 3.0
"""Least displacement of a focal agent; nine of ten of Argoverse 2's exceed 10 m."""
_KIND_WEIGHT: Final = {
    AgentKind.VEHICLE: 1.0,
    AgentKind.BUS: 1.0,
    AgentKind.MOTORCYCLIST: 1.0,
    AgentKind.CYCLIST: 0.5,
    AgentKind.PEDESTRIAN: 0.15,
}
_NEIGHBOUR_M: Final = 80.0
_NEARBY_M: Final = 40.0
_MAX_NEARBY: Final = 15
_APART_M: Final = 60.0
_APART_STEPS: Final = 100
"""Windows nearer than this to an earlier one, in space and time, are down-weighted."""


def choose_windows(
    recording: Recording, seed: int, *, num_windows: int = 80
) -> tuple[Window, ...]:
    """Sample at most ``num_windows`` windows, in the order of their times.

    The focal agent of each exists at all steps and moves. Equal seeds give equal
    windows.
    """
    random = np.random.default_rng([seed, 0x57494E44])
    last = recording.num_steps - 1 - FUTURE_STEPS
    if last < PAST_STEPS or not recording.ids:
        return ()
    weight = np.array([_KIND_WEIGHT.get(kind, 0.0) for kind in recording.kinds])
    weight = np.where(recording.is_parked, 0.0, weight)
    chosen: list[Window] = []
    # Passes through the recording for windows without an eligible agent.
    for _ in range(3):
        edges = np.linspace(PAST_STEPS, last + 1, num_windows - len(chosen) + 1)
        for step in random.uniform(edges[:-1], edges[1:]).astype(int).tolist():
            row = _focal_row(recording, step, weight, chosen, random)
            if row is None:
                continue
            # Factor by which the weight of an agent falls with each of its windows.
            weight[row] /= 3.0
            x, y = _position(recording, np.array([row]), step)[0]
            chosen.append(
                Window(
                    current_step=step,
                    center_m=(float(x), float(y)),
                    focal_id=recording.ids[row],
                    seed=int(random.integers(2**31)),
                )
            )
    return tuple(sorted(chosen, key=lambda one: one.current_step))


def _focal_row(
    recording: Recording,
    step: int,
    weight: Float[np.ndarray, "A"],
    chosen: list[Window],
    random: np.random.Generator,
) -> int | None:
    """Sample the row of a focal agent; None if no agent is eligible."""
    rows = _eligible(recording, step, weight)
    place = _position(recording, rows, step)
    starting = _starting(recording, step)
    chance = (
        weight[rows] * _spread_weight(place, step, chosen) * _neighbour_weight(place)
    )
    chance = chance * _density_weight(
        place, _position(recording, _in_traffic(recording, step), step)
    )
    starts = np.isin(rows, starting)
    # Share of windows with a stationary focal agent that starts, if there is one.
    if starts.any() and random.random() < 0.1:
        chance = np.where(starts, chance, 0.0)
    if not chance.sum() > 0:
        return None
    return int(rows[random.choice(len(rows), p=chance / chance.sum())])


def _eligible(
    recording: Recording, step: int, weight: Float[np.ndarray, "A"]
) -> Int[np.ndarray, "E"]:
    """Agents that exist throughout the window and move in it."""
    begins, lasts = step - PAST_STEPS, step + FUTURE_STEPS
    rows = np.flatnonzero(_is_there(recording, begins, lasts) & (weight > 0))
    way = _position(recording, rows, lasts) - _position(recording, rows, begins)
    return rows[np.linalg.norm(way, axis=-1) >= MIN_FOCAL_PATH_M]


def _is_there(recording: Recording, first: int, last: int) -> Bool[np.ndarray, "A"]:
    """Which agents exist from a step to another one."""
    return (recording.first_step <= first) & (recording.end_step > last)


def _position(
    recording: Recording, rows: Int[np.ndarray, "E"], step: int
) -> Float[np.ndarray, "E 2"]:
    return recording.position_m[recording.row_at(rows, step)]


def _spread_weight(
    place: Float[np.ndarray, "E 2"], step: int, chosen: list[Window]
) -> Float[np.ndarray, "E"]:
    """Weight of positions [E]: halved for each earlier window nearby."""
    recent = [one for one in chosen if abs(step - one.current_step) < _APART_STEPS]
    if not recent:
        return np.ones(len(place))
    gap = place[:, None] - np.array([one.center_m for one in recent])
    return 0.5 ** (np.linalg.norm(gap, axis=-1) < _APART_M).sum(axis=1)


def _neighbour_weight(place: Float[np.ndarray, "E 2"]) -> Float[np.ndarray, "E"]:
    """Weight of positions [E]: small without a neighbour that could be the ego."""
    gap = np.linalg.norm(place[:, None] - place, axis=-1)
    return np.where((gap < _NEIGHBOUR_M).sum(axis=1) > 1, 1.0, 0.05)


def _in_traffic(recording: Recording, step: int) -> Int[np.ndarray, "S"]:
    """Agents that exist at a step and are not parked."""
    return np.flatnonzero(_is_there(recording, step, step) & ~recording.is_parked)


def _density_weight(
    place: Float[np.ndarray, "E 2"], others: Float[np.ndarray, "S 2"]
) -> Float[np.ndarray, "E"]:
    """Weight of positions [E]: number of agents nearby; Argoverse 2 scenes are busy."""
    gap = np.linalg.norm(place[:, None] - others, axis=-1)
    return np.minimum((gap < _NEARBY_M).sum(axis=1), _MAX_NEARBY).astype(float)


def _starting(recording: Recording, step: int) -> Int[np.ndarray, "S"]:
    """Rows of stationary agents that move before the window's end."""
    is_there = _is_there(recording, step, step + FUTURE_STEPS)
    rows = np.flatnonzero(is_there & ~recording.is_parked)
    at = recording.row_at(rows, step)
    stands = np.linalg.norm(recording.velocity_mps[at], axis=-1) < STANDING_MPS
    way = recording.position_m[at + FUTURE_STEPS] - recording.position_m[at]
    return rows[stands & (np.linalg.norm(way, axis=-1) > 1.0)]
