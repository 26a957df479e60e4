"""The study of variants: trains all systems of the paper, small ones, and prints its tables.

``make variants`` or ``python -m reproduction.variants --out build/variants``: simulates 2,000
scenarios unless ``--data`` names a corpus, prepares them once, and trains each variant with
each seed for equally many steps of equal scenes; every variant is the base of the study
but for one file. Then, if PD_EDITOR_AV2 is set, ``python -m reproduction`` with its
``val`` scenes. What is finished stays: the same command goes on where it was stopped. A
variant of one's own is one more TOML file: ``--variants my.toml`` trains it and the base
instead of those of the paper. A file that was edited since its training is refused.
"""

import json
import os
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from pd_editor.base.errors import PdEditorError, TrainingError
from pd_editor.cli.model import model
from pd_editor.cli.synth import synth
from pd_editor.cli.train import train
from pd_editor.experiments.training.run_config import RunConfig
from pd_editor.experiments.training.run_folder import CONFIG_NAME, RunFolder
from pd_editor.experiments.training.settings import (
    SAMPLING,
    RunRequest,
    StageName,
    new_config,
    section_of,
    settings_of,
)
from reproduction.__main__ import PaperTables, make_tables

FOLDER = Path(__file__).parents[1] / "examples" / "variants"
BASE = FOLDER / "study" / "base.toml"
VARIANTS = (
    FOLDER / "mha.toml",
    FOLDER / "pd_minus_cdb.toml",
    FOLDER / "pd_minus_p.toml",
    FOLDER / "vd.toml",
    FOLDER / "paper.toml",
    FOLDER / "study" / "pd_with_warps.toml",
)
DEFAULT = "pd"
"""Name of the base alone, whose stages the other variants borrow."""
STAGES: tuple[StageName, ...] = ("init", "traj")


@dataclass(frozen=True, kw_only=True)
class Study:
    """What is trained, and how long."""

    out: Path = Path("build/variants")
    """Folder of all results; the variants in it are models for ``--models``."""
    data: Path | None = None
    """Corpus to train on; simulated unless given."""
    cache: Path | None = None
    """Folder of prepared scenes; in ``out`` unless given."""
    scenarios: int = 2000
    """Number of scenarios to simulate."""
    seeds: tuple[int, ...] = (0, 1)
    init_steps: int = 3000
    """Steps of 16 scenes for initial states."""
    traj_steps: int = 4000
    """Steps of 16 scenes for trajectories."""
    threads: int | None = None
    """CPU threads; all unless given."""
    variants: tuple[Path, ...] = VARIANTS
    """Files of the variants beside the base itself."""
    only_train: bool = False
    """Print no tables."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One network to train."""

    variant: str
    stage: StageName
    seed: int
    files: tuple[Path, ...]


def tasks_of(study: Study, seed: int) -> Iterator[Task]:
    """All networks of a seed."""
    for stage in STAGES:
        for path in (None, *study.variants):
            if path is None or stage in stages_of(path):
                yield Task(
                    variant=DEFAULT if path is None else path.stem,
                    stage=stage,
                    seed=seed,
                    files=(BASE,) if path is None else (BASE, path),
                )


def stages_of(path: Path) -> tuple[StageName, ...]:
    """The stages that a variant changes."""
    sections = tomllib.loads(path.read_text())
    shared = sections.keys() - set(STAGES)
    return STAGES if shared else tuple(s for s in STAGES if s in sections)


def model_folder(study: Study, variant: str, seed: int) -> Path:
    """Folder of a variant's model; its runs are below."""
    return study.out / f"{variant}-seed{seed}"


def check(study: Study, tasks: Sequence[Task]) -> None:
    """Refuse variants that cannot be trained, or that were edited since they were.

    Raises:
        TrainingError: names the file, what is wrong and what to do.
    """
    names = [DEFAULT, *(path.stem for path in study.variants)]
    for path in study.variants:
        if names.count(path.stem) > 1:
            raise TrainingError(
                f"{path}: there are several variants {path.stem!r}; give the file "
                "another name."
            )
    for task in tasks:
        asked = RunRequest(
            stage=task.stage,
            data=("",),
            preset="default",
            settings=settings_of(task.files, (), task.stage),
        )
        config, run = new_config(asked, is_gpu=False), run_folder(study, task)
        if not (run / CONFIG_NAME).exists():
            continue
        changed = _other_fields(RunFolder(run).config(), config)
        if changed:
            told = ", ".join(
                f"{name} was {before}, is now {after}"
                for name, (before, after) in changed.items()
            )
            raise TrainingError(
                f"{task.files[-1]}: {run} was begun with other settings ({told}); delete "
                "that folder to train it anew, or give the changed file another name."
            )


def run_folder(study: Study, task: Task) -> Path:
    """Folder of the run of a network."""
    return model_folder(study, task.variant, task.seed) / "runs" / task.stage


def is_trained(run: Path, steps: int) -> bool:
    """Whether a run has spent its budget."""
    config = run / "model" / "config.json"
    if not config.exists():
        return False
    (stage,) = json.loads(config.read_text())["stages"].values()
    return stage["training"]["steps"] >= steps


def train_task(study: Study, data: Path, task: Task) -> bool:
    """Train a network, or go on; false if it was stopped before its end."""
    run = run_folder(study, task)
    steps = study.init_steps if task.stage == "init" else study.traj_steps
    name = f"{task.variant}, {task.stage}, seed {task.seed}"
    if is_trained(run, steps):
        print(f"== {name}: trained before", flush=True)
        return True
    print(f"== {name}", flush=True)
    result = train(
        task.stage,
        data=data,
        cache=study.cache or study.out / "cache",
        config=task.files,
        steps=steps,
        seed=task.seed,
        device="auto",
        threads=study.threads,
        preset="default",
        out=run,
        resume=(run / CONFIG_NAME).exists(),
    )
    print(result, flush=True)
    return not result.is_stopped


def join(study: Study, tasks: Sequence[Task]) -> None:
    """Make a whole model of each variant; stages that it leaves alone are those of PD."""
    for variant, seed in dict.fromkeys((task.variant, task.seed) for task in tasks):
        folder = model_folder(study, variant, seed)
        own = [folder / "runs" / stage for stage in STAGES]
        usual = [
            model_folder(study, DEFAULT, seed) / "runs" / stage for stage in STAGES
        ]
        init, traj = (
            mine if mine.exists() else other
            for mine, other in zip(own, usual, strict=True)
        )
        model(out=folder, init=init, traj=traj)


def corpus(study: Study) -> Path:
    """The corpus to train on, simulated if need be."""
    if study.data is not None:
        return study.data
    folder = study.out / "corpus"
    if not (folder / "manifest.json").exists():
        synth(
            out=folder, num=study.scenarios, seed=1, shards=True, resume=folder.exists()
        )
    return folder


def run_study(study: Study) -> int:
    """Train what is left, join the stages, and print the tables; the exit code."""
    tasks_of_seed = {seed: list(tasks_of(study, seed)) for seed in study.seeds}
    check(study, [one for tasks in tasks_of_seed.values() for one in tasks])
    data = corpus(study)
    for tasks in tasks_of_seed.values():
        for task in tasks:
            if not train_task(study, data, task):
                print(f"Stopped; the same command goes on ({study.out}).")
                return 130
        join(study, tasks)
    if study.only_train:
        print(f"All variants are trained ({study.out}).")
        return 0
    recorded = os.environ.get("PD_EDITOR_AV2")
    if not recorded:
        print("No tables; set PD_EDITOR_AV2 to a folder with val/ for them.")
        return 0
    report = study.out / "report"
    print(
        make_tables(
            PaperTables(
                data=(str(Path(recorded) / "val"),),
                out=report,
                models=(study.out,),
                resume=report.exists(),
            )
        )
    )
    return 0


if __name__ == "__main__":
    try:
        raise SystemExit(run_study(tyro.cli(Study)))
    except PdEditorError as error:
        raise SystemExit(f"Error: {error}") from None


def _other_fields(earlier: RunConfig, now: RunConfig) -> dict[str, tuple[Any, Any]]:
    """Fields by name that make the networks of two runs differ, with both values.

    Data, seed and budget do not count, nor do fields that the earlier run did not have.
    """
    found = {}
    for section in ("model", "loss", "own_samples", "augmentation", "optimisation"):
        before, after = section_of(earlier, section), section_of(now, section)
        for name in before.keys() & after.keys():
            if before[name] != after[name]:
                found[f"{section}.{name}"] = (before[name], after[name])
    for section in SAMPLING[now.stage]:
        before, after = section_of(earlier, section), section_of(now, section)
        for name in before.keys() | after.keys():
            if before.get(name) != after.get(name):
                found[f"{section}.{name}"] = (before.get(name), after.get(name))
    return dict(sorted(found.items()))
