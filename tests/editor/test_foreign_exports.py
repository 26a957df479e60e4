"""Exports of other formats: continued, attributed, uploaded as zips, kept in the library."""

import io
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from pd_editor.base.errors import EditError, InputError
from pd_editor.editor.commands import SetAgentSpeed, SetRoadWarp
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import (
    ATTRIBUTION_NAME,
    export_into,
    exported_files,
    foreign_scenes,
    open_scenario,
    recipe_of_export,
    scenario_and_recipe,
)
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import Variant, name_from_text
from pd_editor.scene.bundle import zip_folders
from pd_editor.scene.formats.registry import unread_file, writer
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.scene.formats.test_commonroad import text as commonroad_text
from tests.scene.formats.test_opendrive import lane, road, section
from tests.scene.formats.test_opendrive import write as write_road


@pytest.fixture
def session(tmp_path: Path) -> EditorSession:
    """An edited CommonRoad scene that names who made it."""
    path = tmp_path / "ZAM_Road-1_1_T-1.xml"
    path.write_text(commonroad_text())
    made = EditorSession(open_scenario(path))
    made.apply(SetAgentSpeed(agent_ids=(made.scenario.agents.ids[0],), speed_mps=2.0))
    made.describe(Variant(name="ZAM_Road-2_1_T-1"))
    return made


@pytest.mark.parametrize("kind", ["commonroad", "scenarionet", "av2"])
def test_an_export_is_opened_with_its_recipe_and_attribution(session, tmp_path, kind):
    folder = export_into(
        tmp_path / "out", session.scenario, session.recipe(), format_name=kind
    )
    assert folder.name == "ZAM_Road-2_1_T-1"
    assert "author: A. Author" in (folder / ATTRIBUTION_NAME).read_text()
    again = open_scenario(folder)
    assert again.scenario_id == folder.name
    assert again.provenance.base is not None
    assert "author: A. Author" in (again.provenance.attribution or "")
    recipe = recipe_of_export(Path(again.provenance.source))
    assert recipe is not None
    assert recipe.result_id == again.scenario_id
    files = {
        path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()
    }
    files |= {
        f"{path.parent.name}/{path.name}": path.read_bytes()
        for path in folder.glob("*/*")
    }
    upload = {"any.zip": zip_folders({folder.name: files})}
    scenario, found = scenario_and_recipe(upload)
    assert scenario.scenario_id == folder.name
    assert found is not None
    assert found.commands == Recipe.from_text(session.recipe().to_text()).commands


def test_a_zip_of_two_foreign_scenes_is_refused_in_a_sentence():
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name in ("a.xml", "b.xml"):
            archive.writestr(name, commonroad_text())
    with pytest.raises(InputError, match=r"holds 2 scenes, such as a and b"):
        scenario_and_recipe({"both.zip": content.getvalue()})


def test_names_take_underscores_as_they_come():
    assert name_from_text("USA_Peach-4_1_T-1 (new)") == "USA_Peach-4_1_T-1-new"
    Variant(name="USA_Peach-4_1_T-1")
    with pytest.raises(EditError, match="underscores"):
        Variant(name="_hidden")


def test_who_made_a_file_is_told_where_the_file_tells_it(tmp_path):
    header = 'revMajor="1" revMinor="8" vendor="Maps &amp; Co"'
    path = write_road(tmp_path, road(section(lane(-1))), version=header)
    licence = '<license name="CC BY 4.0"/><userData code="copyright" value="2024"/>'
    path.write_text(
        path.read_text().replace(f"{header}/>", f"{header}>{licence}</header>")
    )
    origin = open_scenario(path).provenance
    assert (
        origin.attribution == "vendor: Maps & Co; license: CC BY 4.0; copyright: 2024"
    )
    assert origin.file_format == "OpenDRIVE"
    assert open_scenario("roundabout").provenance.attribution is None


def test_recorded_argoverse_scenes_name_their_licence(av2_scenario_folders):
    scenario = open_scenario(av2_scenario_folders[0])
    files = exported_files(scenario, EditorSession(scenario).recipe())
    assert b"CC BY-NC-SA 4.0" in files[ATTRIBUTION_NAME]


@pytest.mark.parametrize("kind", ["commonroad", "opendrive", "scenarionet", "gpudrive"])
def test_the_file_of_an_export_tells_what_its_folder_tells(session, tmp_path, kind):
    """The edits, and who made the source, were those of the folder alone.

    Files named this editor, or Waymo, as who made them; each trip added a line.
    """
    folder = export_into(
        tmp_path / "out", session.scenario, session.recipe(), format_name=kind
    )
    files = [one for one in foreign_scenes(folder) if one.is_file()]
    by_file, by_folder = (open_scenario(one).provenance for one in (files[-1], folder))
    assert by_file.base is not None
    assert by_file.edited_ids == by_folder.edited_ids != frozenset()
    (folder / "recipe.json").unlink()
    alone = open_scenario(files[-1])
    assert alone.provenance.attribution == session.scenario.provenance.attribution
    again = writer(kind).write
    assert again is not None
    (tmp_path / "again").mkdir()
    for name, data in again(alone).files.items():
        (tmp_path / "again" / name).write_bytes(data)
    (second, *_) = foreign_scenes(tmp_path / "again")
    told = open_scenario(second).provenance.attribution
    assert told == session.scenario.provenance.attribution


@pytest.mark.parametrize("kind", ["commonroad", "opendrive", "scenarionet", "gpudrive"])
def test_who_made_a_demo_is_made_up_by_no_format(tmp_path, kind):
    scenario = open_scenario("roundabout")
    write = writer(kind).write
    assert write is not None
    for name, data in write(scenario).files.items():
        (tmp_path / name).write_bytes(data)
    (path, *_) = foreign_scenes(tmp_path)
    assert open_scenario(path).provenance.attribution is None


def test_hidden_files_of_a_mac_are_no_scenes(session, tmp_path):
    """They were a second scene of formats that are known by their ending."""
    files = exported_files(
        session.scenario, session.recipe(), format_name="scenarionet"
    )
    (name,) = (one for one in files if one.startswith("sd_"))
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr(f"a folder/{name}", files[name])
        archive.writestr(f"__MACOSX/a folder/._{name}", b"Mac OS X")
    scenario, _ = scenario_and_recipe({"mac.zip": content.getvalue()})
    assert len(scenario.agents) == len(session.scenario.agents)


def test_bytes_of_a_zip_are_no_other_kind_of_file(tmp_path):
    """A zip that was not packed was a protocol buffer, by chance."""
    path = tmp_path / "scenes.zip"
    path.write_bytes(b"PK\x03\x04 xpb .tfrecord > 1.csv ")
    assert unread_file(path) is None


@pytest.mark.parametrize("kind", ["av2", "commonroad", "opendrive"])
def test_a_copy_of_an_export_is_no_recording(tmp_path, kind):
    """A bent road that was converted was as recorded."""
    first = EditorSession(open_scenario("roundabout"))
    term = WarpTerm(kind="smooth-turn", power=6.0, length_m=40.0)
    anchor = pose_of_anchor(first.scenario, "focal")
    first.apply(SetRoadWarp(warp=RoadWarp(anchor=anchor, terms=(term,))))
    made = open_scenario(
        export_into(tmp_path, first.scenario, first.recipe(), base=first.base)
    )
    assert made.provenance.is_bent
    copied = EditorSession(made)
    copied.describe(Variant(name="copy"))
    again = open_scenario(
        export_into(
            tmp_path,
            made,
            copied.recipe(),
            base=made,
            format_name=kind,
        )
    ).provenance
    assert again.is_bent
    assert again.warps
    assert again.edited_ids == made.provenance.edited_ids
    assert again.caused_findings is not None
    assert again.base is not None
    assert again.base.root.scenario_id == "roundabout"
    assert set(made.provenance.notes) <= set(again.notes)


@pytest.mark.parametrize("kind", ["commonroad", "gpudrive", "opendrive", "sumo"])
def test_edited_agents_are_known_under_the_ids_of_the_files(tmp_path, kind):
    """Whoever had their former ids in the files was taken for edited."""
    scenario = open_scenario("roundabout")
    agents = scenario.agents
    row = len(agents) - 1
    ids = tuple("an agent" if n == row else one for n, one in enumerate(agents.ids))
    scene = EditorSession(replace(scenario, agents=replace(agents, ids=ids)))
    scene.apply(SetAgentSpeed(agent_ids=("an agent",), speed_mps=2.0))
    folder = export_into(
        tmp_path, scene.scenario, scene.recipe(), base=scene.base, format_name=kind
    )
    found = open_scenario(folder)
    (name,) = found.provenance.edited_ids
    now = found.current_step
    at = found.agents.position_m[found.agents.row_of[name], now] + found.origin_city_m
    expected = agents.position_m[row, scenario.current_step] + scenario.origin_city_m
    assert at == pytest.approx(expected, abs=0.01)
