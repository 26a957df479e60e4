"""Maximum mean discrepancy between sets."""

import numpy as np

from reproduction.mean_discrepancy import maximum_mean_discrepancy


def test_mmd_is_its_definition():
    random = np.random.default_rng(0)
    first, second = random.normal(size=(7, 2)), random.normal(1, 2, size=(5, 2))
    found = maximum_mean_discrepancy(first, second)
    apart = [np.linalg.norm(a - b) for i, a in enumerate(second) for b in second[:i]]
    np.testing.assert_allclose(found.bandwidth, np.median(apart))

    def kernel(a, b):
        return np.exp(-np.sum((a - b) ** 2) / (2 * found.bandwidth**2))

    expected = (
        np.mean(
            [kernel(a, b) for a in first for b in first if a is not b and any(a != b)]
        )
        + np.mean([kernel(a, b) for a in second for b in second if any(a != b)])
        - 2 * np.mean([kernel(a, b) for a in first for b in second])
    )
    np.testing.assert_allclose(found.squared, expected)


def test_mmd_tells_sets_apart_and_needs_points():
    random = np.random.default_rng(1)
    same = maximum_mean_discrepancy(
        random.normal(size=(400, 1)), random.normal(size=(4000, 1))
    )
    other = maximum_mean_discrepancy(
        random.normal(1, 1, size=(400, 1)), random.normal(size=(4000, 1))
    )
    assert abs(same.squared) < 0.01 < other.squared
    assert not maximum_mean_discrepancy(np.zeros((1, 1)), np.ones((5, 1))).is_valid
    assert not maximum_mean_discrepancy(np.zeros((3, 1)), np.ones((5, 1))).is_valid
