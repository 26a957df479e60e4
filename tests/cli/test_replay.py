import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.installed_files import models_folder
from pd_editor.cli.generate import generate
from pd_editor.cli.warp import warp
from pd_editor.editor.commands import DeleteAgents
from pd_editor.editor.scenario_store import export_into, open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.generation.generators import SHIPPED_MODEL
from tests.cli.shell import JUNCTION, Shell, files_of


def test_a_warp_is_replayed_to_the_same_arrays(shell: Shell, tmp_path: Path):
    first = warp(
        JUNCTION, kind=("smooth-turn", "ripple-road"), power=(6, -2), out=tmp_path
    )
    result = shell.run(
        "replay", first.folder / "recipe.json", "--out", tmp_path / "again"
    )
    assert (result.code, result.err) == (0, "")
    again = tmp_path / "again" / first.folder.name
    assert result.lines == [str(again)]
    assert files_of(again) == files_of(first.folder)
    one, other = open_scenario(first.folder), open_scenario(again)
    np.testing.assert_array_equal(one.agents.position_m, other.agents.position_m)


def test_generated_traffic_is_replayed_and_drawn_again(shell: Shell, tmp_path: Path):
    first = generate(JUNCTION, samples=2, seed=5, out=tmp_path)
    for folder in first.folders:
        out = tmp_path / "again" / folder.name
        stored = shell.run("replay", folder, "--out", out)
        assert stored.code == 0
        drawn = shell.run("replay", folder, "--out", out, "--regenerate", "--overwrite")
        assert drawn.lines[1:] == ["Entry 1: generated again, equal."]
        assert files_of(out / folder.name) == files_of(folder)


def test_unequal_traffic_is_said_and_its_recipe_written(shell: Shell, tmp_path: Path):
    recipe_file = generate(JUNCTION, out=tmp_path).folder / "recipe.json"
    recipe = json.loads(recipe_file.read_text())
    recipe["commands"][0]["seed"] = 1
    recipe_file.write_text(json.dumps(recipe))
    command = ("replay", recipe_file, "--out", tmp_path / "again")
    result = shell.run(*command, "--regenerate")
    assert result.lines[1].startswith(
        "Entry 1: generated again, NOT equal, positions up"
    )
    again = tmp_path / "again" / recipe_file.parent.name
    stored = shell.run("replay", again, "--out", tmp_path / "third")
    assert stored.code == 0
    assert files_of(tmp_path / "third" / again.name) == files_of(again)


def test_the_session_of_a_browser_is_replayed(shell: Shell, tmp_path: Path):
    session = EditorSession(open_scenario(JUNCTION))
    for name in session.scenario.agents.ids[-2:]:
        session.apply(DeleteAgents(agent_ids=(name,)))
    session.undo()
    folder = export_into(
        tmp_path / "browser", session.scenario, session.recipe(), base=session.base
    )
    assert shell.run("replay", folder, "--out", tmp_path / "shell").code == 0
    ours, theirs = files_of(folder), files_of(tmp_path / "shell" / folder.name)
    assert ours == theirs


def test_a_moved_base_is_named(shell: Shell, tmp_path: Path):
    here = warp(JUNCTION, kind="smooth-turn", power=2, out=tmp_path / "here").folder
    bent = warp(here, kind="smooth-turn", power=-2, out=tmp_path / "bent").folder
    moved = here.rename(tmp_path / "moved")
    command = ("replay", bent, "--out", tmp_path / "again")
    told = (
        "if it was moved, make it again from its folder with 'pd-editor replay --base"
    )
    assert told in shell.refused(*command)
    # Also by a command without that option.
    assert told in shell.refused("render", bent / "recipe.json", "--out", "one.html")
    assert shell.run(*command, "--base", moved).code == 0
    out = tmp_path / "other"
    other = warp(JUNCTION, kind="smooth-turn", power=3, name=here.name, out=out).folder
    refused = shell.refused(*command, "--base", other, "--overwrite")
    assert "has other contents than when this was recorded" in refused
    refused = shell.refused(*command, "--base", "winding-street", "--overwrite")
    assert f"belongs to scenario {here.name}, not to winding-street" in refused


def test_an_upload_needs_its_base(shell: Shell, tmp_path: Path):
    folder = warp(JUNCTION, kind="smooth-turn", power=2, out=tmp_path).folder
    recipe = json.loads((folder / "recipe.json").read_text())
    recipe["base"]["source"] = ""
    (folder / "recipe.json").write_text(json.dumps(recipe))
    command = ("replay", folder, "--out", tmp_path / "again")
    assert "was uploaded; make it again from its folder with" in shell.refused(*command)
    assert shell.run(*command, "--base", JUNCTION).code == 0


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is not valid JSON"),
        (b"\xff\xfe\x00", "is not valid JSON"),
        (b"[]", "This is not a recipe"),
        (b'{"format": "pd-editor recipe", "version": 99}', "reads up to 1"),
        (
            b'{"format": "pd-editor recipe", "version": 1, "base": '
            b'{"scenario_id": "x"}, "commands": [{"command": "Fly"}]}',
            "Entry 1 is of the unknown command 'Fly'",
        ),
    ],
)
def test_what_is_no_recipe_is_refused(
    shell: Shell, tmp_path: Path, content: bytes, sentence: str
):
    (tmp_path / "recipe.json").write_bytes(content)
    for name in (tmp_path, tmp_path / "recipe.json"):
        refused = shell.refused("replay", name, "--out", tmp_path / "out")
        assert refused.startswith(f"{tmp_path / 'recipe.json'}: ")
        assert sentence in refused
    assert not (tmp_path / "out").exists()


def test_a_missing_recipe_is_refused(shell: Shell, tmp_path: Path):
    refused = shell.refused("replay", tmp_path / "none.json", "--out", tmp_path)
    assert "none.json: is not there; expected a file recipe.json, or an" in refused


def test_a_recipe_without_traffic_cannot_be_drawn_again(shell: Shell, tmp_path: Path):
    folder = warp(JUNCTION, kind="smooth-turn", power=2, out=tmp_path).folder
    refused = shell.refused("replay", folder, "--out", tmp_path / "x", "--regenerate")
    assert refused == "The recipe holds no generated traffic to regenerate."


def test_a_model_of_ones_own_regenerates_its_recipe(shell: Shell, tmp_path: Path):
    plugin = "examples.drift_generator:DriftGenerator"
    out = tmp_path / "out"
    assert shell.run("generate", JUNCTION, "--model", plugin, "--out", out).code == 0
    (made,) = out.iterdir()
    again = ("replay", made, "--regenerate", "--out", tmp_path / "again")
    refused = shell.refused(*again)
    assert "There is no generator 'drift'" in refused
    assert "name it by --model" in refused
    result = shell.run(*again, "--model", plugin)
    assert result.code == 0, result.err
    assert "equal" in result.out
    assert "NOT" not in result.out


def test_a_renamed_model_regenerates_its_recipe(shell: Shell, tmp_path: Path):
    """Its weights tell that it is the same; its name alone was compared."""
    mine = shutil.copytree(models_folder() / SHIPPED_MODEL, tmp_path / "mine")
    out = tmp_path / "out"
    assert shell.run("generate", JUNCTION, "--model", mine, "--out", out).code == 0
    (made,) = out.iterdir()
    again = ("replay", made, "--regenerate", "--out", tmp_path / "again", "--model")
    result = shell.run(*again, mine.rename(tmp_path / "moved"))
    assert result.code == 0, result.err
    assert "generated again, equal" in result.out
    for other in ("path-diffuser-without-warps", "lane-follower"):
        told = shell.refused(*again, other, "--overwrite")
        assert told == f"Entry 1 was sampled by mine, not by {other}."
