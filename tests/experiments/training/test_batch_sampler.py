import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.training_data import BatchSampler


def sizes(count):
    return np.random.default_rng(0).integers(1, 40, count)


def sampler_of(counts, shares, batch_size, seed=0):
    ends = np.cumsum(counts)
    rows = [
        np.arange(end - count, end) for count, end in zip(counts, ends, strict=True)
    ]
    return BatchSampler(
        rows, sizes(ends[-1]), shares=shares, batch_size=batch_size, seed=seed
    )


def test_each_epoch_has_every_scene_once():
    sampler = sampler_of([96], [1], 6)
    for epoch in range(3):
        seen = np.concatenate([sampler.rows(16 * epoch + k) for k in range(16)])
        assert sorted(seen) == list(range(96))


@given(
    counts=st.lists(st.integers(1, 50), min_size=1, max_size=4),
    batch_size=st.integers(4, 20),
    seed=st.integers(0, 5),
)
def test_no_scene_comes_twice_before_all_others(counts, batch_size, seed):
    sampler = sampler_of(counts, counts, batch_size, seed)
    seen = np.concatenate([sampler.rows(step) for step in range(32)])
    times = np.bincount(seen, minlength=sum(counts))
    for end, count in zip(np.cumsum(counts), counts, strict=True):
        part = times[end - count : end]
        assert part.max() - part.min() <= 1


@given(step=st.integers(0, 10_000))
def test_a_batch_depends_on_the_step_alone(step):
    one, two = sampler_of([70, 30], [1, 1], 8), sampler_of([70, 30], [1, 1], 8)
    one.rows(3)
    assert np.array_equal(one.rows(step), two.rows(step))


def test_roots_have_their_shares_in_every_group_of_batches():
    sampler = sampler_of([1000, 10], [3.0, 1.0], 8)
    seen = np.concatenate([sampler.rows(step) for step in range(16)])
    assert (seen >= 1000).sum() == 2 * 16


def test_a_root_with_a_tiny_share_is_still_there():
    sampler = sampler_of([50, 50, 50], [1000.0, 1.0, 1.0], 6)
    seen = np.concatenate([sampler.rows(step) for step in range(16)])
    assert set(seen // 50) == {0, 1, 2}


def test_scenes_of_a_batch_are_of_like_size():
    sampler = sampler_of([640], [1], 8)
    spreads = []
    for step in range(16):
        size = sizes(640)[sampler.rows(step)]
        spreads.append(size.max() - size.min())
    assert np.mean(spreads) < 5


def test_seeds_differ():
    one, two = (sampler_of([100], [1], 8, seed) for seed in (0, 1))
    assert not np.array_equal(one.rows(0), two.rows(0))


def test_a_batch_smaller_than_the_number_of_roots_is_refused():
    with pytest.raises(TrainingError, match="larger batch"):
        sampler_of([5, 5, 5], [1, 1, 1], 2)
