"""Makes the pictures of the editor from the editor itself: ``python -m assets.make_pictures``.

Needs Chromium, Playwright and Pillow (``.[dev]``). ``python -m assets.make_pictures
guide`` makes those whose names are given. Each picture holds the version of the editor
that it shows, ``STAMP``, which a test compares.
"""

import io
import re
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions

ROOT: Final = Path(__file__).parents[1]
PICTURES: Final = ROOT / "docs" / "pictures"
SLIDER: Final = "S-bend"
NUM_FRAMES: Final = 30
FRAME_MS: Final = 140
SETTLE_MS: Final = 500
MAX_POWER: Final = 7.0
SIZE_PX: Final = (1280, 720)
WIDTH_PX: Final = 800
PATIENCE_MS: Final = 120_000
SOFTWARE: Final = 0x0131
"""Field of a picture's metadata (EXIF) for the program that made it."""
CHROMIUM_ARGUMENTS: Final = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)


def stamp() -> str:
    """Version of the editor, with what catches the eye when it changes: the tabs."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    panel = ROOT / "pd_editor" / "viewer" / "controls" / "tab_elements.py"
    tabs = re.findall(r"add_tab\(\"?(\w+)", panel.read_text())
    return f"pd-editor {project['version']}: {' '.join(tabs).lower()}"


def warp(page: Page) -> list[Image.Image]:
    """A road that is bent and unbent while the traffic plays."""
    open_tab(page, "Road")
    return [_bent(page, number) for number in range(NUM_FRAMES)]


def samples(page: Page) -> list[Image.Image]:
    """All traffic resampled, with the cards of four samples to choose among."""
    open_tab(page, "Generate")
    page.get_by_role("spinbutton", name="Samples").fill("4")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Resample everybody").click()
    strip = page.get_by_role("region", name="Samples", exact=True)
    cards = strip.get_by_role("listbox").get_by_role("option")
    cards.nth(3).wait_for(timeout=PATIENCE_MS)
    _quiet(page)
    for key in ("v", "Home"):
        page.keyboard.press(key)
        page.wait_for_timeout(4 * SETTLE_MS)
    return [_seen(page)]


def guide(page: Page) -> list[Image.Image]:
    """What could happen to the ego, drawn and listed."""
    open_tab(page, "Agents")
    page.get_by_role("button", name=re.compile("What could happen")).click()
    rows = page.locator(".pd-possible-line")
    rows.first.wait_for(timeout=PATIENCE_MS)
    rows.nth(1).hover()
    page.wait_for_timeout(2 * SETTLE_MS)
    return [_seen(page)]


MAKERS: Final[Mapping[str, tuple[str, Callable[[Page], list[Image.Image]]]]] = {
    "warp": ("winding-street", warp),
    "resampled": ("roundabout", samples),
    "guide": ("signalised-junction", guide),
}
"""Demo and maker of each picture."""


def main() -> None:
    """Write the pictures that are named, or all."""
    names = sys.argv[1:] or list(MAKERS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(CHROMIUM_ARGUMENTS)
        )
        for name in names:
            demo, make = MAKERS[name]
            with tempfile.TemporaryDirectory() as library:
                app = ViewerApp(
                    ViewerOptions(reference=demo, port=0, state=Path(library))
                )
                # The page draws no smooth edges without a GPU.
                page = browser.new_page(
                    viewport={"width": SIZE_PX[0], "height": SIZE_PX[1]},
                    device_scale_factor=2,
                )
                page.goto(app.address)
                _prepare(page)
                _write(PICTURES / f"{name}.webp", make(page))
                page.close()
                app.stop()
        browser.close()


def _write(path: Path, frames: list[Image.Image]) -> None:
    exif = Image.Exif()
    exif[SOFTWARE] = stamp()
    options: dict[str, Any] = {"quality": 80}
    if len(frames) > 1:
        frames = [
            one.resize(
                (WIDTH_PX, round(one.height * WIDTH_PX / one.width)),
                Image.Resampling.LANCZOS,
            )
            for one in frames
        ]
        options = {"save_all": True, "append_images": frames[1:], "quality": 55}
        options |= {"duration": FRAME_MS, "loop": 0}
    frames[0].save(path, exif=exif, method=6, **options)


def open_tab(page: Page, name: str) -> None:
    """Show a tab of the panel."""
    page.get_by_role("tab", name=name, exact=True).click(timeout=PATIENCE_MS)
    page.wait_for_timeout(SETTLE_MS)


def _prepare(page: Page) -> None:
    """Wait for the page, stop playback at t = 0, and put notices and hints away."""
    open_tab(page, "Scene")
    page.wait_for_timeout(6 * SETTLE_MS)
    page.get_by_role("button", name="Close the hints").click()
    page.get_by_role("button", name="Pause", exact=True).click()
    page.get_by_role("button", name="t = 0", exact=True).click()
    _quiet(page)


def _quiet(page: Page) -> None:
    """Close notices, and let what is being drawn end."""
    page.evaluate(
        "document.querySelectorAll('.mantine-Notification-closeButton')"
        ".forEach(button => button.click())"
    )
    page.evaluate("document.activeElement && document.activeElement.blur()")
    page.wait_for_timeout(2 * SETTLE_MS)


def _seen(page: Page) -> Image.Image:
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    return picture.resize(SIZE_PX, Image.Resampling.LANCZOS)


def _row(page: Page, label: str) -> Any:
    return page.locator(
        f"xpath=//label[normalize-space()='{label}']"
        "/ancestor::div[contains(@class,'Flex-root')][1]"
    ).first


def _bent(page: Page, number: int) -> Image.Image:
    """One frame: there and back between the original road and the sharpest warp."""
    phase = number / NUM_FRAMES
    power = round(MAX_POWER * (1.0 - abs(2.0 * phase - 1.0)), 1)
    field = _row(page, SLIDER).locator("input:not([type=hidden])").last
    field.fill(str(power))
    field.press("Enter")
    page.evaluate("document.activeElement && document.activeElement.blur()")
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(SETTLE_MS)
    return _seen(page)


if __name__ == "__main__":
    main()
