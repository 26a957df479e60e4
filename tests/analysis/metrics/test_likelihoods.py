"""Likelihoods of the log: against NumPy's histograms, shapely, and Gibbs' inequality."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.analysis.metrics.likelihoods import (
    LIKELIHOODS,
    likelihood_values,
    meta_metric,
)
from pd_editor.analysis.metrics.safety import nearest_box_m, signed_gap_m
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.scene.geometry.oriented_box import Boxes
from tests.analysis.metrics.traffic_builders import generated, recorded

DRIVERS = [(0.0, 0.0, 0.0, 8.0), (30.0, 3.5, 0.0, 6.0), (-40.0, 0.0, 0.0, 4.0)]


def moved(view: TrafficView, seed: int, size_m: float) -> TrafficView:
    """The view's agents on paths that leave the recorded ones."""
    random = np.random.default_rng(seed)
    steps = np.arange(view.num_steps)[:, None] / view.num_steps
    aside = random.normal(size=(len(view), 1, 2)) * size_m * steps
    path = view.logged.position_m + aside
    return generated(view.scenario, view.agents.ids, path)


def mean(view: TrafficView, *samples: TrafficView) -> dict[str, np.ndarray]:
    found = likelihood_values([replace(one, logged=view.logged) for one in samples])
    return {name: np.array([values.valid().mean()]) for name, values in found.items()}


@settings(max_examples=10)
@given(st.integers(0, 999), st.floats(0.5, 30.0), st.integers(1, 4))
def test_nothing_is_likelier_than_the_log_itself(seed, size_m, count):
    log = recorded(DRIVERS)
    own = mean(log, log)
    other = mean(log, *(moved(log, seed + n, size_m) for n in range(count)))
    for name in LIKELIHOODS:
        assert other[name] <= own[name] + 0.01, name
    assert 0 <= meta_metric(other) <= meta_metric(own) + 0.01 <= 1.01


def test_speeds_are_as_likely_as_a_histogram_tells():
    log = recorded(DRIVERS)
    samples = [moved(log, seed, 20.0) for seed in range(5)]
    found = likelihood_values(samples)["likelihood_of_speed"]

    def speeds(view: TrafficView, row: int) -> np.ndarray:
        position = view.agents.position_m[row]
        return np.linalg.norm(position[2:] - position[:-2], axis=-1) / 0.2

    for row in range(len(log)):
        pooled = np.concatenate([speeds(one, row) for one in samples])
        edges = np.linspace(0.0, 25.0, 11)
        counts = np.histogram(pooled, edges)[0] + 0.1
        place = np.digitize(speeds(log, row), edges) - 1
        wanted = np.log(counts[place] / counts.sum()).mean()
        assert found.value[row] == pytest.approx(wanted)


def test_events_count_once_for_an_agent():
    """Of four samples one leaves the road: so would one in four logs."""
    log = recorded(DRIVERS[:1])
    away = log.logged.position_m + np.linspace(0.0, 90.0, log.num_steps)[:, None] * (
        0,
        1,
    )
    leaves = generated(log.scenario, log.agents.ids, away)
    staying = generated(log.scenario, log.agents.ids, log.logged.position_m)
    found = likelihood_values([staying, staying, staying, leaves])
    off_road = found["likelihood_of_off_road"].value
    assert off_road == pytest.approx(np.log(3.001 / 4.002))
    assert found["likelihood_of_collision"].value == pytest.approx(
        np.log(4.001 / 4.002)
    )


@given(st.lists(st.tuples(*[st.floats(-6, 6)] * 2, st.floats(-4, 4), st.floats(0.5, 9)),
                min_size=2, max_size=2))  # fmt: skip
def test_gaps_and_depths_are_those_of_polygons(boxes):
    one, other = (
        Boxes(
            position_m=np.array([[x, y]]),
            heading_rad=np.array([turn]),
            size_m=np.array([[length, 2.0]]),
        )
        for x, y, turn, length in boxes
    )
    gap = float(signed_gap_m(one, other)[0])
    mine, theirs = (shapely.Polygon(box.corners_m()[0]) for box in (one, other))
    if gap > 0:
        assert gap == pytest.approx(mine.distance(theirs), abs=1e-9)
        return
    assert mine.distance(theirs) == pytest.approx(0.0, abs=1e-9)
    # No shorter way out is along a side of either box.
    for box in (one, other):
        for turn in np.arange(4) * np.pi / 2 + box.heading_rad[0]:
            for length in (-0.999 * gap, 0.5 * -gap):
                step = length * np.array([np.cos(turn), np.sin(turn)])
                moved_away = shapely.Polygon(other.corners_m()[0] + step)
                assert mine.distance(moved_away) < 1e-6


def test_the_nearest_box_is_that_of_all():
    random = np.random.default_rng(4)
    states = [
        (x, y, turn, speed)
        for x, y, turn, speed in random.uniform(
            (-50, -20, -3, 0), (50, 20, 3, 12), (25, 4)
        )
    ]
    view = recorded(states)
    found = nearest_box_m(view)
    boxes = view.agents.boxes
    for step in (0, view.num_steps - 1):
        polygons = [shapely.Polygon(one) for one in boxes.corners_m()[:, step]]
        away = np.array([[a.distance(b) for b in polygons] for a in polygons])
        np.fill_diagonal(away, np.inf)
        np.testing.assert_allclose(
            np.maximum(found[:, step], 0.0), away.min(axis=1), atol=1e-9
        )
