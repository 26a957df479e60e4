"""Checks array shapes at run time in every test, and finds the real data."""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

import tests.shape_checker  # noqa: F401  (named by the hook below)

_hook = install_import_hook("pd_editor", "tests.shape_checker.check")
_hook.__enter__()

# Times are for benchmarks; a busy machine is no fault of the code.
settings.register_profile("without-deadline", deadline=None)
settings.load_profile("without-deadline")


def pytest_configure() -> None:
    """Let programs that tests start heed Ctrl-C, even where tests run in the background.

    A shell without job control lets background commands ignore it, and their children
    inherit that.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


# First, as pytest-xdist reads the groups in the same hook.
@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Share tests among processes by file, those in a browser as one group, first.

    They share one Chromium and wait more than they compute, so other tests run beside
    them.
    """
    items.sort(key=lambda item: item.get_closest_marker("browser") is None)
    for item in items:
        is_browser = item.get_closest_marker("browser") is not None
        group = "browser" if is_browser else item.nodeid.partition("::")[0]
        item.add_marker(pytest.mark.xdist_group(group))


@pytest.fixture(scope="session")
def av2_root() -> Path:
    """Root of real Argoverse 2 scenarios; skips aloud where there is none."""
    root = os.environ.get("PD_EDITOR_AV2")
    if not root or not Path(root).is_dir():
        pytest.skip("PD_EDITOR_AV2 names no folder of Argoverse 2 scenarios")
    return Path(root)


@pytest.fixture(scope="session")
def av2_scenario_folders(av2_root: Path) -> list[Path]:
    """Every real scenario folder (train, val and test50), sorted."""
    return sorted(
        path.parent
        for split in ("train", "val", "test50")
        for path in (av2_root / split).glob("*/scenario_*.parquet")
    )
