"""Checks array shapes at run time in unit tests, and finds the real data."""

import os
import signal
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

import tests.shape_checker  # noqa: F401  (named by the hook below)
from tests.oracles.environment import NoOracleError, Oracle
from tests.oracles.environment import oracle as made_oracle

# Times are for benchmarks; a busy machine is no fault of the code.
settings.register_profile("without-deadline", deadline=None)
settings.load_profile("without-deadline")


BROWSER_TESTS = "tests/browser/"


UNIT_TESTS = ("base", "scene", "analysis", "generation", "editor", "experiments")
"""Folders whose quick tests check the shapes of all arrays; that doubles their time."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the choice of tests by whether they check shapes."""
    parser.addoption(
        "--shapes",
        choices=("all", "only", "none", "off"),
        default="all",
        help="check shapes in all tests; run only those that do, or only all others; "
        "run all and check none",
    )


def checks_shapes(item: pytest.Item) -> bool:
    """Whether a test is a quick unit test."""
    in_units = item.nodeid.split("/")[1] in UNIT_TESTS
    return in_units and item.get_closest_marker("slow") is None


def pytest_configure(config: pytest.Config) -> None:
    """Check shapes from here on; let programs that tests start heed Ctrl-C.

    A shell without job control lets background commands ignore it, and their children
    inherit that.
    """
    if config.getoption("--shapes") in ("all", "only"):
        install_import_hook("pd_editor", "tests.shape_checker.check").__enter__()
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Select by shapes; begin with the tests in a browser, which take longest together.

    Those are tried once more, since a busy machine may starve a page; the summary lists
    them, and one that is listed twice has a fault.
    """
    wanted = config.getoption("--shapes")
    if wanted in ("only", "none"):
        leaves = [one for one in items if checks_shapes(one) != (wanted == "only")]
        config.hook.pytest_deselected(items=leaves)
        items[:] = [one for one in items if checks_shapes(one) == (wanted == "only")]
    for one in items:
        if one.get_closest_marker("browser"):
            one.add_marker(pytest.mark.flaky(reruns=1))
    items.sort(key=lambda item: scope_of(item.nodeid) != BROWSER_TESTS)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Skip tests that ask av2's loaders on a Python that av2 has no build for."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != "av2" or sys.version_info < (3, 13):
            raise
        pytest.skip(f"{item.name}: av2 has no build for this Python")


class TestShares(LoadScopeScheduling):
    """Shares tests among processes: by file, those in a browser as one.

    They share one Chromium and wait more than they compute, so other tests run beside
    them.
    """

    __test__ = False

    def _split_scope(self, nodeid: str) -> str:
        return scope_of(nodeid)


def scope_of(nodeid: str) -> str:
    """Folder or file whose tests run in one process."""
    if nodeid.startswith(BROWSER_TESTS):
        return BROWSER_TESTS
    return nodeid.partition("::")[0]


def pytest_xdist_make_scheduler(
    config: pytest.Config, log: Producer | None
) -> TestShares:
    """The scheduler of ``--numprocesses``; groups of marks have no effect in pytest 9.2."""
    return TestShares(config, log)


@pytest.fixture
def no_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run work items in this process, for a new one imports torch, which takes seconds."""
    from pd_editor.experiments.work_engine.local_processes import LocalProcesses
    from pd_editor.experiments.work_engine.work_engine import InThisProcess

    def run(_: LocalProcesses, *arguments: Any, **named: Any) -> None:
        InThisProcess().run(*arguments, **named)

    monkeypatch.setattr(LocalProcesses, "run", run)


@pytest.fixture(scope="session")
def av2_root() -> Path:
    """Root of real Argoverse 2 scenarios; skips aloud where there is none."""
    root = os.environ.get("PD_EDITOR_AV2")
    if not root or not Path(root).is_dir():
        pytest.skip("PD_EDITOR_AV2 names no folder of Argoverse 2 scenarios")
    return Path(root)


@pytest.fixture(scope="session")
def format_files(av2_root: Path) -> Path:
    """Real files of other formats, beside the Argoverse 2 data."""
    folder = av2_root.parent / "formats"
    if not folder.is_dir():
        pytest.skip(f"there is no {folder}")
    return folder


@pytest.fixture(scope="session")
def av2_scenario_folders(av2_root: Path) -> list[Path]:
    """Every real scenario folder (train, val and test50), sorted."""
    return sorted(
        path.parent
        for split in ("train", "val", "test50")
        for path in (av2_root / split).glob("*/scenario_*.parquet")
    )


@pytest.fixture(scope="session")
def say(pytestconfig: pytest.Config) -> Callable[[str], None]:
    """Writes a line that no capturing hides."""
    reporter = pytestconfig.pluginmanager.get_plugin("terminalreporter")
    capture = pytestconfig.pluginmanager.get_plugin("capturemanager")

    def write(text: str) -> None:
        if reporter is None or capture is None:
            return
        with capture.global_and_fixture_disabled():
            reporter.ensure_newline()
            reporter.write_line(text)

    return write


@pytest.fixture(scope="session")
def oracle(say: Callable[[str], None]) -> Callable[[str], Oracle]:
    """Makes the environment of a name of ``tests/oracles``; skips aloud where it cannot."""

    def made(name: str) -> Oracle:
        try:
            return made_oracle(name)
        except NoOracleError as error:
            reason = f"the oracle {name} cannot be installed here: {error}"
            say(f"SKIPPED: {reason}")
            pytest.skip(reason)

    return made
