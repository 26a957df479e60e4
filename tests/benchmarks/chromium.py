"""A headless Chromium for benchmarks, and words about the machine's load."""

import contextlib
import os
import shutil
from collections.abc import Iterator

import numpy as np
from playwright.sync_api import Browser, sync_playwright

from tests.browser.conftest import CHROMIUM_ARGUMENTS, CHROMIUM_NAMES


def chromium_path() -> str | None:
    """Where Chromium is, if it is installed."""
    found = (shutil.which(name) for name in CHROMIUM_NAMES)
    return next((path for path in found if path), None)


@contextlib.contextmanager
def opened_chromium() -> Iterator[Browser]:
    """Chromium with software GL."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium_path(), args=CHROMIUM_ARGUMENTS
        )
        yield browser
        browser.close()


def load_in_words() -> str:
    """Load of the machine, without which its times mean nothing."""
    one, five, _ = os.getloadavg()
    return f"{os.cpu_count()} cores, load {one:.1f} (1 min) {five:.1f} (5 min)"


def spread(values: list[float] | np.ndarray, digits: int = 1) -> str:
    """Median, p95, least and greatest, and how many."""
    if not len(values):
        return "none"
    low, middle, high, top = np.percentile(values, [0, 50, 95, 100])
    return (
        f"median {middle:.{digits}f}  p95 {high:.{digits}f}  "
        f"min {low:.{digits}f}  max {top:.{digits}f}  (n={len(values)})"
    )
