"""The page of all scenarios, without a browser."""

import shutil
from pathlib import Path
from typing import Any

import pytest

import pd_editor
from pd_editor.base.errors import InputError
from pd_editor.base.installed_files import demo_folder, demo_names
from pd_editor.viewer.files.start_page import PAGE
from pd_editor.viewer.state.session_shelf import REJECTED_NAME, Rejected
from tests.builders import two_agents_that_pass
from tests.experiments.evaluation.small_dataset import (
    without_future,
    write_dataset,
    write_scenario,
)
from tests.scene.test_time_cut import recording_of_minutes
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until


def names(tab: FakeTab) -> list[str]:
    return [Path(key).name for key in tab.tiles("dataset")]


def found(tab: FakeTab, **event: Any) -> list[str]:
    """Scenes of the dataset that are left after an event."""
    search = tab.tab.workspace.search
    tab.tiles("dataset")
    tab.hear("startPage", **event)
    until(lambda: tab.tab.workspace.search.is_complete or search)
    until(lambda: tab.tab.workspace.search.is_complete)
    tab.run(tab.elements.start.show)
    return names(tab)


def test_it_opens_the_editor_that_was_started_without_a_scene(tmp_path):
    with running_app(tmp_path, None) as app, connected_tab(app) as tab:
        shown = tab.shown("startPage")
        assert shown["isOpen"]
        assert [one["title"] for one in shown["tiles"]] == list(demo_names())
        assert not tab.tab.workspace.playback.is_playing
        tab.hear("startPage", kind="open", value="merge")
        assert tab.session.base.scenario_id == "merge"
        assert not tab.shown("startPage")["isOpen"]
        assert tab.tab.workspace.playback.is_playing
        assert tab.tiles("demos")["merge"]["isOpen"]
    with running_app(tmp_path, "merge") as app, connected_tab(app) as tab:
        assert not tab.shown("startPage")["isOpen"]


def test_a_library_without_scenarios_offers_nothing_to_filter_by(tmp_path):
    with running_app(tmp_path, None) as app, connected_tab(app) as tab:
        for is_empty in (True, False):
            tab.tiles("library")
            shown = tab.shown("startPage")
            assert (not shown["common"], not shown["facets"]) == (is_empty, is_empty)
            tab.choose("demos", "merge", "save")


def test_pictures_are_drawn_when_the_page_asks_for_them(tmp_path):
    with running_app(tmp_path, None) as app, connected_tab(app) as tab:
        assert tab.shown("scene-picture") is None
        tab.hear("startPage", kind="draw", keys=["merge", "nowhere"])
        until(lambda: tab.shown("scene-picture"))
        drawn = tab.shown("scene-picture")
        assert drawn["name"] == tab.tiles("demos")["merge"]["picture"]
        assert drawn["picture"].startswith("<svg")


def test_the_dataset_tells_city_and_agents_and_opens_by_place(tmp_path):
    root = write_dataset(tmp_path / "data")
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        until(lambda: names(tab) == ["aaa", "bbb", "ccc"])
        tiles = tab.tiles("dataset")
        assert {tile["lines"][0].split(" · ")[1] for tile in tiles.values()} == {
            "2 agents",
            "3 agents",
        }
        (key,) = (one for one in tiles if one.endswith("bbb"))
        tab.choose("dataset", key)
        assert tab.session.base.scenario_id == "bbb"
        assert tab.tiles("dataset")[key]["isOpen"]


def test_the_end_of_the_search_is_told(tmp_path):
    """Its last turn may find nothing more than that there is nothing more."""
    root = write_dataset(tmp_path / "data")
    with (
        running_app(tmp_path / "library", None, data_root=root) as app,
        connected_tab(app) as tab,
    ):
        until(lambda: tab.shown("startPage")["told"] == "3 of 3 scenarios.")


def test_scenes_that_cannot_be_read_are_told_with_the_first_reason(tmp_path):
    """They were left out without a word."""
    root = write_dataset(tmp_path / "data")
    for path in (root / "train").glob("*/scenario_*.parquet"):
        path.write_bytes(b"no_table")
    with (
        running_app(tmp_path / "library", None, data_root=root) as app,
        connected_tab(app) as tab,
    ):
        told = "1 of 3 scenarios. 2 cannot be read, first: train/aaa: "
        until(lambda: tab.shown("startPage")["told"].startswith(told))


def test_splits_and_missing_futures_are_named_and_filtered(tmp_path):
    """Which scenarios end at t = 0 was seen only after they had been opened."""
    root = write_dataset(tmp_path / "data")
    ends = without_future(two_agents_that_pass())
    write_scenario(root, "test", "ddd", ends)
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        until(lambda: len(names(tab)) == 4)
        tiles = tab.tiles("dataset").values()
        assert [tile["lines"][-2].split(" · ")[2:] for tile in tiles] == [
            ["test", "no logged future"],
            ["train"],
            ["train"],
            ["val"],
        ]
        facets = {one["name"]: one for one in tab.shown("startPage")["facets"]}
        splits = [one["value"] for one in facets["split"]["choices"]]
        assert splits == ["", "test", "train", "val"]
        future = facets["future"]["choices"][1]["value"]

        def chosen(name: str, value: str) -> list[str]:
            return found(tab, kind="facet", name=name, value=value)

        assert chosen("future", future) == ["aaa", "bbb", "ccc"]
        assert chosen("split", "val") == ["ccc"]
        # What the page does not offer is no facet.
        assert chosen("split", "nowhere") == ["ccc"]
        assert chosen("first", "3") == ["ccc"]
        assert chosen("split", "test") == []
        with pytest.raises(InputError, match="no further scenario"):
            tab.run(lambda: tab.elements.start.go(1))


def test_recordings_of_minutes_are_listed_and_asked_for_a_moment(tmp_path):
    """They were counted among what cannot be read."""
    root = write_dataset(tmp_path / "data")
    recording_of_minutes(root / "train" / "bab")
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        until(lambda: len(names(tab)) == 4)
        (key,) = (one for one in tab.tiles("dataset") if "minutes" in Path(one).name)
        assert "11 agents" in tab.tiles("dataset")[key]["lines"][0]
        tab.choose("dataset", key)
        assert not tab.shown("startPage")["isOpen"]
        tab.press("Open this part")
        assert tab.session.base.time_axis.num_steps == 110
        assert tab.tiles("dataset")[key]["isOpen"]
        # Who asks for the next and cancels is not asked again.
        tab.run(lambda: tab.elements.start.go(-1))
        assert tab.session.base.scenario_id == "aaa"
        with pytest.raises(InputError):
            tab.run(lambda: tab.elements.start.go(1))
        tab.run(lambda: tab.elements.start.go(1))
        assert tab.session.base.scenario_id == "bbb"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in ("crosswalk", "roundabout", "winding-street"):
        shutil.copytree(demo_folder(name), tmp_path / "scenes" / f"<b>{name}")
    pd_editor.index(tmp_path / "scenes", workers=1)
    return tmp_path / "scenes"


def test_one_line_finds_what_happens_or_words_and_names_a_wrong_one(root, tmp_path):
    with (
        running_app(tmp_path / "library", "merge", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        workspace = tab.tab.workspace
        until(lambda: len(workspace.index_run.index.table) == 3)

        def left(line: str) -> list[str]:
            return [
                one.removeprefix("<b>") for one in found(tab, kind="line", value=line)
            ]

        former = left("following or turn > 500")
        assert len(former) == 2
        assert set(workspace.search.found) == {
            one.folder for one in workspace.search.cards
        }
        assert left("folowing") == former
        shown = tab.shown("startPage")
        assert "not known; the nearest is following. The list stays" in shown["told"]
        assert shown["isWrong"]
        assert left("junction = roundabout") == ["roundabout"]
        assert left("Winding") == ["winding-street"]
        assert not tab.shown("startPage")["isWrong"]
        tab.hear("startPage", kind="common", value="cut-in")
        assert workspace.start.line == "Winding and cut-in"


def test_what_is_rejected_is_left_out_until_it_is_taken_back(root, tmp_path):
    with (
        running_app(tmp_path / "library", "merge", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        until(lambda: len(names(tab)) == 3)
        first, second, third = tab.tiles("dataset")
        tab.choose("dataset", second, "reject")
        tab.choose("demos", "queue", "reject")
        until(lambda: list(tab.tiles("dataset")) == [first, third])
        tab.choose("dataset", first)
        tab.run(lambda: tab.elements.start.go(+1))
        assert str(tab.tab.workspace.dataset_folder) == third
        assert "queue" not in tab.tiles("demos")
    # Another day.
    with (
        running_app(tmp_path / "library", None, data_root=root) as app,
        connected_tab(app) as tab,
    ):
        assert list(tab.tiles("rejected")) == [second, "demo:queue"]
        tab.choose("rejected", "demo:queue", "reject")
        assert "queue" in tab.tiles("demos")
        tab.choose("rejected", second)
        assert tab.session.base.provenance.source == second


@pytest.mark.parametrize("content", [b"", b"{}", b"[1, null, [", b"\xff" * 9, b"[3]"])
def test_a_broken_list_of_rejected_scenes_rejects_nothing(tmp_path, content):
    (tmp_path / REJECTED_NAME).write_bytes(content)
    rejected = Rejected(tmp_path)
    assert rejected.places() == frozenset()
    assert rejected.toggle("here")
    assert Rejected(tmp_path).places() == {"here"}
    assert not Rejected(tmp_path).toggle("here")
    assert rejected.places() == frozenset()


def test_scenes_are_saved_as_they_are(tmp_path):
    with running_app(tmp_path, None) as app, connected_tab(app) as tab:
        assert not tab.tiles("demos")["merge"]["isSaved"]
        tab.choose("demos", "merge", "save")
        assert tab.notices[-1][0] == "Saved to library: merge"
        assert tab.tiles("demos")["merge"]["isSaved"]
        tab.choose("demos", "merge", "save")
        assert tab.notices[-1][0] == "It is in the library already"
        tab.choose("library", "merge")
        assert tab.session.base.scenario_id == "merge"
        # What the page does not offer is not done.
        tab.choose("library", "nowhere", "save")
        tab.choose("library", "merge", "save")
        assert len(tab.tab.workspace.library.cards()) == 1


def test_a_page_has_some_of_many_and_turns_to_the_one_that_is_asked_for(tmp_path):
    root = tmp_path / "data"
    for number in range(PAGE + 3):
        write_scenario(root, "val", f"s{number:03}", two_agents_that_pass())
    with (
        running_app(tmp_path / "library", None, data_root=root) as app,
        connected_tab(app) as tab,
    ):
        until(lambda: tab.shown("startPage")["total"] == PAGE + 3)
        assert len(tab.shown("startPage")["tiles"]) == PAGE
        tab.hear("startPage", kind="page", first=PAGE + 1)
        shown = tab.shown("startPage")
        assert (shown["first"], len(shown["tiles"])) == (PAGE, 3)
        tab.hear("startPage", kind="page", first=10**9)
        assert tab.shown("startPage")["first"] == PAGE
        tab.hear("startPage", kind="page", first=-5)
        assert tab.shown("startPage")["first"] == 0
