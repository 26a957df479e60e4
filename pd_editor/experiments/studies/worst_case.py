"""Worst-case search: the warp under which a method does worst on a scene.

Scene-Attack searches a grid of 18 powers for each kind of warp. The black-box search
samples the powers of all kinds together, with the paper's penalty for each kind beyond
the first, by Optuna's tree-structured Parzen estimator.
"""

import math
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pyarrow as pa

from pd_editor.base.errors import InputError
from pd_editor.editor.variant import short_id
from pd_editor.experiments.evaluation.road_condition import RoadCondition
from pd_editor.experiments.studies.variant_rows import (
    STUDY_AGENTS,
    StudyAgents,
    StudyItem,
    recorded_scenario,
    variant_of,
)
from pd_editor.scene.road_warp import MAX_POWER, WARP_KINDS, WarpKind

if TYPE_CHECKING:
    from optuna.trial import Trial

PENALTY: Final = 10.0
"""Scene-Attack's penalty for each active kind of warp beyond the first."""
GRID_SIZE: Final = 54
"""Number of variants of Scene-Attack's grid: 18 powers of three kinds."""
_FIRST_POWERS: Final = (-10.0, 10.0, -7.0, 7.0, -4.0, 4.0)
"""Powers of each kind that the search tries first."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """Settings of a worst-case search."""

    metric: str = "off_drivable_steps"
    """The study metric to maximise."""
    agents: StudyAgents = STUDY_AGENTS[0]
    num_trials: int = GRID_SIZE
    penalty: float = PENALTY
    """Penalty for each active kind beyond the first; 0 searches sums as well."""
    kinds: tuple[WarpKind, ...] = WARP_KINDS


@dataclass(frozen=True, kw_only=True)
class WorstCase:
    """The worst variant that was found for one scene, method and seed."""

    scenario: str
    folder: Path
    """``StudyItem.place``, which alone tells scenarios of one id apart."""
    method: str
    seed: int
    condition: str
    """Label of the road condition; empty if no trial had a value."""
    value: float
    """The metric there; NaN if no trial had a value."""
    num_trials: int
    """Number of trials of a search; 0 for a grid."""

    @property
    def title(self) -> str:
        """Scene, road and method in one line."""
        return f"{short_id(self.scenario)} \N{MIDDLE DOT} {self.condition} \N{MIDDLE DOT} {self.method}"


@dataclass(frozen=True, kw_only=True)
class SearchItem:
    """Work item: a search on one scene."""

    variant: StudyItem
    """Scene, method and seed; its conditions are not used."""
    settings: SearchSettings


def search_scene(item: SearchItem) -> WorstCase:
    """Search the worst warp of a scene; the same item gives the same result.

    Raises:
        InputError: the scenario cannot be read, or Optuna is not installed.
    """
    try:
        import optuna
    except ImportError as error:
        raise InputError(
            'The worst-case search needs Optuna; install the extra "study" '
            "(pip install 'pd-editor[study]')."
        ) from error
    settings, variant = item.settings, item.variant
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    sampler = optuna.samplers.TPESampler(seed=variant.seed % 2**32)
    study = optuna.create_study(direction="maximize", sampler=sampler)
    for power in _FIRST_POWERS:
        for kind in settings.kinds:
            study.enqueue_trial({"kinds": kind, kind: power})
    best = (-math.inf, "", math.nan)

    def objective(trial: "Trial") -> float:
        nonlocal best
        terms = _terms_of(trial, settings.kinds)
        condition = RoadCondition(terms=terms)
        value = _value_of(variant, condition, settings)
        if not math.isfinite(value):
            raise optuna.TrialPruned
        score = value - settings.penalty * max(len(terms) - 1, 0)
        if score > best[0]:
            best = score, condition.label, value
        return score

    study.optimize(objective, n_trials=settings.num_trials)
    return WorstCase(
        scenario=variant.place.name,
        folder=variant.place,
        method=variant.method.name,
        seed=variant.seed,
        condition=best[1],
        value=best[2],
        num_trials=settings.num_trials,
    )


def _terms_of(
    trial: "Trial", kinds: tuple[WarpKind, ...]
) -> tuple[tuple[WarpKind, float], ...]:
    """Kinds and powers that a trial proposes; powers up to 0.5 count as none."""
    sets = [one for n in range(1, len(kinds) + 1) for one in combinations(kinds, n)]
    names: dict[str, tuple[WarpKind, ...]] = {"+".join(one): one for one in sets}
    chosen = names[trial.suggest_categorical("kinds", list(names))]
    powers: list[tuple[WarpKind, float]] = [
        (k, trial.suggest_float(k, -MAX_POWER, MAX_POWER)) for k in chosen
    ]
    # A kind of warp is active above this power.
    return tuple((k, power) for k, power in powers if abs(power) > 0.5)


def _value_of(
    variant: StudyItem, condition: RoadCondition, settings: SearchSettings
) -> float:
    """The metric under a road condition; NaN if the method fails there."""
    found = variant_of(
        variant, recorded_scenario(variant.folder, variant.cut), condition
    )
    return found.sums[settings.agents][settings.metric].mean


def grid_worst_cases(rows: pa.Table, settings: SearchSettings) -> tuple[WorstCase, ...]:
    """The worst variant of each scene, method and seed among the rows of a study."""
    agents = np.array(rows["agents"].to_pylist(), object)
    has_value = rows[f"{settings.metric}_count"].to_numpy() > 0
    rows = rows.filter(pa.array((agents == settings.agents) & has_value))
    total = rows[f"{settings.metric}_sum"].to_numpy()
    value = total / rows[f"{settings.metric}_count"].to_numpy()
    names = ("folder", "method", "seed", "condition")
    keys = list(zip(*(rows[name].to_pylist() for name in names), strict=True))
    found: dict[tuple[str, str, int], WorstCase] = {}
    for index in np.argsort(-value, kind="stable").tolist():
        place, method, seed, condition = keys[index]
        found.setdefault(
            (place, method, seed),
            WorstCase(
                scenario=Path(place).name,
                folder=Path(place),
                method=method,
                seed=seed,
                condition=condition,
                value=float(value[index]),
                num_trials=0,
            ),
        )
    return tuple(found.values())
