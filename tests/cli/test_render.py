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
    assert "ends in .html, .mp4" in result.err
    assert shell.run("render", "nothing", "--out", tmp_path / "a.html").code == 2
    assert not list(tmp_path.iterdir())


def test_a_player_is_a_format_to_export_to(shell: Shell, tmp_path: Path):
    result = shell.run("convert", "merge", "--to", "player", "--out", tmp_path)
    assert result.code == 0, result.err
    (page,) = tmp_path.glob("merge/*.html")
    assert scenes_in(page.read_bytes())[0]["name"] == "merge"


def test_a_film_and_figures_are_rendered_by_their_endings(shell: Shell, tmp_path: Path):
    warped = pd_editor.warp(JUNCTION, kind="smooth-turn", power=6, out=tmp_path)
    recipe = warped.folder / "recipe.json"
    film = tmp_path / "a.gif"
    done = shell.run("render", recipe, "--until", 0.5, "--height", 120, "--out", film)
    assert done.code == 0, done.err
    assert film.read_bytes().startswith(b"GIF8")
    figure = tmp_path / "a.PDF"
    asked = ("--compare", "--at", 0, 1, "--names", "--width", 88, "--radius", 30)
    # (An export was told to have no original, though its recipe tells it.)
    for one in (recipe, warped.folder):
        done = shell.run("render", one, *asked, "--out", figure, "--overwrite")
        assert done.code == 0, done.err
        assert figure.read_bytes().startswith(b"%PDF")


def test_what_an_export_was_before_its_warp_is_shown(shell: Shell, tmp_path: Path):
    """What was generated on an exported warp was told to have no original."""
    warped = pd_editor.warp("crosswalk", kind="smooth-turn", power=6, out=tmp_path)
    made = shell.run(
        "generate", warped.folder, "--model", "lane-follower", "--out", tmp_path / "b"
    )
    assert made.code == 0, made.err
    (folder,) = (tmp_path / "b").iterdir()
    page, figure = tmp_path / "a.html", tmp_path / "a.png"
    for one in (warped.folder, folder, folder / "recipe.json"):
        done = shell.run("render", one, "--out", page, "--overwrite")
        assert done.code == 0, done.err
        assert scenes_in(page.read_bytes())[0]["original"]["lines"]
        asked = ("--compare", "--out", figure, "--overwrite")
        assert shell.run("render", one, *asked).code == 0
    warped.folder.rename(tmp_path / "moved")
    told = shell.refused("render", folder, *asked)
    assert "has no original:" in told
    done = shell.run("render", folder, "--out", page, "--overwrite")
    assert "has no original:" in done.out + done.err
    assert scenes_in(page.read_bytes())[0]["original"] is None


def test_options_of_another_kind_and_several_scenes_are_refused(
    shell: Shell, tmp_path: Path
):
    told = shell.refused("render", "merge", "--at", 1, "--out", tmp_path / "a.mp4")
    assert told == "--at: a file .mp4 has no such option."
    told = shell.refused("render", "merge", "--radius", 9, "--out", tmp_path / "a.html")
    assert told == "--radius: a file .html has no such option."
    told = shell.refused("render", "merge", "queue", "--out", tmp_path / "a.webm")
    assert told.endswith("pd-editor convert --to webm writes one file for each.")
    assert not list(tmp_path.iterdir())


def test_two_scenes_are_compared_in_a_page(shell: Shell, tmp_path: Path):
    page = tmp_path / "pair.html"
    asked = ("--compare", "--out", page)
    assert shell.run("render", "merge", "roundabout", *asked).code == 0
    content = page.read_bytes()
    assert [one["name"] for one in scenes_in(content)] == ["merge", "roundabout"]
    assert b"data-pair>" in content
    told = shell.refused("render", "merge", *asked, "--overwrite")
    assert "shows two scenes side by side, not 1" in told
