"""Makes the README's pictures from the editor itself: ``python -m assets.make_pictures``.

Needs Chromium, Playwright and Pillow (``.[dev]``). The moving picture shows a demo whose road
is warped step by step while the traffic plays.
"""

import io
import shutil
import tempfile
from pathlib import Path
from typing import Final

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from pd_editor.viewer.viewer_app import ViewerApp

PICTURES: Final = Path(__file__).parents[1] / "docs" / "pictures"
DEMO: Final = "winding-street"
SLIDER: Final = "S-bend"
NUM_FRAMES: Final = 40
FRAME_MS: Final = 110
SETTLE_MS: Final = 500
MAX_POWER: Final = 7.0
SIZE_PX: Final = (1280, 720)
WIDTH_PX: Final = 800
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
        page = browser.new_page(viewport={"width": SIZE_PX[0], "height": SIZE_PX[1]})
        page.goto(app.address)
        _prepare(page)
        frames = [_frame(page, number) for number in range(NUM_FRAMES)]
        browser.close()
        app.stop()
    first, *others = frames
    first.save(
        PICTURES / "warp.webp",
        save_all=True,
        append_images=others,
        duration=FRAME_MS,
        loop=0,
        quality=60,
        method=6,
    )


def _prepare(page: Page) -> None:
    """Wait for the page, stop playback at t = 0, and put notices and hints away."""
    page.get_by_role("tab", name="Road", exact=True).click(timeout=60_000)
    page.wait_for_timeout(3000)
    page.evaluate(
        "document.querySelectorAll('.mantine-Notification-closeButton')"
        ".forEach(button => button.click())"
    )
    page.get_by_role("button", name="Close the hints").click()
    page.get_by_role("button", name="Pause", exact=True).click()
    page.get_by_role("button", name="t = 0", exact=True).click()
    page.wait_for_timeout(500)


def _frame(page: Page, number: int) -> Image.Image:
    """One frame: there and back between the original road and the sharpest warp."""
    phase = number / NUM_FRAMES
    power = round(MAX_POWER * (1.0 - abs(2.0 * phase - 1.0)), 1)
    row = page.locator(
        f"xpath=//label[normalize-space()='{SLIDER}']"
        "/ancestor::div[contains(@class,'Flex-root')][1]"
    ).first
    field = row.locator("input:not([type=hidden])").last
    field.fill(str(power))
    field.press("Enter")
    page.evaluate("document.activeElement && document.activeElement.blur()")
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(SETTLE_MS)
    image = Image.open(io.BytesIO(page.screenshot()))
    height = round(image.height * WIDTH_PX / image.width)
    return image.convert("RGB").resize((WIDTH_PX, height), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    main()
