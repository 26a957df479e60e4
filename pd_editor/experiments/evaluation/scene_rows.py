"""Rows of metrics of one scene under one road condition, and their folder."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool

from pd_editor.analysis.metrics.lanes import OFF_LANE_M, nearest_edge
from pd_editor.analysis.metrics.scene_metrics import agent_values, sample_values
from pd_editor.analysis.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.analysis.metrics.values import METRICS, MetricValues
from pd_editor.editor.scenario_store import scene_part
from pd_editor.experiments.evaluation.evaluation_task import (
    DRIVING,
    EvaluationTask,
    RoadCondition,
)
from pd_editor.experiments.evaluation.method import (
    EvaluatedTraffic,
    Method,
    TrialItem,
    tried,
)
from pd_editor.experiments.work_engine.work_engine import (
    WorkEngine,
    WorkProgress,
    run_items,
)
from pd_editor.experiments.work_engine.work_folder import FINISHED_NAME, ResumableFolder
from pd_editor.scene.agent_kind import GROUP_KINDS
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.generation import GenerationRequest
from pd_editor.scene.thresholds import STANDING_MPS

LISTS: Final = ("local_density", "surroundings")
"""Metrics with several values for each agent."""
PER_STEP: Final = (
    "longitudinal_acceleration",
    "lateral_acceleration",
    "jerk",
    "yaw_rate",
)
"""Metrics per step, which are left out of the rows because of their size."""
METRIC_COLUMNS: Final = tuple(
    name for name in METRICS if name not in PER_STEP and name not in LISTS
)
_Columns = dict[str, np.ndarray]
KEY_FIELDS: Final = (
    ("scenario_id", pa.string()),
    ("city", pa.string()),
    ("split", pa.string()),
    ("method", pa.string()),
    ("warp", pa.string()),
    ("power", pa.float64()),
    ("seed", pa.int64()),
    ("sample", pa.int32()),
    ("agent_id", pa.string()),
    ("kind", pa.string()),
    ("group", pa.string()),
    ("under_way", pa.bool_()),
    ("on_lane", pa.bool_()),
    ("recorded", pa.float32()),
)
"""Columns that identify a row. ``sample`` is null in rows about all samples of an agent.
``under_way`` (not standing at the current step), ``on_lane`` (within 4 m of a centre line
then) and ``recorded`` (share of later steps) are those of the log where states are
recorded, and those of the sample where states are sampled."""
ROW_SCHEMA: Final = pa.schema(
    [
        *KEY_FIELDS,
        *((name, pa.float32()) for name in METRIC_COLUMNS),
        *((name, pa.list_(pa.float32())) for name in LISTS),
    ]
)


@dataclass(frozen=True, kw_only=True)
class SceneItem(TrialItem):
    """Work item: one scene under one road condition, for all methods."""

    condition: RoadCondition
    methods: tuple[Method, ...]
    task: EvaluationTask = DRIVING


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneRows:
    """Result of an item."""

    table: pa.Table
    """One row per method, sample and agent; null where a metric is not valid."""
    failures: Mapping[str, str] = field(default_factory=dict)
    """Reason of each method, or variant, without values."""
    has_future: bool = True
    model_sha256: Mapping[str, str] = field(default_factory=dict)


def evaluate_scene(item: SceneItem) -> SceneRows:
    """Evaluate every method on a scene.

    Raises:
        InputError: the scenario cannot be read.
        EditError: it has no focal agent ahead of which the road is warped.
        GenerationError: it has no road user at its current step.
    """
    recorded = scene_part(item.folder, item.cut)
    later = recorded.agents.is_valid[:, recorded.current_step + 1 :]
    if not later.any():
        return SceneRows(table=ROW_SCHEMA.empty_table(), has_future=False)
    request = item.task.request(
        recorded,
        item.condition.applied_to(recorded),
        num_samples=item.num_samples,
        seed=item.seed,
    )
    log = None
    if not item.task.samples_states:
        log = _columns_of(recorded_traffic(request.scenario, request.agent_ids))
    tables, failures, hashes = [ROW_SCHEMA.empty_table()], {}, {}
    for method in item.methods:
        traffic = tried(partial(method.traffic, request), item.limit_s)
        if isinstance(traffic, str):
            failures[method.name] = traffic
        else:
            tables += _method_tables(item, request, log, method, traffic)
            hashes[method.name] = traffic.model_sha256
    return SceneRows(
        table=pa.concat_tables(tables), failures=failures, model_sha256=hashes
    )


def is_on_its_way(view: TrafficView) -> Bool[np.ndarray, "A"]:
    """Which agents move at the current step and are within 4 m of a centre line then."""
    return _is_under_way(view) & _is_on_lane(view)


def _is_under_way(view: TrafficView) -> Bool[np.ndarray, "A"]:
    return np.hypot(*view.agents.velocity_mps[:, 0].T) >= STANDING_MPS


def _is_on_lane(view: TrafficView) -> Bool[np.ndarray, "A"]:
    edge, _ = nearest_edge(view)
    return edge.is_valid & (edge.value <= OFF_LANE_M)


def _columns_of(view: TrafficView) -> _Columns:
    """Columns of agents: whether they drive, are on a lane, and how long recorded."""
    return {
        "under_way": _is_under_way(view),
        "on_lane": _is_on_lane(view),
        "recorded": view.agents.is_valid[:, 1:].mean(axis=1).astype(np.float32),
    }


def _method_tables(
    item: SceneItem,
    request: GenerationRequest,
    log: _Columns | None,
    method: Method,
    traffic: EvaluatedTraffic,
) -> list[pa.Table]:
    """One table for each sample, and one for all samples together.

    Where states are sampled, agents differ between samples: there are no metrics of all
    samples together, nor errors against the log.
    """
    views = list(traffic.samples)
    values: list[tuple[int | None, _Columns, Mapping[str, MetricValues]]]
    if log is None:
        views = [_without_log(view) for view in views]
        values = [
            (number, _columns_of(view), agent_values(view))
            for number, view in enumerate(views)
        ]
    else:
        values = [
            (number, log, agent_values(view)) for number, view in enumerate(views)
        ]
        values.append((None, log, sample_values(views)))
    agents = views[0].agents
    fixed = {
        # Unique within the split, which ids need not be.
        "scenario_id": item.place.name,
        "city": request.scenario.city,
        "split": item.split,
        "method": method.name,
        "warp": item.condition.kind,
        "power": item.condition.power,
        "seed": request.seed,
    }
    return [
        _table({**fixed, "sample": sample}, agents, columns, metrics)
        for sample, columns, metrics in values
    ]


def _without_log(view: TrafficView) -> TrafficView:
    nowhere = np.zeros_like(view.logged.is_valid)
    return replace(view, logged=replace(view.logged, is_valid=nowhere))


def _table(
    fixed: Mapping[str, str | float | None],
    agents: AgentStates,
    about: Mapping[str, np.ndarray],
    metrics: Mapping[str, MetricValues],
) -> pa.Table:
    count, groups = len(agents), list(GROUP_KINDS)
    each = {
        "agent_id": list(agents.ids),
        "kind": [kind.value for kind in agents.kinds],
        "group": [groups[row] if row >= 0 else None for row in agents.group.tolist()],
        **about,
    }
    columns = []
    for one in ROW_SCHEMA:
        if one.name in fixed:
            columns.append(pa.repeat(pa.scalar(fixed[one.name], one.type), count))
        elif one.name in each:
            columns.append(pa.array(each[one.name], one.type))
        elif one.name not in metrics:
            columns.append(pa.nulls(count, one.type))
        else:
            columns.append(_column(metrics[one.name], one.type))
    return pa.Table.from_arrays(columns, schema=ROW_SCHEMA)


def _column(values: MetricValues, kind: pa.DataType) -> pa.Array:
    if values.value.ndim == 1:
        numbers = values.value.astype(np.float32)
        return pa.array(numbers, kind, mask=~values.is_valid)
    lists: Sequence[Sequence[float]] = [
        row[is_valid].tolist()
        for row, is_valid in zip(values.value, values.is_valid, strict=True)
    ]
    return pa.array(lists, kind)


_METADATA_KEY: Final = b"pd_editor"


@dataclass(frozen=True, kw_only=True, eq=False)
class RunResults:
    """What a run has."""

    rows_path: Path
    """File of the rows of all items, in their order."""
    finished: Mapping[str, SceneRows]
    """Items with rows, which are left out here."""
    failures: Mapping[str, str]
    """Reasons of items without rows, by key."""
    num_resumed: int
    """Number of items that an earlier run had finished."""

    @cached_property
    def rows(self) -> pa.Table:
        """Rows of all items."""
        return pq.read_table(self.rows_path)


class RowsFolder(ResumableFolder):
    """Results folder of trials that can be resumed."""

    def __init__(
        self,
        path: Path,
        settings: Mapping[str, Any],
        rows: tuple[str, pa.Schema],
        *,
        work: str,
        resume: bool,
    ) -> None:
        """Create the folder, or resume the one of an earlier run.

        ``rows`` are name and schema of the file of all rows.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: the folder belongs to a run with other settings.
        """
        super().__init__(path, settings, work=work, resume=resume)
        name, self.schema = rows
        self.rows_path = path / name

    def store(self, key: str, rows: SceneRows) -> None:
        """Store a finished item.

        Raises:
            ExportError: the file cannot be written.
        """
        about = {
            "failures": dict(rows.failures),
            "has_future": rows.has_future,
            "model_sha256": dict(rows.model_sha256),
        }
        metadata = {_METADATA_KEY: json.dumps(about).encode()}
        sink = pa.BufferOutputStream()
        pq.write_table(rows.table.replace_schema_metadata(metadata), sink)
        self.write(self._name(key), sink.getvalue().to_pybytes())

    def load(self, key: str, *, with_rows: bool = True) -> SceneRows | None:
        """Load a finished item; None if it is missing or unusable."""
        try:
            file = pq.ParquetFile(self.path / self._name(key))
            about = json.loads((file.schema_arrow.metadata or {})[_METADATA_KEY])
            if not file.schema_arrow.equals(self.schema):
                return None
            table = file.read() if with_rows else self.schema.empty_table()
        except (OSError, ValueError, KeyError):
            return None
        return SceneRows(table=table.replace_schema_metadata(None), **about)

    def finished(self, keys: Iterable[str]) -> frozenset[str]:
        """Keys of the items that are finished without failures, among some keys."""
        found = ((key, self.load(key, with_rows=False)) for key in keys)
        return frozenset(key for key, rows in found if rows and not rows.failures)

    def run(
        self,
        function: Callable[[Any], SceneRows],
        items: Mapping[str, TrialItem],
        engine: WorkEngine,
        *,
        on_progress: Callable[[WorkProgress], None] | None = None,
        on_rows: Callable[[pa.Table], None] = lambda _: None,
    ) -> RunResults:
        """Run unfinished items, and write the rows of all items in order.

        ``on_rows`` is called with the rows of each item that this run finishes.

        Raises:
            ExportError: the folder cannot be written.
        """
        done = self.finished(items)

        def store(key: str, rows: SceneRows) -> None:
            self.store(key, rows)
            on_rows(rows.table)

        failed = run_items(
            engine, function, items, on_value=store, on_progress=on_progress, done=done
        )
        reasons = {key: failure.reason for key, failure in failed.items()}
        finished: dict[str, SceneRows] = {}
        sink = pa.BufferOutputStream()
        with pq.ParquetWriter(sink, self.schema) as writer:
            for key in items:
                rows = None if key in reasons else self.load(key)
                if rows is None:
                    reasons.setdefault(key, "Its finished file cannot be read.")
                    continue
                writer.write_table(rows.table)
                finished[key] = replace(rows, table=self.schema.empty_table())
        self.write(self.rows_path.name, sink.getvalue().to_pybytes())
        return RunResults(
            rows_path=self.rows_path,
            finished=finished,
            failures=reasons,
            num_resumed=len(done),
        )

    def _name(self, key: str) -> str:
        return f"{FINISHED_NAME}/{key}.parquet"
