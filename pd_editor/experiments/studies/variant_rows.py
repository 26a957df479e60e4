"""Rows of a study: a scenario under a road condition, as one method drives it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool

from pd_editor.analysis.metrics.box_overlaps import box_overlap
from pd_editor.analysis.metrics.lanes import lane_deviation, off_lane
from pd_editor.analysis.metrics.motion import ade, best_of_samples, kinematics
from pd_editor.analysis.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.analysis.metrics.values import MetricValues
from pd_editor.editor.scenario_store import scene_part
from pd_editor.experiments.evaluation.evaluation_task import DRIVING
from pd_editor.experiments.evaluation.method import (
    EvaluatedTraffic,
    Method,
    TrialItem,
    tried,
)
from pd_editor.experiments.evaluation.road_condition import RoadCondition
from pd_editor.experiments.evaluation.scene_rows import (
    RowsFolder,
    SceneRows,
    is_on_its_way,
)
from pd_editor.experiments.work_engine.work_engine import WorkEngine, WorkProgress
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.generation import GenerationRequest
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


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyRecord:
    """Record of a run."""

    rows: pa.Table
    """Rows of all variants, in the order of the items."""
    failures: Mapping[str, str]
    """Reasons of items without rows, by key."""
    num_resumed: int
    """Number of items that an earlier run had finished."""

    @property
    def num_failed_variants(self) -> int:
        """Number of variants without values."""
        failed = len(self.rows) - self.rows["failure"].null_count
        return failed // len(STUDY_AGENTS)


def run_study(
    items: Mapping[str, StudyItem],
    folder: RowsFolder,
    engine: WorkEngine,
    *,
    on_progress: Callable[[WorkProgress], None] | None = None,
    on_rows: Callable[[pa.Table], None] = lambda _: None,
) -> StudyRecord:
    """Run the unfinished items, and write ``variants.parquet`` of all items.

    ``on_rows`` is called with the rows of each item that this run finishes.

    Raises:
        ExportError: the folder cannot be written.
    """
    run = folder.run(
        study_scene, items, engine, on_progress=on_progress, on_rows=on_rows
    )
    rows = pq.read_table(folder.rows_path)
    return StudyRecord(rows=rows, failures=run.failures, num_resumed=run.num_resumed)


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
        **off_lane(view).values(),
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
