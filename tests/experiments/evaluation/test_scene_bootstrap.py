import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pd_editor.experiments.evaluation.summary import (
    NUM_RESAMPLES,
    mean_over_scenes,
    scene_weights,
)


def test_every_value_weighs_the_same():
    sums, counts = np.array([[6.0, 10.0]]), np.array([[3.0, 1.0]])
    found = mean_over_scenes(sums, counts, scene_weights(2, seed=0))
    assert found.value.tolist() == [4.0]
    # Only scene one, both, or only scene two: means 2, 4 and 10.
    assert (found.low.tolist(), found.high.tolist()) == ([2.0], [10.0])


def test_the_interval_of_independent_values_is_the_normal_one():
    values = np.random.default_rng(3).normal(10, 2, (1, 400))
    found = mean_over_scenes(values, np.ones((1, 400)), scene_weights(400, seed=0))
    half = 1.96 * 2 / np.sqrt(400)
    np.testing.assert_allclose(found.high - found.low, 2 * half, rtol=0.1)


@pytest.mark.slow
def test_intervals_of_scenes_that_differ_hold_the_truth_as_often_as_promised():
    random = np.random.default_rng(4)
    sums = 8 * random.normal(0, 1, (200, 60)) + random.normal(0, 8**0.5, (200, 60))
    found = mean_over_scenes(sums, np.full((200, 60), 8.0), scene_weights(60, seed=0))
    hits = np.mean((found.low <= 0) & (found.high >= 0))
    assert 0.9 <= hits <= 0.99


def test_equal_scenes_leave_no_doubt():
    sums, counts = np.full((1, 9), 8.0), np.full((1, 9), 4.0)
    found = mean_over_scenes(sums, counts, scene_weights(9, seed=3))
    assert found.value == found.low == found.high == 2.0


def test_one_scene_or_none_has_no_interval():
    sums, counts = np.array([[5.0, 0.0], [0.0, 0.0]]), np.array([[2.0, 0.0], [0, 0]])
    found = mean_over_scenes(sums, counts, scene_weights(2, seed=0))
    np.testing.assert_array_equal(found.value, [2.5, np.nan])
    assert np.isnan(found.low).all()
    assert np.isnan(found.high).all()


@settings(deadline=None, max_examples=25)
@given(
    arrays(float, (2, 7), elements=st.floats(-5, 5)),
    arrays(np.int64, (2, 7), elements=st.integers(0, 4)),
    st.integers(0, 5),
)
def test_resamples_as_drawn_one_by_one(sums, counts, seed):
    weights, counts = scene_weights(7, seed), counts.astype(float)
    sums = np.where(counts > 0, sums, 0.0)
    found = mean_over_scenes(sums, counts, weights)
    for row in range(2):
        drawn = []
        for weight in weights:
            scenes = np.repeat(np.arange(7), weight.astype(int))
            assert len(scenes) == 7
            if counts[row, scenes].sum():
                drawn.append(sums[row, scenes].sum() / counts[row, scenes].sum())
        if (counts[row] > 0).sum() > 1:
            expected = np.percentile(drawn, [2.5, 97.5])
            np.testing.assert_allclose(
                [found.low[row], found.high[row]], expected, atol=1e-9
            )


def test_weights_depend_on_the_seed_only():
    np.testing.assert_array_equal(scene_weights(5, 1), scene_weights(5, 1))
    assert not np.array_equal(scene_weights(5, 1), scene_weights(5, 2))
    assert scene_weights(5, 1).shape == (NUM_RESAMPLES, 5)
