import numpy as np
import pytest
import torch

from pd_editor.base.errors import InputError, TrainingError
from pd_editor.experiments.recordings.clip_selection import choose_windows
from pd_editor.experiments.recordings.shards import shard_bytes
from pd_editor.experiments.training.run_config import Budget
from pd_editor.experiments.training.training_data import (
    augmented_scenes,
    held_out_scenes,
    prepared_data,
    training_data,
)
from tests.experiments.recordings.recordings import drive


@pytest.fixture(scope="module")
def shards(tmp_path_factory):
    folder = tmp_path_factory.mktemp("corpus")
    for number in range(3):
        recording = drive(name=f"drive-{number}", seed=number)
        windows = choose_windows(recording, seed=3, num_windows=6)
        (folder / f"drive-{number}.shard").write_bytes(
            shard_bytes([(recording, windows)])
        )
    return folder


@pytest.fixture(scope="module")
def prepared(shards, tmp_path_factory):
    return prepared_data([shards], tmp_path_factory.mktemp("cache"), workers=1)


@pytest.mark.slow
def test_a_second_run_finds_what_the_first_has_prepared(shards, tmp_path):
    first = prepared_data([shards], tmp_path, workers=1)
    calls = []
    second = prepared_data([shards], tmp_path, workers=1, on_progress=calls.append)
    assert second.store.index.fingerprint == first.store.index.fingerprint
    assert np.array_equal(second.basis.along, first.basis.along)
    assert len(list(tmp_path.iterdir())) == 1
    assert all(one.num_done == one.num_items for one in calls)
    assert second.num_left_out == 0


@pytest.mark.slow
def test_other_data_has_another_place(shards, tmp_path):
    first = prepared_data([shards], tmp_path, workers=1)
    second = prepared_data([shards, shards], tmp_path, workers=1)
    assert second.store.folder != first.store.folder
    assert len(second.store) == 2 * len(first.store)


def test_bad_roots_and_places_are_refused(shards, tmp_path):
    with pytest.raises(InputError):
        prepared_data([tmp_path / "none"], tmp_path)
    with pytest.raises(TrainingError, match="No data root"):
        prepared_data([], tmp_path)
    (tmp_path / "file").write_text("x")
    with pytest.raises(TrainingError, match="cannot be written"):
        prepared_data([shards], tmp_path / "file")


def test_networks_are_held_out_whole():
    group = np.repeat([f"net-{k}" for k in range(50)], 20)
    held_out = held_out_scenes(group, 0.1, seed=0)
    assert held_out.sum() == 100
    assert not set(group[held_out]) & set(group[~held_out])
    assert np.array_equal(held_out, held_out_scenes(group, 0.1, seed=0))
    assert not np.array_equal(held_out, held_out_scenes(group, 0.1, seed=1))


def test_few_large_cities_give_scenes_here_and_there():
    held_out = held_out_scenes(np.repeat(["a", "b", "c"], 100), 0.1, seed=0)
    assert held_out.sum() == 30
    assert not held_out_scenes(np.repeat(["a", "b"], 2), 0.0, seed=0).any()


def test_every_scene_is_trained_on_or_held_out(prepared):
    data = training_data(prepared.store, Budget(held_out_share=0.4), seed=0)
    rows = np.concatenate([*data.training_rows, data.held_out_rows])
    assert sorted(rows) == list(range(len(prepared.store)))
    groups = prepared.store.group
    assert not set(groups[data.held_out_rows]) & set(groups[data.training_rows[0]])
    few = training_data(
        prepared.store, Budget(held_out_share=0.4, held_out_scenes=2), seed=0
    )
    assert 1 <= len(few.held_out_rows) <= 2
    batch = data.batch(data.training_rows[0][:3])
    assert batch.num_scenes == 3


@pytest.mark.slow
def test_a_root_with_too_few_scenes_is_refused(tmp_path):
    recording = drive()
    windows = choose_windows(recording, seed=3, num_windows=2)
    (tmp_path / "few.shard").write_bytes(shard_bytes([(recording, windows)]))
    prepared = prepared_data([tmp_path], tmp_path / "cache", workers=1)
    with pytest.raises(TrainingError, match="to train on"):
        training_data(prepared.store, Budget(), seed=0)


def test_augmented_scenes_are_moved_as_a_whole(prepared):
    data = training_data(prepared.store, Budget(), seed=0)
    scene = data.batch(data.training_rows[0][:4])
    turned = augmented_scenes(scene, torch.Generator().manual_seed(1))
    for name in ("agent_pose", "piece_pose"):
        exists = scene.has_agent if name == "agent_pose" else scene.has_piece
        before, after = (getattr(one, name)[..., :2] for one in (scene, turned))
        assert not torch.allclose(before, after, atol=0.1)
        distance = [
            torch.cdist(one, one, compute_mode="donot_use_mm_for_euclid_dist")
            for one in (before, after)
        ]
        both = exists[:, :, None] & exists[:, None]
        assert torch.allclose(distance[0][both], distance[1][both], atol=2e-2)
    assert torch.equal(turned.agent_speed, scene.agent_speed)
    again = augmented_scenes(scene, torch.Generator().manual_seed(1))
    assert torch.equal(again.agent_pose, turned.agent_pose)
