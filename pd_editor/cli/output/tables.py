"""The samples of one run as a table: on the shell, and as a file beside the exports."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pd_editor.analysis.findings.check import SceneCheck
from pd_editor.analysis.findings.sample_ranking import (
    Ranking,
    SampleNumbers,
    numbers_of,
    ranked,
    spread_pick,
    with_fullness,
)
from pd_editor.base.errors import ExportError
from pd_editor.base.plain_text import aligned, csv_file
from pd_editor.base.regular_file import write_whole
from pd_editor.scene.generation import GuidanceReport, TrafficSample
from pd_editor.scene.guidance_outcome import Realism, TermOutcome
from pd_editor.scene.scenario import Scenario

_REALISM = (
    ("off-road share", "off_road"),
    ("agents in collisions", "num_collisions"),
    ("distance to lanes [m]", "lateral_deviation_m"),
    ("acceleration [m/s2]", "acceleration_mps2"),
)

_GUIDANCE_COLUMNS = (
    "sample",
    "what",
    "asked",
    "achieved",
    "error",
    "unit",
    "obeyed",
    "feasible",
)
COLUMNS: Final = (
    "rank",
    "sample",
    "agents",
    "problems",
    "notices",
    "realism",
    "collisions",
    "off_road",
    "lateral_m",
    "moving",
    "speed_mps",
    "ttc_s",
    "picked",
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
        differences = (f"{what}, guided minus unguided" for what, _ in _REALISM)
        rows = [[*_GUIDANCE_COLUMNS, *differences]]
        for name, report in zip(self.names, self.reports, strict=True):
            rows += [
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
                for one in report.outcomes
            ]
            rows += _cost_rows(name, report)
        write_whole(path, csv_file(rows), ExportError)


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


@dataclass(frozen=True, kw_only=True)
class SampleTable:
    """Numbers of all samples in the order of a ranking, and which of them are picked."""

    numbers: tuple[SampleNumbers, ...]
    order: tuple[int, ...]
    """Indices of the samples, the best one first."""
    picked: tuple[int, ...]

    @classmethod
    def of(
        cls,
        scenarios: Iterable[tuple[Scenario, SceneCheck]],
        samples: Sequence[TrafficSample],
        ranking: Ranking,
        pick: int | None,
    ) -> "SampleTable":
        """Rank samples, given the scenarios with each of them and their findings.

        ``pick`` None picks all of them.
        """
        numbers = with_fullness(
            numbers_of(scenario, one.ids, check)
            for (scenario, check), one in zip(scenarios, samples, strict=True)
        )
        order = ranked(numbers, ranking)
        count = len(samples) if pick is None else pick
        return cls(
            numbers=numbers,
            order=order,
            picked=spread_pick(samples, count, first=order[0]),
        )

    def lines(self, names: Sequence[str]) -> tuple[str, ...]:
        """The table for people, one line per sample."""
        return aligned([COLUMNS, *self._rows(names)], align=">")

    def write(self, path: Path, names: Sequence[str]) -> None:
        """Write the table as CSV.

        Raises:
            ExportError: the file cannot be written.
        """
        write_whole(path, csv_file([COLUMNS, *self._rows(names)]), ExportError)

    def _rows(self, names: Sequence[str]) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for rank, index in enumerate(self.order, start=1):
            one = self.numbers[index]
            time = one.time_to_collision_s
            rows.append(
                (
                    str(rank),
                    names[index],
                    str(one.num_agents),
                    str(one.num_problems),
                    str(one.num_notices),
                    f"{one.realism:.0f}",
                    str(one.num_hits),
                    f"{one.off_road_share:.3f}",
                    f"{one.lateral_deviation_m:.2f}",
                    f"{one.moving_share:.2f}",
                    f"{one.mean_speed_mps:.1f}",
                    "" if time is None else f"{time:.1f}",
                    "yes" if index in self.picked else "no",
                )
            )
        return rows
