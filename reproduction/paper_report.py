"""The report of the paper's tables and figures."""

from collections.abc import Sequence

from pd_editor.experiments.evaluation.evaluation import EvaluationSplits, RunRecord
from pd_editor.experiments.report import Figure, Report, ReportTable, Section
from reproduction.attention_scores import LEVELS
from reproduction.claims import claims_table, default_table
from reproduction.measures import RowTable
from reproduction.paper_tables import (
    NONE,
    AttentionScores,
    attention_table,
    state_tables,
    trajectory_tables,
)
from reproduction.systems import Trained, in_table_order, label_of

_MOST_FAILURES = 20


def paper_report(
    *,
    trained: Sequence[Trained],
    rows: tuple[RowTable, RowTable, RowTable],
    scores: Sequence[AttentionScores],
    splits: EvaluationSplits,
    records: Sequence[RunRecord],
    command: str,
    figures: tuple[Figure, ...],
    plain: bool,
    warped: bool,
) -> Report:
    """The report, on trajectories on plain and on warped roads if they were evaluated.

    ``rows`` are of initial states, of the paper's agents, and of all agents; the tables
    are of the headline splits.
    """
    states, paper, everyone = rows
    return Report(
        title="Tables and figures of Path Diffuser, from our own rows",
        sections=(
            Section(
                title="What was evaluated",
                paragraphs=_facts(states, splits, command),
                tables=(_trainings(trained),),
            ),
            Section(
                title="Claims",
                tables=(
                    claims_table(states, everyone),
                    default_table(states, everyone),
                ),
            ),
            Section(
                title="Initial states",
                tables=(attention_table(LEVELS, scores), *state_tables(states)),
            ),
            Section(
                title="Trajectories",
                paragraphs=_roads(plain=plain, warped=warped),
                tables=trajectory_tables(
                    paper,
                    everyone,
                    plain=plain,
                    warped=warped,
                    saw_warps={one.system for one in trained if one.saw_warps},
                ),
            ),
            Section(title="Results", paragraphs=(_FIGURES,), figures=figures),
            Section(title="Failures", paragraphs=_failures(records)),
        ),
    )


_OUT_OF_DISTRIBUTION = (
    "Perturbed maps are out of distribution for systems that never saw a warped road; the "
    "others are marked."
)
_NO_WARPS = (
    "There are no tables of perturbed maps: no warped roads were asked for (--warps)."
)
_NO_PLAIN = "There are no tables without map perturbation: plain roads were not asked for (--warps)."
_FIGURES = (
    "One scene, samples of the systems above; each figure lies beside as PNG and PDF."
)


def _roads(*, plain: bool, warped: bool) -> tuple[str, ...]:
    """What the tables of trajectories tell of roads, and which were not asked for."""
    return (
        *(() if plain else (_NO_PLAIN,)),
        _OUT_OF_DISTRIBUTION if warped else _NO_WARPS,
    )


def _facts(states: RowTable, splits: EvaluationSplits, command: str) -> tuple[str, ...]:
    return (
        f"Scenes: {states.num_scenes} of {', '.join(splits.headline)}. Command: `{command}`.",
        "Intervals come from resampling scenes and trainings; with one or two trainings "
        "of a system they tell little of the spread between trainings.",
    )


def _trainings(trained: Sequence[Trained]) -> ReportTable:
    lines = []
    for system in in_table_order(one.system for one in trained):
        own = [one for one in trained if one.system == system]
        warps = sorted({one.warp_share for one in own})
        lines.append(
            (
                label_of(system),
                ", ".join(str(one.seed) for one in own),
                ", ".join(dict.fromkeys(stage for one in own for stage in one.stages)),
                ", ".join(f"{100 * share:g}" for share in warps),
                ", ".join(sorted({one.start for one in own if one.start})) or NONE,
            )
        )
    return ReportTable(
        title="Trainings",
        header=("system", "seeds", "own stages", "warped roads, %", "started from"),
        rows=tuple(lines),
    )


def _failures(records: Sequence[RunRecord]) -> tuple[str, ...]:
    found = [one for record in records for one in record.failures]
    words = [
        f"{one.scene}, {one.condition}, {one.method or 'all'}: {one.reason}"
        for one in found[:_MOST_FAILURES]
    ]
    if len(found) > _MOST_FAILURES:
        words.append(f"And {len(found) - _MOST_FAILURES} more.")
    return tuple(words)
