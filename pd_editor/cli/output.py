"""What commands of the shell print and write: progress, outcomes, tables, plans."""

import dataclasses
import json
import os
import sys
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from pd_editor.analysis.findings.check import SceneCheck
from pd_editor.analysis.findings.sample_ranking import (
    Ranking,
    SampleNumbers,
    numbers_of,
    ranked,
    spread_pick,
    with_fullness,
)
from pd_editor.base.errors import ExportError, InputError
from pd_editor.base.plain_text import aligned, csv_file
from pd_editor.base.regular_file import json_value, read_regular, write_whole
from pd_editor.editor.commands import Command
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import export_into
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import Variant, tags_from_text
from pd_editor.experiments.work_engine.work_engine import (
    WorkFailure,
    WorkProgress,
    progress_line,
)
from pd_editor.scene.formats.argoverse2 import ARGOVERSE2
from pd_editor.scene.generation import (
    GenerationProgress,
    GuidanceReport,
    Made,
    TrafficSample,
    run_to_end,
)
from pd_editor.scene.guidance_terms import Realism, TermOutcome
from pd_editor.scene.policy import DrivenPlans
from pd_editor.scene.scenario import Scenario

_WIDTH: Final = 78


class ProgressLine:
    """One line that a terminal writes over; elsewhere a line every 30 seconds."""

    def __init__(self) -> None:
        """Begin; the first line elsewhere comes after 30 seconds."""
        self.began = self._last = time.monotonic()
        self._written = ""
        self.is_watched = sys.stderr.isatty()

    def show(self, line: str, *, is_over: bool = False) -> None:
        """Write how far the work is, if that is news; ``is_over`` ends a terminal's line."""
        now = time.monotonic()
        if line == self._written:
            return
        if self.is_watched:
            sys.stderr.write(f"\r{line:<{_WIDTH}}" + "\n" * is_over)
            self._written = line
        elif now - self._last >= 30.0:
            sys.stderr.write(f"{line}\n")
            self._last, self._written = now, line
        sys.stderr.flush()

    def clear(self) -> None:
        """Remove the line from a terminal."""
        if self.is_watched:
            sys.stderr.write("\r" + " " * _WIDTH + "\r")


def preparation_shown() -> Callable[[WorkProgress], None]:
    """A function that shows the progress of the preparation of scenes."""
    line = ProgressLine()

    def show(progress: WorkProgress) -> None:
        done, num = progress.num_done, progress.num_items
        line.show(f"Preparing scenes: {done} of {num} parts", is_over=done == num)

    return show


def run_showing_progress(
    steps: Generator[GenerationProgress, None, Made], name: str = ""
) -> Made:
    """Run a generation and show how far it is, or what has been made of a name."""

    def told(progress: GenerationProgress) -> str:
        before = f"{name}:" if name else f"{100 * progress.fraction:3.0f} %"
        return f"{before} {progress.message}"

    line = ProgressLine()
    try:
        return run_to_end(steps, lambda progress: line.show(told(progress)))
    finally:
        line.clear()


def work_shown(noun: str) -> Callable[[WorkProgress], None]:
    """Display of progress of work on many items."""
    line = ProgressLine()

    # Also called while nothing is done, when the rate of what is done would only age.
    @cache
    def text_of(progress: WorkProgress) -> str:
        return progress_line(progress, time.monotonic() - line.began, noun)

    def show(progress: WorkProgress) -> None:
        is_over = progress.num_done == progress.num_items
        line.show(text_of(progress), is_over=is_over)

    return show


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """Scenarios that a command wrote."""

    folders: tuple[Path, ...]
    """One folder per scenario: tracks, map and recipe.json."""
    scenarios: tuple[Scenario, ...]
    """Those of the folders; of a command on several scenes none."""
    remarks: tuple[str, ...] = ()
    """Remarks for the user, one sentence each."""
    failures: Mapping[str, WorkFailure] = field(default_factory=dict)
    """Of a command on several scenes, why some have no folder."""
    records: tuple[Any, ...] = ()
    """What a report of all scenes is made of."""

    @property
    def folder(self) -> Path:
        """The first folder."""
        return self.folders[0]

    @property
    def scenario(self) -> Scenario:
        """The first scenario."""
        return self.scenarios[0]

    def __str__(self) -> str:
        """One line per folder, then the remarks."""
        return "\n".join([*map(str, self.folders), *self.remarks])


def write_session(
    out: str | Path,
    session: EditorSession,
    *,
    overwrite: bool,
    format_name: str = ARGOVERSE2.name,
) -> Path:
    """Write a session's scenario under its name in some format, and its recipe.

    The recipe carries no date, so equal work gives equal files.

    Raises:
        ExportError: the folder cannot be written, or holds something else.
    """
    return export_into(
        out,
        session.scenario,
        undated_recipe(session),
        base=session.base,
        overwrite=overwrite,
        format_name=format_name,
    )


def refuse_existing(file: Path, *, overwrite: bool) -> None:
    """Raise for a file that is there already, unless it may be replaced.

    Raises:
        ExportError: it is there, and stays.
    """
    if os.path.exists(file) and not overwrite:
        raise ExportError(f"{file}: is there already; add --overwrite to replace it.")


def edited_session(
    base: Scenario, commands: Sequence[Command], name: str = ""
) -> EditorSession:
    """A session in which a scenario has been edited, and maybe named."""
    session = EditorSession(base)
    session.describe(described(name))
    for command in commands:
        session.apply(command)
    return session


def undated_recipe(session: EditorSession) -> Recipe:
    """Recipe of a session, without the date."""
    return dataclasses.replace(session.recipe(), created_at="")


def described(name: str, tags: tuple[str, ...] = (), note: str = "") -> Variant:
    """Validate name, tags and note from the shell.

    Raises:
        EditError: the name does not fit, or a text is too long.
    """
    return Variant(name=name, tags=tags_from_text(*tags), note=note)


def _place(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}-plans.json")


def write_plans(folder: Path, plans: DrivenPlans, scenario: Scenario) -> None:
    """Write the plans of a roll-out in the frame of its city, which files keep."""
    origin = scenario.origin_city_m
    data = {
        name: {
            str(at): np.round(line + origin, 2).tolist() for at, line in made.items()
        }
        for name, made in plans.items()
    }
    write_whole(_place(folder), f"{json.dumps(data)}\n".encode())


def read_plans(folder: Path, scenario: Scenario) -> DrivenPlans:
    """The plans beside a folder, in the frame of its scenario; none if there is no file.

    Raises:
        InputError: the file cannot be read, or holds no plans.
    """
    path = _place(folder)
    if not path.exists():
        return {}
    try:
        data = json_value(read_regular(path, max_bytes=1 << 26))
        plans = {
            name: {
                int(at): np.asarray(line, dtype=float) - scenario.origin_city_m
                for at, line in made.items()
            }
            for name, made in data.items()
        }
    except (ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: holds no plans of pd-editor drive.") from error
    lines = [line for made in plans.values() for line in made.values()]
    if not all(one.ndim == 2 and np.isfinite(one).all() for one in lines):
        raise InputError(f"{path}: holds no plans of pd-editor drive.")
    return plans


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
