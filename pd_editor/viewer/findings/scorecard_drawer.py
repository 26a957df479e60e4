"""The scorecard over the picture's left side, and charts of the selected agents."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.findings.check import SceneCheck
from pd_editor.analysis.findings.finding import Finding, Severity
from pd_editor.analysis.findings.scorecard import Level, ScoreRow, scorecard
from pd_editor.analysis.metrics.agent_profile import agent_profile
from pd_editor.editor.cures import Cure, cures
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.overlay.messages import (
    Chart,
    ChartsState,
    ScorecardState,
    ScoreFinding,
    ScoreLine,
    Tone,
)
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.timeline import Timeline, marks_of
from pd_editor.viewer.state.finding_watch import FindingWatch
from pd_editor.viewer.tab.ui_context import UiContext

_MARKS: Final[dict[Severity, str]] = {"problem": "solid", "notice": "striped"}
MAX_CHARTED: Final = 3
"""Number of selected agents with lines in the charts."""
MAX_LISTED: Final = 6
"""Number of findings that an open row lists."""
_TONE: Final[dict[Level, Tone]] = {"usual": "good", "unusual": "warn", "extreme": "bad"}


@dataclass(frozen=True, kw_only=True, eq=False)
class ScorecardActions:
    """Actions of the scorecard."""

    go_to: Callable[[Finding, float], None]
    """Selects a finding's agent, and shows it at that time right of so much of the
    picture's width."""
    cure: Callable[[Cure], None]
    draw: Callable[[Scenario, tuple[Finding, ...]], None]
    redraw: Callable[[], None]
    """Draws rings again."""
    opened: Callable[[], None]
    """Called when it was opened or closed."""


class ScorecardDrawer:
    """The element ``scorecard``; its findings in the scene and on the timeline.

    Metrics are computed while it is open only, after an edit and not during a gesture.
    A row opens the list of its findings, of which one is chosen: camera and time go to
    it, and its cures are offered. While a row is open, its findings alone are drawn.
    """

    def __init__(
        self,
        ui: UiContext,
        overlay: Overlay,
        timeline: Timeline,
        watch: FindingWatch,
        actions: ScorecardActions,
    ) -> None:
        """Start closed."""
        self._ui = ui
        self._overlay = overlay
        self._timeline = timeline
        self._watch = watch
        self._actions = actions
        self._scored: SceneCheck | None = None
        self._rows: tuple[ScoreRow, ...] = ()
        self._charted: tuple[Scenario, tuple[str, ...]] | None = None
        self._open_row = ""
        self._chosen: Finding | None = None
        self._cures: tuple[Cure, ...] | None = ()
        """What helps against the chosen finding; None until it is known."""
        self._draws = True
        self._is_muted = False
        self._covered_share = 0.0
        self.is_open = False
        overlay.on("scorecard", self._heard)
        timeline.on_mark["finding"] = self._mark_chosen

    def toggle(self) -> None:
        """Open it, or close it."""
        self.set_open(not self.is_open)

    def set_open(self, is_open: bool) -> None:
        """Open or close it."""
        if is_open == self.is_open:
            return
        self.is_open = is_open
        self._scored = self._charted = self._chosen = None
        self._rows, self._open_row = (), ""
        if is_open:
            self.show()
        else:
            self._overlay.show(ScorecardState())
            self._mark()
        self._actions.opened()

    def show(self) -> None:
        """Follow scenario and selection."""
        session = self._ui.session
        if not self.is_open:
            return
        if session.state.is_previewing:
            self._actions.draw(session.scenario, ())
            return
        scenario = session.scenario
        check = self._watch.whole()
        if self._scored is not check:
            self._scored, self._rows = check, scorecard(scenario, check.all)
            self._follow_chosen()
        self._show_rows()
        self._mark()
        charted = (scenario, session.selection[:MAX_CHARTED])
        if self._charted != charted:
            self._charted = charted
            self._overlay.show(_charts(*charted))

    def set_muted(self, is_muted: bool) -> None:
        """Draw nothing in the scene while another scenario is drawn there."""
        if is_muted != self._is_muted:
            self._is_muted = is_muted
            self._mark()

    def agents_at(self, step: float) -> frozenset[str]:
        """Agents with a drawn finding at a step."""
        return frozenset(
            name
            for one in self._drawn_findings()
            if one.holds_at(step)
            for name in one.agent_ids
        )

    def _drawn_findings(self) -> tuple[Finding, ...]:
        """Faults of the open row, or of all rows; of a mean the chosen finding."""
        if not self.is_open or not self._draws or self._is_muted:
            return ()
        if self._chosen is not None and not self._chosen.is_fault:
            return (self._chosen,)
        return tuple(
            one
            for row in self._rows
            if self._open_row in ("", row.name)
            for one in row.findings
            if one.is_fault
        )

    def _mark(self) -> None:
        """Draw the findings in the scene, and mark them on the timeline."""
        found = self._drawn_findings()
        scenario = self._ui.session.scenario
        self._actions.draw(scenario, found)
        listed = {one.key for one in self._watch.new}
        lines = [
            (one.shown_step, one.headline)
            for one in found
            # Open problems have marks already.
            if one.is_fault and one.key not in listed
        ]
        self._timeline.set_marks("finding", marks_of(lines))

    def _follow_chosen(self) -> None:
        """The chosen finding as it is after an edit; none if it is gone."""
        former = self._chosen
        self._chosen, self._cures = None, ()
        if former is None:
            return
        for one in self._findings_of(self._open_row):
            if one.key == former.key:
                self._chosen, self._cures = one, None
                self._ui.post(self._offer_cures, "finding cures")
                return

    def _findings_of(self, name: str) -> tuple[Finding, ...]:
        return next((row.findings for row in self._rows if row.name == name), ())

    def _choose(self, row: str, finding: Finding) -> None:
        """Show a finding of a row; what helps is found out afterwards."""
        self._open_row, self._chosen = row, finding
        self._cures = None
        self._actions.go_to(finding, self._covered_share)
        self.show()
        self._actions.redraw()
        self._ui.post(self._offer_cures, "finding cures")

    def _offer_cures(self) -> None:
        if self.is_open and self._chosen is not None:
            self._cures = cures(
                self._ui.session.scenario,
                self._chosen,
                self._findings_of(self._open_row),
                self._watch.untouched(),
            )
            self.show()

    def _show_rows(self) -> None:
        scenario = self._ui.session.scenario
        rows = []
        for row in self._rows:
            is_open = row.name == self._open_row
            listed = self._listed(scenario, row.findings) if is_open else None
            rows.append(_line(scenario, row, listed))
        state = ScorecardState(
            is_open=True,
            draws=self._draws,
            rows=tuple(rows),
            is_searching=self._cures is None,
            cures=tuple(cure.label for cure in self._cures or ()),
        )
        self._overlay.show(state)

    def _listed(
        self, scenario: Scenario, findings: tuple[Finding, ...]
    ) -> tuple[ScoreFinding, ...]:
        listed = findings[:MAX_LISTED]
        if self._chosen in findings and self._chosen not in listed:
            listed = (*listed[:-1], self._chosen)
        return tuple(
            ScoreFinding(
                id=json.dumps(one.key),
                agent=" and ".join(one.agent_ids),
                text=one.headline.removeprefix(" and ".join(one.agent_ids)).strip(),
                time=_time_of(scenario, one),
                is_chosen=one == self._chosen,
            )
            for one in listed
        )

    def _mark_chosen(self, step: int) -> None:
        drawn = self._drawn_findings()
        for row in self._rows:
            for one in row.findings:
                if one in drawn and one.shown_step == step:
                    self._choose(row.name, one)
                    return

    def _heard(self, event: Mapping[str, Any]) -> None:
        kind, name = event.get("kind"), event.get("name")
        if not self.is_open:
            return
        covered = event.get("covered")
        if isinstance(covered, int | float) and 0 <= covered <= 1:
            self._covered_share = float(covered)
        if kind == "close":
            self.set_open(False)
        elif kind == "draw":
            self._draws = bool(event.get("value"))
            self.show()
            self._actions.redraw()
        elif kind == "row" and name == self._open_row:
            self._open_row, self._chosen = "", None
            self._cures = ()
            self.show()
            self._actions.redraw()
        elif kind == "row":
            findings = self._findings_of(str(name))
            if findings:
                self._choose(str(name), findings[0])
        elif kind == "finding":
            for one in self._findings_of(self._open_row):
                if json.dumps(one.key) == event.get("id"):
                    self._choose(self._open_row, one)
                    return
        elif kind == "cure":
            for cure in self._cures or ():
                if cure.label == name:
                    self._actions.cure(cure)
                    return


def _time_of(scenario: Scenario, finding: Finding) -> str:
    later = finding.shown_step - scenario.current_step
    return f"{later * scenario.time_axis.step_s:.1f} s"


def _line(
    scenario: Scenario, row: ScoreRow, listed: tuple[ScoreFinding, ...] | None
) -> ScoreLine:
    """A row of the page; ``listed`` are its findings while it is open."""
    is_share = row.unit == "share"
    scale, unit = (100.0, "%") if is_share else (1.0, row.unit)
    usual = row.usual
    low, high = (f"{scale * value:.3g}" for value in (usual.low, usual.high))
    value = "\u2013" if math.isnan(row.value) else f"{scale * row.value:.3g} {unit}"
    worst = next(iter(row.findings), None)
    where = "" if worst is None else f"{worst.headline}, {_time_of(scenario, worst)}"
    mark = "" if worst is None else _MARKS.get(worst.severity, "")
    return ScoreLine(
        name=row.name,
        title=row.title,
        meaning=row.meaning,
        tone=_TONE[row.level],
        level=row.level,
        value=value,
        usual=f"{low} \u2013 {high}",
        where=where,
        count=len(row.findings),
        mark=mark,
        findings=listed,
        more=max(len(row.findings) - MAX_LISTED, 0),
    )


def _charts(scenario: Scenario, ids: tuple[str, ...]) -> ChartsState:
    profiles = [agent_profile(scenario, one) for one in ids]
    lines = {
        "Speed, m/s": [one.speed_mps for one in profiles],
        "Acceleration, m/s\u00b2": [one.acceleration_mps2 for one in profiles],
        "Gap to the nearest, m": [one.gap_m for one in profiles],
    }
    return ChartsState(
        ids=tuple(one.agent_id for one in profiles),
        time=tuple(profiles[0].time_s.round(2).tolist()) if profiles else (),
        charts=tuple(
            Chart(title=title, lines=tuple(map(_numbers, values)))
            for title, values in lines.items()
        ),
    )


def _numbers(values: Float[np.ndarray, "T"]) -> tuple[float | None, ...]:
    return tuple(
        round(value, 2) if math.isfinite(value) else None for value in values.tolist()
    )
