"""The scene test: a classifier that distinguishes generated from recorded vehicles.

A classifier two-sample test (Lopez-Paz and Oquab, ICLR 2017) on the surroundings of
vehicles, cross-validated by scene. An AUC of 0.5 means indistinguishable, 1.0 always
distinguishable.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
from jaxtyping import Float

from pd_editor.analysis.metrics.road.surroundings import FEATURES
from pd_editor.experiments.evaluation.reference_methods import GROUND_TRUTH
from pd_editor.experiments.evaluation.report.tables import ReportTable
from pd_editor.experiments.evaluation.road_condition import PLAIN

NUM_FOLDS: Final = 8
NUM_SEEDS: Final = 3
NUM_TELLING: Final = 3
_EXTRA: Final = "install pd-editor[evaluate] for it (scikit-learn)"


@dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings:
    """Surroundings of V vehicles of some scenes."""

    features: Float[np.ndarray, "V F"]
    scene: np.ndarray
    """Id of each vehicle's scene [V]."""


@dataclass(frozen=True, kw_only=True)
class SceneTest:
    """Result of a scene test."""

    auc: float
    """AUC on held-out vehicles, mean over seeds."""
    telling: tuple[tuple[str, float], ...]
    """Features that differ most, each with the AUC of the feature alone."""


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
    scene = np.concatenate([recorded.scene, generated.scene])
    num_folds = min(NUM_FOLDS, len(np.unique(scene)))
    if num_folds < 2 or not 0 < is_generated.mean() < 1:
        return None
    found = []
    # One thread: so few vehicles gain nothing from several, which a busy machine slows.
    with threadpool_limits(1):
        for seed in range(NUM_SEEDS):
            folds = GroupKFold(num_folds, shuffle=True, random_state=seed)
            score = np.zeros(len(features))
            for train, test in folds.split(features, is_generated, scene):
                model = HistGradientBoostingClassifier(
                    max_depth=4,
                    max_iter=150,
                    learning_rate=0.06,
                    min_samples_leaf=12,
                    random_state=seed,
                ).fit(features[train], is_generated[train])
                score[test] = model.predict_proba(features[test])[:, 1]
            found.append(roc_auc_score(is_generated, score))
    alone = [roc_auc_score(is_generated, column) for column in features.T]
    order = np.argsort(-np.abs(np.array(alone) - 0.5))[:NUM_TELLING]
    return SceneTest(
        auc=float(np.mean(found)),
        telling=tuple((FEATURES[index], float(alone[index])) for index in order),
    )


def scene_test_tables(
    rows_file: Path, methods: Sequence[str], splits: Sequence[str]
) -> list[ReportTable]:
    """Tables with one row per method: AUC on original roads, and its main features."""
    recorded = _surroundings(rows_file, GROUND_TRUTH, splits)
    rows = []
    for name in methods:
        if name == GROUND_TRUTH:
            continue
        try:
            found = scene_test(recorded, _surroundings(rows_file, name, splits))
        except ImportError:
            rows.append((name, "-", _EXTRA))
            continue
        if found is not None:
            words = ", ".join(f"{name} {auc:.2f}" for name, auc in found.telling)
            rows.append((name, f"{found.auc:.3f}", words))
    if not rows:
        return []
    return [
        ReportTable(
            title="Scene test, vehicles on plain roads",
            header=("method", "AUC", "features that tell most, each alone"),
            rows=tuple(rows),
            note=f"{len(recorded.features)} recorded vehicles. AUC of a classifier, "
            "cross-validated by scene, that tells recorded from generated vehicles by "
            "what is around them; 0.5: it cannot. States are jittered on both sides.",
        )
    ]


def scene_test_of(
    rows_file: Path, method: str, splits: Sequence[str]
) -> SceneTest | None:
    """Scene test of one method; None without scikit-learn or with too few scenes."""
    recorded, generated = (
        _surroundings(rows_file, name, splits) for name in (GROUND_TRUTH, method)
    )
    try:
        return scene_test(recorded, generated)
    except ImportError:
        return None


def _surroundings(rows_file: Path, method: str, splits: Sequence[str]) -> Surroundings:
    table = pq.read_table(
        rows_file,
        columns=["scenario_id", "sample", "surroundings"],
        filters=(pc.field("warp") == PLAIN)
        & (pc.field("method") == method)
        & pc.field("split").isin(list(splits)),
    )
    kept = [
        (scene, values)
        for scene, values in zip(
            table["scenario_id"].to_pylist(),
            table["surroundings"].to_pylist(),
            strict=True,
        )
        if values
    ]
    return Surroundings(
        features=np.array([values for _, values in kept], float).reshape(
            -1, len(FEATURES)
        ),
        scene=np.array([scene for scene, _ in kept], str),
    )
