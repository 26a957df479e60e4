"""Runs an evaluation: every method on every scene and road condition."""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Final

import pyarrow.parquet as pq

from pd_editor.base.errors import InputError
from pd_editor.base.installed_files import data_root
from pd_editor.base.regular_file import unwritable
from pd_editor.experiments.evaluation.evaluation_task import DRIVING, EvaluationTask
from pd_editor.experiments.evaluation.method import Method
from pd_editor.experiments.evaluation.results_folder import (
    EvaluationFolder,
    RunSettings,
)
from pd_editor.experiments.evaluation.road_condition import RoadCondition
from pd_editor.experiments.evaluation.scene_rows import (
    ROW_SCHEMA,
    SceneItem,
    evaluate_scene,
)
from pd_editor.experiments.work_engine import WorkEngine, run_items
from pd_editor.experiments.work_engine.work_engine import WorkProgress
from pd_editor.scene.base_reference import MapWindow, SceneCut, part_name
from pd_editor.scene.formats.dataset import DatasetIndex, no_scenario
from pd_editor.scene.time_cut import COMPARED

ROWS_NAME: Final = "rows.parquet"
_LOG: Final = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class EvaluationPlan:
    """Specification of an evaluation: data, methods, road conditions, task."""

    data: tuple[Path, ...]
    """Roots of datasets; folders below them are searched."""
    methods: tuple[Method, ...]
    conditions: tuple[RoadCondition, ...]
    num_samples: int
    seed: int
    limit: int | None = None
    """Limit of scenes, the first ones by their folders' names."""
    task: EvaluationTask = DRIVING
    development: tuple[str, ...] = ("train",)
    """Splits on which settings were chosen; headlines use the other splits only."""
    limit_s: float | None = None
    """Time that a method may take for a scene; a method that takes longer fails there."""
    cut: SceneCut = COMPARED
    """What is used of each recording."""
    map_parts: tuple[str, ...] = ()
    """Which parts of maps the scenes are, in words of the shell."""

    @property
    def settings(self) -> RunSettings:
        """Settings that finished scenes depend on."""
        return RunSettings(
            version=version("pd-editor"),
            data=tuple(os.path.realpath(root) for root in self.data),
            methods=tuple(method.name for method in self.methods),
            samples=self.num_samples,
            seed=self.seed,
            states=self.task.states,
            agents=self.task.agents,
            current_s=self.cut.current_s,
            map_parts=self.map_parts,
        )


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Failure of one method, or of all methods, on a scene."""

    scene: str
    condition: str
    method: str
    """Name of the method; empty if the scene failed for all."""
    reason: str


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """Record of a run: scenes, failures, resumed scenes."""

    num_scenes: int
    num_skipped_folders: int
    without_future: tuple[str, ...]
    failures: tuple[Failure, ...]
    model_sha256: Mapping[str, str]
    num_resumed: int
    """Number of items that an earlier run had finished."""
    num_items: int


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A scenario's folder, or file of another format, and the name of its split."""

    folder: Path
    split: str
    window: MapWindow | None = None
    """Part of its map that it is; None: all of it."""

    @property
    def key(self) -> str:
        """Split, and name of the folder or of a part of it."""
        return f"{self.split}/{part_name(self.folder.name, self.window)}"

    def cut(self, times: SceneCut) -> SceneCut:
        """What is used of the file, given the times that are."""
        return replace(times, window=self.window)


@dataclass(frozen=True, kw_only=True)
class FoundScenes:
    """Scenarios to evaluate."""

    scenes: tuple[Scene, ...]
    num_skipped: int
    """Number of folders that lack a file or cannot be read."""


def scenes_of(data: Sequence[Path], limit: int | None = None) -> FoundScenes:
    """Find the scenarios below the roots; ``limit`` takes the first ones.

    A root may also be the name of a demo, or "demos" for all of them.

    Raises:
        InputError: a root is no folder, there is no scenario, or one occurs twice.
    """
    found: dict[str, Scene] = {}
    num_skipped = 0
    for root in map(data_root, data):
        index = DatasetIndex(root)
        for card in index.filter(min_agents=1):
            if limit is not None and len(found) >= limit:
                break
            scene = _scene(root, card.folder)
            if found.setdefault(scene.key, scene) is not scene:
                raise InputError(
                    f"{card.folder}: was found before as {scene.key}; give "
                    "every folder once."
                )
        num_skipped += index.num_skipped
        if broken := index.failures():
            _LOG.warning(
                "%d scenes in %s cannot be read and are left out, first: %s",
                len(broken), root, broken[0],
            )  # fmt: skip
    if not found:
        raise no_scenario(data)
    return FoundScenes(scenes=tuple(found.values()), num_skipped=num_skipped)


@dataclass(frozen=True, kw_only=True)
class EvaluationSplits:
    """Splits that are evaluated separately: held-out and development splits."""

    held_out: tuple[str, ...]
    development: tuple[str, ...]

    @property
    def headline(self) -> tuple[str, ...]:
        """Held-out splits; the development splits if there are no others."""
        return self.held_out or self.development


def splits_of(plan: EvaluationPlan, found: FoundScenes) -> EvaluationSplits:
    """Divide the splits of the scenes into held-out and development splits."""
    names = tuple(dict.fromkeys(scene.split for scene in found.scenes))
    return EvaluationSplits(
        held_out=tuple(name for name in names if name not in plan.development),
        development=tuple(name for name in names if name in plan.development),
    )


def _scene(root: Path, folder: Path) -> Scene:
    parent = folder.relative_to(root).parent.as_posix()
    split = os.path.basename(os.path.realpath(root)) if parent == "." else parent
    return Scene(folder=folder, split=split)


def items_of(plan: EvaluationPlan, scenes: Sequence[Scene]) -> dict[str, SceneItem]:
    """Work items by key: split, folder and road condition."""
    return {
        f"{scene.key}/{condition.label.replace(':', '_')}": SceneItem(
            folder=scene.folder,
            split=scene.split,
            condition=condition,
            methods=plan.methods,
            num_samples=plan.num_samples,
            seed=plan.seed,
            task=plan.task,
            limit_s=plan.limit_s,
            cut=scene.cut(plan.cut),
        )
        for scene in scenes
        for condition in plan.conditions
    }


def run_evaluation(
    plan: EvaluationPlan,
    found: FoundScenes,
    folder: EvaluationFolder,
    engine: WorkEngine,
    *,
    on_progress: Callable[[WorkProgress], None] | None = None,
) -> RunRecord:
    """Evaluate unfinished items, and write ``rows.parquet`` of all items.

    Raises:
        ExportError: the folder cannot be written.
    """
    items = items_of(plan, found.scenes)
    done = folder.finished(items)
    failures = run_items(
        engine,
        evaluate_scene,
        items,
        on_value=folder.store,
        on_progress=on_progress,
        done=done,
    )
    broken = {key: failure.reason for key, failure in failures.items()}
    return _collected(folder, items, broken, found.num_skipped, len(done))


def _collected(
    folder: EvaluationFolder,
    items: Mapping[str, SceneItem],
    broken: Mapping[str, str],
    num_skipped: int,
    num_resumed: int,
) -> RunRecord:
    """Write the rows of all items in order, and collect the record of the run."""
    failures: list[Failure] = []
    without_future: dict[str, None] = {}
    hashes: dict[str, str] = {}
    target = folder.path / ROWS_NAME
    try:
        with pq.ParquetWriter(target, ROW_SCHEMA) as writer:
            for key, item in items.items():
                scene, road = item.scene_name, item.condition.label
                rows = None if key in broken else folder.load(key)
                if rows is None:
                    reason = broken.get(key, "Its finished file cannot be read.")
                    failures.append(
                        Failure(scene=scene, condition=road, method="", reason=reason)
                    )
                    continue
                if not rows.has_future:
                    without_future[scene] = None
                failures += [
                    Failure(scene=scene, condition=road, method=name, reason=reason)
                    for name, reason in rows.failures.items()
                ]
                hashes |= {
                    name: text for name, text in rows.model_sha256.items() if text
                }
                writer.write_table(rows.table)
    except OSError as error:
        raise unwritable(target, error) from error
    return RunRecord(
        num_scenes=len({(item.folder, item.cut) for item in items.values()}),
        num_skipped_folders=num_skipped,
        without_future=tuple(without_future),
        failures=tuple(failures),
        model_sha256=hashes,
        num_resumed=num_resumed,
        num_items=len(items),
    )
