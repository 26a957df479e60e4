"""A tab on two vehicles that pass each other, without a browser."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from tests.builders import two_agents_that_pass
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app


@pytest.fixture
def tab(tmp_path: Path) -> Iterator[FakeTab]:
    folder = tmp_path / "scene"
    write_files(scenario_files(two_agents_that_pass()), folder, forbidden=None)
    with (
        running_app(tmp_path / "library", str(folder)) as app,
        connected_tab(app) as opened,
    ):
        opened.tab.workspace.playback.pause()
        yield opened
