"""Recordings with more future than the model samples are cut on the shell."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from tests.cli.shell import Shell
from tests.scene.test_time_cut import long_recording, recording_of_minutes

pytestmark = pytest.mark.usefixtures("no_processes")

CUT = ("--current", 5, "--until", 6)


@pytest.fixture
def minutes(tmp_path: Path) -> Path:
    """A folder with a recording that lasts longer than scenes may."""
    return recording_of_minutes(tmp_path / "data" / "val")


@pytest.mark.parametrize(
    "command",
    [
        ("generate", "--model", "path-diffuser", "--tries", 0),
        ("warp", "--kind", "smooth-turn", "--power", 4),
        ("export", "--name", "cut"),
    ],
)
def test_long_recordings_are_cut_and_replayed(
    command: tuple, shell: Shell, tmp_path: Path
):
    write_files(scenario_files(long_recording()), tmp_path / "long", forbidden=None)
    name, *options = command
    where = (name, tmp_path / "long", *options, "--out", tmp_path / "out")
    if name == "generate":
        assert "--until 6" in shell.refused(*where)
    made = shell.run(*where, *CUT)
    assert made.code == 0, made.err
    assert open_scenario(made.lines[0]).time_axis.num_steps == 110
    recipe = Path(made.lines[0]) / "recipe.json"
    again = shell.run("replay", recipe, "--out", tmp_path / "again")
    assert again.code == 0, again.err
    for path in Path(made.lines[0]).iterdir():
        assert (Path(again.lines[0]) / path.name).read_bytes() == path.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["study", "evaluate"])
def test_studies_and_evaluations_take_what_models_sample_of_them(
    command: str, shell: Shell, tmp_path: Path
):
    """They failed on every such scene (public case 8)."""
    data, out = tmp_path / "data" / "val" / "long", tmp_path / "out"
    write_files(scenario_files(long_recording()), data, forbidden=None)
    options = ("--methods", "path-diffuser", "--kinds", "ripple-road", "--powers", "4")
    if command == "evaluate":
        options = ("--methods", "path-diffuser")
    made = shell.run(command, "--data", tmp_path / "data", "--out", out, *options)
    assert made.code == 0, made.err
    assert "failed" not in made.err
    assert "lasts" not in (out / "report.md").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["study", "evaluate"])
def test_they_take_a_moment_of_recordings_of_minutes(
    command: str, shell: Shell, minutes: Path, tmp_path: Path
):
    """Those were left out, and nothing told at which moment to look."""
    out = tmp_path / "out"
    options: tuple = ("--methods", "lane-follower", "--current", 60)
    if command == "study":
        extras = "--gallery", 1, "--dangers", 1
        options = ("--kinds", "ripple-road", "--powers", "4", *extras, *options)
    given = command, "--data", minutes.parents[1], "--out", out, *options
    made = shell.run(*given)
    assert (made.code, "failed" in made.err, "left out" in made.err) == (0, 0, 0)
    assert "--current 60" in (out / "report.md").read_text()
    for one in (out / "gallery").glob("*"):
        assert open_scenario(one).time_axis.num_future_steps == 60
        assert shell.run("replay", one, "--out", tmp_path / "again").code == 0
    assert "current" in shell.refused(*given[:-1], 50, "--resume")


def test_a_moment_need_not_be_named(shell: Shell, minutes: Path, tmp_path: Path):
    given = ("--data", minutes.parent, "--out", tmp_path / "out")
    made = shell.run("evaluate", *given, "--methods", "ground-truth")
    assert (made.code, made.err) == (0, "")


def test_threats_and_drives_are_of_a_moment(
    shell: Shell, minutes: Path, tmp_path: Path
):
    told = shell.refused("threats", minutes)
    assert "--current S" in told
    assert shell.run("threats", minutes, *CUT).code == 0
    options = (
        "--policies",
        "idm",
        "--ego",
        1140,
        "--seconds",
        1,
        "--model",
        "lane-follower",
    )
    given = ("drive", minutes, *options, "--out", tmp_path / "out")
    made = shell.run(*given, *CUT)
    assert made.code == 0, made.err
    assert open_scenario(made.lines[0]).time_axis.num_future_steps == 10
    # Another moment is another drive.
    assert "--overwrite" in shell.refused(*given, "--current", 60, "--until", 6)
    square = ("--around", 0, 0, "--radius", 1)
    assert "no lane within 1 m" in shell.refused("threats", minutes, *square)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["study", "evaluate"])
def test_they_take_parts_of_maps(command: str, shell: Shell, tmp_path: Path):
    """Maps beyond the limits of a scene were refused."""
    out = tmp_path / "out"
    extras: tuple = ("--methods", "ground-truth", "--workers", 1)
    if command == "study":
        extras += ("--kinds", "ripple-road", "--powers", 4, "--gallery", 2)
        extras += ("--dangers", 1)
    given = command, "--data", "roundabout", *extras, "--radius", 40
    assert "--around" in shell.refused(*given, "--out", out)
    made = shell.run(*given, "--densest", 2, "--out", out)
    assert (made.code, "failed" in made.err) == (0, False), made.err
    report = (out / "report.md").read_text()
    assert ("--radius 40.0" in report, "--densest 2" in report) == (True, True)
    rows = out / ("rows.parquet" if command == "evaluate" else "variants.parquet")
    names = set(pq.read_table(rows)["scenario_id"].to_pylist())
    assert ["-x" in one for one in names] == [True, True]
    for one in (out / "gallery").glob("*"):
        assert '"radius_m": 40' in (one / "recipe.json").read_text()
    x, y = open_scenario("roundabout").origin_city_m
    around = "--around", x, y
    assert "exclude" in shell.refused(*given, *around, "--densest", 2, "--out", out)
    assert "map_parts" in shell.refused(*given, *around, "--out", out, "--resume")
    made = shell.run(*given, *around, "--out", tmp_path / "one")
    assert made.code == 0, made.err
    nowhere = "--around", 0, 0, "--out", tmp_path / "none"
    assert "no lane within 1 m" in shell.refused(*given[:-1], 1, *nowhere)
