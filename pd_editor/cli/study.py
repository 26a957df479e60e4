"""``pd-editor study``: perturbation studies."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.base.errors import InputError
from pd_editor.cli.evaluate import checked_methods, limit_in_s, within
from pd_editor.cli.options.arguments import (
    AddressOption,
    CurrentOption,
    FolderOption,
    LimitOption,
    Switch,
    TimeLimitOption,
    WorkersOption,
    several,
)
from pd_editor.cli.output.progress import work_shown
from pd_editor.experiments.evaluation.evaluation import scenes_of
from pd_editor.experiments.evaluation.evaluation_task import DRIVING
from pd_editor.experiments.evaluation.road_condition import (
    DEFAULT_ANCHOR,
    road_conditions,
)
from pd_editor.experiments.studies.study_folder import StudyFolder
from pd_editor.experiments.studies.study_plan import (
    GRID_POWERS,
    StudyPlan,
    grid_conditions,
    study_command,
)
from pd_editor.experiments.studies.variant_rows import STUDY_METRICS
from pd_editor.experiments.studies.whole_study import (
    Study,
    StudyExtras,
    run_whole_study,
)
from pd_editor.experiments.studies.worst_case import SearchSettings
from pd_editor.experiments.work_engine import EngineChoice, EngineName
from pd_editor.generation.defaults import DeviceName
from pd_editor.scene.generation import MAX_SAMPLES, MAX_SEED
from pd_editor.scene.perturbation.friction_limit import DRY_ROAD_FRICTION
from pd_editor.scene.road_warp import WARP_KINDS
from pd_editor.scene.time_cut import COMPARED

_Texts = str | tuple[str, ...]
_BY_DEFAULT = "(default: -9 to 9 without 0)"


def study(
    *,
    data: Annotated[
        str | Path | tuple[str | Path, ...], tyro.conf.arg(metavar="DIR [DIR ...]")
    ],
    out: FolderOption,
    methods: Annotated[_Texts, tyro.conf.arg(metavar="NAME [NAME ...]")] = (
        "lane-follower",
    ),
    kinds: Annotated[_Texts, tyro.conf.arg(metavar="KIND [KIND ...]")] = WARP_KINDS,
    powers: Annotated[
        float | tuple[float, ...],
        tyro.conf.arg(metavar="P [P ...]", help_behavior_hint=_BY_DEFAULT),
    ] = GRID_POWERS,
    anchors: Annotated[_Texts, tyro.conf.arg(metavar="ANCHOR [ANCHOR ...]")] = (
        DEFAULT_ANCHOR,
    ),
    warps: Annotated[
        _Texts, tyro.conf.arg(metavar="WARP [WARP ...]", help_behavior_hint="")
    ] = (),
    seeds: Annotated[int | tuple[int, ...], tyro.conf.arg(metavar="N [N ...]")] = (0,),
    samples: Annotated[int, tyro.conf.arg(metavar="N")] = 1,
    friction: Annotated[float, tyro.conf.arg(metavar="MU")] = DRY_ROAD_FRICTION,
    search: Annotated[int, tyro.conf.arg(metavar="TRIALS")] = 0,
    metric: Annotated[str, tyro.conf.arg(metavar="METRIC")] = STUDY_METRICS[0],
    penalty: Annotated[float, tyro.conf.arg(metavar="X")] = 10.0,
    gallery: Annotated[int, tyro.conf.arg(metavar="N")] = 6,
    dangers: Annotated[int, tyro.conf.arg(metavar="N")] = 0,
    limit: LimitOption = None,
    current: CurrentOption = None,
    engine: EngineName = "local",
    address: AddressOption = None,
    workers: WorkersOption = None,
    time_limit: TimeLimitOption = None,
    device: DeviceName = "auto",
    resume: Switch = False,
) -> Study:
    """Study how methods fare on perturbed roads: kinds, powers, anchors, seeds, scenes.

    Args:
        data: Folders of Argoverse 2 scenarios or of files of other formats; folders below them are searched. Also names of demos, or demos for all.
        out: New folder for finished items, variants.parquet, report.md, report.html and gallery.
        methods: Reference methods, generators and predictors, as for evaluate.
        kinds: Kinds of warps of the grid.
        powers: Powers of the grid, -10 to 10.
        anchors: Where warps begin: ahead of the focal agent, of the ego vehicle, or both.
        warps: Further roads, such as the sum smooth-turn:6+ripple-road:2.
        seeds: Seeds; each one is a study of its own over all scenes and roads.
        samples: Samples of each variant, for methods that sample at random.
        friction: Slow agents to the speed that this friction coefficient allows; 0 does not slow them.
        search: Trials of a worst-case search of each scene by Optuna; 0 does not search. 54 is the budget of Scene-Attack's grid.
        metric: What the worst cases are worst in.
        penalty: Penalty of the search for each kind of warp beyond the first; 0 searches sums.
        gallery: Number of worst scenes that are exported for the editor.
        dangers: Number of dangerous but avoidable behaviours of agents that are searched over all scenes and exported; 0 does not search.
        limit: Use only the first N scenarios.
        current: Seconds of each recording that count as observed; the last of their steps becomes the current one.
        engine: Processes of this machine, or Ray (extra "cluster").
        address: Address of a Ray cluster, such as auto or head:6379; a new one on this machine unless given.
        workers: Work items that run at a time; they do not change the numbers.
        time_limit: Seconds that a method may take for a variant; one that takes longer fails there, and the rest goes on.
        device: Where models compute; auto takes a GPU if there is one.
        resume: Go on with an earlier run of the same settings.
    """
    if metric not in STUDY_METRICS:
        raise InputError(
            f"--metric: {metric[:60]!r} is not known; expected one of "
            f"{', '.join(STUDY_METRICS)}."
        )
    if not 0 <= friction <= 2:
        raise InputError(f"--friction is {friction:g}; expected 0 to 2.")
    grid = grid_conditions(
        several(kinds),
        (powers,) if isinstance(powers, int | float) else powers,
        several(anchors),
    )
    extra = road_conditions(several(warps)) if warps else ()
    plan = StudyPlan(
        data=tuple(map(Path, several(data))),
        methods=checked_methods(several(methods), device, DRIVING),
        conditions=tuple(dict.fromkeys((*grid, *extra))),
        seeds=(seeds,) if isinstance(seeds, int) else tuple(dict.fromkeys(seeds)),
        num_samples=within(1, samples, MAX_SAMPLES, "samples"),
        friction_coefficient=friction or None,
        limit=None if limit is None else within(1, limit, MAX_SEED, "limit"),
        limit_s=limit_in_s(time_limit),
        cut=replace(COMPARED, current_s=current),
    )
    extras = StudyExtras(
        search=SearchSettings(
            metric=metric,
            num_trials=within(0, search, 100_000, "search"),
            penalty=penalty,
        ),
        num_worst=within(0, gallery, 1000, "gallery"),
        num_dangers=within(0, dangers, 1000, "dangers"),
    )
    choice = EngineChoice(name=engine, address=address, num_workers=workers)
    found = scenes_of(plan.data, plan.limit)
    with choice.engine() as runner:
        study = run_whole_study(
            plan,
            extras,
            found,
            StudyFolder(Path(out), plan.settings, resume=resume),
            runner,
            study_command(plan, out),
            progress_of=work_shown,
        )
    study.check_results()
    return study
