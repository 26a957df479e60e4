"""The family panel: the edits at hand many times, with other numbers, into the library."""

import re
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import viser

from pd_editor.base.errors import ExportError, InputError, PdEditorError
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.family import (
    MOST_MEMBERS,
    Member,
    adds_traffic,
    member,
    members,
    values_of,
)
from pd_editor.editor.library.library import card_of
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.variant import free_name
from pd_editor.editor.varied_numbers import (
    VariedNumber,
    numbers_in_words,
    values_in_words,
    varied_numbers,
)
from pd_editor.generation.generators import GeneratorCatalogue
from pd_editor.scene.generation import ScenarioGenerator
from pd_editor.viewer.files.family_coverage import MadeVariant, coverage
from pd_editor.viewer.tab.panel_style import FixedText
from pd_editor.viewer.tab.ui_context import UiContext, set_property


class FamilyPanel:
    """Ranges, a number of variants, and a run that saves them to the library."""

    def __init__(self, ui: UiContext, generators: GeneratorCatalogue) -> None:
        """Build it into the current tab."""
        self._ui, self._generators = ui, generators
        self._job: _FamilyJob | None = None
        self._shown: Recipe | None = None
        gui = ui.client.gui
        with gui.add_folder("Family"):
            self._known = FixedText(gui, 3)
            self._vary = gui.add_text(
                "Vary",
                "",
                hint="Ranges of these numbers, such as power=4..8, seed=1..99",
            )
            self._num = gui.add_number("Variants", 10, min=1, max=MOST_MEMBERS, step=1)
            self._make = gui.add_button(
                "Make family",
                icon=viser.Icon.COPY,
                hint="The edits with other numbers, traffic generated anew, each saved to "
                "the library (tab Scene) with its problems",
            )
            self._cancel = gui.add_button("Cancel family", color="gray", disabled=True)
            self._told = FixedText(gui, 2)
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
            self._known.show("", f"Now: {numbers_in_words(recipe, adds=adds)}")

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
        set_property(self._cancel, "disabled", True)
        self._ui.model.library_changed.emit()

    def _start(self) -> None:
        if self._job is not None:
            raise InputError("A family is being made; cancel it first.")
        self._ui.commit_gesture()
        session = self._ui.session
        recipe = session.recipe()
        texts = [one for one in re.split(r"[,\s]+", str(self._vary.value)) if one]
        if not texts:
            raise InputError("Vary: enter a range first, such as power=4..8.")
        self._told.show("", "")
        adds = adds_traffic(recipe, session.scenario)
        numbers = varied_numbers(recipe, texts, adds=adds)
        values = list(members(numbers, int(self._num.value), int(time.time())))
        make = partial(member, recipe, session.base, make=self._generator, adds=adds)
        self._job = _FamilyJob(self._ui, self, recipe.result_id, values, make)
        set_property(self._cancel, "disabled", False)
        self.tell(f"0 of {len(values)} variants", ())
        self._job.start()

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
        name: str,
        values: Sequence[Mapping[VariedNumber, float]],
        make: Callable[..., Member],
    ) -> None:
        super().__init__(
            "family", self._done, lambda error: ui.post(partial(panel.end, str(error)))
        )
        self._ui, self._panel = ui, panel
        self._name, self._values, self._make = name, values, make
        self._library = ui.workspace.library
        self._failures: list[str] = []
        self._made: list[MadeVariant] = []

    def _result(self) -> int:
        for number, own in enumerate(self._values, start=1):
            self.check_cancelled()
            name = free_name(f"{self._name}-{number}", self._library.has)
            try:
                one = self._make(values=own, name=name)
                card = card_of(one.scenario, one.base, one.recipe)
                self.check_cancelled()
                self._library.add(card, one.files, thumbnail(one.scenario))
                has_problems = bool(card.row.num_problems)
                self._made.append(
                    MadeVariant(values=own, name=name, has_problems=has_problems)
                )
            except PdEditorError as error:
                self._made.append(MadeVariant(values=own))
                self._failures.append(f"{values_in_words(values_of(own))}: {error}")
            words = f"{number} of {len(self._values)} variants"
            self._ui.post(partial(self._panel.tell, words, tuple(self._made)), "family")
        return len(self._values) - len(self._failures)

    def _done(self, count: int) -> None:
        words = f"{count} of {len(self._values)} variants saved to the library, "
        num_clean = sum(bool(one.name) and not one.has_problems for one in self._made)
        words += f"{num_clean} without problems."
        if self._failures:
            words += f" {len(self._failures)} failed: {self._failures[0]}"
        self._ui.post(partial(self._panel.end, words))

    def _fault(self) -> PdEditorError:
        return ExportError("The family failed by a fault of its own; see the log.")
