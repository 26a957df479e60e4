"""The panel that opens scenarios."""

import pytest

from pd_editor.base.errors import InputError
from pd_editor.editor.commands import TransformAgents
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.exporters.bundle import write_files
from pd_editor.viewer.files.scenario_panel import NO_DEMO
from tests.builders import two_agents_that_pass
from tests.editor.same_scenario import same_scenario
from tests.scene.test_time_cut import long_recording
from tests.viewer.fake_browser import connected_tab, running_app


def test_the_menu_of_demos_names_the_one_that_is_open_if_any(tmp_path):
    """It named a demo that was not open, also after the page was loaded again."""
    folder = tmp_path / "scene"
    write_files(scenario_files(two_agents_that_pass()), folder, forbidden=None)
    with (
        running_app(tmp_path / "library", str(folder)) as app,
        connected_tab(app) as tab,
    ):
        panel = tab.elements.scenario
        assert panel._demo.value == NO_DEMO
        with pytest.raises(InputError, match="Choose a demo"):
            panel._open_demo()
        panel._demo.value = "crosswalk"
        tab.run(panel._open_demo)
        assert panel._demo.value == "crosswalk"
        tab.run(lambda: tab.tab.workspace.open_reference(str(folder)))
        assert panel._demo.value == NO_DEMO


@pytest.mark.parametrize("is_upload", [False, True])
def test_a_long_recording_is_cut_by_a_button_and_opened_whole_again(
    tmp_path, is_upload
):
    """Nothing but the shell could cut it, so that no model sampled it (public case 8)."""
    files = scenario_files(long_recording())
    write_files(files, tmp_path / "long", forbidden=None)
    with running_app(tmp_path / "library", "queue") as app, connected_tab(app) as tab:
        workspace = tab.tab.workspace
        button = tab.elements.scenario._cut
        assert not button.visible
        if is_upload:
            tab.run(lambda: workspace.open_upload(files))
        else:
            tab.run(lambda: workspace.open_reference(str(tmp_path / "long")))
        for num_steps, label in (
            (200, "Keep 6 s after t = 0"),
            (110, "Open the whole"),
        ):
            assert workspace.session.base.time_axis.num_steps == num_steps
            assert button.visible
            assert button.label.startswith(label)
            tab.run(workspace.open_cut)
        assert workspace.session.base.time_axis.num_steps == 200


def test_an_edited_upload_that_was_cut_comes_back_after_a_restart(tmp_path):
    files = scenario_files(long_recording())
    with running_app(tmp_path / "library", "queue") as app, connected_tab(app) as tab:
        workspace = tab.tab.workspace
        tab.run(lambda: workspace.open_upload(files))
        tab.run(workspace.open_cut)
        name = workspace.session.scenario.focal_id
        tab.run(
            lambda: workspace.session.apply(
                TransformAgents(agent_ids=(name,), dx_m=1.0)
            )
        )
        edited = workspace.session.scenario
    with running_app(tmp_path / "library", "queue") as app, connected_tab(app) as tab:
        workspace = tab.tab.workspace
        (work,) = workspace.shelf.unfinished()
        tab.run(lambda: workspace.resume(work))
        assert workspace.session.scenario.time_axis.num_steps == 110
        assert same_scenario(workspace.session.scenario, edited)
