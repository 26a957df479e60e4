"""``pd-editor family``."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

import pd_editor
from pd_editor.analysis.guidance.kinds.speed import TargetSpeed
from pd_editor.cli.replay import read_recipe
from pd_editor.editor import family
from pd_editor.editor.commands import AddGuidance, ReplaceTraffic, SetAgentSpeed
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.varied_numbers import varied_values
from pd_editor.scene.road_warp import RoadWarp
from tests.cli.shell import JUNCTION, Shell
from tests.scene.formats.embedded_scenes import scenes_in


def test_a_recipe_becomes_a_family_of_bends(shell: Shell, tmp_path: Path):
    warped = pd_editor.warp(
        JUNCTION, kind="smooth-turn", power=5, out=tmp_path, name="bend"
    )
    out = tmp_path / "family"
    ranges = ("power=2..6", "seed=10..99")
    asked = ("family", warped.folder, "--vary", *ranges, "--num", 3, "--out", out)
    asked += ("--model", "lane-follower")
    result = shell.run(*asked)
    assert result.code == 0, result.err
    assert "3 of 3 variants" in result.out
    (table,) = out.glob("*.csv")
    rows = list(csv.DictReader(table.read_text().splitlines()))
    library = pd_editor.library
    library.add(tmp_path / "kept", out)
    cards = library.list(tmp_path / "kept").cards
    problems = {one.name: one.row.num_problems for one in cards}
    told = {}
    powers = sorted(float(row["power"]) for row in rows)
    assert [2 + 4 * n / 3 <= one <= 2 + 4 * (n + 1) / 3 for n, one in enumerate(powers)]
    for row in rows:
        recipe, _ = read_recipe(out / row["name"])
        (term,) = recipe.warps[0].terms
        assert term.power == float(row["power"])
        # The table of a library tells the same.
        assert int(row["num_problems"]) == problems[row["name"]]
        # Nothing was generated, so traffic comes at the end.
        traffic = recipe.commands[-1]
        assert isinstance(traffic, ReplaceTraffic)
        assert traffic.seed == int(row["seed"])
        told[row["name"]] = {"power": term.power, "seed": traffic.seed}
    # They stay what they are when a note is written.
    library.tag(tmp_path / "kept", "bend-*", note="for the figure")
    cards = library.list(tmp_path / "kept").cards
    assert {one.name: dict(one.row.values) for one in cards} == told
    assert {one.row.parent for one in cards} == {"bend"}
    assert cards[0].row.lineage.endswith(", variant of bend")
    assert "seed=" in str(library.list(tmp_path / "kept", ("variant of bend",)))
    library.check(tmp_path / "kept")
    found = library.find(tmp_path / "kept", "parent = bend and power > 4 and speed > 0")
    large = {name for name, one in told.items() if one["power"] > 4}
    assert {Path(one.path).name for one in found.scenes} == large
    assert (
        str(found).splitlines()[-1]
        == f"{len(large)} scenario{'s' * (len(large) != 1)}."
    )
    assert "nearest is power" in shell.refused(
        "library", "find", tmp_path / "kept", "powr > 4"
    )
    library.export(tmp_path / "kept", "bend-*", out=tmp_path / "share")
    index = csv.DictReader((tmp_path / "share" / "index.csv").read_text().splitlines())
    assert {(one["parent"], one["values"]) for one in index} == {
        ("bend", f"power={one['power']:.10g}; seed={one['seed']}")
        for one in told.values()
    }
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


def test_guidance_that_was_not_run_is_run(shell: Shell, tmp_path: Path):
    driven = pd_editor.generate(
        JUNCTION, model="lane-follower", out=tmp_path, name="driven"
    )
    recipe, _ = read_recipe(driven.folder)
    agent = open_scenario(JUNCTION).focal_id
    term = AddGuidance(term=TargetSpeed(agent_ids=(agent,), speed_mps=5.0))
    path = tmp_path / "recipe.json"
    path.write_text(replace(recipe, commands=(*recipe.commands, term)).to_text())
    asked = ("family", path, "--vary", "speed_mps=2..9", "--num", 2)
    result = shell.run(*asked, "--out", tmp_path / "out")
    assert result.code == 0, result.err
    for folder in (tmp_path / "out").glob("*-?"):
        # The traffic that the new one replaces is not made.
        guidance, command = read_recipe(folder)[0].commands
        assert isinstance(guidance, AddGuidance)
        assert isinstance(command, ReplaceTraffic)
        assert agent in command.sample.ids
        assert (
            "equal"
            in shell.run(
                "replay", folder, "--regenerate", "--out", tmp_path / "again"
            ).out
        )


def test_of_traffic_that_is_made_again_the_last_seed_is_varied(
    shell: Shell, tmp_path: Path
):
    driven = pd_editor.generate(
        JUNCTION, model="lane-follower", out=tmp_path, name="driven", seed=3
    )
    recipe, _ = read_recipe(driven.folder)
    (first,) = recipe.commands
    assert isinstance(first, ReplaceTraffic)
    path = tmp_path / "recipe.json"
    again = replace(first, seed=4)
    path.write_text(replace(recipe, commands=(first, again)).to_text())
    result = shell.run(
        "family", path, "--vary", "seed=10..99", "--out", tmp_path / "out", "--num", 1
    )
    assert result.code == 0, result.err
    (command,) = read_recipe(tmp_path / "out" / "driven-1")[0].commands
    assert isinstance(command, ReplaceTraffic)
    assert command.seed >= 10
    # A change of motion in between may depend on the first.
    stops = SetAgentSpeed(agent_ids=first.sample.ids[:1], speed_mps=1.0)
    path.write_text(replace(recipe, commands=(first, stops, again)).to_text())
    more = ("--vary", "seed=10..99", "--out", tmp_path / "more", "--num", 1)
    result = shell.run("family", path, *more)
    assert result.code == 0, result.err
    made, _ = read_recipe(tmp_path / "more" / "driven-1")
    runs = [one for one in made.commands if isinstance(one, ReplaceTraffic)]
    assert [one.seed >= 10 for one in runs] == [True, True]
    assert varied_values(made) == {"1.seed": runs[0].seed, "3.seed": runs[1].seed}


def test_an_interrupted_run_tells_what_it_has_made(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    warped = pd_editor.warp(JUNCTION, kind="smooth-turn", power=5, out=tmp_path)
    out = tmp_path / "family"
    make = family.member

    def twice(*about: object, **options: object) -> object:
        if len(list(out.glob("*-?"))) == 2:
            raise KeyboardInterrupt
        return make(*about, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(family, "member", twice)
    with pytest.raises(KeyboardInterrupt):
        pd_editor.family(warped.folder, vary="power=2..4", num=4, out=out,
                         model="lane-follower")  # fmt: skip
    (table,) = out.glob("*.csv")
    assert len(table.read_text().splitlines()) == 3
    assert len(list(out.glob("*.html"))) == 1


def test_members_that_fail_do_not_end_the_others(shell: Shell, tmp_path: Path):
    warped = pd_editor.warp(JUNCTION, kind="smooth-turn", power=5, out=tmp_path)
    out = tmp_path / "family"
    asked = ("family", warped.folder, "--num", 4, "--out", out)
    asked += ("--model", "lane-follower", "--vary")
    result = shell.run(*asked, "power=5..15")
    # As of scenes that fail: what is there is told, what is not is an error.
    assert result.code == 2
    assert "2 of 4 variants" in result.out
    assert result.err.count("is outside -10..10") == 2
    told = shell.refused(*asked, "power=50..99", "--overwrite")
    assert "is outside -10..10" in told


def test_edits_are_made_in_other_scenes(shell: Shell, tmp_path: Path):
    bent = pd_editor.warp(
        JUNCTION, kind="smooth-turn", power=5, out=tmp_path, name="bend"
    )
    out = tmp_path / "family"
    asked = ("family", bent.folder, "--on", "roundabout", "merge", "no-such-demo")
    asked += ("--out", out, "--model", "lane-follower")
    result = shell.run(*asked)
    assert result.code == 2
    assert "2 of 3 variants" in result.out
    assert "bend-on-no-such-demo (no-such-demo): no-such-demo: is neither" in result.err
    for name in ("roundabout", "merge"):
        made = open_scenario(out / f"bend-on-{name}")
        recipe, _ = read_recipe(out / f"bend-on-{name}")
        assert recipe.base.scenario_id == name
        assert recipe.variant.parent == "bend"
        assert recipe.warps[0].terms == open_warp(bent.folder).terms
        assert made.provenance.is_bent
        # What is written can be made again from its own base.
        again = shell.run(
            "replay", out / f"bend-on-{name}", "--out", tmp_path / "again"
        )
        assert again.code == 0, again.err
    (table,) = out.glob("*.csv")
    rows = csv.DictReader(table.read_text().splitlines())
    assert [row["base"] for row in rows] == ["roundabout", "merge"]
    # With ranges each scene gets its own variants.
    both = shell.run(*asked[:5], "--vary", "power=2..4", "--num", 2, *asked[6:], "--overwrite")  # fmt: skip
    assert "4 of 4 variants" in both.out, both.err
    assert "needs a range" in shell.refused(*asked[:2], *asked[6:])


def open_warp(folder: Path) -> RoadWarp:
    (warp,) = read_recipe(folder)[0].warps
    return warp
