"""Makes the README's pictures from the editor itself: ``python -m assets.make_pictures``.

Needs Chromium, Playwright and Pillow (``.[dev]``). The moving picture shows a demo whose road
is warped step by step while the traffic plays.
"""

import io
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from pd_editor.editor.commands import SetRoadWarp
from pd_editor.perturbation.anchor import pose_of_anchor
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M, RoadWarp, WarpTerm
from pd_editor.viewer.viewer_app import ViewerApp

PICTURES: Final = Path(__file__).parents[1] / "docs" / "pictures"
DEMO: Final = "merge"
NUM_FRAMES: Final = 44
FRAME_MS: Final = 90
MAX_POWER: Final = 7.0
VIEWPORT: Final = {"width": 1280, "height": 720}
WIDTH_PX: Final = 760
CHROMIUM_ARGUMENTS: Final = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)


def main() -> None:
    """Write ``warp.webp``."""
    with tempfile.TemporaryDirectory() as library, sync_playwright() as playwright:
        app = ViewerApp(reference=DEMO, port=0, library=Path(library))
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(CHROMIUM_ARGUMENTS)
        )
        page = browser.new_page(viewport=VIEWPORT)  # pyright: ignore[reportArgumentType]
        page.goto(app.address)
        workspace = _workspace(app, page)
        frames = [_frame(page, workspace, number) for number in range(NUM_FRAMES)]
        browser.close()
        app.stop()
    first, *others = frames
    first.save(
        PICTURES / "warp.webp",
        save_all=True,
        append_images=others,
        duration=FRAME_MS,
        loop=0,
        quality=70,
        method=6,
    )


def _workspace(app: ViewerApp, page: Page) -> Any:
    """The tab's workspace, once the page is complete and software toasts are gone."""
    page.get_by_role("tab", name="Agents").wait_for(timeout=60_000)
    end = time.monotonic() + 60.0
    while not app.workspaces() and time.monotonic() < end:
        page.wait_for_timeout(100)
    page.wait_for_timeout(3000)
    page.evaluate(
        "document.querySelectorAll('.mantine-Notification-closeButton')"
        ".forEach(button => button.click())"
    )
    (workspace,) = app.workspaces()
    workspace.playback.pause()
    return workspace


def _frame(page: Page, workspace: Any, number: int) -> Image.Image:
    """One frame: there and back between the original road and the sharpest warp."""
    phase = number / NUM_FRAMES
    power = MAX_POWER * (1.0 - abs(2.0 * phase - 1.0))
    base = workspace.session.base
    term = WarpTerm(
        kind="double-turn", power=power, length_m=DEFAULT_LENGTH_M["double-turn"]
    )
    warp = RoadWarp(anchor=pose_of_anchor(base, "focal"), terms=(term,))
    workspace.session.preview(
        SetRoadWarp(warp=warp if power else None, friction_coefficient=None)
    )
    axis = workspace.playback.axis
    workspace.playback.seek(axis.current_step + phase * axis.num_future_steps)
    page.wait_for_timeout(400)
    canvas = page.locator("canvas").first
    image = Image.open(io.BytesIO(canvas.screenshot()))
    height = round(image.height * WIDTH_PX / image.width)
    return image.convert("RGB").resize((WIDTH_PX, height), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    main()
