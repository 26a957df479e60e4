"""Scenes that a query has found, as pictures of the moments that it asked for."""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
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
from pd_editor.viewer.tab.panel_style import PicturePages, PictureRow
from pd_editor.viewer.tab.ui_context import UiContext, set_property

PAGE: Final = 8
"""Number of scenes that are shown at a time."""


class FoundRows:
    """A page of found scenes; a click chooses one."""

    def __init__(self, ui: UiContext, choose: Callable[[ScenarioCard], None]) -> None:
        """Build it into the current container, hidden while nothing is found."""
        self._cards: Sequence[ScenarioCard] = ()
        self._found: Mapping[Path, FoundScene] = {}
        self._open: Path | None = None
        self._folder = ui.client.gui.add_folder("Found", visible=False)
        with self._folder:
            self._pages = PicturePages[ScenarioCard](
                ui,
                PAGE,
                choose=choose,
                row_of=self._row,
                picture_of=lambda card: _picture(card.folder, self._event(card)),
                tell=lambda shown: set_property(
                    self._folder, "label", f"Found: {shown}"
                ),
            )

    def show(
        self, cards: Sequence[ScenarioCard], found: Mapping[Path, FoundScene]
    ) -> None:
        """Show the cards of scenes that were found."""
        self._cards = [one for one in cards if one.folder in found]
        self._found = found
        set_property(self._folder, "visible", bool(self._cards))
        self._pages.show(self._cards)

    def follow(self, folder: Path | None) -> None:
        """Mark the scene that is open, and show its page."""
        if folder != self._open:
            self._open = folder
            folders = [one.folder for one in self._cards]
            at = folders.index(folder) if folder in folders else None
            self._pages.show(self._cards, at)

    def _row(self, card: ScenarioCard) -> PictureRow:
        events = self._found[card.folder].events
        return PictureRow(
            label=_label(card, events),
            hint="; ".join(map(_in_words, events)),
            icon=viser.Icon.EYE if card.folder == self._open else None,
            drawn=(card.folder, self._event(card)),
        )

    def _event(self, card: ScenarioCard) -> SceneEvent | None:
        return next(iter(self._found[card.folder].events), None)


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
