"""Scenes that a query has found, as pictures of the moments that it asked for."""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Final

import viser

from pd_editor.analysis.manoeuvres import SceneEvent
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.variant import short_id
from pd_editor.experiments.scene_index.find import FoundScene
from pd_editor.scene.formats.dataset import ScenarioCard
from pd_editor.viewer.scene.timeline import in_seconds
from pd_editor.viewer.tab.panel_style import PictureRows
from pd_editor.viewer.tab.ui_context import UiContext, set_property

PAGE: Final = 8
"""Number of scenes that are shown at a time."""
MAX_HINT: Final = 500
_BEFORE, _AFTER = "Earlier", "Later"


class FoundRows:
    """A page of found scenes; a click chooses one."""

    def __init__(self, ui: UiContext, choose: Callable[[ScenarioCard], None]) -> None:
        """Build it into the current container, hidden while nothing is found."""
        self._ui = ui
        self._choose = choose
        self._cards: Sequence[ScenarioCard] = ()
        self._found: Mapping[Path, FoundScene] = {}
        self._first = 0
        self._open: Path | None = None
        self._drawn: dict[int, tuple[Path, SceneEvent | None]] = {}
        """What the picture of each row shows."""
        gui = ui.client.gui
        self._folder = gui.add_folder("Found", visible=False)
        with self._folder:
            self._pictures = PictureRows(gui)
            self._rows = [self._pictures.add("") for _ in range(PAGE)]
            self._pages = gui.add_button_group("Page", (_BEFORE, _AFTER))
        for number, row in enumerate(self._rows):
            ui.on_click(row, partial(self._chosen, number))
        ui.on_option(self._pages, self._turn)

    def show(
        self, cards: Sequence[ScenarioCard], found: Mapping[Path, FoundScene]
    ) -> None:
        """Show the cards of scenes that were found."""
        self._cards = [one for one in cards if one.folder in found]
        self._found = found
        self._show_page()

    def follow(self, folder: Path | None) -> None:
        """Mark the scene that is open, and show its page."""
        if folder != self._open:
            self._open = folder
            folders = [one.folder for one in self._cards]
            if folder in folders:
                self._first = folders.index(folder) // PAGE * PAGE
            self._show_page()

    def _page(self) -> Sequence[ScenarioCard]:
        return self._cards[self._first : self._first + PAGE]

    def _show_page(self) -> None:
        count = len(self._cards)
        self._first = min(self._first, max(count - 1, 0) // PAGE * PAGE)
        page, pictures = self._page(), []
        shown = f"{self._first + 1} to {self._first + len(page)} of {count}"
        set_property(self._folder, "label", f"Found: {shown}")
        set_property(self._folder, "visible", bool(count))
        set_property(self._pages, "visible", count > PAGE)
        for number, row in enumerate(self._rows):
            set_property(row, "visible", number < len(page))
            if number >= len(page):
                continue
            card, scene = page[number], self._found[page[number].folder]
            set_property(row, "label", _label(card, scene.events))
            told = "; ".join(map(_in_words, scene.events))
            set_property(row, "hint", told[:MAX_HINT] or None)
            is_open = card.folder == self._open
            set_property(row, "icon", viser.Icon.EYE if is_open else None)
            drawn = card.folder, next(iter(scene.events), None)
            if self._drawn.get(number) != drawn:
                self._drawn[number] = drawn
                pictures.append((row, partial(self._picture, number)))
        self._pictures.draw_later(self._ui.post, pictures)

    def _picture(self, number: int) -> str:
        """What a row shows by now; it may be another scene than when this was asked for."""
        return _picture(*self._drawn[number])

    def _chosen(self, number: int) -> None:
        page = self._page()
        if number < len(page):
            self._choose(page[number])

    def _turn(self, option: str) -> None:
        first = self._first + (PAGE if option == _AFTER else -PAGE)
        if 0 <= first < len(self._cards):
            self._first = first
            self._show_page()


@lru_cache(maxsize=256)
def _picture(folder: Path, event: SceneEvent | None) -> str:
    scenario = open_scenario(str(folder))
    if event is None:
        return thumbnail(scenario)
    step = event.first_step(scenario.time_axis)
    return thumbnail(scenario, agent_ids=event.agent_ids, step=step)


def _label(card: ScenarioCard, events: Sequence[SceneEvent]) -> str:
    """The first events of two kinds, and what scene it is."""
    firsts = {one.kind: one for one in reversed(events)}
    told = [one for one in events if firsts[one.kind] is one][:2]
    more = len(events) - len(told)
    parts = [*map(_in_words, told), f"{more} more" if more else "", card.city]
    return " · ".join(filter(None, [*parts, short_id(card.scenario_id)]))


def _in_words(event: SceneEvent) -> str:
    """An event with its time and agents."""
    agents = " with ".join(event.agent_ids)
    return f"{event.kind} at {in_seconds(event.begin_s)} by {agents}"
