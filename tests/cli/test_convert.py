"""``pd-editor convert``, and scenes of other formats in the other commands."""

import json
import shutil
from pathlib import Path

import pytest

from pd_editor.editor import scenario_store
from pd_editor.editor.scenario_store import (
    LOSSES_NAME,
    is_foreign,
    open_scenario,
    scenario_and_recipe,
)
from pd_editor.scene.formats.registry import read_scene
from pd_editor.scene.scenario import Scenario
from tests.cli.shell import Shell
from tests.scene.formats.test_commonroad import text as commonroad_text
from tests.scene.formats.test_opendrive import lane, road, section
from tests.scene.formats.test_opendrive import write as write_road
from tests.scene.formats.test_recordings import as_gpudrive
from tests.scene.test_map_window import city


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A folder with a CommonRoad scene and, below it, an OpenDRIVE road."""
    folder = tmp_path / "foreign"
    (folder / "roads").mkdir(parents=True)
    (folder / "scene.xml").write_text(commonroad_text())
    write_road(folder / "roads", road(section(lane(-1), lane(1))))
    (folder / "other.xml").write_text("<html/>")
    return folder


def test_scenes_of_a_folder_are_converted_and_open_again(
    shell: Shell, foreign: Path, tmp_path: Path
):
    out = tmp_path / "out"
    result = shell.run(
        "convert", foreign, "roundabout", "--to", "commonroad", "--out", out
    )
    assert result.code == 0
    road = out / "road"
    assert sorted(one.name for one in out.iterdir()) == [
        "ZAM_Road-1_1_T-1",
        "road",
        "roundabout",
    ]
    # An empty road has no ego, whose start would be the planning problem.
    assert "planning problem" in (road / LOSSES_NAME).read_text()
    result = shell.run("convert", road, "--to", "gpudrive", "--out", tmp_path / "json")
    assert result.code == 2
    assert "neither ego nor focal agent" in result.err
    assert (out / "roundabout" / LOSSES_NAME).exists()
    again = open_scenario(out / "roundabout")
    assert len(again.road_map.lanes) == len(open_scenario("roundabout").road_map.lanes)
    # What is there stays.
    result = shell.run(
        "convert", "roundabout", "crosswalk", "--to", "commonroad", "--out", out
    )
    assert result.code == 0
    assert "done before" in result.out
    back = tmp_path / "back"
    result = shell.run("convert", out / "roundabout", "--to", "av2", "--out", back)
    folder, told = result.lines
    assert (result.code, folder) == (0, str(back / "roundabout"))
    assert told.startswith("AV is the start of planning problem")
    assert not (back / "roundabout" / LOSSES_NAME).exists()


def test_a_bare_road_is_filled_with_traffic(
    shell: Shell, foreign: Path, tmp_path: Path
):
    path = foreign / "roads" / "road.xodr"
    out = tmp_path / "out"
    result = shell.run(
        "generate", path, "--num-agents", "3", "--out", out, "--name", "full"
    )
    assert result.code == 0, result.err
    assert len(open_scenario(out / "full").agents) == 3


def test_formats_that_cannot_be_written_are_refused_before_anything_is_read(
    shell: Shell, tmp_path: Path
):
    for command in (("convert", "nothing", "--to"), ("export", "nothing", "--to")):
        told = shell.refused(*command, "lanelet2", "--out", tmp_path / "x")
        assert told == (
            "No format 'lanelet2' can be written; there are av2, commonroad, "
            "gpudrive, opendrive, scenarionet, sumo, tables, player, mp4, webm, gif, "
            "pdf, svg, png."
        )
    told = shell.refused(
        "export", "queue", "--format", "commonroad", "--verify", "--out", tmp_path / "x"
    )
    assert "--verify is for av2" in told
    assert not (tmp_path / "x").exists()


def test_an_uploaded_file_of_another_format_opens(foreign: Path):
    content = (foreign / "scene.xml").read_bytes()
    assert is_foreign("My scene.XML", content)
    scenario, recipe = scenario_and_recipe({"My scene.XML": content})
    assert (scenario.scenario_id, recipe) == ("ZAM_Road-1_1_T-1", None)
    assert scenario.provenance.source == ""
    assert not is_foreign("other.xml", b"<html/>")
    assert not is_foreign("map.json", b'{"lane_segments": {}}')


def test_errors_of_an_upload_name_the_file_as_it_came(foreign: Path):
    content = commonroad_text(version="2016a").encode()
    with pytest.raises(
        Exception, match=r"^mine\.xml, line 1: <commonRoad> is of version"
    ):
        scenario_and_recipe({"mine.xml": content})


def test_a_folder_with_one_scene_of_another_format_opens(foreign: Path, tmp_path: Path):
    one = tmp_path / "one"
    one.mkdir()
    shutil.copy(foreign / "scene.xml", one)
    assert open_scenario(one).scenario_id == "ZAM_Road-1_1_T-1"


def test_a_json_of_another_format_is_exported_and_not_replayed(
    shell: Shell, tmp_path: Path
):
    path = tmp_path / "one.json"
    path.write_text(json.dumps(as_gpudrive()))
    result = shell.run("export", path, "--out", tmp_path / "out")
    assert (result.code, result.lines) == (0, [str(tmp_path / "out" / "one")])


def test_the_densest_parts_of_a_map_become_scenes_of_their_own(
    shell: Shell, tmp_path: Path
):
    out = tmp_path / "out"
    result = shell.run(
        "convert", city(tmp_path, 3), "--to", "tables", "--densest", "2",
        "--radius", "60", "--out", out,
    )  # fmt: skip
    names = sorted(one.name for one in out.iterdir()) if out.exists() else []
    assert (result.code, len(names)) == (0, 2), result
    told = shell.refused("convert", "roundabout", "--to", "av2", "--out", out,
                         "--densest", "2", "--around", "0", "0")  # fmt: skip
    assert told == "--around and --densest exclude each other."
    told = shell.refused("convert", "roundabout", "--to", "av2", "--out", out,
                         "--densest", "2", "--radius", "nan")  # fmt: skip
    assert "expected metres of the file" in told
    told = shell.refused("convert", "roundabout", "--to", "av2", "--out", out, "--radius", "3")  # fmt: skip
    assert "--around" in told


def test_the_densest_parts_of_a_map_are_cut_from_one_reading(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The file was read for the windows, and once more for each of them."""
    read: list[Path] = []

    def counted(path: Path) -> Scenario:
        read.append(path)
        return read_scene(path)

    monkeypatch.setattr(scenario_store, "read_scene", counted)
    where, out = city(tmp_path, 3), tmp_path / "out"
    asked = ("--to", "tables", "--densest", "3", "--radius", "60", "--out")
    assert shell.run("convert", where, *asked, out).code == 0
    assert len(list(out.iterdir())) == 3
    assert read == [Path(where)]
    # A file that changed meanwhile is read anew.
    assert shell.run("convert", where, *asked, tmp_path / "again").code == 0
    assert len(read) == 2
