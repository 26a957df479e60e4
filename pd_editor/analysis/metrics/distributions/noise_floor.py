"""Noise floor: the distance of distributions between recordings and recordings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pd_editor.analysis.metrics.values import MaskedValues

NUM_RESAMPLES: Final = 200


@dataclass(frozen=True, kw_only=True)
class NoiseFloor:
    """Mean and deviation of a distance between recordings and other recordings."""

    mean: float
    std: float
    num_resamples: int


def noise_floor(
    real_scenes: Sequence[MaskedValues],
    distance: Callable[[np.ndarray, np.ndarray], float],
    *,
    num_agents: int,
    num_resamples: int = NUM_RESAMPLES,
    seed: int = 0,
) -> NoiseFloor:
    """Mean distance between all real scenes and resampled real scenes.

    Whole scenes are resampled with replacement, the last one cut to the number of
    agents. ``distance`` takes the valid values of the resample and of all scenes.

    Args:
        real_scenes: values per scene; agents without a valid value do not count.
        distance: for example ``lambda a, b: histogram.distance(a, b).root``.
        num_agents: number of agents of the set under test.
        num_resamples: number of resamples.
        seed: seed of the resamples.
    """
    scenes = [scene.taken(scene.has_value()) for scene in real_scenes]
    scenes = [scene for scene in scenes if len(scene)]
    assert scenes, "a noise floor needs real values"
    assert num_agents > 0
    everything = np.concatenate([scene.valid() for scene in scenes])
    random = np.random.default_rng(seed)
    found = np.zeros(num_resamples)
    for index in range(num_resamples):
        parts: list[np.ndarray] = []
        missing = num_agents
        while missing > 0:
            scene = scenes[random.integers(len(scenes))]
            if len(scene) > missing:
                scene = scene.taken(random.permutation(len(scene))[:missing])
            parts.append(scene.valid())
            missing -= len(scene)
        found[index] = distance(np.concatenate(parts), everything)
    return NoiseFloor(
        mean=float(found.mean()), std=float(found.std()), num_resamples=num_resamples
    )
