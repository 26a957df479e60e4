"""``pd-editor render``."""

from pathlib import Path

import pd_editor
from tests.cli.shell import JUNCTION, Shell
from tests.scene.formats.embedded_scenes import scenes_in


def test_scenes_and_recipes_become_one_page(shell: Shell, tmp_path: Path):
    warped = pd_editor.warp(JUNCTION, kind="smooth-turn", power=6, out=tmp_path)
    page = tmp_path / "new" / "set.html"
    result = shell.run("render", warped.folder / "recipe.json", "merge", "--out", page)
    assert result.code == 0, result.err
    assert result.lines[0] == str(page)
    assert result.lines[1].startswith("2 scenes, 0.")
    first, second = scenes_in(page.read_bytes())
    assert (first["name"], second["name"]) == (warped.folder.name, "merge")
    # The recipe knows what the road was before.
    assert first["original"] is not None
    again = shell.run("render", "merge", "--out", page)
    assert again.code == 2
    assert "--overwrite" in again.err
    done = shell.run("render", "merge", "--until", 2, "--out", page, "--overwrite")
    assert done.lines[1].startswith("1 scene, ")
    (only,) = scenes_in(page.read_bytes())
    assert (only["last"] - only["current"]) * only["stepS"] <= 2.0


def test_wrong_places_are_told_before_scenes_are_read(shell: Shell, tmp_path: Path):
    result = shell.run("render", "merge", "--out", tmp_path / "set.txt")
    assert (result.code, result.out) == (2, "")
    assert "ends in .html" in result.err
    assert shell.run("render", "nothing", "--out", tmp_path / "a.html").code == 2
    assert not list(tmp_path.iterdir())


def test_a_player_is_a_format_to_export_to(shell: Shell, tmp_path: Path):
    result = shell.run("convert", "merge", "--to", "player", "--out", tmp_path)
    assert result.code == 0, result.err
    (page,) = tmp_path.glob("merge/*.html")
    assert scenes_in(page.read_bytes())[0]["name"] == "merge"
