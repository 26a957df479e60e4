"""The panel that opens scenarios."""

import pytest

from pd_editor.editor.commands import TransformAgents
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.exporters.bundle import write_files
from pd_editor.viewer.files.scenario_panel import NO_DEMO
from tests.builders import two_agents_that_pass
from tests.editor.same_scenario import same_scenario
from tests.scene.test_time_cut import long_recording
from tests.viewer.fake_browser import connected_tab, running_app

UPLOAD = "Upload zip, or parquet and map"


def test_the_menu_of_demos_names_the_one_that_is_open_if_any(tmp_path):
    """It named a demo that was not open, also after the page was loaded again."""
    folder = tmp_path / "scene"
    write_files(scenario_files(two_agents_that_pass()), folder, forbidden=None)
    with (
        running_app(tmp_path / "library", str(folder)) as app,
        connected_tab(app) as tab,
    ):
        demo = tab.field("Demo")
        assert demo.value == NO_DEMO
        tab.press("Open demo")
        assert "Choose a demo" in tab.refusal()
        tab.type("Demo", "crosswalk")
        tab.press("Open demo")
        assert tab.session.base.scenario_id == "crosswalk"
        assert demo.value == "crosswalk"
        tab.type("Folder", str(folder))
        tab.press("Open folder")
        assert demo.value == NO_DEMO
        # Also one that was opened otherwise is named.
        tab.run(lambda: tab.tab.workspace.open_reference("merge"))
        assert demo.value == "merge"


@pytest.mark.parametrize("is_upload", [False, True])
def test_a_long_recording_is_cut_by_a_button_and_opened_whole_again(
    tmp_path, is_upload
):
    """Nothing but the shell could cut it, so that no model sampled it (public case 8)."""
    files = scenario_files(long_recording())
    write_files(files, tmp_path / "long", forbidden=None)
    with running_app(tmp_path / "library", "queue") as app, connected_tab(app) as tab:
        cut, whole = "Keep 6 s after t = 0", "Open the whole recording"

        def offered() -> list[str]:
            found = ((one, tab.inputs().get(one, [])) for one in (cut, whole))
            return [
                one for one, (*handles,) in found if any(h.visible for h in handles)
            ]

        assert offered() == []
        if is_upload:
            for name, content in files.items():
                tab.upload(UPLOAD, name, content)
        else:
            tab.type("Folder", str(tmp_path / "long"))
            tab.press("Open folder")
        for num_steps, label in ((200, cut), (110, whole)):
            assert tab.session.base.time_axis.num_steps == num_steps
            assert offered() == [label]
            tab.press(label)
        assert tab.session.base.time_axis.num_steps == 200


def test_an_edited_upload_that_was_cut_comes_back_after_a_restart(tmp_path):
    files = scenario_files(long_recording())
    with running_app(tmp_path / "library", "queue") as app, connected_tab(app) as tab:
        for name, content in files.items():
            tab.upload(UPLOAD, name, content)
        tab.press("Keep 6 s after t = 0")
        move = TransformAgents(agent_ids=(tab.session.scenario.focal_id,), dx_m=1.0)
        tab.run(lambda: tab.ui.apply(move))
        edited = tab.session.scenario
    with running_app(tmp_path / "library", "queue") as app, connected_tab(app) as tab:
        tab.press("Unfinished work (1)")
        (label,) = (one for one in tab.inputs() if " · 1 edit, last " in one)
        tab.press(label)
        assert tab.session.scenario.time_axis.num_steps == 110
        assert same_scenario(tab.session.scenario, edited)
