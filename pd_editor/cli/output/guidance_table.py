"""Table of the outcomes of guidance terms: printed, and beside the exports."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pd_editor.base.errors import ExportError
from pd_editor.base.regular_file import write_whole
from pd_editor.scene.generation import GuidanceReport
from pd_editor.scene.guidance_outcome import Realism, TermOutcome

_REALISM = (
    ("off-road share", "off_road"),
    ("agents in collisions", "num_collisions"),
    ("distance to lanes [m]", "lateral_deviation_m"),
    ("acceleration [m/s2]", "acceleration_mps2"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class GuidanceTable:
    """Reports of the written samples, with their names."""

    names: tuple[str, ...]
    reports: tuple[GuidanceReport, ...]

    def lines(self) -> tuple[str, ...]:
        """Lines for the shell."""
        found: list[str] = []
        for name, report in zip(self.names, self.reports, strict=True):
            before = f"{name}: " if len(self.names) > 1 else ""
            for one in report.outcomes:
                if not one.is_run:
                    found.append(
                        f"{before}{one.term.in_words}: NOT RUN, achieved {one.achieved}"
                    )
                    continue
                mark = "" if one.is_obeyed else "NOT OBEYED, "
                note = "" if one.is_feasible else " (not feasible)"
                found.append(
                    f"{before}{one.term.in_words}: {mark}asked {one.asked}, achieved "
                    f"{one.achieved}{note}{_term_cost(one)}"
                )
            found += [f"{before}{problem}" for problem in report.motion_problems]
            if report.cost is not None:
                found.append(f"{before}cost: {_cost_in_words(report)}")
        return tuple(found)

    def write(self, path: Path) -> None:
        """Write one row per term and per figure of realism, as CSV.

        Raises:
            ExportError: the file cannot be written.
        """
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(
            [
                "sample",
                "what",
                "asked",
                "achieved",
                "error",
                "unit",
                "obeyed",
                "feasible",
                *(f"{what}, guided minus unguided" for what, _ in _REALISM),
            ]
        )
        for name, report in zip(self.names, self.reports, strict=True):
            for one in report.outcomes:
                table.writerow(
                    [
                        name,
                        one.term.in_words,
                        one.asked,
                        one.achieved,
                        f"{one.error:.4g}",
                        one.unit,
                        ("yes" if one.is_obeyed else "no") if one.is_run else "not run",
                        "yes" if one.is_feasible else "no",
                        *_differences(one),
                    ]
                )
            table.writerows(_cost_rows(name, report))
        write_whole(path, text.getvalue().encode(), ExportError)


def reports_of(
    reports: Sequence[GuidanceReport], indices: Sequence[int]
) -> tuple[GuidanceReport, ...]:
    """Reports of some samples; none without guidance."""
    return tuple(reports[index] for index in indices) if reports else ()


def _differences(outcome: TermOutcome) -> list[str]:
    """Realism of the term's agents against the unguided sample."""
    cost = outcome.cost
    if cost is None:
        return [""] * len(_REALISM)
    return [
        f"{getattr(cost.guided, field) - getattr(cost.unguided, field):.4g}"
        for _, field in _REALISM
    ]


def _term_cost(outcome: TermOutcome) -> str:
    """What the term made worse for the agents that it guides."""
    worse = () if outcome.cost is None else outcome.cost.worse()
    return f"; its agents: {'; '.join(worse)}" if worse else ""


def _cost_in_words(report: GuidanceReport) -> str:
    assert report.cost is not None
    worse = report.cost.worse()
    if not worse:
        return "as realistic as without guidance"
    return (
        f"{'; '.join(worse)} (against the unguided sample of the same seed; "
        "without --guide you get it)"
    )


def _cost_rows(name: str, report: GuidanceReport) -> list[list[str]]:
    if report.cost is None:
        return []

    def value(figures: Realism, field: str) -> str:
        return f"{getattr(figures, field):.4g}"

    return [
        [
            name,
            f"realism: {what}",
            f"{value(report.cost.unguided, field)} unguided",
            value(report.cost.guided, field),
            *[""] * (4 + len(_REALISM)),
        ]
        for what, field in _REALISM
    ]
