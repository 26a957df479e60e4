from dataclasses import replace

import numpy as np
import pytest

from pd_editor.generation.features.map_pieces import (
    PIECE_SIGNAL,
    REACH_M,
    lane_pieces,
    piece_signals,
)
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal, SignalState
from tests.builders import empty_tracks, scenario_with, straight_lane

STOP, GO = (PIECE_SIGNAL.index(name) for name in ("stop", "go"))


def crossing(*signals: tuple[int, float, SignalState]) -> Scenario:
    """A road of 100 m, straight on (2) and to the left (3) through a junction, and on (4)."""
    inside = [
        replace(
            straight_lane(2, (0, 0), (20, 0)), is_intersection=True, successors=(4,)
        ),
        replace(straight_lane(3, (0, 0), (20, 20)), is_intersection=True),
    ]
    road_map = RoadMap(
        lanes=(
            replace(straight_lane(1, (-100, 0), (0, 0)), successors=(2, 3)),
            *inside,
            straight_lane(4, (20, 0), (60, 0)),
        )
    )
    scenario = scenario_with(empty_tracks(110), road_map)
    steps = scenario.time_axis.num_steps
    return replace(
        scenario,
        signals=tuple(
            Signal(
                signal_id=str(lane),
                lane_ids=(lane,),
                stop_share=np.array([share]),
                states=np.full(steps, state, np.int8),
            )
            for lane, share, state in signals
        ),
    )


def told(scenario: Scenario) -> dict[int, np.ndarray]:
    pieces = lane_pieces(scenario.road_map)
    found = piece_signals(scenario, pieces)
    return {lane + 1: found[pieces.lane == lane] for lane in range(4)}


def test_without_signals_nothing_is_told():
    assert not any(one.any() for one in told(crossing()).values())
    unknown = crossing((2, 0.0, SignalState.UNKNOWN))
    assert not any(one.any() for one in told(unknown).values())


def test_movements_are_told_apart_and_their_approach_sees_the_mean():
    found = told(crossing((2, 0.0, SignalState.GO), (3, 0.0, SignalState.STOP)))
    assert (found[2][:, GO] == 1).all()
    assert not found[2][:, STOP].any()
    assert (found[3][:, STOP] == 1).all()
    assert not found[3][:, GO].any()
    assert not found[4].any()
    gap = np.arange(95, 0, -10)
    expected = np.clip(1 - gap / REACH_M, 0, 1) / 2
    assert found[1] == pytest.approx(np.stack([expected] * 2, axis=1))


def test_a_stop_line_at_the_end_of_the_approach_counts_for_what_follows():
    found = told(crossing((1, 1.0, SignalState.STOP)))
    assert (found[2][:, STOP] == 1).all()
    assert (found[3][:, STOP] == 1).all()
    assert np.argmax(found[1][:, STOP]) == len(found[1]) - 1
    assert not found[1][:, GO].any()
    assert not found[4].any()


def test_caution_is_between():
    found = told(crossing((2, 0.0, SignalState.CAUTION), (3, 0.0, SignalState.CAUTION)))
    assert (found[2] == 0.5).all()
    assert (found[3] == 0.5).all()
