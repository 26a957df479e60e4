"""What a distance of distributions is between recordings and recordings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

NUM_DRAWS: Final = 200


@runtime_checkable
class RowsOfValues(Protocol):
    """Values with a row for each agent of a scene; ``MetricValues`` are such."""

    @property
    def is_valid(self) -> Bool[np.ndarray, "A *shape"]:
        """Which values mean something."""
        ...

    def __len__(self) -> int:
        """Number of rows."""
        ...

    def taken(self, rows: np.ndarray) -> "RowsOfValues":
        """Only some rows: indices, or one truth value per row."""
        ...

    def valid(self) -> Float[np.ndarray, "N"]:
        """The values that mean something, one after the other."""
        ...


@dataclass(frozen=True, kw_only=True)
class NoiseFloor:
    """What a distance is between recordings and other recordings."""

    mean: float
    std: float
    num_draws: int


def noise_floor(
    real_scenes: Sequence[RowsOfValues],
    distance: Callable[[np.ndarray, np.ndarray], float],
    *,
    num_agents: int,
    draws: int = NUM_DRAWS,
    seed: int = 0,
) -> NoiseFloor:
    """Mean distance from all real scenes to as many agents of real scenes drawn anew.

    Scenes are drawn with replacement and whole, the last one cut to the number of
    agents. ``distance`` takes the valid values of the draw and those of all scenes.

    Args:
        real_scenes: values per scene; agents without a valid value do not count.
        distance: for example ``lambda a, b: histogram.distance(a, b).root``.
        num_agents: how many agents the set under test has.
        draws: number of draws.
        seed: of the draws.
    """
    scenes = [scene.taken(_has_value(scene)) for scene in real_scenes]
    scenes = [scene for scene in scenes if len(scene)]
    assert scenes, "a noise floor needs real values"
    assert num_agents > 0
    everything = np.concatenate([scene.valid() for scene in scenes])
    random = np.random.default_rng(seed)
    found = np.zeros(draws)
    for draw in range(draws):
        parts: list[np.ndarray] = []
        missing = num_agents
        while missing > 0:
            scene = scenes[random.integers(len(scenes))]
            if len(scene) > missing:
                scene = scene.taken(random.permutation(len(scene))[:missing])
            parts.append(scene.valid())
            missing -= len(scene)
        found[draw] = distance(np.concatenate(parts), everything)
    return NoiseFloor(mean=float(found.mean()), std=float(found.std()), num_draws=draws)


def _has_value(scene: RowsOfValues) -> np.ndarray:
    return np.any(scene.is_valid.reshape(len(scene), -1), axis=1)
