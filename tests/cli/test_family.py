"""``pd-editor family``."""

import csv
from pathlib import Path

import pd_editor
from pd_editor.cli.replay import read_recipe
from pd_editor.editor.commands import ReplaceTraffic
from tests.cli.shell import JUNCTION, Shell
from tests.scene.formats.embedded_scenes import scenes_in


def test_a_recipe_becomes_a_family_of_bends(shell: Shell, tmp_path: Path):
    warped = pd_editor.warp(
        JUNCTION, kind="smooth-turn", power=5, out=tmp_path, name="bend"
    )
    out = tmp_path / "family"
    asked = ("family", warped.folder, "--vary", "power=2..6", "--num", 3, "--out", out)
    result = shell.run(*asked)
    assert result.code == 0, result.err
    assert "3 of 3 variants" in result.out
    (table,) = out.glob("*.csv")
    rows = list(csv.DictReader(table.read_text().splitlines()))
    library = pd_editor.library
    library.add(tmp_path / "kept", out)
    cards = library.list(tmp_path / "kept").cards
    problems = {one.name: one.row.num_problems for one in cards}
    powers = sorted(float(row["power"]) for row in rows)
    assert [2 + 4 * n / 3 <= one <= 2 + 4 * (n + 1) / 3 for n, one in enumerate(powers)]
    for row in rows:
        recipe, _ = read_recipe(out / row["name"])
        (term,) = recipe.warps[0].terms
        assert term.power == float(row["power"])
        # The table of a library tells the same.
        assert int(row["num_problems"]) == problems[row["name"]]
        assert recipe.variant.note == f"power {term.power:g}"
    (page,) = out.glob("*.html")
    names = [one["name"] for one in scenes_in(page.read_bytes())]
    assert names == [row["name"] for row in rows] == ["bend-1", "bend-2", "bend-3"]
    # A second run replaces nothing unless told.
    assert "--overwrite" in shell.refused(*asked)
    assert shell.run(*asked, "--overwrite").code == 0


def test_generated_traffic_is_generated_anew(shell: Shell, tmp_path: Path):
    driven = pd_editor.generate(
        JUNCTION, model="lane-follower", out=tmp_path, name="driven", seed=3
    )
    out = tmp_path / "family"
    ranges = ("--vary", "seed=10..99", "--num", 2)
    assert shell.run("family", driven.folder, *ranges, "--out", out).code == 0
    samples = []
    for folder in sorted(one for one in out.iterdir() if one.is_dir()):
        (command,) = read_recipe(folder)[0].commands
        assert isinstance(command, ReplaceTraffic)
        assert 10 <= command.seed <= 99
        samples.append(command.sample.position_m.tobytes())
        again = shell.run("replay", folder, "--regenerate", "--out", tmp_path / "again")
        assert "generated again, equal" in again.out
    assert samples[0] != samples[1]


def test_members_that_fail_do_not_end_the_others(shell: Shell, tmp_path: Path):
    warped = pd_editor.warp(JUNCTION, kind="smooth-turn", power=5, out=tmp_path)
    out = tmp_path / "family"
    asked = ("family", warped.folder, "--num", 4, "--out", out, "--vary")
    result = shell.run(*asked, "power=5..15")
    assert result.code == 0, result.err
    assert "2 of 4 variants" in result.out
    assert result.out.count("is outside -10..10") == 2
    told = shell.refused(*asked, "power=50..99", "--overwrite")
    assert "is outside -10..10" in told
