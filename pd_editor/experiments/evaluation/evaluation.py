"""Runs an evaluation: every method on every scene and road condition."""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import InputError
from pd_editor.base.installed_files import data_root
from pd_editor.experiments.evaluation.evaluation_task import DRIVING, EvaluationTask
from pd_editor.experiments.evaluation.method import TrialPlan
from pd_editor.experiments.evaluation.scene_rows import (
    ROW_SCHEMA,
    RowsFolder,
    SceneItem,
    evaluate_scene,
)
from pd_editor.experiments.work_engine.work_engine import WorkEngine, WorkProgress
from pd_editor.scene.base_reference import MapWindow, SceneCut, part_name
from pd_editor.scene.formats.dataset import CardFilter, DatasetIndex, no_scenario

ROWS_NAME: Final = "rows.parquet"
_LOG: Final = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class EvaluationPlan(TrialPlan):
    """Specification of an evaluation: data, methods, road conditions, task."""

    seed: int
    task: EvaluationTask = DRIVING
    development: tuple[str, ...] = ("train",)
    """Splits on which settings were chosen; headlines use the other splits only."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that finished scenes depend on."""
        task = {"states": self.task.states, "agents": self.task.agents}
        return {**super().settings, "seed": self.seed, **task}

    def folder(self, path: Path, *, resume: bool) -> RowsFolder:
        """A new folder for the results, or that of an earlier run.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: the folder belongs to an evaluation with other settings.
        """
        rows = ROWS_NAME, ROW_SCHEMA
        return RowsFolder(path, self.settings, rows, work="evaluation", resume=resume)


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
        for card in index.filter(CardFilter(min_agents=1)):
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
    """Divide the splits of the scenes into held-out and development splits.

    Raises:
        InputError: none of the asked splits is there, so that all would be held out.
    """
    names = tuple(dict.fromkeys(scene.split for scene in found.scenes))
    asked = plan.development
    if asked not in ((), EvaluationPlan.development) and not set(asked) & set(names):
        raise InputError(
            f"No scene is of the development split {' or '.join(asked)}; the splits are "
            f"{', '.join(names)}."
        )
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
    folder: RowsFolder,
    engine: WorkEngine,
    *,
    on_progress: Callable[[WorkProgress], None] | None = None,
) -> RunRecord:
    """Evaluate unfinished items, and write ``rows.parquet`` of all items.

    Raises:
        ExportError: the folder cannot be written.
    """
    items = items_of(plan, found.scenes)
    run = folder.run(evaluate_scene, items, engine, on_progress=on_progress)
    failures: list[Failure] = []
    for key, item in items.items():
        reasons = (
            {"": run.failures[key]}
            if key in run.failures
            else run.finished[key].failures
        )
        failures += [
            Failure(
                scene=item.place.name,
                condition=item.condition.label,
                method=method,
                reason=reason,
            )
            for method, reason in reasons.items()
        ]
    without_future = [
        items[key].place.name
        for key, rows in run.finished.items()
        if not rows.has_future
    ]
    hashes = [one.model_sha256.items() for one in run.finished.values()]
    return RunRecord(
        num_scenes=len({item.place for item in items.values()}),
        num_skipped_folders=found.num_skipped,
        without_future=tuple(dict.fromkeys(without_future)),
        failures=tuple(failures),
        model_sha256={name: text for own in hashes for name, text in own if text},
        num_resumed=run.num_resumed,
        num_items=len(items),
    )
