"""The panel that opens scenarios."""

import pytest

from pd_editor.av2_io.write import scenario_files
from pd_editor.errors import InputError
from pd_editor.exporters.bundle import write_files
from pd_editor.viewer.panels.scenario_panel import NO_DEMO
from tests.builders import two_agents_that_pass
from tests.viewer.fake_browser import connected_tab, running_app


def test_the_menu_of_demos_names_the_one_that_is_open_if_any(tmp_path):
    """It named a demo that was not open, also after the page was loaded again."""
    folder = tmp_path / "scene"
    write_files(scenario_files(two_agents_that_pass()), folder, forbidden=None)
    with (
        running_app(tmp_path / "library", str(folder)) as app,
        connected_tab(app) as tab,
    ):
        panel = tab.tab.panels.scenario
        assert panel._demo.value == NO_DEMO
        with pytest.raises(InputError, match="Choose a demo"):
            panel._open_demo()
        panel._demo.value = "crosswalk"
        tab.run(panel._open_demo)
        assert panel._demo.value == "crosswalk"
        tab.run(lambda: tab.tab._workspace.open_reference(str(folder)))
        assert panel._demo.value == NO_DEMO
