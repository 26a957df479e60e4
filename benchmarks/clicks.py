"""Clicks and minutes of two tasks, walked by mouse: a first scene, and a curated set.

Needs Chromium. Run as ``python -m benchmarks.clicks``. Counted is each press of the mouse
that the page hears, not keys; the time is the editor's, since this hand is a fast one.
Goals: ``MOST_CLICKS``; 5 and 10 minutes.
"""

import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from playwright.sync_api import Browser, ViewportSize

from benchmarks.chromium import opened_chromium
from benchmarks.figures import load_in_words
from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions
from tests.browser.editor_page import EditorPage

COUNTED = "presses = 0; addEventListener('pointerdown', () => presses++, true)"
VIEWPORT = ViewportSize(width=1280, height=720)


class Walker:
    """A person at the mouse."""

    def __init__(self, editor: EditorPage) -> None:
        self.editor, self.page = editor, editor.page

    def press(self, name: str, role: Literal["button", "tab"] = "button") -> None:
        """Click something by its name."""
        self.page.get_by_role(role, name=name, exact=True).first.click()
        self.page.wait_for_timeout(150)

    def type(self, label: str, value: object) -> None:
        """Click into a field of the panel, and type, unless it has the value."""
        field = self.editor.row(label).locator("input:not([type=hidden])").last
        if field.input_value() != str(value):
            field.click()
            field.fill(str(value))
            field.press("Enter")
            self.page.wait_for_timeout(150)

    def open(self, scene: str) -> None:
        """Click a picture of the start page."""
        whole = self.page.get_by_role("region", name="All scenarios")
        if not whole.is_visible():
            self.editor.key("n")
        whole.locator(".pd-start-tile", has_text=scene).first.click()
        self.editor.until(lambda: not whole.is_visible(), "the scene")

    def bend(self, scene: str, kind: str = "S-bend") -> None:
        """Open a scene, and bend its road."""
        self.open(scene)
        self.press("Road", "tab")
        self.type(kind, 6)
        self.editor.until(lambda: self.editor.session.scenario.applied_warp, "a bend")

    def family(self, ranges: str, number: int) -> None:
        """Make a family of the edits at hand."""
        cards = self.editor.workspace.library.cards
        wanted = len(cards()) + number
        self.press("Study", "tab")
        self.type("Vary", ranges)
        self.type("Variants", number)
        self.press("Make family")
        self.editor.until(lambda: len(cards()) == wanted, "a family", 300.0)

    def download(self, name: str) -> None:
        """Click a button that downloads a zip."""
        with self.page.expect_download() as download:
            self.press(name)
        assert zipfile.is_zipfile(download.value.path())


def first_scene(walker: Walker) -> None:
    """Warp a demo, resample its traffic, download it."""
    editor = walker.editor
    walker.bend("signalised-junction")
    walker.press("Resample everybody")
    editor.until(lambda: len(editor.session.entries) == 2, "traffic", 300.0)
    walker.press("Scene", "tab")
    walker.download("Download zip")


def curated_set(walker: Walker) -> None:
    """S-bends of three maps, threats of one, waves of one, all in one zip."""
    for scene in ("signalised-junction", "winding-street", "downtown"):
        walker.bend(scene)
        walker.family("power=3..8", 2)
    walker.open("roundabout")
    walker.press("Agents", "tab")
    walker.press("What could happen to the ego?")
    walker.page.locator(".pd-possible-line", has_text="contact").first.click()
    walker.editor.until(lambda: walker.editor.session.scenario.guidance, "a threat")
    walker.family("severity=0..1", 2)
    walker.bend("merge", "Waves")
    walker.family("power=3..8", 2)
    walker.editor.key("n")
    walker.press("Library 10", "tab")
    walker.download("Download 10")


MOST_CLICKS = {first_scene: 10, curated_set: 60}
"""Goals of the tasks."""


def clicks_of(task: Callable[[Walker], None], chromium: Browser, state: Path) -> int:
    """Number of clicks of a task in an editor of its own."""
    app = ViewerApp(ViewerOptions(port=0, state=state))
    page = chromium.new_page(viewport=VIEWPORT, accept_downloads=True)
    page.add_init_script(COUNTED)
    try:
        task(Walker(EditorPage(page, app)))
        return page.evaluate("presses")
    finally:
        page.close()
        app.stop()


def main() -> None:
    """Print clicks and minutes of both."""
    for task in MOST_CLICKS:
        with tempfile.TemporaryDirectory() as state, opened_chromium() as chromium:
            began = time.monotonic()
            clicks = clicks_of(task, chromium, Path(state))
            told = f"{clicks} clicks, {time.monotonic() - began:.0f} s;"
            print(task.__doc__, told, load_in_words())


if __name__ == "__main__":
    main()
