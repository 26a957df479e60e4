"""Figures of a model's samples on a few scenes, to watch a training by."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pd_editor.base.errors import InputError, PdEditorError
from pd_editor.experiments.evaluation.evaluation import Scene, scenes_of
from pd_editor.experiments.evaluation.evaluation_task import (
    DRIVING,
    EvaluationTask,
    RoadCondition,
)
from pd_editor.experiments.evaluation.method import (
    GROUND_TRUTH,
    Method,
    forget_generators,
)
from pd_editor.experiments.evaluation.report.realism import scene_test_of
from pd_editor.experiments.evaluation.scene_rows import (
    ROW_SCHEMA,
    SceneItem,
    evaluate_scene,
)
from pd_editor.experiments.evaluation.summary import Summary, summarise
from pd_editor.scene.generation import ScenarioGenerator

MAX_SCENES: Final = 24
"""Limit of scenes; one takes 0.3 s (trajectories) or 0.8 s (states) on one core."""
PLACING: Final = EvaluationTask(states="sampled")
DRIVING_FIGURES: Final = (
    "min_ade",
    "ade",
    "new_overlap",
    "off_drivable",
    "lateral_deviation_final",
    "path_length",
)
PLACING_FIGURES: Final = (
    "init_overlap",
    "init_off_drivable",
    "askew_to_lane",
    "askew_to_neighbour",
    "speed",
    "standing",
)
_SAMPLED: Final = "samples"
_RECORDED: Final = "recorded"
_PLAIN_ROAD: Final = RoadCondition()
_MODEL: Final = "model:raw=1"
"""Without guidance and repair, which would hide what the network has not learnt."""
_METHODS: Final = (GROUND_TRUTH, _MODEL)


@dataclass(frozen=True, kw_only=True)
class FigureScenes:
    """Scenes, and what is sampled on them: states, or trajectories from recorded states."""

    scenes: tuple[Scene, ...]
    task: EvaluationTask = DRIVING
    num_samples: int = 6
    seed: int = 0

    def figures(
        self, make_generator: Callable[[str], ScenarioGenerator]
    ) -> dict[str, dict[str, float]]:
        """Sample and measure in this process.

        Returns:
            Means over motor vehicles by metric, of ``samples`` and of ``recorded`` ones.
            Means without a value are left out. Samples also have ``failed_scenes``, on
            which the generator failed, and, of states, the AUC of the ``scene_test``.
        """
        methods = tuple(
            Method(name=name, make_generator=make_generator) for name in _METHODS
        )
        tables, num_failed = [ROW_SCHEMA.empty_table()], 0
        for scene in self.scenes:
            item = SceneItem(
                folder=scene.folder,
                split=scene.split,
                condition=_PLAIN_ROAD,
                methods=methods,
                num_samples=self.num_samples,
                seed=self.seed,
                task=self.task,
            )
            try:
                found = evaluate_scene(item)
            except PdEditorError:
                num_failed += 1
                continue
            num_failed += _MODEL in found.failures
            tables.append(found.table)
        forget_generators()
        figures = self._summarised(pa.concat_tables(tables))
        figures[_SAMPLED]["failed_scenes"] = float(num_failed)
        return figures

    def _summarised(self, table: pa.Table) -> dict[str, dict[str, float]]:
        if not len(table):
            return {_SAMPLED: {}, _RECORDED: {}}
        with tempfile.TemporaryDirectory() as folder:
            rows = Path(folder) / "rows.parquet"
            pq.write_table(table, rows)
            summary = summarise(rows, _METHODS, (_PLAIN_ROAD,), self.seed)
            found = {
                name: self._means(summary, index)
                for index, name in enumerate((_RECORDED, _SAMPLED))
            }
            if self.task.samples_states:
                splits = tuple(dict.fromkeys(scene.split for scene in self.scenes))
                test = scene_test_of(rows, _MODEL, splits)
                if test is not None:
                    found[_SAMPLED]["scene_test"] = test.auc
            return found

    def _means(self, summary: Summary, method: int) -> dict[str, float]:
        shown = PLACING_FIGURES if self.task.samples_states else DRIVING_FIGURES
        group = summary.groups.index("movers")
        means = {
            name: float(summary.statistics[name].mean.value[method, 0, group])
            for name in shown
        }
        return {name: value for name, value in means.items() if np.isfinite(value)}


def figure_scenes(roots: Sequence[Path], *, samples_states: bool) -> FigureScenes:
    """At most ``MAX_SCENES`` scenes below the roots, evenly distributed.

    Raises:
        InputError: there are no scenario folders below the roots.
    """
    try:
        found = scenes_of(roots).scenes
    except InputError as error:
        raise InputError(
            f"Samples cannot be evaluated without scenario folders: {error}"
        ) from error
    chosen = np.linspace(0, len(found) - 1, min(len(found), MAX_SCENES))
    rows = chosen.round().astype(int).tolist()
    return FigureScenes(
        scenes=tuple(found[row] for row in rows),
        task=PLACING if samples_states else DRIVING,
    )
