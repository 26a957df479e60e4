"""A classifier that distinguishes sampled from recorded vehicles.

A classifier two-sample test (Lopez-Paz and Oquab, ICLR 2017) on the surroundings of
vehicles, cross-validated by scene. An AUC of 0.5 means indistinguishable, 1.0 always
distinguishable.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from scene_test.features import FEATURES

NUM_FOLDS: Final = 8
NUM_SEEDS: Final = 3
NUM_TELLING: Final = 3
NUM_RESAMPLES: Final = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings:
    """Surroundings of V vehicles of some scenes."""

    features: np.ndarray
    """``FEATURES`` [V F]."""
    scene: np.ndarray
    """Id of each vehicle's scene [V]."""


@dataclass(frozen=True, kw_only=True)
class SceneTest:
    """Result of a scene test."""

    auc: float
    """AUC on held-out vehicles, mean over seeds."""
    interval: tuple[float, float]
    """95 % of its resamples of scenes."""
    telling: tuple[tuple[str, float], ...]
    """Features that differ most, each with the AUC of the feature alone."""

    def __str__(self) -> str:
        """The AUC with its interval, and what tells most, in words."""
        low, high = self.interval
        words = ", ".join(f"{name} {auc:.2f}" for name, auc in self.telling)
        return f"{self.auc:.3f} [{low:.2f}, {high:.2f}]; {words}"


def scene_test(recorded: Surroundings, generated: Surroundings) -> SceneTest | None:
    """Distinguish two sets of vehicles; None with fewer than two scenes.

    Raises:
        ImportError: scikit-learn is not installed.
    """
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.metrics import roc_auc_score
    from sklearn.model_selection import GroupKFold
    from threadpoolctl import threadpool_limits

    features = np.concatenate([recorded.features, generated.features])
    is_generated = np.repeat([0, 1], [len(recorded.features), len(generated.features)])
    names, scene = np.unique(
        np.concatenate([recorded.scene, generated.scene]), return_inverse=True
    )
    num_folds = min(NUM_FOLDS, len(names))
    if num_folds < 2 or not 0 < is_generated.mean() < 1:
        return None
    score = np.zeros((NUM_SEEDS, len(features)))
    # One thread: so few vehicles gain nothing from several, which a busy machine slows.
    with threadpool_limits(1):
        for seed in range(NUM_SEEDS):
            folds = GroupKFold(num_folds, shuffle=True, random_state=seed)
            for train, test in folds.split(features, is_generated, scene):
                model = HistGradientBoostingClassifier(
                    max_depth=4,
                    max_iter=150,
                    learning_rate=0.06,
                    min_samples_leaf=12,
                    random_state=seed,
                ).fit(features[train], is_generated[train])
                score[seed, test] = model.predict_proba(features[test])[:, 1]

    def auc(weight: np.ndarray | None = None) -> float:
        found = [
            roc_auc_score(is_generated, one, sample_weight=weight) for one in score
        ]
        return float(np.mean(found))

    random = np.random.default_rng(0)
    counts = random.multinomial(
        len(names), np.ones(len(names)) / len(names), NUM_RESAMPLES
    )
    resampled = [
        auc(weight)
        for weight in counts[:, scene]
        if weight[is_generated == 0].any() and weight[is_generated == 1].any()
    ]
    low, high = np.quantile(resampled, [0.025, 0.975])
    alone = [roc_auc_score(is_generated, column) for column in features.T]
    order = np.argsort(-np.abs(np.array(alone) - 0.5))[:NUM_TELLING]
    return SceneTest(
        auc=auc(),
        interval=(float(low), float(high)),
        telling=tuple((FEATURES[index], float(alone[index])) for index in order),
    )
