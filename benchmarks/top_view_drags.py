"""Drags of agents in the top view, by a real mouse on real scenes.

Needs PD_EDITOR_AV2 and Chromium. Run as ``python -m benchmarks.top_view_drags``.
Each drag grabs one of one to five selected agents at random and takes it somewhere.
Wanted of every drag: all selected agents moved by what was dragged within 0.1 m, one
history entry, the same selection. The exit code tells whether all did.
"""

import argparse
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from playwright.sync_api import ViewportSize

from benchmarks.chromium import opened_chromium
from benchmarks.figures import load_in_words, spread
from pd_editor.viewer.scene.camera import projected
from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions
from tests.browser.editor_page import EditorPage

VIEWPORT = ViewportSize(width=1600, height=900)
ALLOWED_ERROR_M = 0.1
ROOF_M = 1.0
MIN_WIDTH_M = 0.6
MARGIN = 0.2
"""Share of the picture at its edges that elements of the page may cover."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One drag against what was asked for."""

    num_agents: int
    error_m: float
    num_entries: int
    keeps_selection: bool

    @property
    def is_right(self) -> bool:
        """Whether the drag did what was asked for, and nothing else."""
        return (
            self.error_m <= ALLOWED_ERROR_M
            and self.num_entries == 1
            and self.keeps_selection
        )


def seen_from_above(editor: EditorPage) -> None:
    """Go to the top view at t = 0, paused."""
    editor.until(lambda: editor.tab()._is_built, "the page")
    workspace = editor.workspace
    workspace.playback.pause()
    workspace.playback.seek(float(workspace.playback.axis.current_step))
    looked_at = editor.client.camera.update_timestamp
    editor.key("v")
    editor.until(
        lambda: (
            editor.client.camera.fov < 0.2
            and editor.client.camera.update_timestamp > looked_at
        ),
        "the top view",
    )
    editor.settle()


def within_reach(editor: EditorPage) -> tuple[np.ndarray, np.ndarray]:
    """Rows of agents that a pointer can hit, and their pixels on the page."""
    scenario = editor.session.scenario
    agents, step = scenario.agents, scenario.current_step
    rows = np.flatnonzero(agents.is_valid[:, step])
    points = np.column_stack(
        [agents.position_m[rows, step], np.full(len(rows), ROOF_M)]
    )
    screen, ahead = projected(editor.client.camera, points)
    inside = ahead & ((screen > MARGIN) & (screen < 1 - MARGIN)).all(axis=-1)
    gaps = np.linalg.norm(points[:, None, :2] - points[None, :, :2], axis=-1)
    np.fill_diagonal(gaps, np.inf)
    alone = gaps.min(axis=1) > agents.size_m[rows].max(axis=1) + 0.5
    # Thinner ones are missed by the whole pixels that a mouse points at.
    alone &= agents.size_m[rows].min(axis=1) >= MIN_WIDTH_M
    left, top, width, height = editor.page.evaluate(
        "(() => { const r = __viserMutable.canvas.getBoundingClientRect();"
        " return [r.left, r.top, r.width, r.height]; })()"
    )
    chosen = inside & alone
    return rows[chosen], np.round(
        screen[chosen] * [width, height] + [left, top]
    ).astype(int)


def metres_per_pixel(editor: EditorPage) -> float:
    """Of the ground, in the top view."""
    camera = editor.client.camera
    height_px = editor.page.evaluate("__viserMutable.canvas.clientHeight")
    reach = float(camera.position[2]) - ROOF_M
    return 2 * reach * float(np.tan(camera.fov / 2)) / height_px


def one_drag(editor: EditorPage, rng: np.random.Generator) -> Outcome | None:
    """Select, drag, compare; None where the picture has too few agents."""
    session, mouse = editor.session, editor.page.mouse
    editor.key("Escape")
    editor.settle()
    rows, pixels = within_reach(editor)
    count = int(rng.integers(1, 6))
    if len(rows) < count:
        return None
    picked = rng.choice(len(rows), count, replace=False)
    agents = session.scenario.agents
    ids = tuple(agents.ids[rows[index]] for index in picked)
    for number, index in enumerate(picked):
        if number:
            editor.page.keyboard.down("Shift")
        mouse.click(*map(int, pixels[index]))
        if number:
            editor.page.keyboard.up("Shift")
        editor.until(
            lambda number=number: session.selection == ids[: number + 1],
            f"{ids[number]} selected",
            20.0,
        )
    start = pixels[picked[int(rng.integers(count))]]
    shift = rng.integers(-150, 151, 2)
    shift[np.abs(shift) < 8] = 8
    before = session.scenario.agents.position_m[rows[picked], editor_step(editor)]
    entries = session.state.position
    selection = session.selection
    editor.drag_pixels(
        tuple(map(int, start)), tuple(int(value) for value in start + shift)
    )
    editor.until(lambda: session.state.position > entries, "the drag's end", 10.0)
    editor.settle()
    editor.page.wait_for_timeout(150)
    after = session.scenario.agents.position_m[rows[picked], editor_step(editor)]
    asked = metres_per_pixel(editor) * np.array([shift[0], -shift[1]])
    return Outcome(
        num_agents=count,
        error_m=float(np.linalg.norm(after - before - asked, axis=-1).max()),
        num_entries=session.state.position - entries,
        keeps_selection=session.selection == selection,
    )


def drags_of(folder: Path, count: int, rng: np.random.Generator) -> list[Outcome]:
    """Some drags on one scene, in a browser of its own."""
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as library, opened_chromium() as browser:
        app = ViewerApp(
            ViewerOptions(reference=str(folder), port=0, state=Path(library))
        )
        context = browser.new_context(viewport=VIEWPORT)
        try:
            editor = EditorPage(context.new_page(), app)
            seen_from_above(editor)
            for _ in range(count):
                outcome = one_drag(editor, rng)
                if outcome is not None:
                    outcomes.append(outcome)
                editor.key("Control+z")
        finally:
            context.close()
            app.stop()
    return outcomes


def editor_step(editor: EditorPage) -> int:
    """The step that edits act at."""
    return editor.session.scenario.current_step


def main() -> int:
    """Drag, and say what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drags", type=int, default=50)
    parser.add_argument("--scenes", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    folders = sorted((Path(os.environ["PD_EDITOR_AV2"]) / "val").glob("*/"))
    outcomes: list[Outcome] = []
    for folder in folders:
        missing = options.drags - len(outcomes)
        if missing <= 0:
            break
        each = -(-options.drags // options.scenes)
        found = drags_of(folder, min(each, missing), rng)
        outcomes += found
        wrong = [outcome for outcome in found if not outcome.is_right]
        print(f"{folder.name[:8]}: {len(found)} drags, wrong: {wrong}", flush=True)
    right = sum(outcome.is_right for outcome in outcomes)
    print(f"{right} of {len(outcomes)} drags right; {load_in_words()}")
    print("error (m):", spread([outcome.error_m for outcome in outcomes], 3))
    return int(right < options.drags)


if __name__ == "__main__":
    sys.exit(main())
