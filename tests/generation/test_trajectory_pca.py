import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.generation.inputs import (
    MIRRORED_LATENT_SIGNS,
    NUM_ALONG,
    TrajectoryBasis,
    heading_along,
)
from tests.generation.trajectory.scenes import arc_basis, futures


def test_components_are_orthonormal_and_latents_white() -> None:
    points, speed = futures(500, seed=9)
    basis = TrajectoryBasis.fit(points, speed)
    for components in (basis.along, basis.across):
        assert np.allclose(components @ components.T, np.eye(len(components)))
    latent = basis.encode(points, speed)
    spread = latent.std(axis=0)
    large = basis.scale_m > 0.1
    assert np.allclose(spread[large], 1.0, atol=0.05)


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_encode_is_the_inverse_of_decode(seed: int) -> None:
    basis = arc_basis()
    random = np.random.default_rng(seed)
    latent, speed = random.normal(0, 2, (3, 10)), random.uniform(0, 20, 3)
    assert np.allclose(basis.encode(basis.decode(latent, speed), speed), latent)


def test_futures_are_kept_to_centimetres_and_distances_are_those_of_latents() -> None:
    basis = arc_basis()
    points, speed = futures(200, seed=3)
    latent = basis.encode(points, speed)
    found = basis.decode(latent, speed)
    assert np.abs(found - points).mean() < 0.05
    other, own = basis.decode(latent[:100] * 1.1, speed[:100]), found[:100]
    apart = np.linalg.norm(other - own, axis=(1, 2))
    scaled = np.linalg.norm(latent[:100] * 0.1 * basis.scale_m, axis=1)
    assert np.allclose(apart, scaled)


def test_mirroring_flips_signs() -> None:
    basis = arc_basis()
    points, speed = futures(50, seed=4)
    mirrored = basis.encode(points * [1, -1], speed)
    assert np.allclose(mirrored, basis.encode(points, speed) * MIRRORED_LATENT_SIGNS)
    assert MIRRORED_LATENT_SIGNS[NUM_ALONG - 1] == 1


def test_stored_arrays_make_the_same_basis() -> None:
    basis = arc_basis()
    again = TrajectoryBasis.of_arrays(basis.arrays())
    points, speed = futures(5)
    assert np.array_equal(again.encode(points, speed), basis.encode(points, speed))


@pytest.mark.parametrize("known", [59, 40, 20])
def test_futures_known_in_part_are_completed_through_what_is_known(known: int) -> None:
    basis = arc_basis()
    points, speed = futures(60, seed=6)
    valid = np.arange(59) < np.full(60, known)[:, None]
    found = basis.decode(
        basis.completed(points * valid[..., None], valid, speed), speed
    )
    gap = np.hypot(*np.moveaxis(found - points, -1, 0))
    assert gap[:, :known].mean() < 0.1
    assert gap.max() < 100


def test_headings_follow_the_path_and_are_held_while_standing() -> None:
    turn = np.linspace(0, 1.5, 60)
    circle = 20 * np.stack([np.sin(turn), 1 - np.cos(turn)], axis=-1)
    stands = np.zeros((60, 2)) + 0.01 * np.random.default_rng(0).normal(size=(60, 2))
    back = np.stack([-np.linspace(0, 2, 60), np.zeros(60)], axis=-1)
    paths = np.stack([circle, stands, back])
    heading = heading_along(paths, np.array([0.0, 2.0, 0.0]))
    assert np.allclose(heading[0, 3:-3], turn[3:-3], atol=0.03)
    assert np.all(heading[1] == 2.0)
    assert np.allclose(heading[2], 0.0)
