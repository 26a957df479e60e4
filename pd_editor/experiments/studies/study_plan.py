"""Plan of a perturbation study: scenes, methods, road conditions and seeds."""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import InputError
from pd_editor.experiments.evaluation.evaluation import Scene
from pd_editor.experiments.evaluation.method import TrialPlan
from pd_editor.experiments.evaluation.road_condition import (
    ANCHORS,
    DEFAULT_ANCHOR,
    RoadCondition,
)
from pd_editor.experiments.evaluation.scene_rows import RowsFolder
from pd_editor.experiments.studies.variant_rows import (
    VARIANT_SCHEMA,
    VARIANTS_NAME,
    StudyItem,
)
from pd_editor.scene.generation import MAX_SEED
from pd_editor.scene.perturbation.friction import DRY_ROAD_FRICTION
from pd_editor.scene.road_warp import MAX_POWER, WARP_KINDS, WarpKind

GRID_POWERS: Final = tuple(float(p) for p in (*range(-9, 0), *range(1, 10)))
"""The 18 powers of Scene-Attack's grid."""
CONDITIONS_PER_ITEM: Final = 18
"""Road conditions of one work item: a scenario is read once for all of them."""


@dataclass(frozen=True, kw_only=True)
class StudyPlan(TrialPlan):
    """Specification of a study."""

    seeds: tuple[int, ...] = (0,)
    friction_coefficient: float | None = DRY_ROAD_FRICTION
    """Agents are slowed to the speed that it allows on the warped road; None: not."""

    def __post_init__(self) -> None:
        if not self.methods or not self.seeds or not self.conditions:
            raise InputError(
                "A study needs at least one method, one road condition and one seed."
            )
        for seed in self.seeds:
            if not 0 <= seed <= MAX_SEED:
                raise InputError(f"The seed is {seed}; expected 0 to {MAX_SEED}.")

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that finished items depend on."""
        return {
            **super().settings,
            "conditions": [one.label for one in self.conditions],
            "seeds": self.seeds,
            "friction": self.friction_coefficient,
            "limit": self.limit,
        }

    def folder(self, path: Path, *, resume: bool) -> RowsFolder:
        """A new folder for the results, or that of an earlier run.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: the folder belongs to a study with other settings.
        """
        rows = VARIANTS_NAME, VARIANT_SCHEMA
        return RowsFolder(path, self.settings, rows, work="study", resume=resume)

    def num_variants(self, num_scenes: int) -> int:
        """Number of scenario variants: scenes, methods, conditions and seeds."""
        return num_scenes * len(self.methods) * len(self.seeds) * len(self.conditions)


def study_items(plan: StudyPlan, scenes: Sequence[Scene]) -> dict[str, StudyItem]:
    """Work items by key: split, folder, method, seed, and a part of the conditions."""
    starts = range(0, len(plan.conditions), CONDITIONS_PER_ITEM)
    return {
        f"{scene.key}/m{number}-s{seed}-c{start}": StudyItem(
            folder=scene.folder,
            split=scene.split,
            method=method,
            conditions=plan.conditions[start : start + CONDITIONS_PER_ITEM],
            seed=seed,
            num_samples=plan.num_samples,
            friction_coefficient=plan.friction_coefficient,
            limit_s=plan.limit_s,
            cut=scene.cut(plan.cut),
        )
        for scene in scenes
        for number, method in enumerate(plan.methods)
        for seed in plan.seeds
        for start in starts
    }


def grid_conditions(
    kinds: Iterable[str] = WARP_KINDS,
    powers: Iterable[float] = GRID_POWERS,
    anchors: Iterable[str] = (DEFAULT_ANCHOR,),
) -> tuple[RoadCondition, ...]:
    """The original road, then each kind at each power and anchor.

    Raises:
        InputError: a kind, power or anchor is not known.
    """
    conditions = {RoadCondition(): None}
    for anchor, kind, power in product(anchors, kinds, powers):
        if anchor not in ANCHORS:
            raise InputError(
                f"Anchor {anchor[:60]!r} is not known; expected {' or '.join(ANCHORS)}."
            )
        if not 0 < abs(power) <= MAX_POWER:
            raise InputError(
                f"Power {power:g} is not possible; expected -10 to 10 other than 0."
            )
        terms: tuple[tuple[WarpKind, float], ...] = ((_known_kind(kind), float(power)),)
        conditions[RoadCondition(terms=terms, anchor=anchor)] = None
    return tuple(conditions)


def _known_kind(text: str) -> WarpKind:
    for kind in WARP_KINDS:
        if kind == text:
            return kind
    raise InputError(
        f"Warp {text[:60]!r} is not known; expected {', '.join(WARP_KINDS)}."
    )


def study_command(plan: StudyPlan, out: str | Path) -> str:
    """Command line that reproduces the numbers."""
    words = ["pd-editor", "study", "--data", *map(str, plan.data), "--out", str(out)]
    words += ["--methods", *(method.name for method in plan.methods)]
    kinds = [one for one in plan.conditions if len(one.terms) == 1]
    sums = [one.label for one in plan.conditions if len(one.terms) > 1]
    words += ["--kinds", *dict.fromkeys(one.kind.split(":")[0] for one in kinds)]
    words += ["--powers", *dict.fromkeys(f"{one.power:g}" for one in kinds)]
    words += ["--anchors", *dict.fromkeys(one.anchor for one in kinds)]
    words += ["--warps", *sums] if sums else []
    words += ["--seeds", *map(str, plan.seeds), "--samples", str(plan.num_samples)]
    words += ["--friction", f"{plan.friction_coefficient or 0:g}"]
    words += [] if plan.limit is None else ["--limit", str(plan.limit)]
    now_s = plan.cut.current_s
    words += [] if now_s is None else ["--current", f"{now_s:g}"]
    words += plan.map_parts
    return shlex.join(words)
