import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as hnp

from pd_editor.experiments.recordings.clip import (
    MIN_TRACK_STEPS,
    TrackingNoise,
    cut_scenario,
    runs_of,
)
from pd_editor.experiments.recordings.clip_selection import choose_windows
from pd_editor.experiments.recordings.recording import Window
from pd_editor.scene.agent_kind import AgentCategory
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import check_with_official_loaders, scenario_files
from tests.experiments.recordings.recordings import drive, recording_of


def window_about(recording, row: int, step: int, seed: int = 0) -> Window:
    at = recording.first_row[row] + step - recording.first_step[row]
    x, y = recording.position_m[at]
    return Window(
        current_step=step,
        center_m=(float(x), float(y)),
        focal_id=recording.ids[row],
        seed=seed,
    )


@pytest.mark.parametrize("noise", [None, TrackingNoise()])
def test_a_scenario_has_argoverse_form(noise):
    recording = drive()
    for window in choose_windows(recording, seed=3, num_windows=12):
        scenario = cut_scenario(recording, window, noise=noise)
        agents = scenario.agents
        categories = np.array(agents.categories)
        is_full = agents.is_valid.all(axis=1)
        assert agents.num_steps == 110
        assert scenario.current_step == 49
        assert ((categories != AgentCategory.FRAGMENT) == is_full).all()
        assert (agents.is_valid.sum(axis=1) >= MIN_TRACK_STEPS).all()
        assert (np.abs(np.diff(agents.is_valid.astype(int))).sum(axis=1) <= 2).all()
        assert (agents.observed == agents.is_valid & (np.arange(110) < 50)).all()
        assert (agents.position_m[~agents.is_valid] == 0).all()
        focal = agents.row_of[scenario.focal_id]
        assert (categories == AgentCategory.FOCAL).sum() == 1
        assert categories[focal] == AgentCategory.FOCAL
        ego = agents.row_of["AV"]
        assert categories[ego] == AgentCategory.UNSCORED
        assert agents.has_known_size.all()
        assert len(scenario.road_map.lanes) > 0


def test_states_are_those_of_the_recording():
    recording = drive()
    window = window_about(recording, 1, 150)
    agents = cut_scenario(recording, window).agents
    row = recording.first_row[1] + 150 - 49 - recording.first_step[1]
    focal = agents.row_of[window.focal_id]
    np.testing.assert_array_equal(
        agents.position_m[focal], recording.position_m[row : row + 110]
    )
    np.testing.assert_array_equal(agents.size_m[focal], recording.size_m[1])


def test_signals_have_the_states_of_the_window():
    recording = drive()
    (window,) = choose_windows(recording, 1, num_windows=1)
    (signal,) = cut_scenario(recording, window).signals
    first = window.current_step - 49
    expected = recording.signals[0].states[first : first + 110]
    assert signal.states.tolist() == expected.tolist()
    assert set(signal.lane_ids) <= {1, 3}


def test_agents_outside_the_square_now_are_there_while_inside_it():
    recording = drive(30)
    window = window_about(recording, 1, 150)
    agents = cut_scenario(recording, window, side_m=60).agents
    away = np.abs(agents.position_m - np.array(window.center_m)).max(axis=-1)
    for row in range(len(agents)):
        valid = agents.is_valid[row]
        if valid[49] and away[row, 49] <= 30:
            continue
        assert (away[row, valid] <= 30).all()


def test_the_same_window_gives_the_same_scenario():
    recording = drive()
    window = window_about(recording, 2, 160)
    one, two = (cut_scenario(recording, window) for _ in range(2))
    assert one.scenario_id == two.scenario_id
    assert one.agents.ids == two.agents.ids
    other = cut_scenario(recording, window_about(recording, 2, 161))
    assert other.scenario_id != one.scenario_id


def test_the_map_is_what_lies_near_the_main_agents():
    recording = drive()
    lanes = recording.road_map.lane_of
    window = window_about(recording, 1, 150)
    scenario = cut_scenario(recording, window)
    rows = [
        row
        for row, category in enumerate(scenario.agents.categories)
        if category >= 2 or scenario.agents.ids[row] == "AV"
    ]
    paths = scenario.agents.position_m[rows].reshape(-1, 2)
    kept = {lane.lane_id for lane in scenario.road_map.lanes}
    for lane_id, lane in lanes.items():
        gap = np.linalg.norm(lane.centerline_m[:, None] - paths, axis=-1).min()
        if abs(gap - 35) > 1.5:
            assert (lane_id in kept) == (gap < 35)


def test_argoverse_loaders_take_it(tmp_path):
    recording = drive()
    window = choose_windows(recording, seed=0, num_windows=3)[0]
    scenario = cut_scenario(recording, window)
    for name, data in scenario_files(scenario).items():
        (tmp_path / name).write_bytes(data)
    check_with_official_loaders(tmp_path)
    again = read_scenario(tmp_path)
    assert again.agents.ids == scenario.agents.ids
    assert again.agents.has_known_size.all()
    assert again.time_axis.step_s == scenario.time_axis.step_s


@pytest.mark.real_data
def test_a_real_scenario_cut_from_itself_keeps_its_main_agents(av2_scenario_folders):
    folder = next(one for one in av2_scenario_folders if one.parent.name == "train")
    real = read_scenario(folder)
    recording = recording_of(real)
    window = window_about(recording, real.agents.row_of[real.focal_id], 49)
    cut = cut_scenario(recording, window, side_m=2000.0)
    same = [name for name in cut.agents.ids if name in real.agents.row_of]
    assert len(same) >= len(real.agents) - 1
    for name in same:
        if name != "AV":
            np.testing.assert_array_equal(
                cut.agents.position_m[cut.agents.row_of[name]],
                real.agents.position_m[real.agents.row_of[name]],
            )


@given(
    hnp.arrays(bool, hnp.array_shapes(min_dims=2, max_dims=2, max_side=40)),
)
@settings(max_examples=60, deadline=None)
def test_each_run_becomes_a_track(is_valid):
    rows, runs = runs_of(is_valid)
    expected = []
    for row in range(len(is_valid)):
        text = "".join("x" if one else " " for one in is_valid[row])
        expected += [(row, len(run)) for run in text.split() if len(run) >= 10]
    found = [(int(row), int(run.sum())) for row, run in zip(rows, runs, strict=True)]
    assert found == expected
    for row, run in zip(rows, runs, strict=True):
        assert not (run & ~is_valid[row]).any()
        assert np.abs(np.diff(np.pad(run.astype(int), 1))).sum() == 2
