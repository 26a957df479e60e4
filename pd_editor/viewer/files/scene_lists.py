"""Scenarios that can be opened, by source: what is listed, how it looks, what is done."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Final, Generic, Literal, TypeVar

from pd_editor.analysis.findings.scorecard import MEANS, ROWS, TOTALS
from pd_editor.analysis.manoeuvres.events import SceneEvent
from pd_editor.analysis.metrics.values import METRICS
from pd_editor.base.errors import InputError
from pd_editor.base.installed_files import DEMO_PREFIX, demo_names, demo_sentence
from pd_editor.base.plain_text import number_of, one_line
from pd_editor.editor.library.library import SORTS, Library, LibraryCard
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.recipe import moment
from pd_editor.editor.scenario_store import open_scenario, scenario_and_recipe
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import UnfinishedWork
from pd_editor.editor.variant import short_id
from pd_editor.editor.varied_numbers import values_in_words
from pd_editor.experiments.scene_index.index_file import SceneIndex
from pd_editor.experiments.scene_index.query import FoundScene, find_places, find_scenes
from pd_editor.scene.formats.dataset import CardFilter, ScenarioCard
from pd_editor.viewer.overlay.messages import BulkButton, Choice, SceneFacet, SceneTile
from pd_editor.viewer.scene.timeline import in_seconds
from pd_editor.viewer.state.index_run import IndexRun
from pd_editor.viewer.state.session_shelf import KeptWork
from pd_editor.viewer.state.workspace import base_of, take_in_upload
from pd_editor.viewer.tab.ui_context import UiContext

Item = TypeVar("Item")
ROOT: Final = "(not in a folder)"
"""Name of the split of scenarios that are in the root itself."""
MAX_REASON_CHARACTERS: Final = 200
REJECT: Final = "Reject"
_AGENTS: Final[Mapping[str, tuple[int | None, int | None]]] = {
    "Up to 20 agents": (None, 20),
    "21 to 60 agents": (21, 60),
    "More than 60 agents": (61, None),
}
_METRICS: Final = {
    **{name: one.title for name, one in TOTALS.items()},
    **{name: title for name, (title, _) in MEANS.items()},
}
_ORDERS: Final = {
    "date": "Newest first",
    "name": "Name",
    "base": "Base",
    "city": "City",
    "problems": "Most problems",
    "agents": "Most agents",
}
_ZIP: Final = "One zip in the format under Scene, Export: a folder each, and index.csv"
_WITH_FUTURE: Final = "With a logged future"


@dataclass
class Batch:
    """Work on several scenarios, one after another, between what the page asks for."""

    button: str
    """Name of the button that began it, and ends it."""
    words: str
    """What is done, such as ``Saved``."""
    do: Callable[[str], None]
    """Works on the scenario of a name."""
    left: list[str]
    num_done: int = 0
    failures: list[str] = field(default_factory=list)

    @property
    def told(self) -> str:
        """How far it is."""
        return f"{self.words} {self.num_done} of {self.num_done + len(self.left)}"


class SceneList(ABC, Generic[Item]):
    """Scenarios of one source that pass the filter."""

    run: IndexRun | None = None
    """Index of what happens in them."""

    def __init__(self, ui: UiContext) -> None:
        """List nothing yet."""
        self._ui, self._workspace = ui, ui.workspace
        self.items: Sequence[Item] = ()
        self.wrong = ""
        """Why the line is no query, if no scene has its words either; what was found before
        then stays."""

    @property
    def told(self) -> str:
        """What else there is to say of the list."""
        return ""

    @property
    def words(self) -> list[str]:
        """Words of the line that filters, in small letters."""
        return self._workspace.start.line.lower().split()

    @abstractmethod
    def look(self) -> None:
        """Find out what passes the filter."""

    @abstractmethod
    def tile(self, item: Item) -> SceneTile:
        """What is shown of one."""

    @abstractmethod
    def picture(self, item: Item) -> str:
        """Its picture, as SVG."""

    @abstractmethod
    def open(self, item: Item) -> None:
        """Open it; raises an InputError if that is not possible."""

    def facets(self) -> tuple[SceneFacet, ...]:
        """Menus that filter or sort."""
        return ()

    def bulk(self) -> tuple[BulkButton, ...]:
        """Buttons for several at once."""
        return ()

    def place(self, _item: Item) -> str:
        """Where it is, for those that can be rejected or saved as they are."""
        return ""

    def tick(self, _item: Item) -> None:
        """Tick one, or take its tick away."""

    def reject(self, item: Item) -> None:
        """Leave it out from now on."""
        self._workspace.shelf.rejected.toggle(self.place(item))

    def take_in(self, item: Item) -> str:
        """Add it to the library; returns its name, or none if it is there already."""
        return self._workspace.take_in(self.place(item))

    def save(self, item: Item) -> None:
        """Take it into the library as it is."""
        name = self.take_in(item)
        said = f"Saved to library: {name}" if name else "It is in the library already"
        self._ui.notify(said, "", "success" if name else "info")

    def _is_saved(self, scenario_id: str) -> bool:
        card = self._workspace.library.card(scenario_id)
        return card is not None and not card.row.edits

    def _has_words(self, text: str) -> bool:
        text = text.lower()
        return all(one in text for one in self.words)


class DemoList(SceneList[str]):
    """Scenes that come with the editor."""

    def look(self) -> None:
        """Find words of the line in names and descriptions."""
        rejected = self._workspace.shelf.rejected.places()
        self.items = [
            name
            for name in demo_names()
            if self.place(name) not in rejected
            and self._has_words(f"{name} {demo_sentence(name)}")
        ]

    def place(self, item: str) -> str:
        """A name that no folder has."""
        return f"{DEMO_PREFIX}{item}"

    def tile(self, item: str) -> SceneTile:
        """Its name and description."""
        said = demo_sentence(item)
        return SceneTile(
            key=item,
            title=item,
            lines=(f"{said[:1].upper()}{said[1:]}",),
            picture=self.place(item),
            is_open=self._workspace.session.base.provenance.source == self.place(item),
            is_saved=self._is_saved(item),
            can_save=True,
            reject=REJECT,
        )

    def picture(self, item: str) -> str:
        """The scene at t = 0."""
        return _picture(self.place(item), None)

    def open(self, item: str) -> None:
        """Open the demo."""
        self._workspace.open_reference(item)


class TickedList(SceneList[Item]):
    """Scenarios of which some can be ticked, for buttons that are for several."""

    batch: Batch | None = None
    """What is being done with several."""

    @abstractmethod
    def name_of(self, item: Item) -> str:
        """Name under which one is ticked."""

    @property
    @abstractmethod
    def marks(self) -> set[str]:
        """Names of all that are ticked, also of those that the line leaves out."""

    @property
    def listed(self) -> list[str]:
        """Names of those that pass the filter, in their order."""
        return [self.name_of(one) for one in self.items]

    @property
    def ticked(self) -> list[str]:
        """Names of those of them that are ticked."""
        return [one for one in self.listed if one in self.marks]

    @property
    def chosen(self) -> list[str]:
        """Those that are ticked; all of them if none is."""
        return self.ticked or self.listed

    @property
    def marked(self) -> str:
        """What buttons act on, and how far a batch is."""
        ticked = len(self.ticked)
        acts = f"{ticked} ticked" if ticked else "buttons are for all of them"
        doing = f"{self.batch.told}; " if self.batch else ""
        if not self.items:
            return f"{doing}nothing found"
        return f"{doing}{number_of(len(self.items), 'scenario')}; {acts}"

    def tick(self, item: Item) -> None:
        """Tick one, or take its tick away."""
        self.marks.symmetric_difference_update({self.name_of(item)})

    def tick_all(self) -> None:
        """Tick all that is found, or none at all if that is so."""
        marks, found = self.marks, set(self.listed)
        if marks >= found:
            marks -= found
        else:
            marks |= found

    def _buttons(
        self, others: Iterable[tuple[str, str, str, bool]]
    ) -> tuple[BulkButton, ...]:
        """The button that ticks, and others by name, text, hint, and whether they are on."""
        found = len(self.items)
        tick = "Tick none" if 0 < found == len(self.ticked) else "Tick all"
        ends = self.batch.button if self.batch else ""
        return tuple(
            BulkButton(name=name, text="Cancel", hint="What is done stays", is_on=True)
            if name == ends
            else BulkButton(name=name, text=text, hint=hint, is_on=is_on)
            for name, text, hint, is_on in [("tick", tick, "", found > 0), *others]
        )


class ZipList(TickedList[str]):
    """Scenes of the zip that was uploaded last."""

    def look(self) -> None:
        """Find words of the line in names."""
        uploaded = self._workspace.uploaded_zip
        names = () if uploaded is None else uploaded.scenes
        self.items = [one for one in names if self._has_words(one)]

    @property
    def told(self) -> str:
        """Name of the zip, and what buttons act on."""
        uploaded = self._workspace.uploaded_zip
        return f"{uploaded.name}: {self.marked}." if uploaded else ""

    def name_of(self, item: str) -> str:
        """The name itself."""
        return item

    @property
    def marks(self) -> set[str]:
        """Those of this zip alone."""
        uploaded = self._workspace.uploaded_zip
        return set() if uploaded is None else uploaded.ticked

    def bulk(self) -> tuple[BulkButton, ...]:
        """Buttons for what is ticked, or for all that is found."""
        count = len(self.chosen)
        if not count:
            return ()
        return self._buttons(
            [
                ("zip-save", f"Save {count}", "To the library, with these tags", True),
                ("zip-download", f"Download {count}", _ZIP, True),
            ]
        )

    def tile(self, item: str) -> SceneTile:
        """Its name."""
        workspace = self._workspace
        uploaded = workspace.uploaded_zip
        assert uploaded is not None
        return SceneTile(
            key=item,
            title=item,
            lines=(),
            picture=f"{uploaded.name} {uploaded.size_bytes} {item}",
            is_open=workspace.session.base.scenario_id == item,
            is_saved=workspace.library.card(item) is not None,
            is_ticked=item in self.marks,
            can_save=True,
        )

    def take_in(self, item: str) -> str:
        """Add one to the library; returns its name, or none if it is there already."""
        return self.take_into(self._workspace.library, item)

    def take_into(self, library: Library, item: str, tags: Sequence[str] = ()) -> str:
        """The same, for any library, with tags."""
        return take_in_upload(library, self._files(item), self._workspace.cut, tags)

    def picture(self, item: str) -> str:
        """The scene at t = 0."""
        return thumbnail(scenario_and_recipe(self._files(item))[0])

    def open(self, item: str) -> None:
        """Open it as if it had been uploaded alone."""
        self._workspace.open_upload(self._files(item))

    def _files(self, item: str) -> Mapping[str, bytes]:
        uploaded = self._workspace.uploaded_zip
        assert uploaded is not None
        return uploaded.scenes[item]()


class DatasetList(SceneList[ScenarioCard]):
    """Scenes of the dataset, as far as the search has come."""

    def __init__(self, ui: UiContext) -> None:
        """Look at the index."""
        super().__init__(ui)
        self._fault = ""
        """Why the line is no query."""
        self.run = ui.workspace.index_run
        if self.run is not None:
            self.run.look()

    def look(self) -> None:
        """Search for other scenes if the filter is another one.

        The line is a query, or words; what is either of both is found.
        """
        workspace, start = self._workspace, self._workspace.start
        dataset, found = workspace.dataset, None
        if dataset is None or self.run is None:
            return
        self._fault = ""
        if start.line.strip():
            found = dict[Path, FoundScene]()
            try:
                scenes = find_scenes(self.run.index, start.line)
            except InputError as error:
                self._fault = str(error)
            else:
                root = dataset.root
                found = {root / os.path.relpath(one.path, root): one for one in scenes}
        low, high = _AGENTS.get(start.agents, (None, None))
        split = "" if start.split == ROOT else start.split or None
        wanted = CardFilter(
            city=start.city or None,
            min_agents=low,
            max_agents=high,
            split=split,
            with_future=bool(start.future),
            among=found,
            words=tuple(self.words),
            without=frozenset(map(Path, workspace.shelf.rejected.places())),
        )
        if workspace.search is None or wanted != workspace.search.wanted:
            workspace.search_for(wanted, found)

    def follow(self) -> None:
        """Take what the search has found by now."""
        search = self._workspace.search
        cards = () if search is None else search.cards
        self.wrong = "" if cards else self._fault
        if not self.wrong:
            self.items = cards

    @property
    def told(self) -> str:
        """How far the search is, and what could not be read."""
        search, run = self._workspace.search, self.run
        if search is None or run is None:
            return ""
        count, broken = run.num_missing, search.failures()
        lacks = self._workspace.start.line and run.fraction is None and count
        parts = (
            f"{len(search.cards)} of {search.num_seen} scenarios"
            f"{'' if search.is_complete else ', still reading'}.",
            run.words,
            f"{number_of(count, 'scene')} not indexed yet, so not found."
            if lacks
            else "",
            f"{len(broken)} cannot be read, first:"
            f" {one_line(broken[0], MAX_REASON_CHARACTERS)}"
            if broken
            else "",
        )
        return " ".join(filter(None, parts))

    def facets(self) -> tuple[SceneFacet, ...]:
        """City, split, number of agents, and whether there is a logged future."""
        search, start = self._workspace.search, self._workspace.start
        if search is None:
            return ()
        splits = [one or ROOT for one in search.splits()]
        return (
            _facet("city", "Any city", start.city, search.cities()),
            _facet("split", "Any split", start.split, splits),
            _facet("agents", "Any number of agents", start.agents, _AGENTS),
            _facet("future", "With or without a future", start.future, (_WITH_FUTURE,)),
        )

    def place(self, item: ScenarioCard) -> str:
        """Its folder or file."""
        return str(item.folder)

    def tile(self, item: ScenarioCard) -> SceneTile:
        """What was found in it, and what scene it is."""
        events = self._events(item)
        # The first of each of two kinds.
        firsts = {one.kind: one for one in reversed(events)}
        told = [one for one in events if firsts[one.kind] is one][:2]
        more = len(events) - len(told)
        about = (
            item.city,
            f"{item.num_agents} agents",
            item.split,
            "" if item.has_future else "no logged future",
        )
        return SceneTile(
            key=self.place(item),
            title=short_id(item.scenario_id),
            lines=(
                *map(_in_words, told),
                *((f"{more} more",) if more else ()),
                " · ".join(filter(None, about)),
                item.scenario_id,
            ),
            picture=" ".join((self.place(item), *map(_in_words, events[:1]))),
            is_open=item.folder == self._workspace.dataset_folder,
            is_saved=self._is_saved(item.scenario_id),
            can_save=True,
            reject=REJECT,
        )

    def picture(self, item: ScenarioCard) -> str:
        """The scene at the first moment that the query asks for."""
        return _picture(self.place(item), next(iter(self._events(item)), None))

    def open(self, item: ScenarioCard) -> None:
        """Open the scene."""
        self._workspace.open_from_dataset(item)

    def _events(self, item: ScenarioCard) -> Sequence[SceneEvent]:
        search = self._workspace.search
        found = None if search is None else search.found.get(item.folder)
        return () if found is None else found.events


class LibraryList(TickedList[LibraryCard]):
    """Kept scenarios."""

    def __init__(self, ui: UiContext) -> None:
        """Read nothing yet."""
        super().__init__(ui)
        self._library, self.run = ui.workspace.library, ui.workspace.shelf.index_run
        self._index_told: tuple[object, SceneIndex] = None, self.run.index
        """The index with facts of the cards, and the state of both."""
        self._indexed = -1
        """State of the library that was read for queries."""

    def look(self) -> None:
        """Find what the line describes, and what has its words."""
        run, line = self.run, self._workspace.start.line.strip()
        assert run is not None
        # Looked at first: a change in between then counts as one that follows.
        seen = self._library.stamp(), run.stamp
        cards = self._library.cards()
        self._workspace.ticked &= {card.name for card in cards}
        self.wrong = ""
        if line:
            found: set[str] = set()
            try:
                if self._index_told[0] != seen:
                    told = run.index.beside(self._library.facts())
                    self._index_told = seen, told
                found = set(
                    map(os.path.basename, find_places(self._index_told[1], line))
                )
                self._index()
            except InputError as error:
                self.wrong = str(error)
            words = line.split()
            wanted = [card for card in cards if card.name in found or card.has(words)]
            if wanted:
                self.wrong = ""
            elif self.wrong:
                former = set(self.listed)
                wanted = [card for card in cards if card.name in former]
            cards = wanted
        self.items = sorted(cards, key=SORTS[self._workspace.start.sort])

    @property
    def told(self) -> str:
        """How far the index is, and what buttons act on."""
        line, unread = self._workspace.start.line, self._library.unread
        told = [
            "Nothing found." if line else "Empty: S saves the scenario at hand here."
        ]
        if self.items:
            at = f"; in {self._library.root}" * self._workspace.folders.is_local
            told = [f"{self.marked}{at}."]
        if unread:
            first = one_line(unread[0], MAX_REASON_CHARACTERS)
            told.append(f"{len(unread)} cannot be read, first: {first}.")
        if line and self.run is not None:
            told.append(self.run.words)
        return " ".join(filter(None, told))

    def name_of(self, item: LibraryCard) -> str:
        """Its name."""
        return item.name

    @property
    def marks(self) -> set[str]:
        """Those of this tab."""
        return self._workspace.ticked

    def facets(self) -> tuple[SceneFacet, ...]:
        """The order, of those that are there; metrics once some are computed."""
        known = {name for card in self.items for name in card.metrics}
        orders = {**_ORDERS, **{one: _METRICS[one] for one in ROWS if one in known}}
        choices = tuple(Choice(value=one, text=text) for one, text in orders.items())
        value = self._workspace.start.sort
        sort = SceneFacet(name="sort", label="Sort", value=value, choices=choices)
        return (sort,) if self.items else ()

    def bulk(self) -> tuple[BulkButton, ...]:
        """Buttons for what is ticked, or for all that is found."""
        found, ticked = len(self.items), len(self.ticked)
        removed, count = len(self._workspace.removed), ticked or found
        if not found and not removed:
            return ()
        buttons = [
            ("tag", f"Tag {count}", "Add these tags", found > 0),
            ("untag", f"Untag {count}", "Take these tags away", found > 0),
            ("metrics", f"Metrics {count}", "Compute the scorecard", found > 0),
            ("compare", "Compare two", "The two ticked side by side", ticked == 2),
            ("download", f"Download {count}", _ZIP, found > 0),
            ("remove", f"Remove {ticked}", "Those that are ticked", ticked > 0),
        ]
        if removed:
            buttons.append(
                ("put-back", f"Put back {removed}", "All removed here", True)
            )
        return self._buttons(buttons)

    def tile(self, item: LibraryCard) -> SceneTile:
        """Its problems, tags, descent, note and edits."""
        row, count = item.row, item.row.num_problems
        problems = number_of(count, "problem") if count else ""
        metric = self._metric(item)
        about = " · ".join(filter(None, [metric, problems, *row.tags]))
        edits = "; ".join(row.edits) or "without edits"
        of = (f"variant of {row.parent}",) * bool(row.values)
        return SceneTile(
            key=item.name,
            title=item.name,
            lines=tuple(
                filter(None, [values_in_words(row.values), about, *of, row.note, edits])
            ),
            picture=f"{item.name} {item.saved_at} {edits}",
            is_open=self._workspace.saved_card() == item,
            is_saved=True,
            is_ticked=item.name in self._workspace.ticked,
            reject="Remove",
        )

    def picture(self, item: LibraryCard) -> str:
        """The picture beside it."""
        return self._library.thumbnail(item.name)

    def open(self, item: LibraryCard) -> None:
        """Open the scenario."""
        self._workspace.open_reference(str(self._library.root / item.name))

    def reject(self, item: LibraryCard) -> None:
        """Remove it from the library; the panel can put it back."""
        self.remove((item.name,))

    def remove(self, names: Sequence[str]) -> None:
        """Remove scenarios, which can be put back for a day."""
        for name in names:
            self._library.remove(name)
            removed = dict.fromkeys((*self._workspace.removed, name))
            self._workspace.removed = tuple(removed)
        self._ui.notify(
            f"{number_of(len(names), 'scenario')} removed",
            f"The button Put back {len(self._workspace.removed)} below the library undoes it.",
        )

    def _metric(self, item: LibraryCard) -> str:
        """The metric by which the list is sorted, if it is by one."""
        name = self._workspace.start.sort
        if name not in item.metrics:
            return ""
        value, unit = item.metrics[name], METRICS[name].unit
        shown = f"{value:.0%}" if unit == "share" else f"{value:.1f} {unit}"
        return f"{_METRICS[name]}: {shown}"

    def _index(self) -> None:
        """Read what happens in scenarios that are new, in the background."""
        stamp, run = self._library.stamp(), self.run
        if run is not None and stamp != self._indexed and run.fraction is None:
            self._indexed = stamp
            run.start()


class UnfinishedList(SceneList[KeptWork]):
    """Edited scenarios that are not open, and were not exported."""

    def __init__(self, ui: UiContext) -> None:
        """Ask for no discarding yet."""
        super().__init__(ui)
        self._doubted: str | None = None
        """The one whose discarding was asked for once."""

    def look(self) -> None:
        """Find words of the line in names."""
        shelf = self._workspace.shelf
        self.items = [
            one
            for one in shelf.unfinished()
            if self._has_words(f"{one.name} {one.scenario_id}")
        ]

    def tile(self, item: KeptWork) -> SceneTile:
        """Number and time of its edits."""
        key = _key_of(item)
        edits = number_of(item.num_edits, "edit")
        last = f"{edits}, last {moment(item.last_time):%d %b %H:%M}"
        named = item.name or short_id(item.scenario_id)
        return SceneTile(
            key=key,
            title=named,
            lines=(last, *((item.scenario_id,) if item.scenario_id != named else ())),
            picture=f"{key} {item.num_edits} {item.last_time}",
            reject="Discard for good" if key == self._doubted else "Discard",
        )

    def picture(self, item: KeptWork) -> str:
        """The scenario, or the base of one on disk: a replay would take too long."""
        if isinstance(item.place, EditorSession):
            return thumbnail(item.place.scenario)
        return _base_picture(item.place)

    def open(self, item: KeptWork) -> None:
        """Continue it."""
        self._workspace.resume(item)

    def reject(self, item: KeptWork) -> None:
        """Discard it when asked twice."""
        key = _key_of(item)
        if self._doubted == key:
            self._workspace.shelf.discard(item)
        self._doubted = None if self._doubted == key else key


class RejectedList(SceneList[str]):
    """Scenes that lists leave out."""

    def look(self) -> None:
        """Find words of the line in their places."""
        places = sorted(self._workspace.shelf.rejected.places())
        self.items = [one for one in places if self._has_words(one)]

    def place(self, item: str) -> str:
        """The scene itself."""
        return item

    def tile(self, item: str) -> SceneTile:
        """Its name."""
        title = os.path.basename(item.removeprefix(DEMO_PREFIX))
        return SceneTile(
            key=item, title=title, lines=(), picture=item, reject="Take back"
        )

    def picture(self, item: str) -> str:
        """The scene at t = 0."""
        return _picture(item, None)

    def open(self, item: str) -> None:
        """Open the scene."""
        self._workspace.open_reference(item)


def _facet(
    name: Literal["city", "split", "agents", "future"],
    every: str,
    value: str,
    options: Iterable[str],
) -> SceneFacet:
    """A menu of options, of which the first is to have any of them."""
    choices = [Choice(value=one, text=one) for one in options]
    return SceneFacet(
        name=name,
        label=name.capitalize(),
        value=value,
        choices=(Choice(value="", text=every), *choices),
    )


def _key_of(work: KeptWork) -> str:
    """What tells one work from others while it is not open."""
    place = work.place
    path = place.journal_path if isinstance(place, EditorSession) else place.path
    return str(id(place)) if path is None else path.name


def _in_words(event: SceneEvent) -> str:
    """An event with its time and agents."""
    agents = " with ".join(event.agent_ids)
    return f"{event.kind} at {in_seconds(event.begin_s)} by {agents}"


@lru_cache(maxsize=256)
def _picture(place: str, event: SceneEvent | None) -> str:
    scenario = open_scenario(place)
    if event is None:
        return thumbnail(scenario)
    step = event.first_step(scenario.time_axis)
    return thumbnail(scenario, agent_ids=event.agent_ids, step=step)


@lru_cache(maxsize=64)
def _base_picture(work: UnfinishedWork) -> str:
    return thumbnail(base_of(work))
