"""What evaluations and studies share: scenes, methods and roads, and failures of methods."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from pd_editor.experiments.evaluation.method import Method
from pd_editor.experiments.evaluation.road_condition import RoadCondition
from pd_editor.experiments.work_engine.time_limit import time_limit
from pd_editor.experiments.work_engine.work_engine import failure_of
from pd_editor.scene.base_reference import SceneCut, part_name
from pd_editor.scene.time_cut import COMPARED

_Value = TypeVar("_Value")


@dataclass(frozen=True, kw_only=True)
class TrialPlan:
    """Scenes, methods and roads of many trials."""

    data: tuple[Path, ...]
    """Roots of datasets; folders below them are searched."""
    methods: tuple[Method, ...]
    conditions: tuple[RoadCondition, ...]
    num_samples: int = 1
    limit: int | None = None
    """Limit of scenes, the first ones by their folders' names."""
    limit_s: float | None = None
    """Time that a method may take for a trial; a method that takes longer fails there."""
    cut: SceneCut = COMPARED
    """What is used of each recording."""
    map_parts: tuple[str, ...] = ()
    """Which parts of maps the scenes are, in words of the shell."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that finished trials depend on."""
        return {
            # With another version, definitions may change.
            "version": version("pd-editor"),
            "data": [os.path.realpath(root) for root in self.data],
            "methods": [method.name for method in self.methods],
            "samples": self.num_samples,
            "current_s": self.cut.current_s,
            "map_parts": self.map_parts,
        }


@dataclass(frozen=True, kw_only=True)
class TrialItem:
    """Work item on one scene."""

    folder: Path
    split: str
    """Name of the scene's split."""
    num_samples: int
    seed: int
    limit_s: float | None = None
    """Time that a method may take; None: as long as it takes."""
    cut: SceneCut = COMPARED
    """What is used of the recording."""

    @property
    def place(self) -> Path:
        """Its folder, with a name that tells which part of its map is used."""
        return self.folder.with_name(part_name(self.folder.name, self.cut.window))


def tried(make: Callable[[], _Value], limit_s: float | None) -> _Value | str:
    """What a method makes, or the reason why it made nothing in time."""
    try:
        with time_limit(limit_s):
            return make()
    except Exception as error:  # noqa: BLE001  (methods may raise any error)
        return failure_of(error).reason
