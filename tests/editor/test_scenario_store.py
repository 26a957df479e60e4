import gc
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import ExportError, InputError
from pd_editor.base.installed_files import demo_folder, demo_names
from pd_editor.editor.commands import DeleteAgents, DuplicateAgents, TransformAgents
from pd_editor.editor.edit_findings import edit_findings
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import (
    check_free,
    export_into,
    exported_files,
    open_scenario,
    scenario_and_recipe,
    scenes_in_upload,
)
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import Variant
from pd_editor.scene.agent_kind import AgentCategory
from pd_editor.scene.av2_io.write import check_with_official_loaders
from pd_editor.scene.bundle import write_files, zip_folders
from tests.builders import two_agents_that_collide, two_agents_that_pass

JUNCTION = "signalised-junction"


def named(recipe: Recipe, name: str) -> Recipe:
    return replace(recipe, variant=Variant(name=name))


def edited_session() -> EditorSession:
    session = EditorSession(open_scenario(JUNCTION), clock=lambda: 0.0)
    session.apply(DeleteAgents(agent_ids=session.scenario.agents.ids[-1:]))
    return session


@pytest.mark.parametrize("name", demo_names())
def test_a_demo_has_a_name_that_holds_on_every_machine(name: str):
    scenario = open_scenario(name)
    assert scenario.scenario_id == name
    assert scenario.provenance.source == f"demo:{name}"
    again = open_scenario(scenario.provenance.source)
    assert again.provenance == scenario.provenance
    np.testing.assert_array_equal(again.agents.position_m, scenario.agents.position_m)


def test_a_folder_remembers_its_whole_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    session = edited_session()
    folder = export_into(tmp_path, session.scenario, named(session.recipe(), "x"))
    monkeypatch.chdir(tmp_path)
    for name in ("x", Path("x"), folder):
        assert open_scenario(name).provenance.source == str(folder.resolve())
    monkeypatch.setenv("HOME", str(tmp_path))
    assert open_scenario("~/x").provenance.source == str(folder.resolve())


def test_a_folder_goes_before_a_demo_of_the_same_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    session = edited_session()
    export_into(tmp_path, session.scenario, named(session.recipe(), JUNCTION))
    monkeypatch.chdir(tmp_path)
    opened = open_scenario(JUNCTION)
    assert len(opened.agents) == len(session.base.agents) - 1
    assert len(open_scenario(f"demo:{JUNCTION}").agents) == len(session.base.agents)


@pytest.mark.parametrize("name", ["", "nowhere", "demo:nowhere", "~nobody/x"])
def test_an_unknown_name_is_refused(name: str):
    with pytest.raises(InputError, match="neither a scenario folder nor a demo"):
        open_scenario(name)


def test_a_file_that_is_not_there_is_told(tmp_path: Path):
    with pytest.raises(InputError, match=r"gone\.xodr: there is no such file\."):
        open_scenario(tmp_path / "gone.xodr")
    (tmp_path / "roads.xml").write_text("<roads/>")
    with pytest.raises(InputError, match=r"known format in spite of its ending"):
        open_scenario(tmp_path / "roads.xml")


def test_exported_files_hold_a_recipe_that_leads_to_them():
    session = edited_session()
    files = exported_files(session.scenario, session.recipe())
    recipe = Recipe.from_text(files["recipe.json"])
    result = replay(recipe, open_scenario(recipe.base.source))
    assert exported_files(result, recipe) == files


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_place_is_judged_before_as_when_it_is_written(
    tmp_path: Path, overwrite: bool
):
    session = edited_session()
    scenario, recipe = session.scenario, session.recipe()
    demos = demo_folder(JUNCTION).parent
    (tmp_path / "file").write_text("")
    for name in ("mine", "strange"):
        (tmp_path / name).mkdir()
    (tmp_path / "mine" / "recipe.json").write_text("{}")
    (tmp_path / "strange" / "thesis.txt").write_text("")
    places = [(tmp_path, name) for name in ("new", "mine", "strange", "file")]
    for out, name in [*places, (demos, JUNCTION), (demos / JUNCTION, "inside")]:
        verdicts = []
        for judge in (
            lambda o, n: check_free(o, n, scenario, overwrite=overwrite),
            lambda o, n: export_into(
                o, scenario, named(recipe, n), overwrite=overwrite
            ),
        ):
            try:
                judge(out, name)
                verdicts.append(None)
            except ExportError as error:
                verdicts.append(str(error))
        assert verdicts[0] == verdicts[1], (out, name)
    assert (tmp_path / "strange" / "thesis.txt").exists()
    assert not (demos / JUNCTION / "recipe.json").exists()


def test_an_upload_has_no_folder_to_protect(tmp_path: Path):
    session = edited_session()
    provenance = replace(session.scenario.provenance, source="")
    uploaded = replace(session.scenario, provenance=provenance)
    folder = export_into(tmp_path, uploaded, named(session.recipe(), "x"))
    assert len(list(folder.iterdir())) == 3


def test_a_road_that_traffic_names_is_no_scene_of_its_own():
    """Traffic and its road were refused as two scenes if they had two names."""
    session = EditorSession(two_agents_that_pass())
    recipe = named(session.recipe(), "road")
    files = exported_files(session.scenario, recipe, format_name="opendrive")
    both = {"road.xodr": files["road.xodr"], "traffic.xosc": files["road.xosc"]}
    opened, _ = scenario_and_recipe({"x.zip": zip_folders({"one": both})})
    assert len(opened.agents) == len(session.scenario.agents)
    other = {**both, "more.xosc": files["road.xosc"]}
    content = zip_folders({"one": both, "two": other, "three": both})
    scenes = scenes_in_upload({"x.zip": content})
    assert list(scenes) == ["one", "more", "traffic", "three"]
    for give in scenes.values():
        scenario, _ = scenario_and_recipe(give())
        assert len(scenario.agents) == len(session.scenario.agents)
    with pytest.raises(InputError, match="holds 4 scenes"):
        scenario_and_recipe({"x.zip": content})


def test_scenes_of_a_zip_are_kept_packed():
    """All of them were kept unpacked, as long as the page was open."""
    recipe = named(EditorSession(two_agents_that_pass()).recipe(), "road")
    made = exported_files(two_agents_that_pass(), recipe, format_name="commonroad")
    (scene,) = (data for name, data in made.items() if name.endswith(".xml"))
    words = np.random.default_rng(0).integers(0, 16, 80_000)
    large = scene + b"<!--%s-->" % b" ".join(b"way-point-%d" % one for one in words)
    content = zip_folders({one: {f"{one}.xml": large} for one in ("a", "b", "c")})
    del large
    tracemalloc.start()
    scenes = scenes_in_upload({"x.zip": content})
    gc.collect()
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 1_000_000
    for give in scenes.values():
        assert len(scenario_and_recipe(give())[0].agents) == 2


def test_an_upload_names_no_file_of_the_server(tmp_path: Path):
    """A scenario could name the road of anybody, and show it."""
    session = EditorSession(two_agents_that_pass())
    recipe = named(session.recipe(), "road")
    files = exported_files(session.scenario, recipe, format_name="opendrive")
    road = {"road.xodr": files["road.xodr"]}
    write_files(road, tmp_path / "others", forbidden=None)
    there = "../" * 20 + str(tmp_path / "others" / "road.xodr")[1:]
    asking = files["road.xosc"].replace(b"road.xodr", there.encode())
    with pytest.raises(InputError, match="neither there nor beside it"):
        scenario_and_recipe({"road.xosc": asking})
    # On the user's own machine a road is where the scenario says.
    write_files({"road.xosc": asking}, tmp_path / "own", forbidden=None)
    assert open_scenario(tmp_path / "own" / "road.xosc").road_map.lanes


def test_one_name_in_two_formats_is_two_scenes():
    """One was lost without a word, beside a scene of another name."""
    session = EditorSession(two_agents_that_pass())
    recipe = named(session.recipe(), "road")
    road = exported_files(session.scenario, recipe, format_name="opendrive")[
        "road.xodr"
    ]
    other = exported_files(session.scenario, recipe, format_name="commonroad")
    (scene,) = (data for name, data in other.items() if name.endswith(".xml"))
    content = zip_folders({"one": {"a.xodr": road, "a.xml": scene, "b.xml": scene}})
    scenes = scenes_in_upload({"x.zip": content})
    assert sorted(name for give in scenes.values() for name in give()) == [
        "a.xml",
        "a.xodr",
        "b.xml",
    ]
    for give in scenes.values():
        assert scenario_and_recipe(give())[0].road_map.lanes


def test_an_export_has_one_focal_track_or_is_refused(tmp_path):
    """(D2): the focal id may name an agent of another category, or none."""
    base = two_agents_that_pass()
    scored = (AgentCategory.SCORED,) * 2
    recipe = EditorSession(base).recipe()
    both = replace(base, agents=replace(base.agents, categories=scored))
    write_files(exported_files(both, recipe), tmp_path / "out", forbidden=None)
    assert open_scenario(tmp_path / "out").agents.categories == (
        AgentCategory.FOCAL,
        AgentCategory.SCORED,
    )
    check_with_official_loaders(tmp_path / "out")
    with pytest.raises(ExportError, match="has no focal agent"):
        exported_files(base.without_agents((base.focal_id,)), recipe)


def test_what_was_in_the_recording_is_so_in_its_export_as_well(tmp_path: Path):
    """The same file had no new problems before the export, and 21 afterwards."""
    base = two_agents_that_collide()
    session = EditorSession(base)
    session.apply(DuplicateAgents(agent_ids=("100",), new_ids=("copy",), dy_m=3.5))
    before = edit_findings(session.scenario, base, session.commands_in_force)
    assert [one.kind for one in before.recorded if one.is_problem] == [
        "later-collision"
    ]
    folder = export_into(
        tmp_path, session.scenario, named(session.recipe(), "x"), base=base
    )
    export = open_scenario(folder)
    again = edit_findings(export, export, ())
    assert {one.key for one in again.recorded} >= {one.key for one in before.recorded}
    assert [one.key for one in again.problems] == [one.key for one in before.problems]
    # Without the keys, all problems of edited agents and bent roads count as new.
    bare = open_scenario(
        export_into(tmp_path / "bare", session.scenario, named(session.recipe(), "x"))
    )
    assert bare.provenance.caused_findings is None
    # A further edit is judged against the export.
    moved = TransformAgents(agent_ids=("101",), dx_m=0.5).apply(export)
    assert edit_findings(moved, export, ()).problems
