"""The status chip with problems and progress, and the list that it opens."""

import json
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Final, Literal

from pd_editor.analysis.findings.finding import Finding, FindingKind, Source
from pd_editor.base.plain_text import number_of
from pd_editor.editor.commands import ContinueScene
from pd_editor.editor.cures import Cure, cures
from pd_editor.viewer.files.export_panel import ExportPanel
from pd_editor.viewer.overlay.messages import (
    ActiveProblem,
    ProblemGroup,
    ProblemRow,
    StatusEvent,
    StatusState,
)
from pd_editor.viewer.scene.framing import FreePart
from pd_editor.viewer.scene.timeline import Mark, Timeline, marks_of
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.tab.ui_context import UiContext

MAX_ROWS: Final = 200
Group = Literal["new", "notices", "ignored", "recorded"]
_SOURCES: Final[dict[Source, str]] = {
    "recorded": "This is in the recording itself.",
    "edited": "An edit caused this.",
    "model": "The model's trajectories caused this.",
    "guidance": "Guidance caused this.",
}
_ICON: Final[dict[FindingKind, str]] = {
    "collision": "collision",
    "later-collision": "collision",
    "off-road": "road",
    "later-off-road": "road",
    "friction": "speed",
    "sharp-road": "bend",
    "folded-road": "bend",
    "impossible-motion": "speed",
    "against-traffic": "against",
    "guidance-not-run": "goal",
    "guidance-not-met": "goal",
    "near-pass": "collision",
    "short-time": "collision",
    "harsh-motion": "speed",
    "harsh-past": "speed",
    "impossible-past": "speed",
    "beyond-map": "beyond",
    "no-past": "past",
}


class StatusChip:
    """The element ``status``; a row of its list selects, frames and goes to the time."""

    def __init__(
        self,
        ui: UiContext,
        timeline: Timeline,
        viewpoint: Viewpoint,
        export: ExportPanel,
    ) -> None:
        """Show the chip."""
        self._ui = ui
        self._model = ui.model
        self._overlay = ui.overlay
        self._timeline = timeline
        self._viewpoint = viewpoint
        self._export = export
        self._watch = ui.model.findings
        self._active: tuple[Group, Finding] | None = None
        self._cures: tuple[Cure, ...] | None = ()
        """What helps against the chosen problem; None until it is known."""
        self._free_share = 1.0
        self._is_open = False
        self._num_closed = 0
        self._overlay.on("status", self._heard)
        chosen = timeline.mark_chosen
        chosen["problem"].subscribe(partial(self._mark_chosen, "new"))
        chosen["notice"].subscribe(partial(self._mark_chosen, "notices"))
        self._model.shown.subscribe(self.show)
        self._model.checked.subscribe(self._after_check)
        self._model.pair_opened.subscribe(self.close_list)

    def show(self) -> None:
        """Show what is known now."""
        groups = self._groups()
        self._follow_active(groups)
        self._timeline.set_marks("problem", _marks(groups["new"]))
        # A roll-out is long: where somebody brakes hard is to be found fast.
        commands = self._ui.session.commands_in_force
        is_rolled = any(isinstance(one, ContinueScene) for one in commands)
        harsh = [one for one in groups["notices"] if one.kind == "harsh-motion"]
        self._timeline.set_marks("notice", _marks(harsh if is_rolled else ()))
        count = len(groups["new"])
        text, tone = "No new problems", "good"
        if count:
            text, tone = f"{count} problem{'s' if count > 1 else ''}", "warn"
        unrun = sum(one.kind == "guidance-not-run" for one in groups["new"])
        if unrun:
            which = "" if unrun == count else f"{unrun} "
            tone = "busy" if unrun == count else tone
            text = f"{text}, {which}guidance not run"
        study = self._ui.workspace.study
        if study.is_running:
            text, tone = f"{text} \u00b7 study at {study.fraction:.0%}", "busy"
        problem = self._ui.session.journal_problem
        state = StatusState(
            text=text,
            tone=tone,
            unsaved="" if problem is None else _unsaved(problem),
            groups=tuple(
                ProblemGroup(
                    name=name,
                    title=_title(name, problems),
                    rows=tuple(map(self._row, problems[:MAX_ROWS])),
                    more=max(len(problems) - MAX_ROWS, 0),
                )
                for name, problems in groups.items()
            ),
            active=self._active_state(),
            num_closed=self._num_closed,
        )
        self._overlay.show(state)

    def close_list(self) -> bool:
        """Close the list of problems; returns whether it was open."""
        if not self._is_open:
            return False
        self._is_open = False
        self._num_closed += 1
        self.show()
        return True

    def _after_check(self) -> None:
        """Update the cures of the chosen problem, and show all."""
        self._follow_active(self._groups())
        self._find_cures()
        self.show()

    def choose(self, group: Group, problem: Finding) -> None:
        """Select the agents of a problem, show them, and go to its time.

        What helps is found out afterwards, so that keys walk fast through the rows.
        """
        self._active, self._cures = (group, problem), None
        self._timeline.seek(float(_step_to_show(problem, self._ui)))
        there = self._ui.session.scenario.agents.row_of
        self._ui.session.select(n for n in problem.agent_ids if n in there)
        free = FreePart.left_of(self._free_share)
        self._viewpoint.frame_place(problem.place_m, free)
        self.show()
        self._ui.post(self._offer_cures, "cures")

    def _offer_cures(self) -> None:
        self._find_cures()
        self.show()

    def _groups(self) -> dict[Group, tuple[Finding, ...]]:
        watch = self._watch
        return {
            "new": watch.new,
            "notices": watch.notices,
            "ignored": watch.ignored,
            "recorded": watch.recorded,
        }

    def _follow_active(self, groups: Mapping[Group, tuple[Finding, ...]]) -> None:
        """The chosen problem as it is after an edit; none if it is gone."""
        if self._active is None:
            return
        key = self._active[1].key
        for name, problems in groups.items():
            for problem in problems:
                if problem.key == key:
                    self._active = name, problem
                    return
        self._active, self._cures = None, ()

    def _find_cures(self) -> None:
        self._cures = ()
        if self._active is not None and self._active[0] in ("new", "notices"):
            self._cures = cures(
                self._ui.session.scenario,
                self._active[1],
                self._watch.new + self._watch.notices,
                self._watch.untouched(),
            )

    def _active_state(self) -> ActiveProblem | None:
        if self._active is None:
            return None
        group, problem = self._active
        # All buttons come at once, so that none moves under the pointer.
        ignore = {"ignored": "No longer ignore", "recorded": ""}.get(group, "Ignore")
        return ActiveProblem(
            id=_id(problem),
            message=problem.message,
            cures=tuple(cure.label for cure in self._cures or ()),
            ignore="" if self._cures is None else ignore,
            note=_SOURCES[problem.source],
        )

    def _row(self, problem: Finding) -> ProblemRow:
        scenario = self._ui.session.scenario
        later = problem.shown_step - scenario.current_step
        time = f"{later * scenario.time_axis.step_s:.1f} s"
        return ProblemRow(
            id=_id(problem),
            icon=_ICON[problem.kind],
            severity=problem.severity,
            text=problem.headline,
            hint=problem.message,
            time=time if _has_time(problem) else "",
        )

    def _mark_chosen(self, group: Group, step: int) -> None:
        for problem in self._groups()[group]:
            if _has_time(problem) and problem.shown_step == step:
                self.choose(group, problem)
                return

    def _heard(self, event: StatusEvent) -> None:
        kind, value = event.kind, event.value
        if kind in ("list", "choose"):
            self._free_share = event.free if 0 <= event.free <= 1 else 1.0
        if kind == "list":
            self._is_open = event.is_open
        if kind == "choose":
            for name, problems in self._groups().items():
                for problem in problems:
                    if _id(problem) == value:
                        self.choose(name, problem)
                        return
        elif kind == "cure":
            for cure in self._cures or ():
                if cure.label == value:
                    apply_cure(self._ui, cure)
                    return
        elif kind == "ignore" and self._active is not None:
            group, problem = self._active
            if group != "recorded":
                self._watch.ignore(problem, group != "ignored")
                self._model.checked.emit()
        elif kind == "download":
            self._export.download()


def apply_cure(ui: UiContext, cure: Cure) -> None:
    """Apply a cure, or regenerate what it would regenerate."""
    if cure.command is not None:
        ui.apply(cure.command)
    else:
        ui.model.run_requested.emit(cure.regenerated_ids, True)


def _step_to_show(problem: Finding, ui: UiContext) -> int:
    """Step at which a problem is shown; the current step for problems of the road."""
    return (
        problem.shown_step if _has_time(problem) else ui.session.scenario.current_step
    )


def _marks(findings: Iterable[Finding]) -> tuple[Mark, ...]:
    """Marks of findings on the timeline."""
    return marks_of((one.shown_step, one.message) for one in findings if _has_time(one))


def _has_time(finding: Finding) -> bool:
    """Whether it is of agents at certain steps, not of the road or of guidance."""
    return bool(finding.agent_ids and finding.spans)


def _unsaved(problem: str) -> str:
    reason = problem.removeprefix("Edits are not kept on disk: ")
    return f"Edits are not saved: {reason}"


def _id(problem: Finding) -> str:
    return json.dumps(problem.key)


def _title(group: Group, findings: tuple[Finding, ...]) -> str:
    count = len(findings)
    others = sum(not one.is_problem for one in findings)
    notices = number_of(others, "notice")
    if group == "recorded":
        if count == others:
            return f"{notices if count else 'Nothing'} in the recording"
        return f"{count - others} in the recording{f', {notices}' * (others > 0)}"
    if group == "ignored":
        return f"{count} ignored"
    if group == "notices":
        return notices
    return "No new problems" if not count else f"{count} new"
