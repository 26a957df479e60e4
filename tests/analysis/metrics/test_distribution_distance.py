from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import jensenshannon

from pd_editor.analysis.metrics.distribution_distance import (
    HISTOGRAMS,
    histogram_of,
    jensen_shannon_divergence,
    noise_floor,
)
from pd_editor.analysis.metrics.values import METRICS, measured

COUNTS = st.lists(st.integers(0, 30), min_size=6, max_size=6).filter(any)


@given(COUNTS, COUNTS)
def test_the_root_is_what_scipy_calls_the_jensen_shannon_distance(first, second):
    one, two = np.array(first, float), np.array(second, float)
    found = jensen_shannon_divergence(one, two)
    assert found <= np.log(2) + 1e-12
    scipys = np.nan_to_num(jensenshannon(one, two))
    np.testing.assert_allclose(np.sqrt(found), scipys, atol=1e-7)
    np.testing.assert_allclose(found, jensen_shannon_divergence(two, one), atol=1e-15)
    np.testing.assert_allclose(
        found, jensen_shannon_divergence(one[::-1], two[::-1]), atol=1e-15
    )


def test_disjoint_sets_are_as_far_as_can_be():
    speed = histogram_of("speed", "ours")
    apart = speed.distance(np.full(4, 2.5), np.full(9, 12.5))
    np.testing.assert_allclose(apart.divergence, np.log(2))
    np.testing.assert_allclose(apart.root, 0.8325546)


def test_the_papers_bins_drop_what_is_out_of_range_and_ours_count_it():
    values = np.array([-1.0, 0.0, 3.0, 3.01, 500.0])
    paper = histogram_of("nearest_edge", "paper").counts(values)
    assert len(paper) == 30
    assert paper.sum() == 2
    assert paper[-1] == 1
    ours = histogram_of("nearest_edge", "ours").counts(values)
    assert len(ours) == 42
    assert ours.sum() == 5
    assert ours[0] == ours[-1] == 1


def test_an_empty_histogram_has_no_distance():
    paper = histogram_of("nearest_edge", "paper")
    assert not paper.distance(np.array([9.0]), np.array([1.0])).is_valid
    assert not paper.distance(np.zeros(0), np.array([1.0])).is_valid


def test_each_metric_has_at_most_one_histogram_of_each_source():
    count = Counter((h.metric, h.source) for h in HISTOGRAMS)
    assert set(count.values()) == {1}
    assert {h.metric for h in HISTOGRAMS} <= set(METRICS)
    assert sum(h.source == "paper" for h in HISTOGRAMS) == 5


def scenes_of_speeds(num_scenes: int):
    random = np.random.default_rng(5)
    return [
        measured("speed", random.uniform(0, 30, size), random.random(size) < 0.8)
        for size in random.integers(1, 20, num_scenes)
    ]


def test_the_noise_floor_falls_with_the_number_of_agents():
    scenes, speed = scenes_of_speeds(60), histogram_of("speed", "ours")

    def root(one, two):
        return speed.distance(one, two).root

    few = noise_floor(scenes, root, num_agents=20)
    many = noise_floor(scenes, root, num_agents=2000)
    assert 0 < many < few / 3
    assert noise_floor(scenes, root, num_agents=20) == few


@pytest.mark.parametrize("num_agents", [1, 7, 100])
def test_draws_have_just_so_many_agents(num_agents):
    sizes = []

    def count(one, two):
        sizes.append((len(one), len(two)))
        return 0.0

    scenes = scenes_of_speeds(30)
    noise_floor(scenes, count, num_agents=num_agents, num_resamples=20)
    assert set(sizes) == {(num_agents, sum(len(scene.valid()) for scene in scenes))}
