"""The strip of branches over the picture: preview, switch, compare and delete them."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

from pd_editor.analysis.findings.check import scene_findings
from pd_editor.analysis.findings.finding import Finding
from pd_editor.base.plain_text import number_of
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.commands import ReplaceTraffic
from pd_editor.editor.commands.command import parts_of
from pd_editor.editor.commands.roll_out import begun_like
from pd_editor.editor.edit_findings import edit_findings
from pd_editor.editor.library.thumbnail import PictureFrame, thumbnail
from pd_editor.editor.session import Branch
from pd_editor.editor.variant import name_from_text
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.controls.history_panel import OPENED
from pd_editor.viewer.controls.page_aids import STUDY
from pd_editor.viewer.generation.sample_strip import (
    COVERED_PX,
    SampleStrip,
    as_address,
    finding_lines,
)
from pd_editor.viewer.overlay.messages import (
    BranchesState,
    BranchPicturesState,
    CardLine,
    StripCard,
    StripEvent,
)
from pd_editor.viewer.scene.original_view import changed_rows
from pd_editor.viewer.scene.scene_pair import ScenePair
from pd_editor.viewer.tab.ui_context import UiContext

_recorded: Final = lru_cache(maxsize=1)(scene_findings)
"""Findings of the opened scenario, which each new branch is compared with."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Drawn:
    """What is known of a branch: its picture, and the findings that its edits cause."""

    scenario: Scenario
    frame: PictureFrame
    picture: str
    findings: tuple[Finding, ...]


class BranchStrip:
    """The element ``branches``: a card for each branch of the history.

    Pointing at a card shows its scenario in the scene, without an edit; a click switches.
    """

    def __init__(self, ui: UiContext, samples: SampleStrip) -> None:
        """Show nothing yet; one strip makes room for the other."""
        self._ui, self._model, self._samples = ui, ui.model, samples
        self.is_open = False
        self._pair = ScenePair(ui, noun="branch", use=self._switch)
        self._base = ui.session.base
        self._drawn: dict[int, _Drawn] = {}
        self._asked: tuple[Scenario, ...] = ()
        """Scenarios of the branches whose pictures were asked for."""
        ui.overlay.on("branches", self._heard)
        ui.model.shown.subscribe(self.show)
        ui.model.library_changed.subscribe(self.show)
        samples.opened.subscribe(self.close)
        self.show()

    def toggle(self) -> None:
        """Open the strip with the focus on its cards, or close it."""
        if self.close():
            return
        self._samples.close()
        self.is_open = True
        self.show(takes_focus=True)

    def close(self) -> bool:
        """Close the comparison, or else the strip; returns whether one was open."""
        if self._pair.close():
            return True
        was_open, self.is_open = self.is_open, False
        if was_open:
            self._model.preview(None)
            self.show()
        return was_open

    def show(self, *, takes_focus: bool = False) -> None:
        """Show the branches of the session as they are now."""
        session = self._ui.session
        if self._base is not session.base:
            self._base, self._drawn, self._asked = session.base, {}, ()
            self.close()
        self._model.covered["branches"] = COVERED_PX if self.is_open else 0
        if not self.is_open:
            self._pair.close()
            self._ui.overlay.show(BranchesState())
            return
        branches = self._branches()
        self._draw(branches)
        there = {one.number: one for one in branches}
        drawn = self._drawn
        pictures = {one: as_address(drawn[one].picture) for one in sorted(drawn)}
        self._ui.overlay.show(BranchPicturesState(pictures=pictures))
        count = len(session.branch_tips)
        more = count - len(branches)
        self._ui.overlay.show(
            BranchesState(
                is_open=True,
                takes_focus=takes_focus,
                title=f"{count} branch{'es' * (count != 1)}"
                + f", {more} older ones not shown" * (more > 0),
                cards=tuple(self._card(one, there) for one in branches),
                num_dropped=len(session.dropped),
            )
        )

    def _branches(self) -> Sequence[Branch]:
        """The opened scenario and the newest others, each after the one that it leaves."""
        opened, *others = self._ui.session.branches
        there = {one.number: one for one in (opened, *others[-40:])}
        following = defaultdict[int | None, list[Branch]](list)
        for one in there.values():
            left = _left_by(one, there)
            following[left].append(one)

        def after(left: int | None) -> Iterator[Branch]:
            for one in following[left]:
                yield one
                yield from after(one.number)

        return list(after(None))

    def _card(self, branch: Branch, there: Mapping[int, Branch]) -> StripCard:
        state, number = self._ui.session.state, branch.number
        library = self._ui.workspace.library
        undone = state.num_entries - state.position
        is_adopted = self._is_in_force(number)
        edits = number_of(len(branch.entries), "edit")
        generated = parts_of((one.command for one in branch.entries), ReplaceTraffic)
        edits += "".join(f", seed {one.seed}" for one in generated[-1:])
        left, shared = _left_by(branch, there), branch.fork[1]
        hints = [entry.label for entry in branch.entries]
        if left is not None and shared:
            hints.insert(0, f"Leaves {_name(there[left])} after edit {shared}:")
        drawn = self._drawn.get(number)
        told: tuple[CardLine, ...] = (CardLine(text="\N{HORIZONTAL ELLIPSIS}"),) * 2
        if drawn is not None:
            ignored = branch.variant.ignored
            told = finding_lines(
                [one for one in drawn.findings if one.ignored_key not in ignored]
            )
        return StripCard(
            index=number,
            name=_name(branch),
            mark=""
            if not is_adopted
            else f"{undone} undone"
            if undone and number
            else "in use",
            is_adopted=is_adopted,
            lines=(*told, CardLine(text=edits)),
            hint="\n".join(hints),
            can_drop=number not in (0, state.tip),
            is_kept=any(
                kept is branch.scenario and library.marked(mark)
                for kept, mark in self._ui.session.exports
            ),
            fork_of=left,
        )

    def _is_in_force(self, number: int) -> bool:
        state = self._ui.session.state
        return number == (state.tip if state.position else 0)

    def _draw(self, branches: Sequence[Branch]) -> None:
        """Make pictures and findings of new branches in the background."""
        asked = tuple(one.scenario for one in branches)
        if asked == self._asked:
            return
        self._asked = asked
        base, known, post = self._base, dict(self._drawn), self._ui.post
        BackgroundJob(
            "branch-cards",
            lambda _job: _drawn(branches, base, known),
            lambda drawn: post(lambda: self._computed(asked, drawn)),
            lambda error: post(lambda: self._ui.report(error)),
        ).start()

    def _computed(self, asked: tuple[Scenario, ...], drawn: dict[int, _Drawn]) -> None:
        if asked == self._asked:
            self._drawn = drawn
            self.show()

    def _heard(self, event: StripEvent) -> None:
        kind, value = event.kind, event.value
        session = self._ui.session
        there = {one.number: one for one in self._branches()} if self.is_open else {}
        if kind == "close":
            self.close()
        elif kind == "leave":
            self._model.preview(None)
        elif kind == "restore":
            session.drop_branches(())
            self.show()
        elif not isinstance(value, int) or value not in there:
            return
        elif kind == "point":
            is_now = there[value].scenario is session.scenario
            self._model.preview(None if is_now else there[value].scenario)
        elif kind == "adopt":
            self._switch(value)
        elif kind == "keep":
            self._switch(value)
            self._model.save_requested.emit()
        elif kind == "rename" and value:
            self._switch(value)
            named = replace(session.variant, name=name_from_text(event.text))
            session.describe(named)
            self._model.shown.emit()
        elif kind == "carry":
            self._switch(value)
            self._model.tab_asked.emit(STUDY)
        elif kind == "pair" and len(there) > 1:
            self._compare(value)
        elif kind == "drop":
            self._model.preview(None)
            session.drop_branches(session.dropped | {value})
            self.show()

    def _switch(self, number: int) -> None:
        self._model.preview(None)
        self._pair.close()
        self._ui.commit_gesture()
        self._ui.session.go_to(number)

    def compare(self) -> None:
        """Compare the branch that is pointed at, or the newest; close it if it is open."""
        if self._pair.close():
            return
        others = [one for one in self._branches() if not self._is_in_force(one.number)]
        pointed = [one for one in others if one.scenario is self._model.sample]
        if others:
            self._compare((*pointed, others[-1])[0].number)

    def _compare(self, number: int) -> None:
        there = {one.number: one for one in self._branches()}
        adopted = next(filter(self._is_in_force, there), None)
        offered = {one: (_name(there[one]), there[one].scenario) for one in there}
        if adopted is not None:
            offered[adopted] = (offered[adopted][0], self._ui.session.scenario)
        frame = _frame(list(there.values()), self._ui.session.base)
        self._pair.open(number, offered, frame, adopted=adopted)


def _left_by(branch: Branch, there: Mapping[int, Branch]) -> int | None:
    """The branch of these that it leaves; None: it is the opened scenario."""
    left, _ = branch.fork
    return None if not branch.number else left if left in there else 0


def _name(branch: Branch) -> str:
    """What its user called it, or its last own edit: a run only where it has no other."""
    if not branch.entries:
        return OPENED
    own = branch.entries[branch.fork[1] :] or branch.entries
    edits = [one for one in own if not parts_of((one.command,), ReplaceTraffic)]
    return branch.variant.name or (edits or own)[-1].label.split(" (")[0]


def _frame(branches: Sequence[Branch], base: Scenario) -> PictureFrame:
    """A frame with what differs among branches."""
    shown: list[tuple[Scenario, Sequence[str]]] = []
    for branch in branches:
        agents = branch.scenario.agents
        rows = changed_rows(agents, base.agents)
        shown.append((branch.scenario, [agents.ids[row] for row in rows]))
    return PictureFrame.around_agents(shown)


def _drawn(
    branches: Sequence[Branch], base: Scenario, known: Mapping[int, _Drawn]
) -> dict[int, _Drawn]:
    frame, recorded = _frame(branches, base), _recorded(base)
    drawn: dict[int, _Drawn] = {}
    for branch in branches:
        number, scenario = branch.number, branch.scenario
        former = known.get(number)
        if former is not None and former.scenario is scenario:
            picture, findings = former.picture, former.findings
            if former.frame != frame:
                picture = thumbnail(scenario, frame)
        else:
            commands = [one.command for one in branch.entries]
            given = recorded if begun_like(base, commands) is base else None
            findings = edit_findings(scenario, base, commands, given).new
            picture = thumbnail(scenario, frame)
        drawn[number] = _Drawn(
            scenario=scenario, frame=frame, picture=picture, findings=findings
        )
    return drawn
