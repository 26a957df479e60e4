"""The dataset panel's line that asks for what happens in scenes, and the index of it."""

import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import viser

from pd_editor.base.errors import InputError
from pd_editor.experiments.scene_index.find import FoundScene, find_scenes
from pd_editor.viewer.tab.panel_style import FixedText
from pd_editor.viewer.tab.ui_context import UiContext, set_property

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
"""Conditions that are offered as buttons."""


class ContentQuery:
    """A query, buttons that write into it, and a button that indexes what is missing."""

    def __init__(self, ui: UiContext, on_change: Callable[[], None]) -> None:
        """Build it into the current container; ``on_change``: other scenes are found."""
        self._run = ui.workspace.index_run
        self._on_change = on_change
        self._found: Mapping[Path, FoundScene] | None = None
        self._stamp = -1
        gui = ui.client.gui
        # Above the line: its note comes and goes, and must not move them.
        common = gui.add_button_group("What happens", COMMON)
        self.line = gui.add_text(
            "Contains",
            "",
            hint="What happens in a scene, such as: cut-in by bus and density > 20."
            " Conditions are joined by and, or, not",
        )
        self.note = FixedText(gui, 2)
        self._index = gui.add_button(
            "Index",
            color="gray",
            icon=viser.Icon.LIST_SEARCH,
            hint="Read what happens in them, once, in the background",
        )
        self._bar = gui.add_progress_bar(0.0)
        self._cancel = gui.add_button("Cancel the indexing", color="gray")
        ui.on_option(common, self._toggle)
        if self._run is not None:
            ui.on_click(self._index, self._run.start)
            ui.on_click(self._cancel, self._run.cancel)
            self._run.look()
        self.follow()

    def found(self) -> Mapping[Path, FoundScene] | None:
        """What the query finds so far; None without one.

        While the line is no query, that of the one before; the line's error is shown.
        """
        text, run = str(self.line.value).strip(), self._run
        wrong = ""
        if not text or run is None:
            self._found = None
        else:
            root = run.dataset.root
            try:
                scenes = find_scenes(run.index, text)
            except InputError as error:
                wrong = str(error)
            else:
                self._found = {
                    root / os.path.relpath(one.path, root): one for one in scenes
                }
        self._show(wrong)
        return self._found

    def follow(self) -> None:
        """Show how far the index is; a query finds more while it grows."""
        if self._run is not None and self._run.stamp != self._stamp:
            self._stamp = self._run.stamp
            if self.line.value:
                self._on_change()
            else:
                self._show("")

    def _show(self, wrong: str) -> None:
        run = self._run
        if run is None:
            return
        count, fraction = run.num_missing, run.fraction
        scenes = f"{count} scene{'s' * (count != 1)}"
        is_lacking = fraction is None and count and self.line.value
        lacking = f"{scenes} not indexed yet, so not found." if is_lacking else ""
        self.note.show(wrong, *() if wrong else (run.words, lacking))
        set_property(self._index, "label", f"Index {scenes}")
        set_property(self._index, "visible", bool(count) and fraction is None)
        set_property(self._bar, "value", round(100 * (fraction or 0.0), 1))
        for shown in (self._bar, self._cancel):
            set_property(shown, "visible", fraction is not None)

    def _toggle(self, condition: str) -> None:
        self.line.value = toggled(str(self.line.value), condition)
        self._on_change()


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
