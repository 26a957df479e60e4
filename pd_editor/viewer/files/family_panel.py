"""The family panel: the edits at hand with other numbers or on other scenes, into the library."""

import html
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import viser

from pd_editor.base.errors import InputError, PdEditorError
from pd_editor.base.installed_files import demo_names
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.family import (
    MOST_MEMBERS,
    Member,
    MemberPlan,
    adds_traffic,
    family_name,
    left_out_in_words,
    members,
    planned,
)
from pd_editor.editor.library.library import card_of
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.variant import free_name
from pd_editor.editor.varied_numbers import (
    VariedNumber,
    numbers_in_words,
    range_example,
    varied_numbers,
)
from pd_editor.generation.generators import GeneratorCatalogue
from pd_editor.scene.generation import ScenarioGenerator
from pd_editor.viewer.tab.panel_style import FixedText
from pd_editor.viewer.tab.ui_context import UiContext, set_property

_WIDTH, _LINE, _EDGE = 300, 34, 8
_COLOR: Final = {
    "without problems": "#2e8b57",
    "with problems": "#e08a00",
    "dropped": "none",
    "failed": "#c62828",
}


@dataclass(frozen=True, kw_only=True)
class MadeVariant:
    """A variant that was made, or could not be."""

    values: Mapping[VariedNumber, float]
    name: str = ""
    """In the library; empty: it could not be made."""
    has_problems: bool = False

    def fate(self, kept: frozenset[str]) -> str:
        """What has become of it, given what the library still has."""
        if not self.name:
            return "failed"
        if self.name not in kept:
            return "dropped"
        return "with problems" if self.has_problems else "without problems"


def coverage(made: Sequence[MadeVariant], kept: frozenset[str]) -> str:
    """A picture of the values that were made, as HTML; empty without any."""
    if not made:
        return ""
    fates = [one.fate(kept) for one in made]
    lines = [
        _line(number, [(one, fate) for one, fate in zip(made, fates, strict=True)], row)
        for row, number in enumerate(made[0].values)
    ]
    legend = " &nbsp; ".join(
        f'<svg width="10" height="10">{_dot(5, 5, fate)}</svg> {fates.count(fate)} {fate}'
        for fate in _COLOR
        if fate in fates
    )
    drawn = (
        f'<svg viewBox="0 0 {_WIDTH} {_LINE * len(lines)}" width="100%" fill="currentColor"'
        f' font-size="12">{"".join(lines)}</svg>'
    )
    return (
        '<div style="margin:0 0.75em 0.5em;font-size:12.5px;line-height:20px">'
        f"{drawn if lines else ''}<div>{legend}</div></div>"
    )


def _line(
    number: VariedNumber, made: Sequence[tuple[MadeVariant, str]], row: int
) -> str:
    """A range with its name and ends, and the values in it."""
    y = row * _LINE + 24
    ends = f"{number.low:g} to {number.high:g}"
    dots = []
    for one, fate in made:
        value = one.values[number]
        share = (value - number.low) / (number.high - number.low or 1)
        told = html.escape(f"{one.name or 'failed'}: {number.name} {value:g}, {fate}")
        x = _EDGE + share * (_WIDTH - 2 * _EDGE)
        dots.append(f"<g>{_dot(x, y, fate)}<title>{told}</title></g>")
    return (
        f'<text x="{_EDGE}" y="{y - 11}">{html.escape(number.name)} {ends}</text>'
        f'<path d="M{_EDGE} {y}H{_WIDTH - _EDGE}" stroke="currentColor" opacity="0.4"/>'
        + "".join(dots)
    )


def _dot(x: float, y: float, fate: str) -> str:
    color = _COLOR[fate]
    edge = "currentColor" if color == "none" else color
    fill = color if color != "none" else "var(--mantine-color-body)"
    return f'<circle cx="{x:.1f}" cy="{y}" r="4" fill="{fill}" stroke="{edge}"/>'


_THIS, _DEMOS, _LISTED, _TICKED = (
    "This scene",
    "All demos",
    "Scenes found in the dataset",
    "Scenes ticked in the library",
)


class FamilyPanel:
    """Ranges, a number of variants, scenes, and a run that saves them to the library."""

    def __init__(self, ui: UiContext, generators: GeneratorCatalogue) -> None:
        """Build it into the current tab."""
        self._ui, self._generators = ui, generators
        self._job: _FamilyJob | None = None
        self._shown: Recipe | None = None
        self._example = ""
        gui = ui.client.gui
        with gui.add_folder("Family"):
            self._known = FixedText(gui, 2)
            self._vary = gui.add_text(
                "Vary",
                "",
                hint="Ranges of these numbers",
            )
            self._scenes = gui.add_dropdown(
                "Make in",
                (_THIS, _DEMOS, _LISTED, _TICKED),
                hint="Elsewhere, edits of single agents other than the ego and the focal "
                "agent are left out",
            )
            self._num = gui.add_number("Variants", 10, min=1, max=MOST_MEMBERS, step=1)
            self._make = gui.add_button(
                "Make family",
                icon=viser.Icon.COPY,
                hint="The edits with other numbers or on other scenes, traffic generated anew, each saved to "
                "the library (tab Scene) with its problems",
            )
            self._cancel = gui.add_button("Cancel family", color="gray", visible=False)
            self._told = FixedText(gui, 2, grows=True)
            self._coverage = gui.add_html("")
        self._made: tuple[MadeVariant, ...] = ()
        ui.on_click(self._make, self._start)
        ui.on_click(self._cancel, self._stop)
        ui.model.shown.subscribe(self.show)
        ui.model.library_changed.subscribe(self._cover)

    def show(self) -> None:
        """Tell the numbers of the edits at hand."""
        recipe = self._ui.session.recipe()
        commands = list(map(id, recipe.commands))
        if self._shown is None or commands != list(map(id, self._shown.commands)):
            self._shown = recipe
            adds = adds_traffic(recipe, self._ui.session.scenario)
            self._example = range_example(recipe, adds=adds)
            now = numbers_in_words(recipe, adds=adds)
            self._known.show("", f"Such as {self._example}. Now: {now}")

    def close(self) -> None:
        """End a run; what is saved stays."""
        if self._job is not None:
            self._job.cancel()

    def tell(self, words: str, made: tuple[MadeVariant, ...]) -> None:
        """Show how far a run is, unless it was cancelled."""
        if self._job is not None:
            self._told.show("", words)
            self._made = made
            self._cover()

    def end(self, words: str) -> None:
        """Show how a run ended."""
        self.tell(words, self._made)
        self._job = None
        self._set_running(False)
        self._ui.model.library_changed.emit()

    def _start(self) -> None:
        if self._job is not None:
            raise InputError("A family is being made; cancel it first.")
        self._ui.commit_gesture()
        session = self._ui.session
        recipe = session.recipe()
        texts = [one for one in re.split(r"[,\s]+", str(self._vary.value)) if one]
        scenes = self._other_scenes()
        if not texts and not scenes:
            raise InputError(f"Vary: enter a range first, such as {self._example}.")
        self._told.show("", "")
        adds = adds_traffic(recipe, session.scenario)
        numbers = varied_numbers(recipe, texts, adds=adds) if texts else ()
        count = int(self._num.value) if texts else 1
        values = list(members(numbers, count, int(time.time())))
        is_taken = self._ui.workspace.library.has
        plans = planned(family_name(recipe, numbers), values, scenes, is_taken)

        def make(plan: MemberPlan) -> Member:
            return plan.made(recipe, session.base, self._generator, adds=adds)

        self._job = _FamilyJob(self._ui, self, plans, make)
        self._set_running(True)
        self.tell(f"0 of {len(plans)} variants", ())
        self._job.start()

    def _other_scenes(self) -> Sequence[str]:
        """The scenes that are chosen; none stands for the one at hand.

        Raises:
            InputError: there is none of the chosen kind.
        """
        chosen, workspace = self._scenes.value, self._ui.workspace
        found: Sequence[str] = ()
        if chosen == _DEMOS:
            found = demo_names()
        elif chosen == _LISTED and (search := workspace.search) is not None:
            if not search.is_complete:
                raise InputError(
                    "Make in: the dataset is still being read; wait for it."
                )
            found = [str(one.folder) for one in search.cards]
        elif chosen == _TICKED:
            root = workspace.library.root
            found = [str(root / name) for name in sorted(workspace.ticked)]
        if chosen != _THIS and not found:
            raise InputError(f"There are no {str(chosen).lower()}.")
        if len(found) > MOST_MEMBERS:
            raise InputError(
                f"Make in: {len(found)} scenes; expected at most {MOST_MEMBERS}."
            )
        return found

    def _set_running(self, is_running: bool) -> None:
        set_property(self._make, "visible", not is_running)
        set_property(self._cancel, "visible", is_running)

    def _stop(self) -> None:
        self.close()
        self.end("Cancelled; what is saved stays.")

    def _cover(self) -> None:
        """Show which values are in the library."""
        library = self._ui.workspace.library
        kept = frozenset(one.name for one in self._made if library.has(one.name))
        set_property(self._coverage, "content", coverage(self._made, kept))

    def _generator(self, name: str) -> ScenarioGenerator:
        offers = self._generators.offers
        offer = offers.get(name or next(iter(offers)))
        if offer is None:
            raise InputError(f"{name}: the editor has no generator of this name.")
        return offer.make()


class _FamilyJob(BackgroundJob[int]):
    """Makes variants one after another; all that it tells goes to the tab's own thread."""

    def __init__(
        self,
        ui: UiContext,
        panel: FamilyPanel,
        plans: Sequence[MemberPlan],
        make: Callable[[MemberPlan], Member],
    ) -> None:
        super().__init__(
            "family",
            lambda _job: self._all_made(),
            self._done,
            lambda error: ui.post(partial(panel.end, str(error))),
            subject="The family",
        )
        self._ui, self._panel = ui, panel
        self._plans, self._make = plans, make
        self._library = ui.workspace.library
        self._failures: list[str] = []
        self._made: list[MadeVariant] = []
        self._left_out: tuple[str, ...] = ()

    def _all_made(self) -> int:
        made: list[tuple[str, ...]] = []
        for number, plan in enumerate(self._plans, start=1):
            self.check_cancelled()
            name = free_name(plan.name, self._library.has)
            try:
                one = self._make(replace(plan, name=name))
                card = card_of(one.scenario, one.base, one.recipe)
                self.check_cancelled()
                self._library.add(card, one.files, thumbnail(one.scenario))
                has_problems = bool(card.row.num_problems)
                self._made.append(
                    MadeVariant(
                        values=plan.values, name=name, has_problems=has_problems
                    )
                )
                made.append(one.left_out)
            except PdEditorError as error:
                self._made.append(MadeVariant(values=plan.values))
                self._failures.append(f"{plan.in_words}: {error}")
            words = f"{number} of {len(self._plans)} variants"
            self._ui.post(partial(self._panel.tell, words, tuple(self._made)), "family")
        self._left_out = left_out_in_words(made)
        return len(self._plans) - len(self._failures)

    def _done(self, count: int) -> None:
        words = f"{count} of {len(self._plans)} variants saved to the library (N), "
        num_clean = sum(bool(one.name) and not one.has_problems for one in self._made)
        words += f"{num_clean} without problems."
        if self._failures:
            words += f" {len(self._failures)} failed: {self._failures[0]}"
        words = " ".join([words, *self._left_out])
        self._ui.post(partial(self._panel.end, words))
