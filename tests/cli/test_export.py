import csv
import re
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.installed_files import demo_folder, demo_names
from pd_editor.cli.export import export
from pd_editor.cli.generate import generate
from pd_editor.cli.warp import warp
from pd_editor.editor.scenario_store import open_scenario
from tests.cli.shell import JUNCTION, Shell, files_of
from tests.scene.av2_io.small_files import MAP, TRACKS, changed_map, rows, with_cell


def folder_with(folder: Path, **files: bytes) -> Path:
    folder.mkdir()
    names = {"tracks": "scenario_x.parquet", "map": "log_map_archive_x.json"}
    for key, data in files.items():
        (folder / names[key]).write_bytes(data)
    return folder


@pytest.mark.parametrize("name", demo_names())
def test_a_demo_is_written_with_a_recipe(shell: Shell, tmp_path: Path, name: str):
    result = shell.run("export", name, "--out", tmp_path)
    assert (result.code, result.err) == (0, "")
    assert result.lines == [str(tmp_path / name)]
    assert sorted(path.name for path in (tmp_path / name).iterdir()) == [
        f"log_map_archive_{name}.json",
        "recipe.json",
        f"scenario_{name}.parquet",
    ]
    one, other = open_scenario(name), open_scenario(tmp_path / name)
    np.testing.assert_array_equal(one.agents.position_m, other.agents.position_m)


def test_it_is_only_overwritten_on_demand(shell: Shell, tmp_path: Path):
    command = ("export", JUNCTION, "--out", tmp_path)
    assert shell.run(*command).code == 0
    assert "already holds files" in shell.refused(*command)
    assert shell.run(*command, "--overwrite").code == 0


def test_the_input_is_never_overwritten(shell: Shell, tmp_path: Path):
    folder = export(JUNCTION, out=tmp_path).folder
    before = files_of(folder)
    refused = shell.refused("export", folder, "--out", tmp_path, "--overwrite")
    assert "the input is never written to" in refused
    assert files_of(folder) == before
    demos = demo_folder(JUNCTION).parent
    refused = shell.refused("export", JUNCTION, "--out", demos, "--overwrite")
    assert "the input is never written to" in refused


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        ({}, "found no track files"),
        ({"map": MAP}, "found no track files"),
        ({"tracks": TRACKS}, "the map log_map_archive_x.json is missing"),
        ({"tracks": TRACKS[:200], "map": MAP}, "scenario_x.parquet: "),
        ({"tracks": TRACKS, "map": b"[1"}, "log_map_archive_x.json: "),
        ({"tracks": TRACKS, "map": b"{}"}, "log_map_archive_x.json: "),
        ({"tracks": rows([]), "map": MAP}, "scenario_x.parquet: "),
        ({"tracks": rows([0, 0, 1]), "map": MAP}, "scenario_x.parquet: "),
        (
            {"tracks": with_cell("position_x", 3, float("nan")), "map": MAP},
            "scenario_x.parquet: ",
        ),
        (
            {"tracks": TRACKS, "map": changed_map(lambda m: m.pop("lane_segments"))},
            "log_map_archive_x.json: ",
        ),
    ],
)
def test_damaged_folders_get_one_sentence(
    shell: Shell, tmp_path: Path, files: dict[str, bytes], sentence: str
):
    folder = folder_with(tmp_path / "x", **files)
    assert sentence in shell.refused("export", folder, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["nowhere", "~nobody-here/x", "", "demo:x"])
def test_a_wrong_name_lists_the_demos(shell: Shell, tmp_path: Path, name: str):
    refused = shell.refused("export", name, "--out", tmp_path / "out")
    assert "is neither a scenario folder nor a demo (bus-stop, " in refused


def test_a_file_in_the_way_of_the_output(shell: Shell, tmp_path: Path):
    (tmp_path / "file").write_text("")
    refused = shell.refused("export", JUNCTION, "--out", tmp_path / "file")
    assert f"file/{JUNCTION}: cannot be written (" in refused


@pytest.mark.slow
def test_av2_loads_what_was_exported(shell: Shell, tmp_path: Path):
    pytest.importorskip("av2")
    bent = warp(JUNCTION, kind="ripple-road", power=3, out=tmp_path / "bent").folder
    driven = generate(bent, out=tmp_path / "driven").folder
    result = shell.run("export", driven, "--verify", "--out", tmp_path / "out")
    assert result.code == 0, result.err
    (said,) = result.lines[1:]
    assert re.fullmatch(
        r"Loaded again with av2's own loaders and the editor's reader; (\d+) of \1 "
        r"agents are visible to loaders at the last observed step\.",
        said,
    )


@pytest.mark.real_data
def test_a_real_scenario_makes_the_whole_journey(
    shell: Shell, av2_scenario_folders: list[Path], tmp_path: Path
):
    source = av2_scenario_folders[0]
    before = files_of(source)
    bent = f"{source.name[:8]}-double-turn-p4"
    steps = (
        ("warp", source, "--kind", "double-turn", "--power", 4, "--friction", 0.7),
        ("generate", tmp_path / "warp" / bent, "--seed", 2),
        ("export", tmp_path / "generate" / f"{bent}-s2"),
        ("replay", tmp_path / "warp" / bent / "recipe.json"),
    )
    for command, *rest in steps:
        result = shell.run(command, *rest, "--out", tmp_path / command)
        assert result.code == 0, result.err
    assert files_of(source) == before
    folders = [tmp_path / name / bent for name in ("warp", "replay")]
    assert files_of(folders[0]) == files_of(folders[1])


def test_name_tags_and_note_are_written_and_a_zip_has_a_table(
    shell: Shell, tmp_path: Path
):
    """(D6): every export has an id of its own, and says what it was made from."""
    pytest.importorskip("av2")
    bent = warp(JUNCTION, kind="ripple-road", power=3, out=tmp_path / "bent").folder
    result = shell.run(
        *("export", bent / "recipe.json", "--out", tmp_path, "--verify"),
        *("--name", "mine", "--tags", "hard", "night", "--note", "=1+1"),
    )
    assert (result.code, result.err) == (0, "")
    assert result.lines[0] == str(tmp_path / "mine")
    opened = open_scenario(tmp_path / "mine")
    assert opened.scenario_id == "mine"
    base = opened.provenance.base
    assert base is not None
    assert base.scenario_id == JUNCTION
    sources = (JUNCTION, bent / "recipe.json", tmp_path / "mine" / "recipe.json", bent)
    result = shell.run("export", *sources, "--out", tmp_path, "--zip")
    assert (result.code, result.err) == (0, "")
    with zipfile.ZipFile(tmp_path / "scenarios.zip") as archive:
        lines = list(csv.DictReader(archive.read("index.csv").decode().splitlines()))
        names = {name.split("/")[0] for name in archive.namelist()} - {"index.csv"}
    ids = [JUNCTION, bent.name, "mine", f"{bent.name}-2"]
    assert [line["id"] for line in lines] == ids
    assert names == set(ids)
    assert [line["base_id"] for line in lines] == [JUNCTION] * 4
    assert (lines[2]["tags"], lines[2]["note"]) == ("hard; night", "'=1+1")
    assert lines[1]["edits"] == "Bend the road: waves +3"
    assert "add --overwrite" in shell.refused(
        "export", JUNCTION, "--out", tmp_path, "--zip"
    )
    assert "is for one scenario" in shell.refused(
        "export", JUNCTION, bent, "--out", tmp_path, "--name", "x"
    )
    assert "expected up to 80 letters" in shell.refused(
        "export", JUNCTION, "--out", tmp_path, "--name", "a/b"
    )


def test_without_av2_nothing_is_written_to_verify(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Its wheels end with Python 3.12."""
    monkeypatch.setitem(sys.modules, "av2", None)
    refused = shell.refused("export", JUNCTION, "--verify", "--out", tmp_path / "out")
    assert "the package av2, which is missing" in refused
    assert not (tmp_path / "out").exists()
