import pickle
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import InputError
from pd_editor.experiments.recordings import shards
from pd_editor.experiments.recordings.clip import cut_scenario
from pd_editor.experiments.recordings.clip_selection import choose_windows
from pd_editor.experiments.recordings.recording import (
    HEADING_STEP_RAD,
    MAP_STEP_M,
    POSITION_STEP_M,
    VELOCITY_STEP_MPS,
)
from pd_editor.experiments.recordings.shards import ShardReader, shard_bytes
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.angles import wrap_angle
from tests.experiments.recordings.recordings import drive, recording_of

TINY = 1e-9


def check_rounded(before, after):
    for name in ("ids", "kinds", "name", "city", "num_steps", "step_s"):
        assert getattr(before, name) == getattr(after, name)
    for name in ("is_parked", "first_step", "first_row", "origin_city_m"):
        np.testing.assert_array_equal(getattr(before, name), getattr(after, name))
    for name, step in (
        ("position_m", POSITION_STEP_M),
        ("velocity_mps", VELOCITY_STEP_MPS),
        ("size_m", 0.01),
    ):
        gap = np.abs(getattr(before, name) - getattr(after, name))
        assert gap.max(initial=0) <= step / 2 + TINY
    turn = np.abs(wrap_angle(before.heading_rad - after.heading_rad))
    assert turn.max(initial=0) <= HEADING_STEP_RAD / 2 + TINY
    lines = before.road_map.polylines, after.road_map.polylines
    for one, two in zip(*lines, strict=True):
        assert np.abs(one - two).max() <= MAP_STEP_M / 2 + TINY
    for one, two in zip(before.road_map.lanes, after.road_map.lanes, strict=True):
        for name in ("lane_id", "kind", "is_intersection", "left_mark", "right_mark"):
            assert getattr(one, name) == getattr(two, name)
        for name in ("successors", "predecessors", "left_neighbor", "right_neighbor"):
            assert getattr(one, name) == getattr(two, name)
    for one, two in zip(before.signals, after.signals, strict=True):
        assert (one.signal_id, one.lane_ids) == (two.signal_id, two.lane_ids)
        np.testing.assert_array_equal(one.stop_share, two.stop_share)
        np.testing.assert_array_equal(one.states, two.states)


@given(st.integers(0, 1000), st.integers(1, 20))
@settings(max_examples=15, deadline=None)
def test_recordings_come_back_rounded(tmp_path_factory, seed, num_agents):
    path = tmp_path_factory.mktemp("shards") / "a.shard"
    recording = drive(num_agents, seed=seed)
    windows = choose_windows(recording, seed, num_windows=8)
    path.write_bytes(shard_bytes([(recording, windows)]))
    reader = ShardReader(path)
    again = reader.recording(0)
    check_rounded(recording, again)
    assert tuple(window for _, window in reader.windows) == windows
    assert shard_bytes([(again, windows)]) == path.read_bytes()
    for index, window in enumerate(windows):
        direct, read = cut_scenario(recording, window), reader.window(index)
        assert read.scenario_id == direct.scenario_id
        assert read.agents.ids == direct.agents.ids
        # Rounding takes hardly anybody over the edge of the square.
        both = read.agents.is_valid & direct.agents.is_valid
        assert (read.agents.is_valid ^ direct.agents.is_valid).sum() <= 2
        gap = np.abs(read.agents.position_m - direct.agents.position_m)[both]
        assert gap.max(initial=0) <= POSITION_STEP_M / 2 + TINY


def test_headings_may_turn_round_and_round():
    recording = drive(3)
    turning = np.linspace(0, 40, len(recording.heading_rad))
    recording.heading_rad[:] = wrap_angle(turning)
    about, rows, points = shards.coded_recording(recording)
    check_rounded(recording, shards.decoded_recording(about, rows, points))


@pytest.mark.real_data
def test_real_maps_and_tracks_come_back_rounded(av2_scenario_folders):
    recording = recording_of(read_scenario(av2_scenario_folders[3]))
    about, rows, points = shards.coded_recording(recording)
    check_rounded(recording, shards.decoded_recording(about, rows, points))


def two_shards(folder):
    folder.mkdir()
    for number in range(2):
        recordings = [drive(seed=2 * number + k, name=f"r{k}") for k in range(2)]
        chosen = [(one, choose_windows(one, 0, num_windows=5)) for one in recordings]
        (folder / f"{number}.shard").write_bytes(shard_bytes(chosen))
    return folder


def test_a_folder_reads_as_one(tmp_path):
    folder = two_shards(tmp_path / "set")
    whole = ShardReader(folder, num_kept=1)
    parts = [ShardReader(folder / f"{number}.shard") for number in range(2)]
    assert len(whole) == sum(map(len, parts)) > 10
    ids = [part.window(k).scenario_id for part in parts for k in range(len(part))]
    order = np.random.default_rng(0).permutation(len(whole)).tolist()
    assert [whole.window(k).scenario_id for k in order] == [ids[k] for k in order]
    copy = pickle.loads(pickle.dumps(whole))
    assert copy.window(3).scenario_id == ids[3]


def test_files_that_are_no_shards_are_refused(tmp_path):
    with pytest.raises(InputError, match="no shard"):
        ShardReader(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        ShardReader(tmp_path / "gone.shard")
    text = tmp_path / "text.shard"
    text.write_text("hello")
    with pytest.raises(InputError, match="damaged or not a shard"):
        ShardReader(text)
    with zipfile.ZipFile(text, "w") as archive:
        archive.writestr("index.json", '{"version": 99, "recordings": []}')
    with pytest.raises(InputError, match="version 99"):
        ShardReader(text)


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_a_damaged_shard_is_read_as_before_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "a.shard"
    recording = drive(3)
    windows = choose_windows(recording, 0, num_windows=3)
    content = bytearray(shard_bytes([(recording, windows)]))
    at = data.draw(st.integers(0, len(content) - 1))
    if data.draw(st.booleans()):
        content[at] ^= data.draw(st.integers(1, 255))
    else:
        del content[at:]
    path.write_bytes(bytes(content))
    try:
        reader = ShardReader(path)
        for index in range(len(reader)):
            reader.window(index)
    except InputError as error:
        assert str(path) in str(error)  # noqa: PT017
