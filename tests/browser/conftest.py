"""A headless Chromium, and editors to open in it.

``PD_EDITOR_SLOW_PAGE=6`` slows the pages down to a sixth: a test that looks at a page before
the page shows the state of the server then fails.
"""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.browser.editor_page import EditorPage

CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM_ARGUMENTS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
]
VIEWPORT = {"width": 1000, "height": 640}


@pytest.fixture(scope="session")
def browser() -> Iterator:
    """One Chromium for all tests; skips aloud where there is none."""
    found = [path for name in CHROMIUM_NAMES if (path := shutil.which(name))]
    if not found:
        pytest.skip("no Chromium on this machine: install it to run the browser tests")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=found[0], args=CHROMIUM_ARGUMENTS
        )
        yield chromium
        chromium.close()


@pytest.fixture
def open_editor(browser, tmp_path: Path) -> Iterator[Callable[..., EditorPage]]:
    """Opens pages on editors of their own; closes them all after the test."""
    from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions

    apps, contexts = [], []

    def opened(*, app=None, context=None, **options) -> EditorPage:
        if app is None:
            defaults = {
                "reference": "signalised-junction",
                "port": 0,
                "state": tmp_path / "state",
            }
            app = ViewerApp(ViewerOptions(**{**defaults, **options}))
            apps.append(app)
        if context is None:
            context = browser.new_context(viewport=VIEWPORT, accept_downloads=True)
            contexts.append(context)
        page = context.new_page()
        if factor := os.environ.get("PD_EDITOR_SLOW_PAGE"):
            context.new_cdp_session(page).send(
                "Emulation.setCPUThrottlingRate", {"rate": float(factor)}
            )
        return EditorPage(page, app)

    yield opened
    for context in contexts:
        context.close()
    for app in apps:
        app.stop()
