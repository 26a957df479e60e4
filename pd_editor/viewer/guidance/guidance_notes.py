"""What is said of guidance terms: problems before a run, and outcomes after it."""

from dataclasses import dataclass
from typing import Final, Literal

from pd_editor.generation import GuidanceReport
from pd_editor.guidance.feasibility import guidance_problems
from pd_editor.scene.guidance_outcome import (
    GuidanceCost,
    GuidanceProblem,
    Realism,
    TermOutcome,
)
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.ui_context import UiContext

Tone = Literal["plain", "good", "warn", "bad"]
TAKE_UNGUIDED: Final = "Take the unguided sample"
MAX_DRAGGED_TERMS: Final = 2
"""More terms that change at once, as in a warp, are checked when the edit is over."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """One line of text with its tone."""

    tone: Tone
    text: str


@dataclass(frozen=True, kw_only=True)
class RunReport:
    """What a run as a whole came to."""

    lines: tuple[Line, ...] = ()
    figures: tuple[tuple[str, str, str], ...] = ()
    """Realism: name, guided and unguided value; the first row has the titles."""
    action: str | None = None
    """Label of the button that takes the unguided sample; None: not offered."""


class GuidanceNotes:
    """Notes of the session's terms, computed once per scenario."""

    def __init__(self, ui: UiContext) -> None:
        """Make notes of a tab's session."""
        self._ui = ui
        self._terms: tuple[GuidanceTerm, ...] = ()
        self._problems: dict[int, tuple[GuidanceProblem, ...]] = {}
        self._checked: Scenario | None = None
        self._is_partial = False

    def refresh(self) -> bool:
        """Check the session's terms; returns whether what is said has changed.

        While an edit is being made, only terms that it changes are checked.
        """
        state = self._ui.session.state
        scenario, is_partial = state.scenario, state.is_previewing
        if scenario is self._checked and not self._is_partial:
            return False
        former, terms = self._problems, scenario.guidance
        if is_partial:
            checked = [i for i, term in enumerate(terms) if term not in self._terms]
            if len(checked) > MAX_DRAGGED_TERMS:
                checked = []
            kept = set(range(len(terms))) - set(checked)
            found = {index: former[index] for index in kept if index in former}
        else:
            checked, found = list(range(len(terms))), {}
        for problem in guidance_problems(scenario, tuple(terms[i] for i in checked)):
            for index in checked:
                if terms[index] == problem.term:
                    found[index] = (*found.get(index, ()), problem)
        self._problems, self._terms = found, terms
        self._checked, self._is_partial = scenario, is_partial
        return found != former

    def of_term(self, index: int) -> tuple[Line, ...]:
        """Lines beside a term: its problems, and what the last run achieved."""
        scenario = self._ui.session.scenario
        lines = [
            Line(
                tone="bad" if problem.severity == "error" else "warn",
                text=problem.message,
            )
            for problem in self._problems.get(index, ())
        ]
        run = self._ui.workspace.guided_runs.of(scenario.agents)
        term = scenario.guidance[index]
        if run is not None:
            lines += [
                outcome_line(outcome)
                for outcome in run.report.outcomes
                if outcome.term == term
            ]
        return tuple(lines)

    def sentences(self) -> dict[int, tuple[str, ...]]:
        """Sentences of what is wrong with terms, by their indices."""
        return {
            index: tuple(problem.message for problem in problems)
            for index, problems in self._problems.items()
        }

    def report(self) -> RunReport:
        """Lines on the last run as a whole; none after another edit of the traffic."""
        run = self._ui.workspace.guided_runs.of(self._ui.session.scenario.agents)
        return RunReport() if run is None else report_of(run.report)


def outcome_line(outcome: TermOutcome) -> Line:
    """Asked and achieved in one line."""
    text = f"Asked: {outcome.asked}. Achieved: {outcome.achieved}"
    if outcome.is_obeyed:
        return Line(tone="good", text=f"{text}.")
    why = "." if outcome.is_feasible else ". It could not be met within the limits."
    return Line(tone="bad", text=f"{text}{why}")


def report_of(report: GuidanceReport) -> RunReport:
    """Obeyed terms, realism against the unguided sample, and impossible motions."""
    lines: list[Line] = []
    if report.outcomes:
        obeyed = sum(outcome.is_obeyed for outcome in report.outcomes)
        count = len(report.outcomes)
        tone: Tone = "good" if obeyed == count else "bad"
        lines.append(Line(tone=tone, text=f"Terms obeyed: {obeyed} of {count}"))
    cost = report.cost
    worse = () if cost is None else cost.worse()
    if worse:
        text = f"Guidance made the scene worse: {'; '.join(worse)}."
        lines.append(Line(tone="warn", text=text))
    lines += [Line(tone="warn", text=text) for text in report.motion_problems]
    return RunReport(
        lines=tuple(lines),
        figures=() if cost is None else figures_of(cost),
        action=None if report.unguided is None else TAKE_UNGUIDED,
    )


def figures_of(cost: GuidanceCost) -> tuple[tuple[str, str, str], ...]:
    """Realism of the guided and of the unguided sample of the same seed."""
    guided, other = _in_words(cost.guided), _in_words(cost.unguided)
    names = (
        "Agents in new collisions",
        "Time off the road",
        "Distance to lanes",
        "Mean acceleration",
    )
    return (
        ("Realism", "guided", "unguided"),
        *zip(names, guided, other, strict=True),
    )


def _in_words(realism: Realism) -> tuple[str, ...]:
    return (
        f"{realism.num_collisions}",
        f"{realism.off_road:.1%}",
        f"{realism.lateral_deviation_m:.2f} m",
        f"{realism.acceleration_mps2:.2f} m/s\u00b2",
    )
