"""What is said of guidance terms: problems before a run, and outcomes after it."""

from dataclasses import dataclass, replace
from typing import Final, Literal

from pd_editor.analysis.guidance.kinds.pairs import Threaten, approach_obstacles
from pd_editor.analysis.guidance.report import SLOWED, guidance_problems
from pd_editor.analysis.threats.encounter import APPROACH_WORDS
from pd_editor.editor.edit_findings import scene_outcomes, unrun_terms
from pd_editor.scene.generation import GuidanceReport
from pd_editor.scene.guidance_terms import (
    GuidanceCost,
    GuidanceProblem,
    GuidanceTerm,
    Realism,
    TermOutcome,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.tab.ui_context import UiContext

Tone = Literal["plain", "good", "warn", "bad"]
TAKE_UNGUIDED: Final = "Take the unguided sample"
NOT_RUN: Final = "Not run yet: Regenerate to apply it."
FIGURES: Final = (
    (
        "Agents that collide after t = 0",
        "Agents whose boxes overlap at t = 0 already count only if they hit another one; a "
        "contact that was asked for does not count",
    ),
    (
        "Time off the road",
        "Share of the time of moving vehicles and cyclists, as on the cards of samples; "
        "the scorecard has the share of vehicles that are ever off the road",
    ),
    ("Distance to lanes", "Mean distance to the nearest reachable lane"),
    ("Mean acceleration", "Of its absolute value"),
)
"""Names of the figures of realism, and what they mean."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """One line of text with its tone."""

    tone: Tone
    text: str


CHECKING: Final = Line(tone="plain", text="Checking ...")


@dataclass(frozen=True, kw_only=True)
class RunReport:
    """What a run as a whole came to."""

    lines: tuple[Line, ...] = ()
    figures: tuple[tuple[str, str, str, str], ...] = ()
    """Realism: name, guided and unguided value, help; the first row has the titles."""
    action: str | None = None
    """Label of the button that takes the unguided sample; None: not offered."""


class GuidanceNotes:
    """Notes of the session's terms, computed once per scenario."""

    def __init__(self, ui: UiContext) -> None:
        """Make notes of a tab's session."""
        self._ui = ui
        self._problems: dict[GuidanceTerm, tuple[GuidanceProblem, ...]] = {}
        self._obstacles: dict[GuidanceTerm, dict[str, tuple[str, str]]] = {}
        self._checked: Scenario | None = None
        self._is_partial = False
        """Whether some terms of the checked scenario were left for later."""
        self._terms: tuple[GuidanceTerm, ...] = ()
        self._awaited: frozenset[GuidanceTerm] = frozenset()
        """Terms that are checked in the next pause."""
        self._judged: tuple[Scenario | None, tuple[TermOutcome, ...]] = (None, ())

    def refresh(self, *, is_pause: bool = False) -> bool:
        """Check the session's terms; returns whether what is said has changed.

        While an edit is being made, only terms that it changes are checked. Threats take
        up to a second, so they wait for a pause; until then their former problems stay,
        and after the edit a sign tells that they are checked.
        """
        state = self._ui.session.state
        scenario, terms = state.scenario, state.scenario.guidance
        if scenario is self._checked and not self._is_partial:
            return False
        checked = list(terms)
        if state.is_previewing:
            checked = [term for term in terms if term not in self._terms]
            # More terms that change at once, as in a warp, are checked when the edit is
            # over.
            if len(checked) > 2:
                checked = []
        if not is_pause:
            checked = [term for term in checked if not isinstance(term, Threaten)]
        former = self._problems, self._awaited
        known = self._problems
        found = {
            term: known[term] for term in terms if term in known and term not in checked
        }
        for problem in guidance_problems(scenario, tuple(checked)):
            found[problem.term] = (*found.get(problem.term, ()), problem)
        self._problems, self._terms, self._checked = found, terms, scenario
        self._obstacles = {
            term: approach_obstacles(scenario, term)
            if term in checked
            else self._obstacles.get(term, {})
            for term in terms
            if isinstance(term, Threaten)
        }
        self._is_partial = len(checked) < len(terms)
        self._awaited = frozenset(
            term
            for term in terms
            if term.is_on and term not in checked and not state.is_previewing
        )
        return (found, self._awaited) != former

    def of_term(self, index: int) -> tuple[Line, ...]:
        """Lines beside a term: its problems, and what the last run achieved."""
        scenario = self._ui.session.scenario
        lines = [
            Line(
                tone="bad" if problem.severity == "error" else "warn",
                text=problem.message,
            )
            for problem in self._problems.get(scenario.guidance[index], ())
        ]
        term = scenario.guidance[index]
        if term in self._awaited:
            lines.append(CHECKING)
        run = self._ui.workspace.guided_runs.of(scenario.agents)
        unrun = unrun_terms(scenario, self._ui.session.commands_in_force)
        if run is not None and term in unrun:
            lines.append(Line(tone="warn", text=NOT_RUN))
        lines += [outcome_line(one) for one in self._outcomes() if one.term == term]
        return tuple(lines)

    def before_run(self) -> str:
        """What to know of terms that are not run yet; empty if all are."""
        session = self._ui.session
        unrun = unrun_terms(session.scenario, session.commands_in_force)
        wrong = [one for term in unrun for one in self._problems.get(term, ())]
        return wrong[0].message if wrong else NOT_RUN if unrun else ""

    def of_options(self, index: int, name: str) -> dict[str, tuple[str, str]]:
        """Why approaches of a threat are infeasible, in few words and in a sentence."""
        term = self._ui.session.scenario.guidance[index]
        known = self._obstacles.get(term, {}) if name == "approach" else {}
        return {
            words: known[one] for one, words in APPROACH_WORDS.items() if one in known
        }

    def _outcomes(self) -> tuple[TermOutcome, ...]:
        """Outcomes as the list of findings has them, with what is known of their run."""
        session = self._ui.session
        scenario, (judged, found) = session.scenario, self._judged
        if session.state.is_previewing:
            return ()
        if judged is not scenario:
            found = scene_outcomes(scenario, session.commands_in_force)
            self._judged = scenario, found
        run = self._ui.workspace.guided_runs.of(scenario.agents)
        known = () if run is None else run.report.outcomes
        return tuple(
            next((merged(one, other) for other in known if other.term == one.term), one)
            for one in found
        )

    def sentences(self) -> dict[int, tuple[str, ...]]:
        """Sentences of what is wrong with terms, by their indices."""
        terms = self._ui.session.scenario.guidance
        return {
            index: tuple(problem.message for problem in self._problems[term])
            for index, term in enumerate(terms)
            if term in self._problems
        }

    def report(self) -> RunReport:
        """Lines on the last run as a whole; none after another edit of the traffic."""
        scenario = self._ui.session.scenario
        run = self._ui.workspace.guided_runs.of(scenario.agents)
        if run is None:
            return RunReport()
        now, then = _in_force(scenario), _in_force(run.request.scenario)
        if now != then:
            count = len(unrun_terms(scenario, self._ui.session.commands_in_force))
            unrun = f"{count} of {len(now)} not run yet. " if count else ""
            head = Line(tone="warn", text=f"{unrun}The last run, with other guidance:")
            report = report_of(run.report)
            former = (replace(line, tone="plain") for line in report.lines)
            return replace(report, lines=(head, *former))
        return report_of(replace(run.report, outcomes=self._outcomes()))


def merged(outcome: TermOutcome, of_run: TermOutcome) -> TermOutcome:
    """An outcome with the cost of its run, and what slowed the agent there."""
    slowed = SLOWED * of_run.achieved.endswith(SLOWED)
    return replace(
        outcome,
        achieved=outcome.achieved + slowed,
        is_feasible=of_run.is_feasible,
        cost=of_run.cost,
    )


def _in_force(scenario: Scenario) -> list[GuidanceTerm]:
    return [term for term in scenario.guidance if term.is_on]


def outcome_line(outcome: TermOutcome) -> Line:
    """Asked and achieved in one line."""
    if not outcome.is_run:
        return Line(tone="warn", text=f"The last run achieved {outcome.achieved}.")
    text = f"Asked: {outcome.asked}. Achieved: {outcome.achieved}"
    worse = () if outcome.cost is None else outcome.cost.worse()
    cost = f" Cost: {'; '.join(worse)}." if worse else ""
    if outcome.is_obeyed:
        return Line(tone="warn" if worse else "good", text=f"{text}.{cost}")
    why = "." if outcome.is_feasible else ". It could not be met within the limits."
    return Line(tone="bad", text=f"{text}{why}{cost}")


def report_of(report: GuidanceReport) -> RunReport:
    """Obeyed terms, realism against the unguided sample, and impossible motions."""
    lines: list[Line] = []
    if report.outcomes:
        obeyed = sum(outcome.is_obeyed for outcome in report.outcomes)
        count = sum(outcome.is_run for outcome in report.outcomes)
        left = len(report.outcomes) - count
        tone: Tone = "good" if obeyed == count else "bad"
        more = f"; {left} had no effect" if left else ""
        lines.append(Line(tone=tone, text=f"Guidance met: {obeyed} of {count}{more}"))
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


def figures_of(cost: GuidanceCost) -> tuple[tuple[str, str, str, str], ...]:
    """Realism of the guided and of the unguided sample of the same seed."""
    guided, other = _in_words(cost.guided), _in_words(cost.unguided)
    return (
        ("Realism", "guided", "unguided", "Of all motor vehicles and cyclists"),
        *(
            (name, mine, others, hint)
            for (name, hint), mine, others in zip(FIGURES, guided, other, strict=True)
        ),
    )


def _in_words(realism: Realism) -> tuple[str, ...]:
    return (
        f"{realism.num_collisions}",
        f"{realism.off_road:.1%}",
        f"{realism.lateral_deviation_m:.2f} m",
        f"{realism.acceleration_mps2:.2f} m/s\u00b2",
    )
