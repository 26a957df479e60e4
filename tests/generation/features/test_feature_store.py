import json
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import TrainingError
from pd_editor.generation.features.feature_store import (
    FeatureStore,
    StoreIndex,
    open_for_writing,
    write_part,
)
from pd_editor.generation.features.map_pieces import BOUNDARY_SHAPE, PIECE_SHAPE
from pd_editor.generation.features.scene_features import (
    NUM_CANDIDATES,
    PackedScene,
    packed,
    scene_features,
)
from pd_editor.generation.features.scene_fields import (
    LATENT_SIZE,
    NUM_NEAR_AGENTS,
    NUM_NEAR_BOUNDARY,
    NUM_NEAR_PIECES,
)
from tests.builders import scenario_with, straight_drivers

INDEX = StoreIndex(fingerprint="f" * 64, roots=("here", "there"), settings="none")


def some_scene(seed: int, num_pieces: int, num_agents: int) -> PackedScene:
    random = np.random.default_rng(seed)

    def numbers(*shape: int) -> np.ndarray:
        return random.normal(0, 3, shape).astype(np.float32)

    num_boundary = int(random.integers(0, 9))
    counts = random.integers(0, NUM_CANDIDATES + 1, num_agents)
    has_candidate = np.arange(NUM_CANDIDATES) < counts[:, None]
    latents = numbers(num_agents, NUM_CANDIDATES, LATENT_SIZE)
    has_future = random.random(num_agents) < 0.5
    return PackedScene(
        piece_pose=numbers(num_pieces, 3),
        piece_shape=numbers(num_pieces, len(PIECE_SHAPE)),
        piece_kind=random.integers(0, 4, num_pieces),
        piece_signal=numbers(num_pieces, 2),
        boundary_pose=numbers(num_boundary, 3),
        boundary_shape=numbers(num_boundary, len(BOUNDARY_SHAPE)),
        agent_pose=numbers(num_agents, 3),
        agent_speed=numbers(num_agents),
        agent_size=numbers(num_agents, 2),
        agent_kind=random.integers(0, 5, num_agents),
        agent_activity=random.integers(0, 4, num_agents),
        near_boundary=random.integers(
            -1, max(num_boundary, 1), (num_agents, NUM_NEAR_BOUNDARY)
        ),
        near_pieces=random.integers(
            -1, max(num_pieces, 1), (num_agents, NUM_NEAR_PIECES)
        ),
        near_agents=random.integers(
            -1, max(num_agents, 1), (num_agents, NUM_NEAR_AGENTS)
        ),
        candidates=latents * has_candidate[..., None],
        has_candidate=has_candidate,
        future=numbers(num_agents, LATENT_SIZE) * has_future[:, None],
        has_future=has_future,
    )


def assert_same(one: PackedScene, two: PackedScene) -> None:
    for field in fields(PackedScene):
        first, second = getattr(one, field.name), getattr(two, field.name)
        assert first.shape == second.shape, field.name
        if first.dtype.kind == "f":
            assert second.dtype == np.float32
            assert np.allclose(first, second, rtol=1e-3, atol=1e-3), field.name
        else:
            assert np.array_equal(first, second), field.name


@given(
    st.lists(
        st.tuples(st.integers(0, 9), st.integers(0, 40), st.integers(0, 12)),
        max_size=6,
    ),
    st.integers(1, 3),
)
@settings(max_examples=20, deadline=None)
def test_what_is_written_is_read(tmp_path_factory, sizes, per_part):
    folder = tmp_path_factory.mktemp("store") / "features"
    scenes = [some_scene(*size) for size in sizes]
    assert open_for_writing(folder, INDEX) == frozenset()
    for first in range(0, len(scenes), per_part):
        part = scenes[first : first + per_part]
        groups = [f"net-{first + place}" for place in range(len(part))]
        write_part(folder, f"{first:04d}", part, groups, 1)
    store = FeatureStore(folder)
    assert len(store) == len(scenes)
    for place, scene in enumerate(scenes):
        assert_same(scene, store[place])
    assert store.group.tolist() == [f"net-{place}" for place in range(len(scenes))]
    assert store.num_agents.tolist() == [len(one.agent_pose) for one in scenes]
    assert store.num_pieces.tolist() == [len(one.piece_pose) for one in scenes]
    assert (store.root == 1).all()
    assert store.index == INDEX
    with pytest.raises(IndexError):
        store[len(scenes)]


def test_going_on_finds_the_parts_that_are_there(tmp_path):
    open_for_writing(tmp_path, INDEX)
    write_part(tmp_path, "000", [some_scene(0, 3, 2)], ["a"], 0)
    (tmp_path / ".001-77").mkdir()
    assert open_for_writing(tmp_path, INDEX) == {"000"}
    assert len(FeatureStore(tmp_path)) == 1


def test_a_part_that_another_process_has_added_stays(tmp_path):
    open_for_writing(tmp_path, INDEX)
    for size in (3, 5):
        write_part(tmp_path, "000", [some_scene(0, size, 2)], ["a"], 0)
    assert FeatureStore(tmp_path).num_pieces.tolist() == [3]
    assert [one.name for one in tmp_path.iterdir() if one.name.startswith(".")] == []


def test_large_latents_stay_finite(tmp_path):
    scene = some_scene(0, 3, 2)
    scene.future[:] = 1e9
    open_for_writing(tmp_path, INDEX)
    write_part(tmp_path, "000", [scene], ["a"], 0)
    assert np.isfinite(FeatureStore(tmp_path)[0].future).all()


def test_features_of_other_data_are_refused(tmp_path):
    open_for_writing(tmp_path, INDEX)
    other = StoreIndex(fingerprint="0" * 64, roots=("here",), settings="none")
    with pytest.raises(TrainingError, match="other data or settings"):
        open_for_writing(tmp_path, other)


def test_what_is_no_store_is_refused(tmp_path):
    with pytest.raises(TrainingError, match="no feature store"):
        FeatureStore(tmp_path)
    for text in ("{", "[]", '{"fingerprint": 3}'):
        (tmp_path / "store.json").write_text(text)
        with pytest.raises(TrainingError, match="no feature store"):
            FeatureStore(tmp_path)


def test_a_store_of_another_format_is_refused(tmp_path):
    open_for_writing(tmp_path, INDEX)
    path = tmp_path / "store.json"
    values = json.loads(path.read_text())
    path.write_text(json.dumps({**values, "version": 99}))
    with pytest.raises(TrainingError, match="format 99"):
        FeatureStore(tmp_path)


def test_a_damaged_part_is_named(tmp_path):
    open_for_writing(tmp_path, INDEX)
    write_part(tmp_path, "000", [some_scene(0, 3, 2)], ["a"], 0)
    path = tmp_path / "part-000" / "agents.npy"
    path.write_bytes(path.read_bytes()[:-7])
    with pytest.raises(TrainingError, match=r"agents\.npy: is missing or damaged"):
        FeatureStore(tmp_path)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(TrainingError, match="cannot be written"):
        open_for_writing(tmp_path / "file" / "store", INDEX)


def test_a_scene_is_packed_agent_by_agent():
    found = scene_features(
        scenario_with(straight_drivers([(0, 0, 0, 10), (30, 3.5, 0.1, 4)]))
    )

    def ends_and_speed(future_m: np.ndarray, speed_mps: np.ndarray) -> np.ndarray:
        latent = np.zeros((*future_m.shape[:-2], LATENT_SIZE))
        latent[..., :2] = future_m[..., -1, :]
        latent[..., 2] = speed_mps
        return latent

    scene = packed(found, ends_and_speed)
    valid = found.has_candidate
    assert np.allclose(scene.candidates[valid][:, :2], found.candidate_m[valid][:, -1])
    speed = np.repeat(found.agent_speed[:, None], NUM_CANDIDATES, axis=1)
    assert np.allclose(scene.candidates[valid][:, 2], speed[valid])
    assert (scene.candidates[~valid] == 0).all()
    assert np.allclose(scene.future[:, :2], found.future_m[:, -1])
