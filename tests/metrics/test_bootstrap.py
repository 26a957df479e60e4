import numpy as np
import pytest

from pd_editor.metrics.bootstrap import difference_interval, mean_interval
from pd_editor.metrics.values import measured


def scene(values, is_valid=None):
    value = np.array(values, float)
    valid = np.ones(value.shape, bool) if is_valid is None else np.array(is_valid)
    return measured("speed", value, valid)


def test_the_mean_is_over_values_not_over_scenes():
    interval = mean_interval([scene([1, 1, 1]), scene([5]), scene([])])
    assert interval.mean == 2
    assert interval.num_scenes == 2
    assert interval.num_values == 4
    assert interval.low == 1
    assert interval.high == 5


def test_equal_scenes_leave_no_doubt_and_no_scene_no_value():
    interval = mean_interval([scene([2, 4])] * 9)
    assert interval.low == interval.mean == interval.high == 3
    assert not mean_interval([]).is_valid
    assert not mean_interval([scene([1], [False])]).is_valid


def test_the_interval_of_independent_values_is_the_normal_one():
    random = np.random.default_rng(3)
    scenes = [scene([value]) for value in random.normal(10, 2, 400)]
    interval = mean_interval(scenes)
    half = 1.96 * 2 / np.sqrt(400)
    np.testing.assert_allclose(interval.high - interval.low, 2 * half, rtol=0.1)


@pytest.mark.slow
def test_intervals_of_scenes_that_differ_hold_the_truth_as_often_as_promised():
    random = np.random.default_rng(4)
    hits = 0
    for draw in range(200):
        scenes = [scene(random.normal(random.normal(0, 1), 1, 8)) for _ in range(60)]
        interval = mean_interval(scenes, draws=500, seed=draw)
        hits += interval.low <= 0 <= interval.high
    assert 0.9 <= hits / 200 <= 0.99


def test_differences_are_paired_on_the_same_agents():
    random = np.random.default_rng(6)
    first = [scene(random.uniform(0, 30, 5)) for _ in range(20)]
    second = [scene(one.value - 0.1) for one in first]
    interval = difference_interval(first, second)
    np.testing.assert_allclose([interval.low, interval.mean, interval.high], 0.1)
    assert interval.num_values == 100


def test_agents_that_one_method_lacks_are_left_out():
    first = [scene([1, 9], [True, True])]
    second = [scene([0, 0], [True, False])]
    interval = difference_interval(first, second)
    assert interval.mean == 1
    assert interval.num_values == 1
    with pytest.raises(AssertionError):
        difference_interval([scene([1])], [scene([1, 2])])
