"""Files of other formats in the browser: empty maps, their framing and their downloads."""

import zipfile

import numpy as np
import pytest

from pd_editor.viewer.interaction.camera import projected
from tests.browser.test_files_and_sessions import notice, upload
from tests.scene.formats.test_commonroad import text as commonroad_text
from tests.scene.formats.test_opendrive import LINE, lane, road, section, write

pytestmark = pytest.mark.browser

LONG = LINE.replace('length="50"', 'length="400"')


def test_an_empty_map_is_shown_whole_and_asks_to_be_filled(open_editor, tmp_path):
    path = write(tmp_path, road(section(lane(-1), lane(1)), geometry=LONG, length=400))
    editor = open_editor()
    upload(editor, "empty.xodr", path.read_bytes())
    editor.until(lambda: not len(editor.session.scenario.agents), "the road")
    notice(editor, "Fill the road")
    editor.settle()
    lines = np.concatenate(editor.session.scenario.road_map.polylines)
    screen, is_ahead = projected(editor.client.camera, lines * [1, 1, 0])
    assert is_ahead.all()
    assert ((screen > 0) & (screen < 1)).all(), "the whole road is in the picture"
    assert np.ptp(screen, axis=0).max() > 0.5, "and not from too far away"
    assert editor.page.get_by_text("Click a car").count() == 0


def test_a_commonroad_scene_is_downloaded_as_commonroad(open_editor, tmp_path):
    editor = open_editor()
    upload(editor, "scene.xml", commonroad_text().encode())
    name = "ZAM_Road-1_1_T-1"
    editor.until(lambda: editor.session.scenario.scenario_id == name, "the scene")
    editor.choose("Format", "CommonRoad")
    with editor.page.expect_download() as download:
        editor.press("Download zip")
    files = zipfile.ZipFile(download.value.path()).namelist()
    assert f"{name}/{name}.xml" in files
