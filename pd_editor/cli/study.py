"""``pd-editor study``: perturbation studies."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pd_editor.base.errors import InputError
from pd_editor.cli.evaluate import TrialOptions, checked_methods, within
from pd_editor.cli.options import FolderOption, Folders, Number, several, shown, taking
from pd_editor.cli.output import work_shown
from pd_editor.experiments.evaluation.evaluation_task import (
    DEFAULT_ANCHOR,
    DRIVING,
    road_conditions,
)
from pd_editor.experiments.studies.outcomes import SearchSettings
from pd_editor.experiments.studies.study_plan import (
    GRID_POWERS,
    STUDY_METRICS,
    StudyPlan,
    grid_conditions,
)
from pd_editor.experiments.studies.whole_study import (
    Study,
    StudyExtras,
    run_whole_study,
)
from pd_editor.scene.generation import MAX_SAMPLES
from pd_editor.scene.perturbation.friction import DRY_ROAD_FRICTION
from pd_editor.scene.road_warp import WARP_KINDS

_Texts = str | tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class StudyOptions(TrialOptions):
    """Options of ``pd-editor study``.

    Args:
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
        time_limit: Seconds that a method may take for a variant; one that takes longer fails there, and the rest goes on.
    """

    data: Folders
    out: FolderOption
    methods: Annotated[_Texts, shown("NAME [NAME ...]")] = ("lane-follower",)
    kinds: Annotated[_Texts, shown("KIND [KIND ...]")] = WARP_KINDS
    powers: Annotated[
        float | tuple[float, ...], shown("P [P ...]", "(default: -9 to 9 without 0)")
    ] = GRID_POWERS
    anchors: Annotated[_Texts, shown("ANCHOR [ANCHOR ...]")] = (DEFAULT_ANCHOR,)
    warps: Annotated[_Texts, shown("WARP [WARP ...]", "")] = ()
    seeds: Annotated[int | tuple[int, ...], shown("N [N ...]")] = (0,)
    samples: Number = 1
    friction: Annotated[float, shown("MU")] = DRY_ROAD_FRICTION
    search: Annotated[int, shown("TRIALS")] = 0
    metric: Annotated[str, shown("METRIC")] = STUDY_METRICS[0]
    penalty: Annotated[float, shown("X")] = 10.0
    gallery: Number = 6
    dangers: Number = 0

    def plan(self) -> StudyPlan:
        """Scenes, roads and methods.

        Raises:
            GenerationError: a method is not known.
            InputError: a road cannot be, or a number is out of range.
        """
        if not 0 <= self.friction <= 2:
            raise InputError(f"--friction is {self.friction:g}; expected 0 to 2.")
        powers, seeds = self.powers, self.seeds
        grid = grid_conditions(
            several(self.kinds),
            (powers,) if isinstance(powers, int | float) else powers,
            several(self.anchors),
        )
        extra = road_conditions(several(self.warps)) if self.warps else ()
        return StudyPlan(
            methods=checked_methods(several(self.methods), self.device, DRIVING),
            conditions=tuple(dict.fromkeys((*grid, *extra))),
            seeds=(seeds,) if isinstance(seeds, int) else tuple(dict.fromkeys(seeds)),
            num_samples=within(1, self.samples, MAX_SAMPLES, "samples"),
            friction_coefficient=self.friction or None,
            **self.scope(),
        )


@taking(StudyOptions)
def study(options: StudyOptions) -> Study:
    """Study how methods fare on perturbed roads: kinds, powers, anchors, seeds, scenes."""
    metric = options.metric
    if metric not in STUDY_METRICS:
        raise InputError(
            f"--metric: {metric[:60]!r} is not known; expected one of "
            f"{', '.join(STUDY_METRICS)}."
        )
    plan = options.plan()
    extras = StudyExtras(
        search=SearchSettings(
            metric=metric,
            num_trials=within(0, options.search, 100_000, "search"),
            penalty=options.penalty,
        ),
        num_worst=within(0, options.gallery, 1000, "gallery"),
        num_dangers=within(0, options.dangers, 1000, "dangers"),
    )
    choice, found = options.choice, options.found(plan.data, plan.limit)
    with choice.engine() as runner:
        study = run_whole_study(
            plan,
            extras,
            found,
            plan.folder(Path(options.out), resume=options.resume),
            runner,
            progress_of=work_shown,
        )
    study.check_results()
    return study
