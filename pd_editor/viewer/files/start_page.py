"""The page of all scenarios over the picture: what the editor starts with."""

import logging
import re
import time
from dataclasses import replace
from functools import partial
from typing import Any, Final

import viser

from pd_editor.base.errors import LargeSceneError, PdEditorError
from pd_editor.base.plain_text import number_of
from pd_editor.viewer.files.scene_lists import (
    DatasetList,
    DemoList,
    LibraryList,
    RejectedList,
    SceneList,
    TickedList,
    UnfinishedList,
    ZipList,
)
from pd_editor.viewer.overlay.messages import (
    Choice,
    ScenePictureState,
    StartPageEvent,
    StartPageState,
)
from pd_editor.viewer.scene.timeline import Timeline
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.state.events import Signal
from pd_editor.viewer.state.view_memory import Source
from pd_editor.viewer.tab.ui_context import NOT_DONE, UiContext

COMMON: Final = (
    "cut-in",
    "lane-change",
    "left-turn",
    "right-turn",
    "hard-braking",
    "yielding",
    "crossing with pedestrian",
    "near-miss",
    "overtaking",
    "merge",
)


def toggled(query: str, condition: str) -> str:
    """A query with one more condition, or without it where it has it."""
    query = re.sub(r"(\s+(and|or))+$", "", query.strip(), flags=re.IGNORECASE)
    parts = re.split(r"\s+and\s+", query, flags=re.IGNORECASE) if query else []
    if condition in parts:
        parts.remove(condition)
    elif re.search(r"\bor\b", query, re.IGNORECASE):
        parts = [f"({query})", condition]
    else:
        parts.append(condition)
    return " and ".join(parts)


PAGE: Final = 60
"""Number of scenarios that are shown at a time."""
_LOG: Final = logging.getLogger(__name__)


class StartPage:
    """Lists scenarios by source, with one line that filters; opens, keeps and rejects."""

    def __init__(self, ui: UiContext, timeline: Timeline, viewpoint: Viewpoint) -> None:
        """Show it if the tab had it open."""
        self._ui, self._workspace = ui, ui.workspace
        self._timeline, self._viewpoint = timeline, viewpoint
        self.library, self.dataset = LibraryList(ui), DatasetList(ui)
        self.zip = ZipList(ui)
        self._unfinished = UnfinishedList(ui)
        self._lists: dict[Source, SceneList[Any]] = {
            "dataset": self.dataset,
            "demos": DemoList(ui),
            "zip": self.zip,
            "library": self.library,
            "unfinished": self._unfinished,
            "rejected": RejectedList(ui),
        }
        self.listed = Signal[()]()
        """Lists are shown again."""
        self.acted = Signal[str, str]()
        """A button for several scenarios was pressed: its name, and the tags beside it."""
        self._shown: dict[str, Any] = {}
        """What the page shows, by keys."""
        self._wanted: list[str] = []
        """Keys of pictures that the page waits for."""
        self._seen: tuple[object, ...] = ()
        self._searched_at = 0.0
        self._plays_again = ui.workspace.is_new
        """Whether the scene plays once it is closed."""
        ui.overlay.on("startPage", self._heard)
        ui.model.library_changed.subscribe(self.follow)
        ui.model.scene_shown.subscribe(self.show)
        self.follow()
        self._notice: viser.NotificationHandle | None = None
        if self._workspace.is_new and self._unfinished.items and not self.is_open:
            self._notice = ui.notify(
                "Unfinished work found",
                "Edits that were not exported are kept: N, then Unfinished.",
                stays=True,
            )

    @property
    def is_open(self) -> bool:
        """Whether it covers the picture."""
        return self._workspace.start.is_open

    def toggle(self) -> None:
        """Open it, or close it."""
        if self.is_open:
            self.close()
        else:
            self.open(self._workspace.start.source)

    def open(self, source: Source, **changed: str) -> None:
        """Open it with a source, and what else is shown otherwise."""
        self._ui.commit_gesture()
        if self._notice is not None:
            self._notice.remove()
            self._notice = None
        playback = self._workspace.playback
        self._plays_again = playback.is_playing
        playback.pause()
        self._change(is_open=True, source=source, **changed)

    def close(self) -> None:
        """Show the scene, which plays if it did, or if nobody has seen it yet."""
        self._change(is_open=False)
        if self._plays_again:
            self._play()

    def go(self, direction: int) -> None:
        """Open the next (+1) or previous (-1) scene of the dataset under the filter."""
        self._ui.commit_gesture()
        self._workspace.open_neighbour(direction)
        self._show_moment()

    def follow(self) -> None:
        """Look again if any tab or program has changed what there is."""
        workspace = self._workspace
        stamp = (
            workspace.library.stamp(),
            workspace.shelf.index_run.stamp,
            workspace.shelf.stamp(),
            workspace.shelf.rejected.stamp(),
            workspace.index_run and workspace.index_run.stamp,
        )
        if stamp != self._seen:
            self._seen = stamp
            self.look()

    def follow_search(self) -> None:
        """Show what a search has found, not at each of its turns."""
        search, now = self._workspace.search, time.monotonic()
        is_over = search is None or search.is_complete
        if is_over or now - self._searched_at > 0.25:
            self._searched_at = now
            self.show()

    def show(self) -> None:
        """Show the page of the source, as far as a search has come."""
        start, source = self._workspace.start, self._list
        self.dataset.follow()
        total = len(source.items)
        first = min(start.first, max(total - 1, 0)) // PAGE * PAGE
        items = source.items[first : first + PAGE] if start.is_open else ()
        tiles = tuple(source.tile(one) for one in items)
        self._shown = {tile.key: one for tile, one in zip(tiles, items, strict=True)}
        run = source.run
        is_indexing = run is not None and run.fraction is not None
        index = ""
        if is_indexing:
            index = "Cancel the indexing"
        elif source is self.dataset and run is not None and run.num_missing:
            index = f"Index {number_of(run.num_missing, 'scene')}"
        wrong = source.wrong
        self._ui.overlay.show(
            StartPageState(
                is_open=start.is_open,
                source=start.source,
                sources=self._sources(),
                line=start.line,
                is_wrong=bool(wrong),
                told=f"{wrong} The list stays as it was."
                if wrong
                else source.told or ("" if total else "Nothing found."),
                common=COMMON if run is not None and (total or start.line) else (),
                facets=source.facets(),
                index=index,
                is_indexing=is_indexing,
                bulk=source.bulk(),
                tiles=tiles,
                first=first,
                total=total,
            )
        )
        self.listed.emit()

    @property
    def ticked_list(self) -> TickedList[Any]:
        """The list at hand, in which some are ticked; else the library."""
        source = self._list
        return source if isinstance(source, TickedList) else self.library

    @property
    def _list(self) -> SceneList[Any]:
        return self._lists[self._workspace.start.source]

    def _sources(self) -> tuple[Choice, ...]:
        """Sources with their numbers; those that are empty most of the time are left out then."""
        start, dataset = self._workspace.start, self._workspace.dataset
        offered = {"demos", "library", start.source}
        if dataset is not None:
            offered.add("dataset")
        return tuple(
            Choice(value=name, text=f"{name.capitalize()} {len(one.items)}")
            for name, one in self._lists.items()
            if name in offered or (name != "dataset" and one.items)
        )

    def _change(self, **values: Any) -> None:
        """Remember what is to be shown, look and show it."""
        self._workspace.start = replace(self._workspace.start, **values)
        self.look()

    def look(self) -> None:
        """Find out what passes the filter, and show it."""
        for one in self._lists.values():
            one.look()
        self.show()

    def _heard(self, event: StartPageEvent) -> None:
        kind, value = event.kind, event.value
        start = self._workspace.start
        if kind == "close":
            self.close()
        elif kind == "source" and value in self._lists:
            self._change(source=value, first=0)
        elif kind == "line":
            self._change(line=value, first=0)
        elif kind == "common":
            self._change(line=toggled(start.line, value), first=0)
        elif kind == "facet":
            self._set_facet(event.name, value)
        elif kind == "page":
            self._change(first=max(event.first, 0))
        elif kind == "bulk":
            for one in self._list.bulk():
                if one.name == event.name and one.is_on:
                    act = partial(self.acted.emit, one.name, value)
                    self._ui.reporting(f"{NOT_DONE}: {one.text}", act)()
        elif kind == "index" and (run := self._list.run) is not None:
            (run.start if run.fraction is None else run.cancel)()
            self.follow()
        elif kind == "draw":
            self._wanted = list(event.keys)
            self._draw()
        elif value in self._shown:
            item = self._shown[value]
            tile = self._list.tile(item)
            verb = tile.reject if kind == "reject" else kind.capitalize()
            act = partial(self._act, kind, item)
            self._ui.reporting(f"{NOT_DONE}: {verb} {tile.title}", act)()

    def _set_facet(self, name: str, value: str) -> None:
        for one in self._list.facets():
            if one.name == name and value in [choice.value for choice in one.choices]:
                self._change(**{name: value}, first=0)

    def _act(self, kind: str, item: Any) -> None:
        """Do with a scenario what a key or a button asks for."""
        source = self._list
        if kind == "open":
            self._open(item)
            return
        can_save = source.tile(item).can_save
        if kind == "save" and can_save:
            source.save(item)
        elif kind == "reject":
            source.reject(item)
        elif kind == "tick":
            source.tick(item)
        self.look()
        self._ui.model.library_changed.emit()

    def _open(self, item: Any) -> None:
        self._ui.commit_gesture()
        if self._ui.model.mode is not None:
            self._ui.model.mode.stop()
        try:
            self._list.open(item)
        except LargeSceneError:
            # The page asks for a part of it, over the picture.
            self._change(is_open=False)
            raise
        self._change(is_open=False)
        self._show_moment()
        if not self._ui.session.selection:
            self._play()

    def _play(self) -> None:
        self._plays_again = False
        self._workspace.playback.play()
        self._ui.model.playhead_moved.emit()

    def _show_moment(self) -> None:
        """Select and frame the agents of the first event that the query has found there."""
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

    def _draw(self) -> None:
        """Draw one picture after another, so that the page goes on meanwhile."""
        while self._wanted and self.is_open:
            key = self._wanted.pop(0)
            item = self._shown.get(key)
            if item is None:
                continue
            source, picture = self._list, ""
            try:
                picture = source.picture(item)
            except PdEditorError as error:
                _LOG.info("There is no picture of %s: %s", key, error)
            name = source.tile(item).picture
            self._ui.overlay.show(ScenePictureState(name=name, picture=picture))
            break
        if self._wanted:
            self._ui.post(self._draw, "pictures")
