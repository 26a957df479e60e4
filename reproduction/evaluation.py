"""Evaluates all systems for the paper's tables, and writes the report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pd_editor.base.errors import InputError, PdEditorError
from pd_editor.base.installed_files import models_folder
from pd_editor.cli.output import work_shown
from pd_editor.experiments.evaluation.evaluation import (
    ROWS_NAME,
    EvaluationPlan,
    RunRecord,
    run_evaluation,
    scenes_of,
    splits_of,
)
from pd_editor.experiments.report import Figure
from pd_editor.experiments.work_engine.ray_cluster import EngineChoice
from pd_editor.experiments.work_engine.work_engine import WorkEngine
from pd_editor.experiments.work_engine.work_folder import WorkFolder
from pd_editor.generation.generators import shipped_models
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import ScenarioGenerator
from reproduction.attention_scores import attention_scores
from reproduction.measures import RowTable
from reproduction.paper_report import paper_report
from reproduction.paper_tables import STATE_COLUMNS, TRAJECTORY_COLUMNS
from reproduction.pictures import PaperPicture, PictureBook
from reproduction.plans import PaperPlan, Part, paper_plan
from reproduction.systems import Trained, trained_systems

NAME: Final = "paper"


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperEvaluation:
    """The report of the paper's tables, and its files."""

    folder: Path
    files: tuple[Path, ...]
    text: str
    records: tuple[RunRecord, ...]

    def __str__(self) -> str:
        """The tables, then one line per file."""
        failures = sum(len(one.failures) for one in self.records)
        remarks = [f"{failures} failures; the report says which and why."] * bool(
            failures
        )
        return "\n".join([self.text, *map(str, self.files), *remarks])


def evaluate_paper(
    base: EvaluationPlan,
    models: Sequence[Path],
    out: Path,
    make_generator: Callable[[str], ScenarioGenerator],
    choice: EngineChoice,
    *,
    resume: bool,
    command: str,
) -> PaperEvaluation:
    """Evaluate all systems for the paper's tables, and write the report.

    Args:
        base: data, roads, samples and seed.
        models: folders of variants.
        out: folder of the results.
        make_generator: factory of generators by name.
        choice: where items run.
        resume: whether to go on with an earlier run.
        command: that reproduces it.

    Raises:
        PdEditorError: a model cannot be used, or nothing is left to compare.
    """
    folder = WorkFolder(out)
    if not resume:
        folder.check_free()
    shipped = {name: models_folder() / name for name in shipped_models()}
    trained = trained_systems(models, tuple(shipped.items()))
    folders = {one.method: shipped.get(one.method, Path(one.method)) for one in trained}
    for one in trained:
        _check_weights(folders[one.method])
    plan = paper_plan(base, trained, make_generator)
    found = scenes_of(base.data, base.limit)
    with choice.engine() as engine:
        records = [_run(part, out, engine, resume=resume) for part in plan.parts]
    splits = splits_of(base, found)
    rows = _tables(plan, out, splits.headline, base.seed)
    held = [one.folder for one in found.scenes if one.split in splits.headline]
    pictures = list(_pictures(held, trained, make_generator))
    figures = tuple(
        Figure(data=one.png, caption=one.caption, media="png") for one in pictures
    )
    report = paper_report(
        trained=trained,
        rows=rows,
        scores=attention_scores(trained, folders, held),
        splits=splits,
        records=records,
        command=command,
        figures=figures,
        plain=any(one.is_plain for one in base.conditions),
        warped=any(not one.is_plain for one in base.conditions),
    )
    files = [*report.write(out, NAME)]
    for one in pictures:
        for kind, data in (("png", one.png), ("pdf", one.pdf)):
            files.append(folder.write(f"figures/{one.name}.{kind}", data))
    return PaperEvaluation(
        folder=out,
        files=tuple(files),
        text=report.markdown(),
        records=tuple(records),
    )


def _check_weights(folder: Path) -> None:
    """Raise for weights that do not fit, once and not for each scene."""
    from pd_editor.generation.checkpoints.model_folder import load_model
    from pd_editor.generation.stages import STAGE_KINDS

    load_model(folder, STAGE_KINDS)


def _run(part: Part, out: Path, engine: WorkEngine, *, resume: bool) -> RunRecord:
    folder = part.plan.folder(part.folder(out), resume=resume)
    found = scenes_of(part.plan.data, part.plan.limit)
    shown = work_shown(f"scenes on roads, {part.name}")
    return run_evaluation(part.plan, found, folder, engine, on_progress=shown)


def _tables(
    plan: PaperPlan, out: Path, splits: Sequence[str], seed: int
) -> tuple[RowTable, RowTable, RowTable]:
    """Rows of the three evaluations."""
    states, paper, everyone = (
        RowTable.of(
            part.folder(out) / ROWS_NAME,
            part.entries,
            STATE_COLUMNS if part is plan.states else TRAJECTORY_COLUMNS,
            splits,
            seed,
        )
        for part in plan.parts
    )
    if not any(len(one.scene) for one in (states, paper, everyone)):
        raise InputError("No scene has an agent to evaluate; see the failures.")
    return states, paper, everyone


def _pictures(
    scenes: Sequence[Path],
    trained: Sequence[Trained],
    make_generator: Callable[[str], ScenarioGenerator],
) -> Sequence[PaperPicture]:
    """Figures of the first scene that can be read."""
    for folder in scenes:
        try:
            scenario = read_scenario(folder)
        except PdEditorError:
            continue
        book = PictureBook(
            scenario=scenario, trained=trained, make_generator=make_generator
        )
        return list(book.pictures())
    return ()
