"""``python -m reproduction --data DIR --out DIR``: the paper's tables and figures."""

import shlex
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import tyro

from pd_editor.base.errors import PdEditorError
from pd_editor.cli.evaluate import within
from pd_editor.experiments.evaluation.evaluation import EvaluationPlan
from pd_editor.experiments.evaluation.evaluation_task import (
    EvaluationTask,
    road_conditions,
)
from pd_editor.experiments.work_engine.ray_cluster import EngineChoice, EngineName
from pd_editor.generation.defaults import DeviceName
from pd_editor.generation.generators import make_generator
from pd_editor.scene.generation import MAX_SAMPLES, MAX_SEED
from reproduction.evaluation import PaperEvaluation, evaluate_paper


@dataclass(frozen=True, kw_only=True)
class PaperTables:
    """What the tables are made of."""

    data: tuple[str, ...]
    """Roots of Argoverse 2 datasets; folders below them are searched. Also demos."""
    out: Path
    """New folder for finished scenes, paper.html, paper.md and figures."""
    models: tuple[Path, ...] = ()
    """Folders of trained variants, or of such folders, as make variants leaves them;
    NAME-seedK is the variant NAME trained with seed K."""
    warps: tuple[str, ...] = ("all",)
    """Roads: none (as recorded), KIND:POWER such as smooth-turn:3, or all."""
    samples: int = 6
    """Samples of each scene, for methods that sample at random."""
    seed: int = 0
    limit: int | None = None
    """Use only the first N scenarios."""
    engine: EngineName = "local"
    address: str | None = None
    """Address of a Ray cluster; a new one on this machine unless given."""
    workers: int | None = None
    device: DeviceName = "auto"
    resume: bool = False
    """Go on with an earlier run of the same settings."""

    @property
    def command(self) -> str:
        """Command line that reproduces the numbers."""
        words = ["python", "-m", "reproduction", "--data", *self.data]
        words += ["--out", str(self.out)]
        words += ["--models", *map(str, self.models)] if self.models else []
        words += ["--warps", *self.warps, "--samples", str(self.samples)]
        words += ["--seed", str(self.seed)]
        words += [] if self.limit is None else ["--limit", str(self.limit)]
        return shlex.join(words)


def make_tables(asked: PaperTables) -> PaperEvaluation:
    """Evaluate all systems, and write the report.

    Raises:
        PdEditorError: a model cannot be used, or nothing is left to compare.
    """
    plan = EvaluationPlan(
        task=EvaluationTask(),
        data=tuple(map(Path, asked.data)),
        methods=(),
        conditions=road_conditions(asked.warps),
        num_samples=within(1, asked.samples, MAX_SAMPLES, "samples"),
        seed=within(0, asked.seed, MAX_SEED, "seed"),
        limit=None
        if asked.limit is None
        else within(1, asked.limit, MAX_SEED, "limit"),
    )
    choice = EngineChoice(
        name=asked.engine, address=asked.address, num_workers=asked.workers
    )
    return evaluate_paper(
        plan,
        asked.models,
        asked.out,
        partial(make_generator, device=asked.device),
        choice,
        resume=asked.resume,
        command=asked.command,
    )


if __name__ == "__main__":
    try:
        print(make_tables(tyro.cli(PaperTables)))
    except PdEditorError as error:
        raise SystemExit(f"Error: {error}") from None
