import shutil
from dataclasses import fields

import numpy as np
import pytest

from pd_editor.base.errors import InputError, TrainingError
from pd_editor.experiments.recordings.clip_selection import choose_windows
from pd_editor.experiments.recordings.shards import shard_bytes
from pd_editor.experiments.training import feature_preparation as scenario_dataset
from pd_editor.experiments.training.augmentation import crawling_share
from pd_editor.experiments.training.feature_preparation import (
    Preparation,
    fit_basis,
    open_roots,
    prepare_features,
)
from pd_editor.experiments.training.run_config import Augmentation
from pd_editor.generation.features.scene_features import (
    PackedScene,
    packed,
    scene_center,
    scene_features,
)
from pd_editor.generation.inputs import TrajectoryBasis
from pd_editor.scene.av2_io.read import read_scenario
from tests.experiments.recordings.recordings import drive


@pytest.fixture(scope="module")
def shards(tmp_path_factory):
    """Two shards of one recording each."""
    folder = tmp_path_factory.mktemp("corpus")
    for name in ("drive-1", "drive-2"):
        recording = drive(name=name, seed=int(name[-1]))
        windows = choose_windows(recording, seed=3, num_windows=9)
        (folder / f"{name}.shard").write_bytes(shard_bytes([(recording, windows)]))
    return folder


@pytest.fixture(scope="module")
def av2_copy(tmp_path_factory, av2_scenario_folders):
    """Three real scenarios, and one that is damaged."""
    folder = tmp_path_factory.mktemp("av2")
    train = [one for one in av2_scenario_folders if one.parent.name == "train"]
    for source in train[:4]:
        shutil.copytree(source, folder / source.name)
    damaged = sorted(folder.glob("*/*.json"))[1]
    damaged.write_text("{}")
    return folder


@pytest.fixture(scope="module")
def basis():
    time = 0.1 * np.arange(1, 60)
    random = np.random.default_rng(0)
    speed, braking = random.uniform(0, 20, 300), random.uniform(-1, 1, 300)
    side = random.uniform(-0.3, 0.3, 300)
    along = speed[:, None] * time + braking[:, None] * time**2 / 2
    future = np.stack([along, side[:, None] * time**2], axis=-1)
    return TrajectoryBasis.fit(future, speed)


def test_roots_of_both_kinds(shards, av2_copy):
    recorded, simulated = open_roots([av2_copy, shards])
    assert len(recorded) == 4
    first, window = recorded.scenario(0), simulated.scenario(0)
    assert first.scenario_id == sorted(av2_copy.iterdir())[0].name
    assert window.time_axis.num_steps == 110
    again = simulated.scenario(0)
    assert np.array_equal(window.agents.position_m, again.agents.position_m)
    assert recorded.group(0) == first.city
    assert simulated.group(0) == "drive-1"
    assert simulated.group(len(simulated) - 1) == "drive-2"


def test_futures_of_synthetic_agents_are_whole(shards):
    (root,) = open_roots([shards])
    found = [scene_features(root.scenario(place)) for place in range(len(root))]
    shares = [one.has_future.mean() for one in found if len(one.has_future)]
    assert np.mean(shares) > 0.6


def test_features_are_prepared_and_read(shards, av2_copy, basis, tmp_path, monkeypatch):
    monkeypatch.setattr(scenario_dataset, "PART_SIZE", 7)
    told = []
    store = prepare_features(
        [av2_copy, shards],
        tmp_path / "store",
        basis,
        workers=2,
        preparation=Preparation(augmentation=None),
        on_progress=told.append,
    )
    recorded, simulated = open_roots([av2_copy, shards])
    assert (np.bincount(store.root) == [len(recorded) - 1, len(simulated)]).all()
    assert set(store.group[store.root == 1]) == {"drive-1", "drive-2"}
    assert (
        told[-1].num_done == told[-1].num_items == len(list(tmp_path.glob("*/part-*")))
    )
    last = packed(scene_features(simulated.scenario(len(simulated) - 1)), basis.encode)
    found = store[len(store) - 1]
    for field in fields(PackedScene):
        one, two = getattr(last, field.name), getattr(found, field.name)
        assert np.allclose(one, two, rtol=2e-3, atol=2e-3), field.name


@pytest.mark.slow
def test_a_stopped_preparation_goes_on(shards, basis, tmp_path, monkeypatch):
    monkeypatch.setattr(scenario_dataset, "PART_SIZE", 2)
    whole = prepare_features([shards], tmp_path / "a", basis, workers=1)
    prepare_features([shards], tmp_path / "b", basis, workers=1)
    shutil.rmtree(sorted((tmp_path / "b").glob("part-*"))[1])
    told = []
    again = prepare_features(
        [shards], tmp_path / "b", basis, workers=1, on_progress=told.append
    )
    assert told[-1].num_items == 1
    assert len(again) == len(whole)
    for place in range(len(whole)):
        for field in fields(PackedScene):
            one, two = (getattr(store[place], field.name) for store in (whole, again))
            assert np.array_equal(one, two)


def test_other_settings_are_refused_in_the_same_folder(shards, basis, tmp_path):
    prepare_features(
        [shards], tmp_path, basis, preparation=Preparation(most_per_root=3)
    )
    with pytest.raises(TrainingError, match="other data or settings"):
        prepare_features(
            [shards], tmp_path, basis, preparation=Preparation(most_per_root=4)
        )


def test_only_some_of_each_root(shards, basis, tmp_path):
    store = prepare_features(
        [shards], tmp_path, basis, preparation=Preparation(most_per_root=4)
    )
    assert len(store) == 4
    assert set(store.group) == {"drive-1", "drive-2"}


def test_the_basis_is_fitted_to_the_roots_futures(shards, av2_copy):
    basis = fit_basis([shards, av2_copy], count=24, workers=1, augmentation=None)
    for folder in sorted(av2_copy.iterdir())[:1]:
        found = scene_features(read_scenario(folder))
        future = found.future_m[found.has_future].astype(float)
        speed = found.agent_speed[found.has_future].astype(float)
        again = basis.decode(basis.encode(future, speed), speed)
        assert np.abs(again - future).mean() < 0.3


def test_damaged_shards_are_left_out_and_counted(shards, basis, tmp_path):
    root = tmp_path / "root"
    shutil.copytree(shards, root)
    (whole,) = open_roots([root])
    (root / "drive-0.shard").write_bytes(b"not a shard")
    cut = root / "drive-2.shard"
    (source,) = open_roots([root])
    assert (len(source), source.num_damaged) == (len(whole), 1)
    cut.write_bytes(cut.read_bytes()[:-40])
    (source,) = open_roots([root])
    assert source.num_damaged == 2
    assert 0 < len(source) < len(whole)
    assert prepare_features([root], tmp_path / "store", basis, workers=1).index.roots
    for file in root.glob("*.shard"):
        file.write_bytes(b"")
    with pytest.raises(InputError, match="damaged or not a shard"):
        open_roots([root])


def test_what_is_no_root_is_refused(tmp_path, basis):
    with pytest.raises(TrainingError, match="No data root"):
        open_roots([])
    with pytest.raises(InputError, match="no such dataset folder"):
        open_roots([tmp_path / "nowhere"])
    with pytest.raises(InputError, match="neither Argoverse 2 scenarios nor shards"):
        open_roots([tmp_path])


@pytest.mark.slow
def test_a_root_of_damaged_scenarios_only_is_refused(av2_copy, basis, tmp_path):
    (damaged,) = [
        path.parent for path in av2_copy.glob("*/*.json") if path.read_text() == "{}"
    ]
    root = tmp_path / "root"
    shutil.copytree(damaged, root / damaged.name)
    with pytest.raises(TrainingError, match="None of 1 scenarios can be used"):
        prepare_features([root], tmp_path / "store", basis, workers=1)
    with pytest.raises(TrainingError, match="complete trajectory"):
        fit_basis([root], workers=1)


@pytest.mark.slow
def test_simulated_scenes_in_which_too_many_crawl_are_left_out(
    shards, av2_copy, basis, tmp_path
):
    (source,) = open_roots([shards])
    share = np.array(
        [
            crawling_share(one, scene_center(one))
            for one in map(source.scenario, range(len(source)))
        ]
    )
    most = float(np.median(share[share > 0]))
    kept = int((share <= most).sum())
    assert 0 < kept < len(source)
    flowing = Augmentation(most_crawling=most)
    store = prepare_features(
        [shards],
        tmp_path / "some",
        basis,
        preparation=Preparation(augmentation=flowing),
    )
    assert len(store) == kept
    none = Augmentation(most_crawling=0.0)
    store = prepare_features(
        [av2_copy], tmp_path / "real", basis, preparation=Preparation(augmentation=none)
    )
    assert len(store) == 3
