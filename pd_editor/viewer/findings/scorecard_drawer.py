"""The scorecard, its findings on the road, and charts of the selected agents."""

import json
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.analysis.findings.check import SceneCheck
from pd_editor.analysis.findings.finding import Finding, Severity
from pd_editor.analysis.findings.scorecard import Level, ScoreRow, scorecard
from pd_editor.analysis.metrics.scene_metrics import agent_profile
from pd_editor.editor.cures import Cure, cures
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.palette import Palette
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.findings.status_chip import apply_cure
from pd_editor.viewer.meshes.colors import shown_exactly
from pd_editor.viewer.meshes.flat_mesh import FlatMesh, MeshNode, Primitive, facing_up
from pd_editor.viewer.meshes.ribbons import dotted, path_ribbons
from pd_editor.viewer.overlay.messages import (
    Chart,
    ChartsState,
    ScorecardEvent,
    ScorecardState,
    ScoreFinding,
    ScoreLine,
    Tone,
)
from pd_editor.viewer.scene.framing import FreePart
from pd_editor.viewer.scene.timeline import Timeline, marks_of
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.tab.ui_context import UiContext

HEIGHT_M: Final = 0.058
"""Under the ribbons of the trajectories, which are narrower."""
ABOVE_M: Final = 1e-3
MARGIN_M: Final = 0.8
"""Bands are wider than their agents by this."""
FRAME_GAP_M: Final = 0.35
FRAME_WIDTH_M: Final = 0.35
"""The frame around the pose at the worst step."""


class FindingsView:
    """One node of one browser; faults beyond comfort only are striped."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._palette = palette
        self._node = MeshNode(client, "/findings")
        self._scenario: Scenario | None = None
        self._findings: tuple[Finding, ...] = ()

    def show(self, scenario: Scenario, findings: Sequence[Finding]) -> None:
        """Draw findings of a scenario; none hides the node."""
        wanted = tuple(findings)
        if self._findings == wanted and (not wanted or scenario is self._scenario):
            return
        self._scenario, self._findings = scenario, wanted
        self._send()

    def set_palette(self, palette: Palette) -> None:
        """Redraw in another theme."""
        self._palette = palette
        self._send()

    def _send(self) -> None:
        if self._scenario is not None and self._findings:
            self._node.draw(
                finding_primitives(self._scenario, self._findings, self._palette)
            )
        self._node.set_visible(bool(self._findings))


def finding_primitives(
    scenario: Scenario, findings: Sequence[Finding], palette: Palette
) -> list[Primitive]:
    """Bands along the parts of trajectories, and frames around the worst poses."""
    agents, now = scenario.agents, scenario.current_step
    known = [
        (one, agents.row_of[name])
        for one in findings
        for name in one.agent_ids
        if name in agents.row_of
    ]
    if not known:
        return []
    spans = [(one, row, first, last) for one, row in known for first, last in one.spans]
    rows = np.array([row for _, row, _, _ in spans])
    mild = np.array([not one.is_problem for one, _, _, _ in spans])
    # A step more at both ends: an instant is a short piece of the trajectory as well.
    first, last = np.array([(first - 1, last + 1) for _, _, first, last in spans]).T
    begin = min(now, *(one.first_step for one, _ in known))
    steps = np.arange(begin, agents.num_steps)
    is_in = (steps >= first[:, None]) & (steps <= last[:, None])
    is_in &= agents.is_valid[rows, begin:]
    points = agents.position_m[rows, begin:]
    width = agents.size_m[rows, 1] + MARGIN_M
    striped, is_stripe = dotted(points[mild], is_in[mild])
    color = shown_exactly(palette.warning)
    return [
        _bands(striped, is_stripe, width[mild], HEIGHT_M, color),
        _bands(points[~mild], is_in[~mild], width[~mild], HEIGHT_M + ABOVE_M, color),
        _frames(scenario, known, color),
    ]


def _bands(
    points_m: np.ndarray,
    is_valid: np.ndarray,
    width_m: np.ndarray,
    height_m: float,
    color: tuple[float, float, float],
) -> Primitive:
    shape = is_valid.shape
    band = path_ribbons(
        points_m,
        is_valid,
        color=np.tile(color, (len(points_m), 1)),
        opacity=np.ones(shape),
        width_m=np.broadcast_to(width_m[:, None], shape),
        height_m=np.full(len(points_m), height_m),
    )
    # Without opacities per vertex the band is opaque, and always under the ribbons.
    return Primitive(
        points_m=band.points_m, faces=band.faces, height_m=band.height_m, color=color
    )


def _frames(
    scenario: Scenario,
    findings: Sequence[tuple[Finding, int]],
    color: tuple[float, float, float],
) -> Primitive:
    agents = scenario.agents
    rows = np.array([row for _, row in findings])
    steps = np.array([one.worst_step for one, _ in findings])
    pose = agents.position_m[rows, steps], agents.heading_rad[rows, steps]
    inner = agents.size_m[rows] + 2 * FRAME_GAP_M
    # [F 8 2]: the inner corners, then the outer ones.
    corners = np.concatenate(
        [box_corners(*pose, inner), box_corners(*pose, inner + 2 * FRAME_WIDTH_M)],
        axis=1,
    )
    side = np.arange(4)
    after = (side + 1) % 4
    faces = np.concatenate(
        [
            np.stack([side, side + 4, after], axis=-1),
            np.stack([after, side + 4, after + 4], axis=-1),
        ]
    )
    mesh = facing_up(
        FlatMesh(
            points_m=corners.reshape(-1, 2),
            faces=(8 * np.arange(len(rows))[:, None, None] + faces).reshape(-1, 3),
        )
    )
    return Primitive(
        points_m=mesh.points_m,
        faces=mesh.faces,
        height_m=HEIGHT_M + 2 * ABOVE_M,
        color=color,
    )


_MARKS: Final[dict[Severity, str]] = {"problem": "solid", "notice": "striped"}
MAX_LISTED: Final = 6
"""Number of findings that an open row lists."""
_TONE: Final[dict[Level, Tone]] = {"usual": "good", "unusual": "warn", "extreme": "bad"}


class ScorecardDrawer:
    """The element ``scorecard``; its findings in the scene and on the timeline.

    Metrics are computed while it is open only, after an edit and not during a gesture.
    A row opens the list of its findings, of which one is chosen: camera and time go to
    it, and its cures are offered. While a row is open, its findings alone are drawn.
    """

    def __init__(self, ui: UiContext, timeline: Timeline, viewpoint: Viewpoint) -> None:
        """Start closed."""
        self._ui = ui
        self._model = ui.model
        self._overlay = ui.overlay
        self._timeline = timeline
        self._viewpoint = viewpoint
        self._watch = ui.model.findings
        self._view = FindingsView(ui.client, ui.model.palette)
        self._scored: SceneCheck | None = None
        self._rows: tuple[ScoreRow, ...] = ()
        self._charted: tuple[Scenario, tuple[str, ...]] | None = None
        self._open_row = ""
        self._chosen: Finding | None = None
        self._cures: tuple[Cure, ...] | None = ()
        """What helps against the chosen finding; None until it is known."""
        self._draws = True
        self._covered_share = 0.0
        self.is_open = False
        self._overlay.on("scorecard", self._heard)
        timeline.mark_chosen["finding"].subscribe(self._mark_chosen)
        self._model.drawer_changed.subscribe(self._follow_drawer)
        self._model.sample_pointed.subscribe(self._mark)
        self._model.theme_changed.subscribe(self._follow_theme)
        self._model.shown.subscribe(self.show)

    def _follow_drawer(self) -> None:
        is_open = self._model.drawer == "scorecard"
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
        self._model.marks_changed.emit()

    def _follow_theme(self) -> None:
        self._view.set_palette(self._model.palette)

    def show(self) -> None:
        """Follow scenario and selection."""
        session = self._ui.session
        if not self.is_open:
            return
        if session.state.is_previewing:
            self._view.show(session.scenario, ())
            return
        scenario = session.scenario
        check = self._watch.whole()
        if self._scored is not check:
            self._scored, self._rows = check, scorecard(scenario, check.all)
            self._follow_chosen()
        self._show_rows()
        self._mark()
        # Number of selected agents with lines in the charts.
        charted = (scenario, session.selection[:3])
        if self._charted != charted:
            self._charted = charted
            self._overlay.show(_charts(*charted))

    def _drawn_findings(self) -> tuple[Finding, ...]:
        """Faults of the open row, or of all rows; of a mean the chosen finding."""
        if not self.is_open or not self._draws:
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
        """Draw the findings in the scene, and mark them on the timeline.

        Nothing is drawn while a sample is in the scene.
        """
        self._model.marked_findings = self._drawn_findings()
        found = () if self._model.sample is not None else self._model.marked_findings
        self._view.show(self._ui.session.scenario, found)
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
        self._go_to(finding)
        self.show()
        self._model.marks_changed.emit()
        self._ui.post(self._offer_cures, "finding cures")

    def _go_to(self, finding: Finding) -> None:
        """Select the agents of a finding, and show it at that time beside the drawer."""
        agents = self._ui.session.scenario.agents
        self._timeline.seek(float(finding.shown_step))
        self._ui.session.select(finding.agent_ids)
        rows = agents.rows(finding.agent_ids)
        x, y = agents.position_m[rows, finding.shown_step].mean(axis=0)
        free = FreePart.right_of(self._covered_share)
        self._viewpoint.frame_place((float(x), float(y)), free)

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

    def _heard(self, event: ScorecardEvent) -> None:
        kind, name = event.kind, event.name
        if not self.is_open:
            return
        if 0 <= event.covered <= 1:
            self._covered_share = event.covered
        if kind == "close":
            self._model.open_drawer(None)
        elif kind == "draw":
            self._draws = event.value
            self.show()
            self._model.marks_changed.emit()
        elif kind == "row" and name == self._open_row:
            self._open_row, self._chosen = "", None
            self._cures = ()
            self.show()
            self._model.marks_changed.emit()
        elif kind == "row":
            findings = self._findings_of(name)
            if findings:
                self._choose(name, findings[0])
        elif kind == "finding":
            for one in self._findings_of(self._open_row):
                if json.dumps(one.key) == event.id:
                    self._choose(self._open_row, one)
                    return
        elif kind == "cure":
            for cure in self._cures or ():
                if cure.label == name:
                    apply_cure(self._ui, cure)
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
