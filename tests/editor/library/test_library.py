"""The library on disk, and its table."""

import csv
import io
import json
import os
import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pd_editor.analysis.findings.finding import open_in_words
from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.guidance.kinds.speed import TargetSpeed
from pd_editor.base.errors import ExportError, InputError
from pd_editor.editor.commands import AddGuidance, TransformAgents, traffic_command
from pd_editor.editor.library.index_table import index_csv, index_row
from pd_editor.editor.library.library import CARD_NAME, Library
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import exported_files
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import Variant
from pd_editor.scene.generation import GenerationRequest, run_to_end
from tests.builders import two_agents_that_pass
from tests.editor.fake_generators import DriftGenerator


def starred(library: Library, name: str, moment: float, note: str = "") -> None:
    session = EditorSession(two_agents_that_pass())
    session.apply(TransformAgents(agent_ids=("101",), dy_m=-3.5))
    session.describe(Variant(name=name, tags=("a",), note=note))
    recipe = session.recipe()
    library.add(
        index_row(session.scenario, session.base, recipe),
        exported_files(session.scenario, recipe),
        saved_at=moment,
    )


def test_entries_outlive_the_process_and_are_zipped_with_a_table(tmp_path: Path):
    """(D6): only one scenario could be downloaded, under the original's id."""
    library = Library(tmp_path / "library")
    assert library.cards() == []
    starred(library, "second", 2.0, note="=cmd()")
    starred(library, "first", 1.0)
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
    starred(library, "one", 1.0)
    with pytest.raises(ExportError, match="already holds files"):
        starred(library, "one", 2.0)
    library.remove("one")
    library.remove("../elsewhere")
    assert library.cards() == []
    with pytest.raises(InputError, match="holds none of these"):
        library.zipped(["one"])


def test_what_is_removed_can_be_put_back_for_a_day(tmp_path: Path):
    library = Library(tmp_path)
    starred(library, "one", 1.0)
    (entry,) = library.cards()
    library.remove("one")
    starred(library, "one", 2.0)
    with pytest.raises(ExportError, match="has this name by now"):
        library.put_back("one")
    library.remove("one")
    # The one that was removed last.
    library.put_back("one")
    assert [again.saved_at for again in library.cards()] == [2.0]
    (aside,) = (path for path in tmp_path.iterdir() if path.name.startswith("."))
    library.remove("one")
    os.utime(aside, (0.0, 0.0))
    again = Library(tmp_path)
    assert not aside.exists()
    again.put_back("one")
    assert again.cards() == [replace(entry, saved_at=2.0)]
    with pytest.raises(ExportError, match="removed for good"):
        again.put_back("one")


def test_what_is_half_written_or_damaged_is_not_listed(tmp_path: Path, caplog):
    library = Library(tmp_path)
    starred(library, "one", 1.0)
    (tmp_path / "one").rename(tmp_path / ".one.12345678.new")
    starred(library, "two", 1.0)
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
    assert open_in_words(row.problems) == "1 open problem (1 guidance not run)"


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
    assert index_csv([]).startswith(b"id,name,base_id,city")


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
    session = EditorSession(scenario)
    recipe = session.recipe()
    entry = library.add(
        index_row(scenario, scenario, recipe),
        exported_files(scenario, recipe),
        saved_at=1.0,
        thumbnail=thumbnail(scenario),
    )
    assert library.cards() == [entry]
    # Entries of earlier versions have none.
    about = library._folder / entry.name / CARD_NAME
    former = json.loads(about.read_bytes())
    del former["thumbnail"]
    about.write_text(json.dumps(former))
    assert library.cards()[0].thumbnail == ""


def test_a_thumbnail_of_an_empty_road(tmp_path: Path):
    scenario = two_agents_that_pass()
    empty = scenario.without_agents(scenario.agents.ids)
    assert "<polygon" not in thumbnail(empty)


def test_an_entry_with_a_long_picture_stays_in_the_library(tmp_path: Path):
    library = Library(tmp_path / "library")
    session = EditorSession(two_agents_that_pass())
    recipe = session.recipe()
    picture = f"<svg>{'<path/>' * 5_000}</svg>"
    library.add(
        index_row(session.scenario, session.base, recipe),
        exported_files(session.scenario, recipe),
        saved_at=1.0,
        thumbnail=picture,
    )
    (entry,) = Library(tmp_path / "library").cards()
    assert entry.thumbnail == picture
