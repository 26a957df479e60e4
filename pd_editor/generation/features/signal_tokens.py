"""What traffic signals tell those who drive along each piece of a lane."""

from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.generation.features.lane_tokens import LanePieces
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import SignalState, states_at

PIECE_SIGNAL: Final = ("stop", "go")
"""What the signal ahead says, 0 without one; both are a half where it says caution.

Through a junction both are those of the movement; on the way to it the mean over the
movements, times a factor that falls from 1 at the stop line to 0 ``REACH_M`` before it.
"""
REACH_M: Final = 80.0
"""Distance from a stop line at which its signal is out of sight."""
_SAYS: Final = {
    SignalState.STOP: (1.0, 0.0),
    SignalState.CAUTION: (0.5, 0.5),
    SignalState.GO: (0.0, 1.0),
}


def piece_signals(scenario: Scenario, pieces: LanePieces) -> Float[np.ndarray, "P 2"]:
    """Signals of the pieces of a scenario's map at the current step."""
    found = np.zeros((len(pieces.kind), len(PIECE_SIGNAL)))
    graph = lane_graph(scenario.road_map)
    says, stop_m, is_own = _own_signals(scenario, graph)
    if not is_own.any():
        return found
    says, stop_m = _seen_ahead(scenario, graph, says, stop_m, is_own)
    is_lane = pieces.lane >= 0
    lane = pieces.lane[is_lane]
    gap = stop_m[lane] - pieces.middle[is_lane] * graph.lengths_m[lane]
    nearness = np.clip(1 - np.maximum(gap, 0.0) / REACH_M, 0.0, 1.0)
    found[is_lane] = says[lane] * nearness[:, None]
    return found


def _own_signals(
    scenario: Scenario, graph: LaneGraph
) -> tuple[Float[np.ndarray, "L 2"], Float[np.ndarray, "L"], np.ndarray]:
    """What each lane's own signal says, where its stop line is, and whether it has one."""
    says = np.zeros((len(graph.lane_ids), len(PIECE_SIGNAL)))
    stop_m = np.full(len(says), np.inf)
    shares = [share for one in scenario.signals for share in one.stop_share]
    states = states_at(scenario.signals, scenario.current_step)
    for (lane_id, state), share in zip(states.items(), shares, strict=True):
        row = graph.row_of.get(lane_id)
        if row is not None and state in _SAYS:
            says[row] = _SAYS[state]
            stop_m[row] = share * graph.lengths_m[row]
    return says, stop_m, np.isfinite(stop_m)


def _seen_ahead(
    scenario: Scenario,
    graph: LaneGraph,
    says: Float[np.ndarray, "L 2"],
    stop_m: Float[np.ndarray, "L"],
    is_own: np.ndarray,
) -> tuple[Float[np.ndarray, "L 2"], Float[np.ndarray, "L"]]:
    """What the signals ahead of each lane say, and how far from its start they are."""
    links = [
        (row, other) for row, after in enumerate(graph.successors) for other in after
    ]
    if not links:
        return says, stop_m
    here, there = np.array(links).T
    inside = np.array(
        [scenario.road_map.lane_of[one].is_intersection for one in graph.lane_ids]
    )
    says, stop_m = says.copy(), stop_m.copy()
    # A lane through the junction obeys the signal at the end of the lane before it.
    follows = is_own[here] & ~inside[here] & inside[there] & ~is_own[there]
    says[there[follows]], stop_m[there[follows]] = says[here[follows]], 0.0
    is_open = ~is_own & ~inside
    while True:
        seen = is_open[here] & (stop_m[there] < REACH_M)
        if not seen.any():
            return says, stop_m
        count = np.bincount(here[seen], minlength=len(says))
        total, nearest = np.zeros_like(says), np.full(len(says), np.inf)
        np.add.at(total, here[seen], says[there[seen]])
        np.minimum.at(nearest, here[seen], stop_m[there[seen]])
        told = count > 0
        says[told] = total[told] / count[told, None]
        stop_m[told] = nearest[told] + graph.lengths_m[told]
        is_open &= ~told
