"""The panel that opens scenarios."""

import numpy as np
import pytest

from pd_editor.editor.commands import TransformAgents
from pd_editor.scene import scene_limits
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.base_reference import MapWindow, SceneCut
from pd_editor.scene.bundle import write_files
from tests.editor.same_scenario import same_scenario
from tests.scene.test_time_cut import long_recording, recording_of_minutes
from tests.viewer.fake_browser import connected_tab, running_app

UPLOAD = "Upload files"


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
        (key,) = tab.tiles("unfinished")
        tab.choose("unfinished", key)
        assert tab.session.scenario.time_axis.num_steps == 110
        assert same_scenario(tab.session.scenario, edited)


@pytest.mark.parametrize("is_upload", [False, True])
def test_a_moment_of_a_recording_of_minutes_is_asked_for(tmp_path, is_upload):
    """It was refused, with options of the shell."""
    path = recording_of_minutes(tmp_path / "data")
    with running_app(tmp_path / "library", "queue") as app, connected_tab(app) as tab:

        def open_file() -> None:
            if is_upload:
                tab.upload(UPLOAD, path.name, path.read_bytes())
            else:
                tab.type("Folder", str(path))
                tab.press("Open folder")

        open_file()
        assert " lasts 163.5 s; at most 100 s are" in tab.text()
        asked = tab.field("Current moment (s)"), tab.field("Until (s)")
        # The file's own moment, and what models sample.
        assert [one.value for one in asked] == [73.6, 6.0]
        tab.enter(tab.inputs()["Cancel"][-1], True)
        assert not tab.inputs().get("Until (s)")
        assert tab.session.base.scenario_id == "queue"
        open_file()
        tab.type("Current moment (s)", 60.0)
        tab.type("Until (s)", 80.0)
        assert tab.field("Current moment (s)").max == 163.5
        tab.press("Open this part")
        assert not tab.inputs().get("Until (s)")
        axis, base = tab.session.base.time_axis, tab.session.base
        assert (axis.current_step, axis.num_steps) == (49, 850)
        # What models sample of the same moment, and another moment of the whole.
        tab.press("Keep 6 s after t = 0")
        assert tab.session.base.time_axis.num_steps == 110
        same = tab.session.base.agents.cut_to(slice(110)).position_m
        shift = base.origin_city_m - tab.session.base.origin_city_m
        ids = tab.session.base.agents.ids
        rows = base.agents.rows(ids)
        there = tab.session.base.agents.is_valid
        moved = base.agents.cut_to(slice(110)).position_m[rows] + shift
        np.testing.assert_allclose(same[there], moved[there], atol=1e-6)
        tab.press("Open the whole recording")
        tab.type("Current moment (s)", 90.0)
        tab.press("Open this part")
        assert tab.session.base.provenance.cut == SceneCut(current_s=90.0, until_s=6.0)
        square = MapWindow(x_m=0.0, y_m=0.0, radius_m=50.0)
        tab.run(lambda: tab.tab.workspace.lanes_of_file())
        tab.run(lambda: tab.tab.workspace.open_window(square))
        cut = SceneCut(current_s=90.0, until_s=6.0, window=square)
        assert tab.session.base.provenance.cut == cut


def test_a_moment_of_a_large_map_is_asked_for_before_a_part_of_it(
    tmp_path, monkeypatch
):
    path = recording_of_minutes(tmp_path / "data")
    with running_app(tmp_path / "library", "queue") as app, connected_tab(app) as tab:
        monkeypatch.setattr(scene_limits, "MAX_LANES", 8)
        tab.type("Folder", str(path))
        tab.press("Open folder")
        tab.type("Current moment (s)", 60.0)
        tab.press("Open this part")
        card = tab.shown("mapWindow")
        assert "drag a square" in card["title"]
        tab.hear("mapWindow", kind="open", square=[*card["square"][:2], 20])
        x, y = card["square"][:2]
        square = MapWindow(x_m=x, y_m=y, radius_m=20.0)
        cut = SceneCut(current_s=60.0, until_s=6.0, window=square)
        assert tab.session.base.provenance.cut == cut
