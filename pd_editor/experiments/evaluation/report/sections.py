"""Sections of the report of an evaluation: text, tables and figures."""

import platform
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Final

import numpy as np
from jaxtyping import Int

from pd_editor.base.plain_text import number_of
from pd_editor.experiments.evaluation.evaluation import (
    EvaluationPlan,
    EvaluationSplits,
    RunRecord,
)
from pd_editor.experiments.evaluation.evaluation_task import (
    SAMPLED_HALF_SIDE_M,
    EvaluationTask,
    RoadCondition,
)
from pd_editor.experiments.evaluation.report.tables import (
    HEADLINES,
    PLACING_HEADLINES,
    PLACING_SHOWN,
    SHOWN,
    complete_tables,
    definition_table,
    difference_tables,
    figures_of,
    headline_tables,
    road_tables,
)
from pd_editor.experiments.evaluation.summary import COVERAGE, NUM_RESAMPLES, Summary
from pd_editor.experiments.report import Report, ReportTable, Section, table_of_first
from pd_editor.scene.perturbation.friction import DRY_ROAD_FRICTION

_PACKAGES: Final = ("pd-editor", "numpy", "pyarrow", "shapely", "av2")
_DISTANCES_WORDS: Final = (
    "Square roots of Jensen-Shannon divergences, natural logarithm (what the paper calls "
    "JSD), 0 to 0.833. Read each beside its noise floor: recordings differ that much from "
    "recordings."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """Results of an evaluation by split."""

    splits: EvaluationSplits
    summary: Summary
    development: Summary | None = None
    """Summary of the development splits, if they are not the headline."""
    distances: Sequence[ReportTable] = ()
    """Distances of distributions for the headline splits."""
    scene_test: Sequence[ReportTable] = ()
    """Scene test for the headline splits, where initial states are sampled."""
    realism: Sequence[ReportTable] = ()
    """Likelihoods of the log for the headline splits, where they are recorded."""

    @property
    def num_scenes(self) -> Int[np.ndarray, "M"]:
        """Number of scenes of each method in all splits."""
        parts = (self.summary, self.development)
        return sum(
            (part.num_scenes.max(axis=(1, 2)) for part in parts if part is not None),
            start=np.zeros(len(self.summary.methods), int),
        )


def report_of(
    plan: EvaluationPlan, record: RunRecord, found: Findings, command: str
) -> Report:
    """Assemble the report."""
    summary = found.summary
    return Report(
        title="Evaluation",
        sections=(
            Section(title="What was done", paragraphs=_words(plan, record, found)),
            Section(title="Scene test", tables=tuple(found.scene_test)),
            *_compared(plan, summary, found.distances),
            Section(title="Realism", tables=tuple(found.realism)),
            *_development(plan.task, found),
            Section(title="Road by road", tables=tuple(road_tables(summary))),
            Section(title="All metrics", tables=tuple(complete_tables(summary))),
            Section(title="Definitions", tables=(definition_table(),)),
            Section(
                title="What failed",
                paragraphs=_failure_words(record),
                tables=table_of_first(
                    "Failed scenes",
                    ("scene", "road", "method", "reason"),
                    [
                        (one.scene, one.condition, one.method or "all", one.reason)
                        for one in record.failures
                    ],
                ),
            ),
            Section(
                title="How to repeat it", tables=(_run_table(plan, record, command),)
            ),
        ),
    )


def _compared(
    plan: EvaluationPlan, summary: Summary, distances: Sequence[ReportTable]
) -> tuple[Section, ...]:
    task, beside = plan.task, "collisions, path length, ADE and spread"
    if task.samples_states:
        beside = "collisions and path length"
    results = (
        "Means over agents and samples, with intervals. Final lateral deviation alone is "
        f"low for agents that stay on any lane, even at random: read it beside {beside}. "
        "Agents of the log are evaluated while they are recorded, all others to the end"
    )
    of_states = "states (speed, nearest distance, density, nearest edge and its angle)"
    if task.samples_states:
        return (
            _results(plan, summary, f"{results}."),
            _distances(
                f"Distances of {of_states} are to all agents of the log, those of ways "
                "to the agents that the log has to the end.",
                distances,
            ),
        )
    return (
        _results(
            plan,
            summary,
            f"{results}; the differences to the log, below, are free of that.",
        ),
        Section(
            title="Differences to the log",
            paragraphs=(
                "Paired on the same agents on the same roads, of which the log has "
                "every later step: an agent that left the recording early has a "
                "shorter path there, and less time to go astray.",
            ),
            tables=tuple(difference_tables(summary)),
        ),
        _distances(
            f"The methods here keep the states, so distances of {of_states} are 0 by "
            "construction.",
            distances,
        ),
    )


def _development(task: EvaluationTask, found: Findings) -> tuple[Section, ...]:
    if found.development is None:
        return ()
    headlines = PLACING_HEADLINES if task.samples_states else HEADLINES
    words = (
        f"Settings were chosen on {_listed(found.splits.development)}; these figures are "
        "for development and are no evidence of quality."
    )
    return (
        Section(
            title="Development scenes",
            paragraphs=(words,),
            tables=tuple(
                replace(table, title=f"{table.title} (development)")
                for table in headline_tables(found.development, headlines)
            ),
        ),
    )


def _listed(splits: Sequence[str]) -> str:
    return " and ".join(f"`{name}`" for name in splits)


def _results(plan: EvaluationPlan, summary: Summary, words: str) -> Section:
    headlines, shown = HEADLINES, SHOWN
    if plan.task.samples_states:
        headlines, shown = PLACING_HEADLINES, PLACING_SHOWN
    return Section(
        title="Results",
        paragraphs=(words,),
        tables=tuple(headline_tables(summary, headlines)),
        figures=figures_of(summary, plan.conditions, shown),
    )


def _distances(words: str, tables: Sequence[ReportTable]) -> Section:
    return Section(
        title="Distances to the log",
        paragraphs=(f"{_DISTANCES_WORDS} {words}",),
        tables=tuple(tables),
    )


def _roads_words(conditions: Sequence[RoadCondition]) -> str:
    warps = [one.label for one in conditions if not one.is_plain]
    plain = ["plain roads"] if len(warps) < len(conditions) else []
    warped = [f"roads warped by {', '.join(warps)}"] if warps else []
    return " and on ".join([*plain, *warped])


def _words(plan: EvaluationPlan, record: RunRecord, found: Findings) -> tuple[str, ...]:
    words = [
        f"{record.num_scenes} scenes on {_roads_words(plan.conditions)}. "
        f"{_asked(plan.task)} Methods that sample at random give {plan.num_samples} "
        "samples of each scene.",
        _split_words(found.splits),
        *(f"**{method.name}**: {method.description}" for method in plan.methods),
        "Counted are road users present at the current step. Movers are vehicles, "
        "buses and motorcyclists; those on their way are not slower than 0.3 m/s at "
        "the current step and start within 4 m of a mapped centre line. The others "
        "are parked, or drive where the map has ended, and dominate mean deviations. "
        "An agent counts once on every road. Boxes overlap when they share more than "
        "0.05 m^2.",
        f"Intervals hold {100 * COVERAGE:.0f} % of {NUM_RESAMPLES} bootstrap resamples "
        "of scenes. Medians have none.",
    ]
    if any(not one.is_plain for one in plan.conditions):
        words.insert(
            1,
            "Perturbed roads are Scene-Attack's, warped ahead of the focal agent. The "
            "agents' states and the logged trajectories are warped with the map, by "
            "the same shear, and slowed to what friction allows on a dry road "
            f"(mu = {DRY_ROAD_FRICTION:g}). Displacements are measured to the warped "
            "log. SOR and HOR are Scene-Attack's soft and hard off-road rates: the "
            "share of steps outside the drivable area, and of agents that are outside "
            "it at any step. A model whose training scenes were warped by the same "
            "functions is not out of distribution on these roads.",
        )
    if record.without_future:
        words.append(
            f"{len(record.without_future)} scenes have no logged future and were left "
            "out."
        )
    if record.num_skipped_folders:
        words.append(
            "Left out, for a file is missing or cannot be read: "
            f"{number_of(record.num_skipped_folders, 'folder')}."
        )
    lost = [
        f"{method} has {num} of {most} scenes"
        for method, num in zip(
            found.summary.methods, found.num_scenes.tolist(), strict=True
        )
        if num < (most := int(found.num_scenes.max(initial=0)))
    ]
    if lost:
        words.append(f"Some methods failed on scenes: {'; '.join(lost)}.")
    return tuple(words)


def _split_words(splits: EvaluationSplits) -> str:
    """Describe the scenes of the headline figures."""
    if not splits.held_out:
        return (
            f"All scenes are of {_listed(splits.development)}, on which settings were "
            "chosen: these figures are for development and are no evidence of quality."
        )
    words = f"Figures are of {_listed(splits.held_out)} unless a title says otherwise."
    if splits.development:
        words += (
            f" Settings were chosen on {_listed(splits.development)}, whose figures "
            "stand apart."
        )
    return words


def _asked(task: EvaluationTask) -> str:
    """Describe the task of the methods."""
    words = "Agents keep their states at the current step; their trajectories are generated."
    if task.samples_states:
        words = (
            "Initial states and trajectories are sampled: as many agents of each kind as the log has in a "
            f"square of {2 * SAMPLED_HALF_SIDE_M:g} m around the focal agent, all others "
            "left out. Whether a sampled agent is on its way depends on its sampled state."
        )
    if task.agents == "paper":
        words += (
            " Only agents that the paper's code keeps are in the scenes"
            + (
                ", and states are sampled on the road only"
                if task.samples_states
                else ""
            )
            + "."
        )
    return words


def _failure_words(record: RunRecord) -> tuple[str, ...]:
    if not record.failures:
        return ("Nothing.",)
    whole = len([one for one in record.failures if not one.method])
    by_method = Counter(one.method for one in record.failures if one.method)
    parts = [f"{num} times {method}" for method, num in sorted(by_method.items())]
    if whole:
        parts.append(f"{whole} times the whole scene")
    return (f"Of {record.num_items} scenes on roads: {', '.join(parts)}.",)


def _run_table(plan: EvaluationPlan, record: RunRecord, command: str) -> ReportTable:
    rows = [
        ("command", command),
        ("data", " ".join(map(str, plan.data))),
        ("seed", str(plan.seed)),
        ("samples", str(plan.num_samples)),
        ("Python", platform.python_version()),
        *((name, version(name)) for name in _PACKAGES),
        *(
            (f"weights of {name}", text)
            for name, text in sorted(record.model_sha256.items())
        ),
    ]
    return ReportTable(title="Run", header=("what", "value"), rows=tuple(rows))
