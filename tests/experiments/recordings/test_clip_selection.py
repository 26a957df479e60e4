import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.experiments.recordings.clip import cut_scenario
from pd_editor.experiments.recordings.clip_selection import (
    MIN_FOCAL_PATH_M,
    choose_windows,
)
from tests.experiments.recordings.recordings import drive


@given(st.integers(0, 50))
@settings(max_examples=15, deadline=None)
def test_windows_are_about_agents_that_move_and_stay(seed):
    recording = drive(seed=seed)
    windows = choose_windows(recording, seed, num_windows=15)
    assert list(windows) == sorted(windows, key=lambda one: one.current_step)
    for window in windows:
        row = recording.ids.index(window.focal_id)
        assert not recording.is_parked[row]
        assert 49 <= window.current_step < recording.num_steps - 60
        scenario = cut_scenario(recording, window)
        focal = scenario.agents.row_of[window.focal_id]
        position = scenario.agents.position_m[focal]
        assert np.linalg.norm(position[-1] - position[0]) >= MIN_FOCAL_PATH_M
        np.testing.assert_allclose(position[49], window.center_m)


def test_a_recording_that_is_too_short_has_no_windows():
    assert choose_windows(drive(num_steps=109), 0) == ()


def test_the_same_seed_gives_the_same_windows():
    recording = drive()
    assert choose_windows(recording, 4) == choose_windows(recording, 4)
    assert choose_windows(recording, 4) != choose_windows(recording, 5)


def test_windows_are_spread_in_time_and_over_agents():
    recording = drive(20)
    windows = choose_windows(recording, 0, num_windows=29)
    steps = np.array([window.current_step for window in windows])
    assert len(windows) == 29
    assert np.diff(steps).max() <= 40
    assert len({window.focal_id for window in windows}) >= 6


def test_where_no_focal_moves_there_is_no_window():
    recording = drive(5)
    parked = dataclasses.replace(recording, is_parked=np.ones(5, bool))
    assert choose_windows(parked, 0) == ()
    no_focal = dataclasses.replace(
        recording,
        ids=(),
        kinds=(),
        size_m=np.zeros((0, 2)),
        is_parked=np.zeros(0, bool),
        first_step=np.zeros(0, int),
        first_row=np.zeros(1, int),
        position_m=np.zeros((0, 2)),
        heading_rad=np.zeros(0),
        velocity_mps=np.zeros((0, 2)),
    )
    assert choose_windows(no_focal, 0) == ()
