"""``pd-editor library``."""

import csv
import io
import json
import multiprocessing
import os
import shutil
import zipfile
from pathlib import Path

import pytest

import pd_editor
from benchmarks import library_kills
from pd_editor.analysis.findings.scorecard import scorecard
from pd_editor.editor.library.library import Library, LibraryCard
from pd_editor.editor.recipe import Recipe
from tests.cli.shell import Shell


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library of a demo, a warped and a quiet one."""
    root = tmp_path_factory.mktemp("filled")
    warped = pd_editor.warp(
        "merge", kind="smooth-turn", power=6, name="bent", out=root / "out"
    )
    made = pd_editor.library.add(
        root / "library",
        ("crosswalk", warped.folder),
        tags=("paper",),
        author="A. Author",
    )
    assert [one.name for one in made.folders] == ["crosswalk", "bent"]
    return root / "library"


@pytest.fixture
def folder(filled: Path, tmp_path: Path) -> Path:
    return shutil.copytree(filled, tmp_path / "library")


def card_in(folder: Path, name: str) -> LibraryCard:
    card = Library(folder).card(name)
    assert card is not None
    return card


def test_a_library_is_listed_sorted_and_filtered(folder: Path, shell: Shell):
    head, *rows, told = shell.run("library", "list", folder).lines
    assert head.split() == [
        "name",
        "base",
        "city",
        "edits",
        "problems",
        "date",
        "family",
        "values",
        "tags",
        "note",
    ]
    assert told == "2 scenarios."
    assert len(rows) == 2
    by_name = shell.run("library", "list", folder, "--sort", "name").lines[1:-1]
    assert [row.split()[0] for row in by_name] == ["bent", "crosswalk"]
    (row,) = shell.run("library", "list", folder, "MERGE", "paper").lines[1:-1]
    assert row.startswith("bent")
    assert shell.run("library", "list", folder, "--tag", "none").lines[-1][0] == "0"
    cards = json.loads(shell.run("library", "list", folder, "bent", "--json").out)
    assert cards[0]["row"]["parent"] == "merge"
    assert cards[0]["author"] == "A. Author"
    assert cards[0]["format"] == "Argoverse 2"


def test_tags_are_in_the_card_and_in_the_recipe(folder: Path, shell: Shell):
    def tags() -> list[tuple[str, ...]]:
        cards = {one.name: one for one in Library(folder).cards()}
        texts = [(folder / one / "recipe.json").read_text() for one in sorted(cards)]
        said = [Recipe.from_text(one).variant.tags for one in texts]
        assert said == [cards[one].row.tags for one in sorted(cards)]
        return said

    run = ("library", "tag", folder, "*")
    done = shell.run(*run, "--add", "cut-in", "<b>", "--note", "<i>a</i>")
    assert done.out == "2 of 2 scenarios changed.\n"
    assert tags() == [("paper", "cut-in", "<b>")] * 2
    assert shell.run(*run, "--remove", "paper", "<b>").code == 0
    assert tags() == [("cut-in",)] * 2
    assert shell.run(*run, "--add", "cut-in").out == "0 of 2 scenarios changed.\n"
    # Commas part tags, as in the browser, where one with a comma was none that goes away.
    assert shell.run(*run, "--add", "one,two", "three").code == 0
    assert tags() == [("cut-in", "one", "two", "three")] * 2
    assert shell.run("library", "list", folder, "--tag", "one,two").lines[-1][0] == "2"
    assert shell.run(*run, "--remove", "one,two,three").code == 0
    assert shell.run("library", "check", folder).code == 0
    assert "nearest is bent" in shell.refused(
        "library", "tag", folder, "ben", "--add", "a"
    )
    assert "Nothing to change" in shell.refused(*run)
    # None is changed unless all can be.
    (folder / "crosswalk" / "recipe.json").write_text("{}")
    assert "not a recipe" in shell.refused(*run, "--add", "more")
    assert Library(folder).cards()[0].row.tags == ("cut-in",)
    assert "Expected up to 20 tags" in shell.refused(
        "library", "tag", folder, "bent", "--add", *map(str, range(30))
    )


def test_what_happens_in_them_is_found(folder: Path, shell: Shell):
    found = shell.run("library", "find", folder, "crossing")
    assert found.lines[-1] == "1 scenario."
    assert found.lines[0].startswith(str(folder / "crosswalk"))
    # A tag changes nothing of it, so that nothing is read again.
    before = (folder / "scenes.index.parquet").read_bytes()
    shell.run("library", "tag", folder, "*", "--add", "more")
    again = shell.run("library", "find", folder, "agents > 0")
    assert again.lines[-1] == "2 scenarios."
    assert (folder / "scenes.index.parquet").read_bytes() == before
    # The index is made again from the folders.
    (folder / "scenes.index.parquet").unlink()
    shutil.rmtree(folder / "bent")
    assert shell.run("library", "find", folder, "agents > 0").lines[-1] == "1 scenario."
    assert "is not known" in shell.refused("library", "find", folder, "cutin")


def test_what_cannot_be_found_yet_says_what_to_do(folder: Path, shell: Shell):
    """A metric was an unknown word, and a city without scenes no more than 0 scenarios."""
    told = shell.refused("library", "find", folder, "path_length > 5")
    assert "'path_length' is a metric" in told
    assert "'pd-editor library metrics' computes it" in told
    near = shell.refused("library", "find", folder, "path_lenght > 5")
    assert "the nearest is path_length" in near
    none = shell.run("library", "find", folder, "city = berlin or name = gone")
    assert none.lines == [
        "0 scenarios. No scene has city = berlin; there are synthetic. No scene has"
        " name = gone; there are bent, crosswalk."
    ]
    assert shell.run("library", "find", folder, "city = berlin", "--json").out == "[]\n"
    some = shell.run("library", "find", folder, "city = berlin or agents > 0")
    assert some.lines[-1] == "2 scenarios."


def test_any_of_them_are_exported_in_any_format(
    folder: Path, shell: Shell, tmp_path: Path
):
    out = tmp_path / "out"
    run = ("library", "export", folder, "bent", "cross*", "--out", out)
    done = shell.run(*run)
    assert done.lines == [str(out / "bent"), str(out / "crosswalk")]
    assert {one.name for one in (out / "bent").iterdir()} == {
        "log_map_archive_bent.json",
        "recipe.json",
        "scenario_bent.parquet",
    }
    rows = [*csv.DictReader(io.StringIO((out / "index.csv").read_text()))]
    assert [row["id"] for row in rows] == ["crosswalk", "bent"]
    assert "--overwrite" in shell.refused(*run)
    assert shell.run(*run, "--overwrite").code == 0
    packed = shell.run(*run, "--zip", "--to", "commonroad")
    assert packed.lines == [str(out / "scenarios.zip")]
    with zipfile.ZipFile(out / "scenarios.zip") as archive:
        assert {"index.csv", "bent/bent.xml", "bent/recipe.json"} <= {
            *archive.namelist()
        }
    assert "No format 'nonsense'" in shell.refused(*run, "--to", "nonsense")
    assert "holds no scenario" in shell.refused(
        "library", "export", folder, "../library/bent", "--out", out
    )


def test_an_export_comes_back_as_it_was(folder: Path, shell: Shell, tmp_path: Path):
    """Also without its base, and from another format; what is there is not doubled."""
    out, other = tmp_path / "out", tmp_path / "other"
    shell.run("library", "export", folder, "*", "--out", out)
    again = shell.run("library", "add", folder, out)
    assert again.lines == ["2 of 2 are there already."]
    text = (out / "bent" / "recipe.json").read_text()
    (out / "bent" / "recipe.json").write_text(text.replace("demo:merge", "/nowhere"))
    assert shell.run("library", "add", other, out).code == 0
    assert [one.name for one in Library(other).cards()] == ["bent", "crosswalk"]
    (bent, _) = Library(other).cards()
    assert bent.row.edits == card_in(folder, "bent").row.edits
    assert bent.row.tags == ("paper",)
    assert shell.run("library", "check", other).code == 0
    foreign = tmp_path / "foreign"
    shell.run(
        "library", "export", folder, "bent", "--to", "commonroad", "--out", foreign
    )
    assert shell.run("library", "add", folder, foreign).lines == [
        str(folder / "bent-2")
    ]
    assert shell.run("library", "add", folder, foreign).lines == [
        "1 of 1 are there already."
    ]
    assert card_in(folder, "bent-2").format == "CommonRoad"
    recipe = out / "crosswalk" / "recipe.json"
    assert shell.run("library", "add", folder, recipe, "nothing").code == 2


def test_each_broken_or_foreign_folder_is_told_in_one_sentence(
    folder: Path, shell: Shell, tmp_path: Path
):
    assert shell.run("library", "check", folder).lines == [
        "2 of 2 scenarios are whole."
    ]

    def faults() -> str:
        result = shell.run("library", "check", folder)
        assert (result.code, result.lines[0].split(" of ")[0]) == (2, "1")
        (fault,) = result.err.splitlines()
        return fault.removeprefix("pd-editor: ")

    (folder / "photographs").mkdir()
    (folder / "notes.txt").touch()
    shutil.rmtree(folder / "bent")
    assert faults() == (
        "photographs: holds no card.json; 'pd-editor library add' takes in scenes of "
        "other folders."
    )
    shutil.rmtree(folder / "photographs")
    place = folder / "wide"
    shutil.copytree(folder / "crosswalk", place)
    assert faults() == (
        f"wide: {place}/card.json: is the card of crosswalk; give the folder that name, "
        "or move it out and take it in by 'pd-editor library add'."
    )
    # (It was found, though no list had it.)
    found = shell.run("library", "find", folder, "agents > 0")
    assert found.lines == [str(folder / "crosswalk"), "1 scenario."]
    card = (place / "card.json").read_text()
    (place / "card.json").write_text(card.replace('"crosswalk"', '"wide"', 1))
    assert faults() == "wide: its files are of crosswalk."
    (place / "card.json").write_text("[")
    assert faults() == f"wide: {place}/card.json: is no JSON."
    (place / "card.json").write_text("[]")
    assert faults().startswith(f"wide: {place}/card.json: The card must be an object")
    shutil.rmtree(place)
    shutil.copytree(folder / "crosswalk", tmp_path / "whole")
    shutil.copytree(tmp_path / "whole", place)
    shutil.rmtree(folder / "crosswalk")
    place.rename(folder / "crosswalk")
    shutil.copytree(tmp_path / "whole", folder / "x")
    shutil.rmtree(folder / "x")
    assert shell.run("library", "check", folder).code == 0
    assert "is no library" in shell.refused("library", "list", tmp_path / "nowhere")


def test_what_does_not_agree_is_told(folder: Path, shell: Shell):
    def fault(name: str, file: str, old: str, new: str) -> str:
        path = folder / name / file
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))
        result = shell.run("library", "check", folder)
        path.write_text(text)
        assert result.code == 2
        return result.err.removeprefix("pd-editor: ").strip()

    told = "bent: its card.json tells other things than its files."
    assert fault("bent", "card.json", '"paper"', '"other"') == told
    assert fault("bent", "recipe.json", '"paper"', '"other"') == told
    path = folder / "bent" / "recipe.json"
    path.write_text(path.read_text().replace('"power": 6', '"power": 3'))
    (command,) = Recipe.from_text(path.read_text()).commands
    (label,) = card_in(folder, "bent").row.edits
    assert fault("bent", "card.json", label, command.label) == (
        "bent: its recipe makes another scenario than its files hold."
    )
    (folder / "bent" / "scenario_bent.parquet").write_bytes(b"PAR1")
    result = shell.run("library", "check", folder)
    assert result.code == 2
    assert result.err.count("\n") == 1


def test_names_of_any_kind_become_names_of_folders(shell: Shell, tmp_path: Path):
    pd_editor.export("merge", out=tmp_path / "a b.é", name="x")
    folder = tmp_path / "a library of é"
    result = shell.run("library", "add", folder, tmp_path / "a b.é", "--note", "<b>")
    assert result.lines == [str(folder / "x")]
    assert shell.run("library", "list", folder).lines[1].endswith("<b>")
    refused = shell.run("library", "add", folder, "merge", "--tags", "a\x00")
    assert refused.code == 2
    assert "control characters" in refused.err


@pytest.mark.slow
@pytest.mark.parametrize("what", library_kills.WORK)
def test_a_kill_loses_nothing_and_leaves_all_whole(tmp_path: Path, what: str):
    for seed in range(5):
        folder = tmp_path / str(seed) / "library"
        library_kills.make(folder)
        assert library_kills.one_kill(folder, what, seed) == []


def add_many(folder: Path, count: int) -> None:
    for _ in range(count):
        pd_editor.library.add(folder, "crosswalk", tags=(str(os.getpid()),))


def tag_many(folder: Path, tags: tuple[str, ...]) -> None:
    for one in tags:
        pd_editor.library.tag(folder, "*", add=(one,))


def test_two_writers_at_once_lose_nothing(folder: Path):
    context = multiprocessing.get_context("fork")
    mine, theirs = ("a", "b", "c", "d", "e"), ("v", "w", "x", "y", "z")
    both = [
        context.Process(target=tag_many, args=(folder, one)) for one in (mine, theirs)
    ]
    for one in both:
        one.start()
    for one in both:
        one.join()
        assert one.exitcode == 0
    for card in Library(folder).cards():
        assert set(card.row.tags) == {"paper", *mine, *theirs}


def test_metrics_are_kept_in_cards_and_lists_sort_by_them(folder: Path, shell: Shell):
    done = shell.run("library", "metrics", folder, "*")
    assert done.out == "2 of 2 scenarios measured.\n"
    for name in ("bent", "crosswalk"):
        told = card_in(folder, name).metrics
        rows = scorecard(pd_editor.open_scenario(folder / name))
        assert told == {one.name: one.value for one in rows if one.value == one.value}
    head, *rows, _ = shell.run("library", "list", folder, "--sort", "path_length").lines
    assert head.split()[:2] == ["name", "path_length"]
    lengths = [float(row.split()[1]) for row in rows]
    assert lengths == sorted(lengths, reverse=True)
    found = shell.run("library", "find", folder, f"path_length >= {lengths[0] - 0.1}")
    assert rows[0].split()[0] in found.out
    wrong = shell.run("library", "list", folder, "--sort", "path_lenght")
    assert "the nearest is path_length" in wrong.err
    assert shell.run("library", "check", folder).code == 0


def test_a_folder_of_other_things_is_told_to_be_no_library(folder: Path, shell: Shell):
    """It was an empty one."""
    for one in (folder / "bent", folder.parent):
        assert "is no library" in shell.run("library", "list", one).err
    shutil.rmtree(folder / "bent")
    shutil.rmtree(folder / "crosswalk")
    assert shell.run("library", "list", folder).lines[-1] == "0 scenarios."
