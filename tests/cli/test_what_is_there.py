"""References to files, byte-order marks and focal agents: what is there is looked at."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from tests.builders import two_agents_that_pass
from tests.cli.shell import Shell

BEND = ("--kind", "smooth-turn", "--power", 4)


def test_an_own_zip_opens_on_the_shell(shell: Shell, tmp_path: Path):
    shell.run("export", "roundabout", "--zip", "--out", tmp_path)
    packed = tmp_path / "scenarios.zip"
    made = shell.run("warp", packed, *BEND, "--out", tmp_path / "warped")
    assert made.code == 0, made.err
    recipe = Path(made.lines[0]) / "recipe.json"
    again = shell.run("replay", recipe, "--out", tmp_path / "again")
    assert again.code == 0, again.err
    for path in Path(made.lines[0]).iterdir():
        assert (Path(again.lines[0]) / path.name).read_bytes() == path.read_bytes()
    shell.run("export", "roundabout", "queue", "--zip", "--out", tmp_path / "two")
    two = tmp_path / "two" / "scenarios.zip"
    assert "expected exactly one scenario" in shell.refused(
        "warp", two, *BEND, "--out", tmp_path / "x"
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("scenario_x.parquet", "expected the folder that holds"),
        ("map.xodr", "is no valid XML"),
        ("recipe.json", "recipes are replayed by pd-editor replay"),
        ("missing", "neither a scenario folder nor a demo"),
    ],
)
def test_files_are_told_as_what_they_are(
    name: str, words: str, shell: Shell, tmp_path: Path
):
    if name != "missing":
        (tmp_path / name).write_bytes(b"x")
    told = shell.refused("warp", tmp_path / name, *BEND, "--out", tmp_path / "out")
    assert words in told


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-8"])
def test_recipes_of_windows_editors_are_read(encoding: str):
    text = open_recipe_text()
    data = text.encode(encoding)
    assert Recipe.from_text(data).to_text() == text
    assert Recipe.from_text("\ufeff" + text).to_text() == text


def open_recipe_text() -> str:
    from pd_editor.editor.session import EditorSession

    return EditorSession(two_agents_that_pass()).recipe().to_text()


@pytest.fixture
def without_focal(tmp_path: Path) -> Path:
    """The focal agent is not among the tracks."""
    scenario = replace(two_agents_that_pass(), scenario_id="lost", focal_id="gone")
    write_files(scenario_files(scenario), tmp_path / "lost", forbidden=None)
    return tmp_path / "lost"


def test_advice_on_focal_agents_can_be_followed(
    shell: Shell, without_focal: Path, tmp_path: Path
):
    out = tmp_path / "out"
    ids = open_scenario(without_focal).agents.ids
    assert "--focal ID" in shell.refused("export", without_focal, "--out", out)
    assert "--focal ID" in shell.refused("warp", without_focal, *BEND, "--out", out)
    commands = (
        ("export", without_focal, "--name", "one"),
        ("warp", without_focal, *BEND),
        ("generate", without_focal, "--model", "lane-follower"),
    )
    for command in commands:
        made = shell.run(*command, "--focal", ids[1], "--out", out)
        assert made.code == 0, made.err
        scenario = open_scenario(made.lines[0])
        assert scenario.focal_id == ids[1]
    recipe = json.loads((out / "one" / "recipe.json").read_text())
    assert recipe["commands"] == [{"command": "SetFocalAgent", "agent_id": ids[1]}]


def test_an_absent_focal_agent_is_no_dead_end(shell: Shell, tmp_path: Path):
    scenario = two_agents_that_pass()
    there = scenario.agents.is_valid.copy()
    row = scenario.agents.row_of[scenario.focal_id]
    there[row, scenario.current_step] = False
    other = next(name for name in scenario.agents.ids if name != scenario.focal_id)
    agents = replace(scenario.agents, is_valid=there)
    files = scenario_files(replace(scenario, agents=agents, scenario_id="late"))
    write_files(files, tmp_path / "late", forbidden=None)
    command = ("warp", tmp_path / "late", *BEND, "--out", tmp_path / "out")
    assert "--anchor ID" in shell.refused(*command)
    made = shell.run(*command, "--anchor", other)
    assert made.code == 0, made.err
    assert np.isfinite(open_scenario(made.lines[0]).agents.position_m).all()
