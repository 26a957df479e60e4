"""``pd-editor evaluate``: evaluate generators on many scenes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np

from pd_editor.base.errors import GenerationError, InputError
from pd_editor.base.foreign_code import is_reference
from pd_editor.base.plain_text import nearest_or_all
from pd_editor.cli.many_scenes import EngineOptions, WindowsOptions
from pd_editor.cli.options import (
    FolderOption,
    Folders,
    Number,
    Switch,
    command_line,
    several,
    shown,
    taking,
)
from pd_editor.cli.output import work_shown
from pd_editor.experiments.evaluation.evaluation import (
    EvaluationPlan,
    EvaluationSplits,
    FoundScenes,
    RunRecord,
    run_evaluation,
    scenes_of,
    splits_of,
)
from pd_editor.experiments.evaluation.evaluation_task import (
    AgentsChoice,
    EvaluationTask,
    StatesChoice,
    road_conditions,
)
from pd_editor.experiments.evaluation.method import (
    GROUND_TRUTH,
    REFERENCE_METHODS,
    Method,
)
from pd_editor.experiments.evaluation.report.realism import (
    distance_tables,
    realism_tables,
    scene_test_tables,
)
from pd_editor.experiments.evaluation.report.sections import Findings, report_of
from pd_editor.experiments.evaluation.scene_rows import RowsFolder
from pd_editor.experiments.evaluation.summary import Summary, summarise
from pd_editor.generation.defaults import DeviceName
from pd_editor.generation.generators import (
    DEFAULT_GENERATOR,
    GENERATORS,
    is_generator,
    make_generator,
)
from pd_editor.scene.generation import (
    MAX_SAMPLES,
    MAX_SEED,
    ScenarioGenerator,
    supported_by,
)
from pd_editor.scene.scene_cut import COMPARED

DEFAULT_METHODS = (*REFERENCE_METHODS, "lane-follower", DEFAULT_GENERATOR)
DEFAULT_PLACING_METHODS = (GROUND_TRUTH, DEFAULT_GENERATOR)
"""Default methods where initial states are sampled."""
MIN_LIMIT_S: Final = 0.1
MAX_LIMIT_S: Final = 86_400.0
_BY_DEFAULT: Final = (
    f"(default: {' '.join(DEFAULT_METHODS)}; with sampled states "
    f"{' '.join(DEFAULT_PLACING_METHODS)})"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """Result of an evaluation, and the files that were written."""

    folder: Path
    files: tuple[Path, ...]
    summary: Summary
    record: RunRecord

    def __str__(self) -> str:
        """One line per file, then notes on missing scenes and failures."""
        remarks = []
        if self.record.without_future:
            remarks.append(
                f"{len(self.record.without_future)} of {self.record.num_scenes} scenes "
                "have no future and were left out."
            )
        if self.record.failures:
            remarks.append(
                f"{len(self.record.failures)} failures; the report says which and why."
            )
        return "\n".join([*map(str, self.files), *remarks])


@dataclass(frozen=True, kw_only=True)
class TrialOptions(WindowsOptions, EngineOptions):
    """How methods are tried on many scenes.

    Args:
        data: Folders of Argoverse 2 scenarios or of files of other formats; folders below them are searched. Also names of demos, or demos for all.
        limit: Use only the first N scenarios.
        current: Seconds of each recording that count as observed; the last of their steps becomes the current one.
        time_limit: Seconds that a method may take for a scene; a method that takes longer has no rows of that scene, and the rest goes on.
        device: Where models compute; auto takes a GPU if there is one.
        resume: Go on with an earlier run of the same settings.
    """

    data: Folders
    limit: Annotated[int | None, shown("N", "(default: all)")] = None
    current: Annotated[float | None, shown("S", "(default: the file's)")] = None
    time_limit: Annotated[float | None, shown("S", "(default: none)")] = None
    device: DeviceName = "auto"
    resume: Switch = False

    def scope(self) -> dict[str, Any]:
        """What plans of trials share.

        Raises:
            InputError: a limit is out of range.
        """
        limit, limit_s = self.limit, self.time_limit
        if limit_s is not None and not MIN_LIMIT_S <= limit_s <= MAX_LIMIT_S:
            raise InputError(
                f"--time-limit is {limit_s:g} s; expected {MIN_LIMIT_S:g} to "
                f"{MAX_LIMIT_S:g}."
            )
        return {
            "data": tuple(map(Path, several(self.data))),
            "limit": None if limit is None else within(1, limit, MAX_SEED, "limit"),
            "limit_s": limit_s,
            "cut": replace(COMPARED, current_s=self.current),
            "map_parts": tuple(
                word
                for name in ("around", "radius", "densest")
                if (value := getattr(self, name)) is not None
                for word in (f"--{name}", *map(str, np.atleast_1d(value).tolist()))
            ),
        }

    def found(self, data: Sequence[Path], limit: int | None) -> FoundScenes:
        """The scenes, or the parts of their maps that are asked for.

        Raises:
            InputError: a scene or a part is not there.
        """
        found = scenes_of(data, limit)
        return replace(
            found,
            scenes=tuple(
                replace(scene, window=window)
                for scene in found.scenes
                for window in self.windows(scene.folder)
            ),
        )


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(TrialOptions):
    """Options of ``pd-editor evaluate``.

    Args:
        out: New folder for finished scenes, rows.parquet, report.md and report.html.
        methods: Reference methods, generators (also with options: path-diffuser:lanes=0.6,tries=1,steps=10), folders of models, and generators or predictors of your own as package.module:attribute; ground-truth is what others are compared with.
        states: Keep the recorded initial states and generate trajectories, or sample initial states as well: as many agents of each kind as the log has within 62 m of the focal agent.
        agents: All road users, or only those that the paper's code keeps.
        warps: Roads: none (as recorded), KIND:POWER such as smooth-turn:3, or all.
        samples: Samples of each scene, for methods that sample at random.
        seed: Random seed; the same seed gives the same numbers.
        development: Splits on which settings were chosen; headline figures are of the other splits alone.
    """

    data: Folders
    out: FolderOption
    methods: Annotated[
        tuple[str, ...] | None, shown("NAME [NAME ...]", _BY_DEFAULT)
    ] = None
    states: StatesChoice = "recorded"
    agents: AgentsChoice = "all"
    warps: Annotated[tuple[str, ...], shown("WARP [WARP ...]")] = ("none",)
    samples: Number = 6
    seed: Number = 0
    development: Annotated[tuple[str, ...], shown("SPLIT [SPLIT ...]")] = ("train",)


@taking(EvaluateOptions)
def evaluate(options: EvaluateOptions) -> Evaluation:
    """Evaluate methods on many scenes and write rows, tables and a report."""
    task = EvaluationTask(states=options.states, agents=options.agents)
    plan = EvaluationPlan(
        task=task,
        methods=_methods(options.methods, options.device, task),
        conditions=road_conditions(several(options.warps)),
        num_samples=within(1, options.samples, MAX_SAMPLES, "samples"),
        seed=within(0, options.seed, MAX_SEED, "seed"),
        development=several(options.development),
        **options.scope(),
    )
    choice, found = options.choice, options.found(plan.data, plan.limit)
    splits = splits_of(plan, found)
    with choice.engine() as runner:
        folder = plan.folder(Path(options.out), resume=options.resume)
        record = run_evaluation(
            plan, found, folder, runner, on_progress=work_shown("scenes on roads")
        )
    command = command_line("evaluate", replace(options, resume=False))
    return _reported(plan, splits, folder, record, command)


def _reported(
    plan: EvaluationPlan,
    splits: EvaluationSplits,
    folder: RowsFolder,
    record: RunRecord,
    command: str,
) -> Evaluation:
    """Summarise the rows and write the reports."""
    rows = folder.rows_path
    methods = tuple(method.name for method in plan.methods)

    def summary_of(names: tuple[str, ...]) -> Summary:
        return summarise(rows, methods, plan.conditions, plan.seed, names)

    is_apart = bool(splits.held_out and splits.development)
    found = Findings(
        splits=splits,
        summary=summary_of(splits.headline),
        development=summary_of(splits.development) if is_apart else None,
        distances=distance_tables(rows, methods, plan.task, splits.headline),
        scene_test=scene_test_tables(rows, methods, splits.headline)
        if plan.task.samples_states
        else (),
        realism=realism_tables(rows, methods, splits.headline, plan.seed),
    )
    report = report_of(plan, record, found, command)
    files = (*report.write(folder.path), rows)
    _check_something_left(found, record, files[0])
    return Evaluation(
        folder=folder.path, files=files, summary=found.summary, record=record
    )


def _methods(
    wanted: str | tuple[str, ...] | None, device: DeviceName, task: EvaluationTask
) -> tuple[Method, ...]:
    if wanted is None:
        wanted = DEFAULT_PLACING_METHODS if task.samples_states else DEFAULT_METHODS
    return checked_methods(several(wanted), device, task)


def checked_methods(
    asked: tuple[str, ...], device: DeviceName, task: EvaluationTask
) -> tuple[Method, ...]:
    """Methods by name.

    Raises:
        GenerationError: a name is not known, or does not fit the task.
    """
    make = _maker(device)
    known = [*REFERENCE_METHODS, *GENERATORS]
    methods = tuple(Method(name=name, make_generator=make) for name in asked)
    for name, method in zip(asked, methods, strict=True):
        plain = method.generator_name if method.options else name
        if plain not in known and not is_generator(plain):
            raise GenerationError(
                f"There is no method {name[:60]!r}; {nearest_or_all(plain, known)} "
                "(folders of models and package.module:attribute are taken as well)."
            )
        if is_reference(plain):
            make(plain)  # What cannot be imported is refused once, not for each scene.
        if task.samples_states and not _places_agents(plain, make):
            raise GenerationError(
                f"{name[:60]} samples no initial states; where states are sampled, choose "
                f"{GROUND_TRUTH}, {DEFAULT_GENERATOR} or the folder of a model."
            )
        if device == "cuda" and plain not in REFERENCE_METHODS:
            make(plain)  # An unusable method raises here, not once for each scene.
    if not asked:
        raise GenerationError(
            f"No method was asked for; choose among {', '.join(known)}."
        )
    return methods


def _maker(device: DeviceName) -> Callable[[str], ScenarioGenerator]:
    """Factory of generators; a module-level function, so that workers can have it."""
    return (
        make_generator if device == "auto" else partial(make_generator, device=device)
    )


def _places_agents(name: str, make: Callable[[str], ScenarioGenerator]) -> bool:
    if name in REFERENCE_METHODS:
        return name == GROUND_TRUTH
    if name in GENERATORS:
        return "states" in GENERATORS[name].supports
    return "states" in supported_by(make(name))


def within(least: int, value: int, most: int, name: str) -> int:
    """Validate a number of an option.

    Raises:
        InputError: it is out of range.
    """
    if not least <= value <= most:
        raise InputError(f"--{name} is {value}; expected {least} to {most}.")
    return value


def _check_something_left(found: Findings, record: RunRecord, report: Path) -> None:
    """Raise if a method succeeded on no scene."""
    if record.num_scenes == len(record.without_future):
        raise InputError(
            f"None of the {record.num_scenes} scenes has a logged future; there is "
            "nothing to compare with."
        )
    parts = [part for part in (found.summary, found.development) if part is not None]
    for row, name in enumerate(found.summary.methods):
        if not any(part.num_agents[row].any() for part in parts):
            reasons = [f.reason for f in record.failures if f.method in ("", name)]
            reason = f" ({reasons[0].rstrip('.')})" if reasons else ""
            raise GenerationError(
                f"{name}: failed on every scene, see {report}{reason}."
            )
