"""The library on disk, and its table."""

import csv
import io
import os
import tempfile
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from unittest import mock
from xml.etree import ElementTree

import numpy as np
import pytest
from filelock import FileLock
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.analysis.findings.finding import problems_in_words
from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.guidance.kinds.speed import TargetSpeed
from pd_editor.base.errors import EditError, ExportError, InputError
from pd_editor.editor.commands import AddGuidance, TransformAgents, traffic_command
from pd_editor.editor.library import library as module
from pd_editor.editor.library.index_table import index_csv, index_row
from pd_editor.editor.library.library import Library, card_of
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import exported_files
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import Variant
from pd_editor.scene.generation import GenerationRequest, run_to_end
from tests.builders import two_agents_that_pass
from tests.editor.fake_generators import DriftGenerator


def saved(library: Library, name: str, moment: float, note: str = "") -> None:
    session = EditorSession(two_agents_that_pass())
    session.apply(TransformAgents(agent_ids=("101",), dy_m=-3.5))
    session.describe(Variant(name=name, tags=("a",), note=note))
    recipe = session.recipe()
    card = card_of(session.scenario, session.base, recipe)
    library.add(
        replace(card, saved_at=moment), exported_files(session.scenario, recipe)
    )


def test_entries_outlive_the_process_and_are_zipped_with_a_table(tmp_path: Path):
    """(D6): only one scenario could be downloaded, under the original's id."""
    library = Library(tmp_path / "library")
    assert library.cards() == []
    saved(library, "second", 2.0, note="=cmd()")
    saved(library, "first", 1.0)
    again = Library(tmp_path / "library")
    assert [entry.name for entry in again.cards()] == ["first", "second"]
    assert again.cards()[0].row.num_problems >= 1
    assert again.cards() == library.cards()
    with zipfile.ZipFile(io.BytesIO(again.zipped({"second", "gone"}))) as archive:
        assert sorted(archive.namelist()) == [
            "index.csv",
            "second/log_map_archive_second.json",
            "second/recipe.json",
            "second/scenario_second.parquet",
        ]
        (row,) = csv.DictReader(io.StringIO(archive.read("index.csv").decode()))
    assert row["problems"].startswith("collision")
    assert (row["base_id"], row["num_edits"]) == ("two-lane-road", "1")
    assert row["note"] == "'=cmd()"
    with pytest.raises(InputError, match="holds none of these"):
        again.zipped(["gone"])


def test_nothing_is_replaced_and_what_is_removed_is_gone(tmp_path: Path):
    library = Library(tmp_path)
    saved(library, "one", 1.0)
    with pytest.raises(ExportError, match="already holds files"):
        saved(library, "one", 2.0)
    library.remove("one")
    library.remove("../elsewhere")
    assert library.cards() == []
    with pytest.raises(InputError, match="holds none of these"):
        library.zipped(["one"])


def test_what_is_removed_can_be_put_back_for_a_day(tmp_path: Path):
    library = Library(tmp_path)
    saved(library, "one", 1.0)
    (entry,) = library.cards()
    library.remove("one")
    saved(library, "one", 2.0)
    library.remove("one")
    # The one that was removed last.
    assert library.put_back("one") == "one"
    assert [again.saved_at for again in library.cards()] == [2.0]
    (aside,) = tmp_path.glob(".one.*")
    library.remove("one")
    os.utime(aside, (0.0, 0.0))
    again = Library(tmp_path)
    assert not aside.exists()
    again.put_back("one")
    assert again.cards() == [replace(entry, saved_at=2.0)]
    with pytest.raises(ExportError, match="removed for good"):
        again.put_back("one")


def test_what_is_put_back_makes_way_for_one_that_took_its_name(tmp_path: Path):
    library = Library(tmp_path)
    saved(library, "one", 1.0, note="the first")
    library.measure("one")
    (before,) = library.cards()
    files = library.files("one")
    library.remove("one")
    saved(library, "one", 2.0)
    assert library.put_back("one") == "one-2"
    back = library.card("one-2")
    assert back == replace(before, row=replace(before.row, scenario_id="one-2"))
    assert library.card("one").saved_at == 2.0
    library.check("one-2")
    assert library.files("one-2").keys() == {
        name.replace("_one", "_one-2") for name in files
    }
    with pytest.raises(ExportError, match="removed for good"):
        library.put_back("one")


def test_what_is_half_written_or_damaged_is_not_listed(tmp_path: Path, caplog):
    library = Library(tmp_path)
    saved(library, "one", 1.0)
    left = tmp_path / ".one.12345678.new"
    (tmp_path / "one").rename(left)
    assert Library(tmp_path).cards() == []
    assert left.exists(), "it may be at work"
    os.utime(left, (0.0, 0.0))
    assert Library(tmp_path).cards() == []
    assert not left.exists()
    saved(library, "two", 1.0)
    (tmp_path / "two" / "card.json").write_text('{"row": {')
    assert library.cards() == []
    assert "two in the library cannot be read" in caplog.text


def test_problems_of_an_earlier_export_are_not_the_recordings():
    """(D5): overlaps that edits had caused counted as the recording's own."""
    session = EditorSession(two_agents_that_pass())
    session.apply(TransformAgents(agent_ids=("101",), dy_m=-3.5))
    export = session.scenario
    unedited = Recipe(base=export.reference)
    assert index_row(export, export, unedited).num_problems == 0
    provenance = replace(export.provenance, edited_ids=session.recipe().edited_ids)
    export = replace(export, provenance=provenance)
    assert index_row(export, export, unedited).num_problems >= 1


def test_a_threat_that_was_never_run_is_told_in_the_table():
    """Three of them were three threat scenarios without a problem."""
    session = EditorSession(two_agents_that_pass())
    threat = Threaten(agent_id="101", other_id="100", approach="rear")
    session.apply(AddGuidance(term=threat))
    row = index_row(session.scenario, session.base, session.recipe())
    assert row.problems == {"guidance-not-run": 1}
    assert row.guidance == ("threat of agent 101 to 100 (from behind): not run",)
    (line,) = csv.DictReader(io.StringIO(index_csv([row]).decode()))
    assert line["num_problems"] == "1"
    assert line["guidance"] == row.guidance[0]
    assert problems_in_words(row.problems) == "1 new problem (1 guidance not run)"


def test_asked_and_achieved_are_in_the_table():
    session = EditorSession(two_agents_that_pass())
    session.apply(AddGuidance(term=TargetSpeed(agent_ids=("100",), speed_mps=50.0)))
    request = GenerationRequest(scenario=session.scenario, agent_ids=("100",))
    traffic = run_to_end(DriftGenerator().generate(request))
    session.apply(traffic_command(request, traffic))
    row = index_row(session.scenario, session.base, session.recipe())
    assert row.problems["guidance-not-met"] == 1
    (told,) = row.guidance
    assert told.startswith("target speed of agent 100: asked 50.0 m/s")
    assert "achieved" in told


def test_a_table_of_nothing_has_its_head():
    assert index_csv([]).startswith(b"id,name,base_id,parent,values,city")


def test_a_thumbnail_shows_the_state(tmp_path: Path):
    """Ground, one box per agent that is there, the focal agent in its own colour."""
    scenario = two_agents_that_pass()
    drawn = ElementTree.fromstring(thumbnail(scenario))
    boxes = [one for one in drawn.iter() if one.tag.endswith("polygon")]
    assert len(boxes) == 2
    assert len({box.get("fill") for box in boxes}) == 2
    corners = np.array(
        [point.split(",") for point in boxes[0].get("points", "").split()], float
    )
    # Around the focal agent, in metres, with y down.
    focal = scenario.agents.row_of[scenario.focal_id]
    step = scenario.current_step
    position = (
        scenario.agents.position_m[:, step] - scenario.agents.position_m[focal, step]
    )
    np.testing.assert_allclose(corners.mean(axis=0), position[0] * [1, -1], atol=0.1)
    (ground,) = [one for one in drawn.iter() if one.tag.endswith("path")]
    assert ground.get("d", "").startswith("M")

    library = Library(tmp_path)
    recipe = EditorSession(scenario).recipe()
    card = card_of(scenario, scenario, recipe)
    library.add(card, exported_files(scenario, recipe), thumbnail(scenario))
    assert library.cards() == [card]
    assert library.thumbnail(card.name) == thumbnail(scenario)
    assert library.thumbnail("nothing") == ""


def test_a_thumbnail_of_an_empty_road(tmp_path: Path):
    scenario = two_agents_that_pass()
    empty = scenario.without_agents(scenario.agents.ids)
    assert "<polygon" not in thumbnail(empty)


def test_a_list_follows_what_others_change_at_once(tmp_path: Path):
    """What was read is kept only while nothing changes, however fast it changes."""
    mine, other = Library(tmp_path), Library(tmp_path)
    for number in range(20):
        saved(other, f"s-{number}", float(number))
        assert len(mine.cards()) == number + 1
    time.sleep(0.2)
    before = mine.cards()
    with mock.patch.object(Library, "folders", side_effect=AssertionError):
        assert mine.cards() == before
    other.describe(["s-3"], lambda variant: variant.tagged(("x",)))
    assert mine.cards()[3].row.tags == ("a", "x")
    other.remove("s-3")
    assert len(mine.cards()) == 19


@given(
    st.lists(st.text(st.characters(codec="utf-8"), max_size=70), max_size=22),
    st.text(st.characters(codec="utf-8"), max_size=50),
)
@settings(max_examples=15, deadline=None)
def test_what_is_said_of_a_scenario_is_kept_or_refused(tags: list[str], note: str):
    with tempfile.TemporaryDirectory() as folder:
        library = Library(Path(folder))
        saved(library, "one", 1.0)
        (before,) = library.cards()
        try:
            library.describe(
                ["one"], lambda variant: variant.tagged(tags, ("a",), note)
            )
        except EditError:
            assert Library(Path(folder)).cards() == [before]
        else:
            (after,) = Library(Path(folder)).cards()
            expected = tuple(one for one in dict.fromkeys(tags) if one != "a")
            assert (after.row.tags, after.row.note) == (expected, note)
            assert after.saved_at == before.saved_at
            library.check("one")
        assert there(Path(folder)) == ["one"]


def there(folder: Path) -> list[str]:
    return sorted(one.name for one in folder.iterdir() if one.name != ".lock")


def test_a_full_or_read_only_disk_loses_nothing(tmp_path: Path, monkeypatch):
    library = Library(tmp_path)
    saved(library, "one", 1.0)
    (before,) = library.cards()

    def full_disk(_path: Path, _data: bytes) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full_disk)
        with pytest.raises(ExportError, match="No space left on device"):
            library.describe(["one"], lambda variant: variant.tagged(("b",)))
        with pytest.raises(ExportError, match="No space left on device"):
            saved(library, "two", 2.0)
    assert Library(tmp_path).cards() == [before]
    assert there(tmp_path) == ["one"]

    def read_only(*_args: object, **_options: object) -> None:
        raise OSError(30, "Read-only file system")

    with monkeypatch.context() as patch:
        patch.setattr(FileLock, "acquire", read_only)
        for change in (
            lambda: saved(library, "two", 2.0),
            lambda: library.describe(["one"], lambda variant: variant.tagged(("b",))),
            lambda: library.remove("one"),
        ):
            with pytest.raises(ExportError, match="Read-only file system"):
                change()
    assert Library(tmp_path).cards() == [before]
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(ExportError, match="cannot be written"):
        saved(Library(file), "one", 1.0)
    assert Library(file).cards() == []


def test_a_writer_waits_for_another_one(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(module, "PATIENCE_S", 0.05)
    library = Library(tmp_path)
    saved(library, "one", 1.0)
    with (
        FileLock(tmp_path / ".lock"),
        pytest.raises(ExportError, match="another program has been writing"),
    ):
        saved(library, "two", 2.0)
    saved(library, "two", 2.0)
