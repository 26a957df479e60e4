import dataclasses

import numpy as np
import pytest

from pd_editor.experiments.recordings.clip import (
    TrackingNoise,
    noisy,
    seen,
    smooth_noise,
)
from pd_editor.scene.geometry.angles import wrap_angle
from tests.builders import straight_drivers

SILENT = TrackingNoise(
    along_m=0,
    across_m=0,
    standing_m=0,
    heading_rad=0,
    velocity_along_mps=0,
    velocity_across_mps=0,
    range_m=np.inf,
    occlusions_per_s=0,
)


def random():
    return np.random.default_rng(5)


def crowd(speed: float, count: int = 600):
    states = [(10.0 * row, 3.0 * row, 0.4, speed) for row in range(count)]
    return straight_drivers(states)


@pytest.mark.parametrize("width", [0.0, 2.0, 10.0])
def test_smooth_noise_has_its_variance_and_correlation(width):
    series = smooth_noise(random(), 4000, 60, width)
    assert abs(series.mean()) < 0.03
    np.testing.assert_allclose(series.var(axis=0), 1.0, atol=0.1)
    for gap in (1, 5, 15):
        found = (series[:, gap:] * series[:, :-gap]).mean()
        law = np.exp(-(gap**2) / (4 * width**2)) if width else 0.0
        assert found == pytest.approx(law, abs=0.03)


def test_a_perfect_tracker_changes_nothing():
    tracks = crowd(8.0, 20)
    blurred = noisy(tracks, SILENT, random(), 0.1)
    np.testing.assert_allclose(blurred.position_m, tracks.position_m, atol=1e-12)
    np.testing.assert_allclose(blurred.heading_rad, tracks.heading_rad, atol=1e-12)
    np.testing.assert_allclose(blurred.velocity_mps, tracks.velocity_mps, atol=1e-12)
    everything = seen(tracks, 0, np.array([0]), SILENT, random(), 0.1)
    np.testing.assert_array_equal(everything, tracks.is_valid)


def test_strengths_are_the_stated_ones_along_and_across():
    tracks = crowd(10.0)
    noise = dataclasses.replace(TrackingNoise(), agent_spread=0.0, heading_spread=0.0)
    blurred = noisy(tracks, noise, random(), 0.1)
    ahead = np.array([np.cos(0.4), np.sin(0.4)])
    left = np.array([-ahead[1], ahead[0]])
    moved = blurred.position_m - tracks.position_m
    assert (moved @ ahead).std() == pytest.approx(noise.along_m, rel=0.06)
    assert (moved @ left).std() == pytest.approx(noise.across_m, rel=0.06)
    turned = wrap_angle(blurred.heading_rad - tracks.heading_rad)
    assert turned.std() == pytest.approx(noise.heading_rad, rel=0.06)
    changed = blurred.velocity_mps - tracks.velocity_mps
    assert (changed @ ahead).std() == pytest.approx(noise.velocity_along_mps, rel=0.06)
    assert (changed @ left).std() == pytest.approx(noise.velocity_across_mps, rel=0.06)


def test_headings_have_the_tails_of_real_tracks():
    tracks = crowd(10.0, 3000)
    turned = noisy(tracks, TrackingNoise(), random(), 0.1).heading_rad - 0.4
    middle, tail = np.degrees(np.percentile(np.abs(turned), [50, 90]))
    assert 0.5 < middle < 0.9
    assert 2.7 < tail < 4.5


def test_standing_agents_hardly_move():
    tracks = crowd(0.0)
    blurred = noisy(tracks, TrackingNoise(), random(), 0.1)
    scatter = blurred.position_m.std(axis=1).mean(axis=1)
    assert 0.02 < np.median(scatter) < 0.1
    assert np.median(blurred.speed_mps()) < 0.05


def test_tracks_are_smooth():
    """Over 1 s, tracks leave a parabola by centimetres only, as real ones do."""
    blurred = noisy(crowd(10.0), TrackingNoise(), random(), 0.1).position_m[:, :11]
    time = np.linspace(-0.5, 0.5, 11)
    basis = np.stack([time**0, time, time**2], axis=-1)
    rest = np.eye(11) - basis @ np.linalg.pinv(basis)
    assert np.median((rest @ blurred).std(axis=1)) < 0.02


def test_far_and_hidden_agents_are_not_seen():
    tracks = crowd(0.0, 40)
    sight = dataclasses.replace(SILENT, range_m=100.0, range_spread=0.0)
    is_seen = seen(tracks, 0, np.array([0, 39]), sight, random(), 0.1)
    gap = np.linalg.norm(tracks.position_m - tracks.position_m[0], axis=-1)
    expected = gap <= 100.0
    expected[39] = True
    np.testing.assert_array_equal(is_seen, expected)


def test_occlusions_last_as_long_as_they_should():
    """The hidden share of a process of arrivals is 1 - exp(-rate * mean duration)."""
    noise = dataclasses.replace(
        SILENT, occlusions_per_s=0.05, occlusion_s=1.5, occlusion_spread=0.0
    )
    tracks = crowd(0.0)
    is_seen = seen(tracks, 0, np.array([0]), noise, random(), 0.1)
    assert is_seen[0].all()
    late = 1 - is_seen[1:, 60:].mean()
    assert late == pytest.approx(1 - np.exp(-0.05 * 1.55), rel=0.15)
