"""Several scenes in one call of ``warp``, ``generate`` and ``replay``."""

import shutil
from pathlib import Path

import pytest

import pd_editor
from pd_editor.base.installed_files import demo_folder, demo_names
from pd_editor.cli.many_scenes import all_scenes
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from tests.cli.shell import Shell, files_of

BEND = {"kind": "smooth-turn", "power": 4}
WARP = ("--kind", "smooth-turn", "--power", 4)


@pytest.mark.slow
def test_a_call_for_all_gives_what_a_call_for_each_gives(tmp_path: Path):
    for demo in demo_names():
        bent = pd_editor.warp(demo, **BEND, out=tmp_path / "one/bent")
        driven = pd_editor.generate(
            bent.folder, model="lane-follower", out=tmp_path / "one/driven"
        )
        pd_editor.replay(driven.folder, out=tmp_path / "one/again")
    together = pd_editor.warp("demos", **BEND, out=tmp_path / "all/bent")
    assert [one.name for one in together.folders] == [
        f"{demo}-smooth-turn-p4" for demo in demo_names()
    ]
    # A folder of scenes, a pattern of them, and processes of their own.
    driven = pd_editor.generate(
        tmp_path / "all/bent", model="lane-follower", out=tmp_path / "all/driven"
    )
    assert len(driven.folders) == len(demo_names())
    pd_editor.replay(
        str(tmp_path / "all/driven/*"), out=tmp_path / "all/again", workers=2
    )
    recipes = {"recipe.json"}
    for part in ("bent", "driven", "again"):
        mine, theirs = (
            files_of(tmp_path / "all" / part),
            files_of(tmp_path / "one" / part),
        )
        assert mine.keys() == theirs.keys()
        # A recipe names the folder of its base.
        for name in mine:
            assert Path(name).name in recipes or mine[name] == theirs[name], name


def test_one_that_fails_does_not_stop_the_others(shell: Shell, tmp_path: Path):
    result = shell.run("warp", "merge", "nowhere", "queue", *WARP, "--out", tmp_path)
    assert result.code == 2
    written = [tmp_path / f"{demo}-smooth-turn-p4" for demo in ("merge", "queue")]
    assert result.lines[:2] == list(map(str, written))
    assert result.err.startswith("pd-editor: nowhere: is neither a scenario folder nor")
    assert result.err.count("\n") == 1


def test_a_second_run_does_what_is_left(shell: Shell, tmp_path: Path):
    command = ("warp", "merge", "queue", "downtown", *WARP, "--out", tmp_path)
    assert shell.run("warp", "queue", *WARP, "--out", tmp_path).code == 0
    before = files_of(tmp_path)
    result = shell.run(*command)
    assert (result.code, len(result.lines)) == (0, 5)
    assert result.lines[-1].startswith("1 of 3 scenes were done before")
    assert files_of(tmp_path).items() >= before.items()
    again = shell.run(*command, "--overwrite")
    assert (again.code, len(again.lines)) == (0, 6)


def test_results_below_the_scenes_are_no_scenes(tmp_path: Path):
    data, out = tmp_path / "data", tmp_path / "data/out"
    for demo in ("merge", "queue"):
        shutil.copytree(demo_folder(demo), data / "train" / demo)
    first = pd_editor.warp(data, **BEND, out=out)
    second = pd_editor.warp(data, **BEND, out=out, overwrite=True)
    assert len(first.folders) == 2
    assert second.folders == first.folders


def test_tables_and_pages_beside_scenes_are_no_scenes(shell: Shell, tmp_path: Path):
    """Of a pattern, also one that the shell expands; they made the call fail."""
    out = tmp_path / "out"
    pd_editor.warp("merge", **BEND, out=out)
    for name in ("scenes.index.parquet", "a-family.csv", "a-family.html", "report.md"):
        (out / name).write_text("")
    scenes = tuple(one for one in all_scenes(out, tmp_path / "new"))
    assert len(scenes) == 1
    assert all_scenes(f"{out}/*", tmp_path / "new") == scenes
    assert all_scenes(tuple(out.iterdir()), tmp_path / "new") == scenes
    recipes = (tmp_path / "new", "recipe.json")
    assert all_scenes(tuple(out.iterdir()), *recipes) == scenes
    # Alone it is meant.
    told = shell.refused("warp", out / "report.md", *WARP, "--out", tmp_path / "new")
    assert "is no file of a known format" in told
    told = shell.refused("warp", out, *WARP, "--out", out)
    assert told.startswith(f"{out}: all scenes there are in {out}, which gets")


def test_the_engine_of_one_scene_is_checked_too(shell: Shell, tmp_path: Path):
    command = ("warp", "merge", *WARP, "--out", tmp_path / "out")
    assert "expected 1 to 256" in shell.refused(*command, "--workers", 0)
    assert "is for --engine ray" in shell.refused(*command, "--address", "auto")


def test_links_to_scenes_are_followed_but_not_in_circles(tmp_path: Path):
    """``index`` and ``evaluate`` saw linked scenes, other commands did not."""
    kept, chosen = tmp_path / "kept", tmp_path / "chosen"
    pd_editor.warp("merge", kind=("smooth-turn",), power=(3,), out=kept)
    pd_editor.export("merge", name="plain", out=kept)
    chosen.mkdir()
    for one in kept.iterdir():
        (chosen / f"a-{one.name}").symlink_to(one)
    (chosen / "circle").symlink_to(chosen)
    assert len(all_scenes(chosen, tmp_path / "out")) == 2
    (kept / "again").symlink_to(kept / "plain")
    found = all_scenes(kept, tmp_path / "out")
    assert sorted(Path(one).name for one in found) == ["merge-smooth-turn-p3", "plain"]


def test_scenes_of_one_name_are_told(tmp_path: Path):
    """The second result would have to overwrite the first."""
    for root in ("one", "other"):
        shutil.copytree(demo_folder("merge"), tmp_path / root / "merge")
    outcome = pd_editor.warp(
        (tmp_path / "one/merge", tmp_path / "other/merge"), **BEND, out=tmp_path / "out"
    )
    assert len(outcome.folders) == 1
    ((scene, failure),) = outcome.failures.items()
    assert scene == str(tmp_path / "other/merge")
    assert "already holds files" in failure.reason


def test_a_bug_in_one_scene_is_told_as_a_bug(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """With its traceback and exit code 1, after the others are done."""

    def pose(scenario, anchor):
        if scenario.scenario_id == "merge":
            raise ZeroDivisionError("by zero")
        return pose_of_anchor(scenario, anchor)

    monkeypatch.setattr("pd_editor.cli.warp.pose_of_anchor", pose)
    result = shell.run("warp", "merge", "queue", "none", *WARP, "--out", tmp_path)
    assert result.code == 1
    assert result.lines[0] == str(tmp_path / "queue-smooth-turn-p4")
    assert "Traceback" in result.err
    assert "pd-editor: merge: ZeroDivisionError: by zero\n" in result.err
    assert "pd-editor: none: is neither" in result.err


@pytest.mark.parametrize(
    ("scenes", "options", "words"),
    [
        (
            ["merge", "queue"],
            ["--name", "mine"],
            "--name is for one scenario; 2 were given",
        ),
        (["merge", "queue"], ["--workers", 0], "--workers is 0; expected 1 to 256"),
        ([], [], "Missing SCENARIO; see pd-editor warp --help."),
        (["{}/*"], [], "no scene of a format that is read is there or below it"),
        (["*\0"], [], "*\\x00: is no usable path"),
        (["{}"], [], "no scene of a format that is read is there or below it"),
    ],
)
def test_what_cannot_be_done(
    shell: Shell, tmp_path: Path, scenes: list[str], options: list[object], words: str
):
    named = [one.format(tmp_path) for one in scenes]
    out = tmp_path / "new/out"
    assert words in shell.refused("warp", *named, *WARP, "--out", out, *options)
    assert not out.exists()
