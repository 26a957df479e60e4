"""The dataset panel: browse a root of Argoverse 2 scenarios."""

from typing import Any, Final

import viser

from pd_editor.base.errors import InputError
from pd_editor.base.plain_text import one_line
from pd_editor.scene.formats.dataset import CardFilter, ScenarioCard
from pd_editor.viewer.files.content_query import ContentQuery
from pd_editor.viewer.files.found_rows import FoundRows
from pd_editor.viewer.scene.timeline import Timeline
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.state.workspace import DatasetSearch
from pd_editor.viewer.tab.panel_style import KeptSettings, plain
from pd_editor.viewer.tab.ui_context import UiContext, set_property, set_value

ANY_CITY: Final[str] = "Any city"
ANY_SPLIT: Final[str] = "Any split"
ROOT: Final[str] = "(not in a folder)"
"""Name of the split of scenarios that are in the root itself."""
MAX_LISTED: Final = 200
MAX_AGENTS: Final = 200
MAX_REASON_CHARACTERS: Final = 200
NONE_FOUND: Final[str] = "-"


class DatasetPanel:
    """Filters, the list they leave, previous and next; found scenes as pictures."""

    def __init__(self, ui: UiContext, timeline: Timeline, viewpoint: Viewpoint) -> None:
        """Build it into the current container; hidden where no root was given."""
        self._ui = ui
        self._timeline, self._viewpoint = timeline, viewpoint
        self._workspace = ui.workspace
        dataset = ui.workspace.dataset
        gui = ui.client.gui
        self._folder = gui.add_folder("Dataset", visible=dataset is not None)
        with self._folder:
            self._count = gui.add_markdown("")
            self._city: Any = gui.add_dropdown("City", (ANY_CITY,))
            self._split: Any = gui.add_dropdown(
                "Split", (ANY_SPLIT,), hint="Folder of the dataset, such as val"
            )
            self._with_future = gui.add_checkbox(
                "Logged future only",
                False,
                hint="Test splits end at t = 0: what happens later is not in their files",
            )
            self._text = gui.add_text("Id contains", "")
            self._agents = gui.add_multi_slider(
                "Number of agents",
                min=0,
                max=MAX_AGENTS,
                step=1,
                initial_value=(0, MAX_AGENTS),
            )
            self.query = ContentQuery(ui, self._filter)
            self._list = gui.add_dropdown("Scenario", (NONE_FOUND,))
            self._open = gui.add_button("Open scenario", icon=viser.Icon.FOLDER_OPEN)
            self._previous = gui.add_button(
                "Previous", icon=viser.Icon.CHEVRON_LEFT, color="gray", hint="Page up"
            )
            self._next = gui.add_button(
                "Next", icon=viser.Icon.CHEVRON_RIGHT, color="gray", hint="Page down"
            )
            self._rows = FoundRows(ui, self._open_card)
        filters = {
            "city": self._city,
            "split": self._split,
            "future": self._with_future,
            "text": self._text,
            "agents": self._agents,
            "query": self.query.line,
        }
        self._kept = KeptSettings(ui.workspace.dataset_filter, filters)
        for handle in filters.values():
            ui.on_change(handle, lambda _value: self._filter(), merge_key="filter")
        ui.on_click(self._open, self._open_chosen)
        ui.on_click(self._previous, lambda: self.go(-1))
        ui.on_click(self._next, lambda: self.go(+1))
        self._shown: tuple[DatasetSearch, int, bool] | None = None
        self._cards: dict[str, ScenarioCard] = {}
        ui.model.scene_shown.subscribe(self.follow)
        # A search that finished under an earlier connection gives no new event.
        self.show()
        self._kept.restore()

    def go(self, direction: int) -> None:
        """Open the next (+1) or previous (-1) scenario under the filter."""
        if self._workspace.dataset is None:
            raise InputError("Start the editor with --data DIR to browse a dataset.")
        self._ui.commit_gesture()
        self._workspace.open_neighbour(direction)
        self._show_moment()

    def show(self) -> None:
        """Show the list as far as the search has come."""
        search = self._workspace.search
        if search is None:
            return
        # The last turn of a search may find nothing more than that it is complete.
        shown = (search, search.num_seen, search.is_complete)
        if shown == self._shown:
            return
        self._shown = shown
        _offer(self._city, (ANY_CITY, *search.cities()))
        _offer(self._split, (ANY_SPLIT, *(one or ROOT for one in search.splits())))
        found = search.cards
        self._cards = {_label(card): card for card in found[:MAX_LISTED]}
        labels = tuple(self._cards)
        if tuple(self._list.options) != (labels or (NONE_FOUND,)):
            self._list.options = labels or (NONE_FOUND,)
        if search.is_complete:
            self._rows.show(found, search.found)
            self.follow()
        more = "" if len(found) <= MAX_LISTED else f", the first {MAX_LISTED} listed"
        state = "" if search.is_complete else ", still reading"
        text = f"{len(found)} of {search.num_seen} scenarios{more}{state}"
        if broken := search.failures():
            first = plain(one_line(broken[0], MAX_REASON_CHARACTERS))
            text += f"\n\n{len(broken)} cannot be read, first: {first}"
        set_property(self._count, "content", text)

    def follow(self) -> None:
        """Choose in the list what is open, if it is listed."""
        folder = self._workspace.dataset_folder
        for label, card in self._cards.items():
            if card.folder == folder:
                set_value(self._list, label)
        self._rows.follow(folder)

    def follow_index(self) -> None:
        """Show how far the index is."""
        self.query.follow()

    def close(self) -> None:
        """Leave the filter to the page that comes next."""
        self._kept.keep()

    def _filter(self) -> None:
        low, high = self._agents.value
        split = "" if self._split.value == ROOT else str(self._split.value)
        found = self.query.found()
        self._workspace.search_for(
            CardFilter(
                city=None if self._city.value == ANY_CITY else str(self._city.value),
                text=str(self._text.value).strip() or None,
                min_agents=int(low),
                max_agents=None if high >= MAX_AGENTS else int(high),
                split=None if split == ANY_SPLIT else split,
                with_future=bool(self._with_future.value),
                among=found,
            ),
            found,
        )

    def _open_chosen(self) -> None:
        chosen = self._cards.get(str(self._list.value))
        if chosen is None:
            raise InputError("No scenario passes the filter; widen it.")
        self._open_card(chosen)

    def _open_card(self, card: ScenarioCard) -> None:
        self._ui.commit_gesture()
        self._workspace.open_from_dataset(card)
        self._show_moment()

    def _show_moment(self) -> None:
        """Select and frame the agents of the first event that the query has found there."""
        self.follow()
        folder, search = self._workspace.dataset_folder, self._workspace.search
        if folder is None or search is None or folder not in search.found:
            return
        scenario = self._ui.session.scenario
        agents = scenario.agents
        for event in search.found[folder].events[:1]:
            there = [one for one in event.agent_ids if one in agents.row_of]
            step = event.first_step(scenario.time_axis)
            self._timeline.seek(float(step))
            self._ui.session.select(there)
            rows = agents.rows(there)
            place_m = agents.position_m[rows, step][agents.is_valid[rows, step]]
            if len(place_m):
                x, y = place_m.mean(axis=0).tolist()
                self._viewpoint.frame_place((x, y))


def _offer(dropdown: Any, options: tuple[str, ...]) -> None:
    """Offer other options; what is chosen stays."""
    if tuple(dropdown.options) != options:
        chosen = dropdown.value
        dropdown.options = options
        set_value(dropdown, chosen)


def _label(card: ScenarioCard) -> str:
    """What tells scenarios apart comes first, since ids are as long as the list is wide."""
    about = [card.split] if card.split else []
    if not card.has_future:
        about.append("no logged future")
    name = card.folder.name
    # Folders of one split may hold scenarios of one id.
    is_named = name == card.scenario_id or name.startswith(f"{card.scenario_id}.")
    names = (card.scenario_id, *(() if is_named else (f"in {name}",)))
    parts = (card.city, f"{card.num_agents} agents", *about, *names)
    return " · ".join(filter(None, parts))
