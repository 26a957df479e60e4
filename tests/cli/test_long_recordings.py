"""Recordings with more future than the model samples are cut on the shell."""

from pathlib import Path

import pytest

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.exporters.bundle import write_files
from tests.cli.shell import Shell
from tests.scene.test_time_cut import long_recording

CUT = ("--current", 5, "--until", 6)


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
