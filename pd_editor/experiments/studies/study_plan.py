"""Plan of a perturbation study (scenes, methods, roads, seeds), and rows of variants."""

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyarrow as pa
from jaxtyping import Bool

from pd_editor.analysis.metrics.box_overlaps import box_overlap
from pd_editor.analysis.metrics.lanes import lane_deviation, off_lane_values
from pd_editor.analysis.metrics.motion import ade, best_of_samples, kinematics
from pd_editor.analysis.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.analysis.metrics.values import MetricValues
from pd_editor.base.errors import InputError
from pd_editor.editor.scenario_store import scene_part
from pd_editor.experiments.evaluation.evaluation import Scene
from pd_editor.experiments.evaluation.evaluation_task import (
    ANCHORS,
    DEFAULT_ANCHOR,
    DRIVING,
    RoadCondition,
)
from pd_editor.experiments.evaluation.method import (
    EvaluatedTraffic,
    Method,
    TrialItem,
    TrialPlan,
    tried,
)
from pd_editor.experiments.evaluation.scene_rows import (
    RowsFolder,
    SceneRows,
    is_on_its_way,
)
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.generation import MAX_SEED, GenerationRequest
from pd_editor.scene.perturbation.friction import DRY_ROAD_FRICTION
from pd_editor.scene.road_warp import MAX_POWER, WARP_KINDS, WarpKind
from pd_editor.scene.scenario import Scenario

VARIANTS_NAME: Final = "variants.parquet"
STUDY_METRICS: Final = (
    "off_drivable_steps",
    "off_drivable",
    "lateral_deviation_mean",
    "lateral_deviation_final",
    "new_overlap",
    "uncomfortable",
    "impossible",
    "ade",
    "min_ade",
)
"""Metrics of a study: Scene-Attack's SOR and HOR first."""
StudyAgents = Literal["movers on their way", "movers", "focal"]
STUDY_AGENTS: Final[tuple[StudyAgents, ...]] = (
    "movers on their way",
    "movers",
    "focal",
)
"""Motor vehicles that move and start on a lane; all motor vehicles; or the focal agent
alone, as in Scene-Attack."""
VARIANT_SCHEMA: Final = pa.schema(
    [
        ("scenario_id", pa.string()),
        ("city", pa.string()),
        ("split", pa.string()),
        ("folder", pa.string()),
        ("method", pa.string()),
        ("model_sha256", pa.string()),
        ("condition", pa.string()),
        ("kind", pa.string()),
        ("power", pa.float64()),
        ("anchor", pa.string()),
        ("seed", pa.int64()),
        ("num_samples", pa.int32()),
        ("agents", pa.string()),
        ("failure", pa.string()),
        *((f"{name}_sum", pa.float64()) for name in STUDY_METRICS),
        *((f"{name}_count", pa.int32()) for name in STUDY_METRICS),
    ]
)
"""A row per variant and group of agents. A metric's mean is its sum over its count:
agents times samples. ``failure`` says why a variant has no values."""
_MAX_REASON_CHARACTERS: Final = 300


@dataclass(frozen=True, kw_only=True)
class StudyItem(TrialItem):
    """Work item: one scene, one method and one seed under several road conditions."""

    method: Method
    conditions: tuple[RoadCondition, ...]
    friction_coefficient: float | None

    def request(
        self, recorded: Scenario, condition: RoadCondition
    ) -> GenerationRequest:
        """Request for the traffic of one condition.

        Raises:
            EditError: the anchor of the warp is not in the scenario.
            GenerationError: there is no road user.
        """
        return DRIVING.request(
            recorded,
            condition.applied_to(recorded, self.friction_coefficient),
            num_samples=self.num_samples,
            seed=self.seed,
        )


def num_failed_variants(rows: pa.Table) -> int:
    """Number of variants without values."""
    return (len(rows) - rows["failure"].null_count) // len(STUDY_AGENTS)


def study_scene(item: StudyItem) -> SceneRows:
    """Rows of all conditions of an item.

    Raises:
        InputError: the scenario cannot be read.
    """
    recorded, rows = recorded_scenario(item.folder, item.cut), []
    failures: dict[str, str] = {}
    for condition in item.conditions:
        variant = variant_of(item, recorded, condition)
        rows += _rows(item, recorded, condition, variant)
        if variant.failure is not None:
            failures[condition.label] = variant.failure
    table = pa.Table.from_pylist(rows, VARIANT_SCHEMA)
    return SceneRows(table=table, failures=failures)


@lru_cache(maxsize=2)
def recorded_scenario(folder: Path, cut: SceneCut) -> Scenario:
    """Scenario that several items of a worker share."""
    return scene_part(folder, cut)


@dataclass(frozen=True, kw_only=True)
class MetricSum:
    """Sum and count of a metric over agents and samples."""

    total: float = 0.0
    count: int = 0

    @property
    def mean(self) -> float:
        """Mean; NaN without values."""
        return self.total / self.count if self.count else float("nan")


@dataclass(frozen=True, kw_only=True)
class DrivenVariant:
    """A scenario under a road condition, as a method drives it."""

    sums: Mapping[StudyAgents, Mapping[str, MetricSum]]
    """Sums of all study metrics for each group of agents."""
    model_sha256: str = ""
    failure: str | None = None
    """Why there are no values."""


def variant_of(
    item: StudyItem, recorded: Scenario, condition: RoadCondition
) -> DrivenVariant:
    """Run the item's method under a road condition; a method that fails has no values."""

    def drive() -> tuple[GenerationRequest, EvaluatedTraffic]:
        request = item.request(recorded, condition)
        return request, item.method.traffic(request)

    driven = tried(drive, item.limit_s)
    if isinstance(driven, str):
        return _failed(driven)
    request, traffic = driven
    return DrivenVariant(
        sums=_metric_sums(request, traffic), model_sha256=traffic.model_sha256
    )


def _failed(reason: str) -> DrivenVariant:
    empty: dict[str, MetricSum] = {name: MetricSum() for name in STUDY_METRICS}
    nothing = dict.fromkeys(STUDY_AGENTS, empty)
    return DrivenVariant(sums=nothing, failure=reason[:_MAX_REASON_CHARACTERS])


def _metric_sums(
    request: GenerationRequest, traffic: EvaluatedTraffic
) -> dict[StudyAgents, dict[str, MetricSum]]:
    """Sums over samples; which agents are on their way depends on recorded states."""
    log = recorded_traffic(request.scenario, request.agent_ids)
    movers = log.agents.is_in("movers")
    focal = np.array([one == request.scenario.focal_id for one in log.agents.ids], bool)
    members: dict[StudyAgents, Bool[np.ndarray, "A"]] = {
        "movers on their way": movers & is_on_its_way(log),
        "movers": movers,
        "focal": focal,
    }
    singles = [_values(view) for view in traffic.samples]
    best = best_of_samples(traffic.samples)
    return {
        group: {
            name: _summed(
                [best[name]] if name in best else [one[name] for one in singles], wanted
            )
            for name in STUDY_METRICS
        }
        for group, wanted in members.items()
    }


def _values(view: TrafficView) -> Mapping[str, MetricValues]:
    return {
        **off_lane_values(view),
        **lane_deviation(view).values(),
        "new_overlap": box_overlap(view).newly(),
        **kinematics(view).values(),
        "ade": ade(view),
    }


def _summed(values: Sequence[MetricValues], wanted: Bool[np.ndarray, "A"]) -> MetricSum:
    masks = [one.is_valid & wanted for one in values]
    pairs = list(zip(values, masks, strict=True))
    return MetricSum(
        total=float(sum(one.value[mask].sum() for one, mask in pairs)),
        count=int(sum(mask.sum() for mask in masks)),
    )


def _rows(
    item: StudyItem,
    recorded: Scenario,
    condition: RoadCondition,
    variant: DrivenVariant,
) -> list[dict[str, object]]:
    return [
        {
            "scenario_id": recorded.scenario_id,
            "city": recorded.city,
            "split": item.split,
            "folder": str(item.place),
            "method": item.method.name,
            "model_sha256": variant.model_sha256,
            "condition": condition.label,
            "kind": condition.family,
            "power": condition.power,
            "anchor": condition.anchor,
            "seed": item.seed,
            "num_samples": item.num_samples,
            "agents": group,
            "failure": variant.failure,
            **{f"{name}_sum": one.total for name, one in of_group.items()},
            **{f"{name}_count": one.count for name, one in of_group.items()},
        }
        for group, of_group in variant.sums.items()
    ]


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
