"""The library and its bar: stars that are described anew, and tabs that share it."""

import csv
import io
import json
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest

import pd_editor
from pd_editor.editor.commands import SetAgentSpeed, SetRoadWarp
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.scene.formats.embedded_scenes import scenes_in
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until

IS_KEPT = "This state is in the library already", ""


@pytest.fixture
def tabs(tmp_path: Path) -> Iterator[tuple[FakeTab, FakeTab]]:
    with (
        running_app(tmp_path / "library", "crosswalk") as app,
        connected_tab(app) as one,
        connected_tab(app) as other,
    ):
        yield one, other


def star(
    tab: FakeTab, name: str = "", tags: tuple[str, ...] = (), note: str = ""
) -> None:
    for label, text in (("Name", name), ("Tags", ", ".join(tags)), ("Note", note)):
        tab.type(label, text)
    tab.press("Save to library")


def drive(tab: FakeTab, speed_mps: float) -> None:
    ids = (tab.session.scenario.focal_id,)
    command = SetAgentSpeed(agent_ids=ids, speed_mps=speed_mps)
    tab.run(lambda: tab.ui.apply(command))


def listed(tab: FakeTab) -> list[str]:
    return tab.elements.start.library.listed


def tick(tab: FakeTab, name: str) -> None:
    tab.choose("library", name, "tick")


def find(tab: FakeTab, line: str) -> None:
    tab.run(lambda: tab.elements.start.open("library"))
    tab.hear("startPage", kind="line", value=line)


def lines(tab: FakeTab, name: str) -> list[str]:
    return tab.tiles("library")[name]["lines"]


def bar(tab: FakeTab) -> dict[str, str]:
    """Texts of the buttons for several that can be pressed, by their names."""
    tab.run(lambda: tab.elements.start.open("library"))
    return {
        one["name"]: one["text"]
        for one in tab.shown("startPage")["bulk"]
        if one["isOn"]
    }


def act(tab: FakeTab, name: str, tags: str = "") -> None:
    if tab.shown("startPage")["source"] != "library":
        tab.run(lambda: tab.elements.start.open("library"))
    tab.hear("startPage", kind="bulk", name=name, value=tags)


def downloaded(tab: FakeTab) -> zipfile.ZipFile:
    with mock.patch.object(tab.ui.client, "send_file_download") as send:
        act(tab, "download")
    return zipfile.ZipFile(io.BytesIO(send.call_args.args[1]))


def test_a_star_takes_the_name_tags_and_note_that_were_typed_after_it(tabs):
    """Pressed again, it said that the state is there already, and kept the old ones."""
    tab, _ = tabs
    drive(tab, 3.0)
    star(tab)
    (former,) = listed(tab)
    first = tab.tab.workspace.library.card(former)
    star(tab, tags=("cut-in",), note="near miss")
    assert tab.notices[-1][0] == f"Updated in the library: {former}"
    star(tab, name="near-miss", tags=("cut-in",))
    assert tab.notices[-1][0] == "Updated in the library: near-miss"
    star(tab, name="near-miss", tags=("cut-in",))
    assert tab.notices[-1] == IS_KEPT
    assert listed(tab) == ["near-miss"]
    archive = downloaded(tab)
    (row,) = csv.DictReader(io.StringIO(archive.read("index.csv").decode()))
    assert (row["id"], row["tags"], row["note"]) == ("near-miss", "cut-in", "")
    assert "near-miss/scenario_near-miss.parquet" in archive.namelist()
    now = tab.tab.workspace.library.card("near-miss")
    assert now.saved_at == first.saved_at
    tab.tab.workspace.library.remove("near-miss")
    assert not tab.tab.workspace.is_exported


def test_another_state_under_the_name_of_a_star_is_one_more(tabs):
    tab, _ = tabs
    drive(tab, 3.0)
    star(tab, name="slow")
    drive(tab, 6.0)
    star(tab, name="slow")
    assert listed(tab) == ["slow-2", "slow"]
    tab.run(tab.session.undo)
    star(tab, name="slow", note="the slower one")
    entries = tab.tab.workspace.library.cards()
    assert [(one.name, one.row.note) for one in entries] == [
        ("slow", "the slower one"),
        ("slow-2", ""),
    ]


def test_a_star_of_another_tab_is_not_described_anew(tabs):
    """Both tabs have the same state, and the name is free in neither."""
    one, other = tabs
    drive(one, 3.0)
    star(one, name="slow")
    drive(other, 3.0)
    star(other, name="slow", note="mine")
    entries = one.tab.workspace.library.cards()
    assert [(entry.name, entry.row.note) for entry in entries] == [
        ("slow", ""),
        ("slow-2", "mine"),
    ]


def test_the_list_follows_what_other_tabs_do(tabs):
    """A tab listed what another had removed, until it saved something itself."""
    one, other = tabs
    for speed in (3.0, 6.0):
        drive(one, speed)
        star(one)
    until(lambda: listed(other) == listed(one))
    assert len(listed(other)) == 2
    tick(one, listed(one)[0])
    act(one, "remove")
    until(lambda: len(listed(one)) == 1)
    assert len(listed(one)) == 1
    until(lambda: listed(other) == listed(one))
    until(lambda: bar(other)["download"] == "Download 1")


def test_a_download_tells_what_another_tab_has_removed(tabs):
    """The zip had one scenario fewer than the button said, without a word."""
    one, other = tabs
    for name, speed in (("kept", 3.0), ("gone", 6.0)):
        drive(one, speed)
        star(one, name=name)
    until(lambda: bar(other)["download"] == "Download 2")
    # Before the list of the other tab follows.
    with mock.patch.object(other.elements.start, "follow"):
        one.tab.workspace.library.remove("gone")
        archive = downloaded(other)
    title, text = other.notices[-1]
    assert title == "1 scenario not in the zip"
    assert "removed gone from" in text
    assert {name.split("/")[0] for name in archive.namelist()} == {"index.csv", "kept"}
    assert listed(other) == ["kept"]


def test_what_was_removed_can_be_put_back(tabs):
    tab, _ = tabs
    for speed in (3.0, 6.0):
        drive(tab, speed)
        star(tab)
    before = tab.tab.workspace.library.cards()
    # A second press on the same button must not remove all that is left.
    assert not {"remove", "put-back"} & set(bar(tab))
    tick(tab, listed(tab)[0])
    act(tab, "remove")
    assert bar(tab)["put-back"] == "Put back 1"
    act(tab, "remove")
    assert len(listed(tab)) == 1
    tab.choose("library", listed(tab)[0], "reject")
    assert (listed(tab), bar(tab)) == ([], {"put-back": "Put back 2"})
    act(tab, "put-back")
    assert len(listed(tab)) == 2
    assert tab.tab.workspace.library.cards() == before
    assert "put-back" not in bar(tab)
    tab.press("Save to library")
    assert tab.notices[-1] == IS_KEPT


def test_the_library_is_downloaded_in_the_chosen_format(tabs):
    tab, _ = tabs
    star(tab, name="near_miss")
    tab.type("Format", "CommonRoad")
    names = downloaded(tab).namelist()
    assert {"index.csv", "near_miss/near_miss.xml", "near_miss/recipe.json"} <= set(
        names
    )
    assert not any(name.endswith(".parquet") for name in names)


def test_players_of_the_library_compare_with_the_original(tabs):
    """Those that the editor downloads did, those of its library did not."""
    tab, _ = tabs
    term = WarpTerm(kind="smooth-turn", power=5.0, length_m=30.0)
    bend = RoadWarp(anchor=pose_of_anchor(tab.session.scenario, "focal"), terms=(term,))
    tab.run(lambda: tab.ui.apply(SetRoadWarp(warp=bend)))
    star(tab, name="bent")
    tab.type("Format", "Player (HTML)")
    (scene,) = scenes_in(downloaded(tab).read("bent/bent.html"))
    assert scene["original"]["agents"]


def test_one_line_finds_words_and_what_happens(tabs):
    tab, _ = tabs
    star(tab, name="quiet", tags=("calm",))
    drive(tab, 9.0)
    star(tab, name="fast", tags=("calm", "cut-in"), note="<b>bold</b>")

    def found(line: str) -> list[str]:
        find(tab, line)
        return listed(tab)

    until(lambda: found("CUT-in") == ["fast"])
    until(lambda: found("calm bold") == ["fast"])
    until(lambda: found("calm") == ["fast", "quiet"])
    assert lines(tab, "fast")[:2] == ["calm · cut-in", "<b>bold</b>"]
    # What happens is read in the background first.
    until(lambda: found("agents > 0 and not city = miami") == ["fast", "quiet"])
    until(lambda: found("agents < 0") == [])
    assert found("calm") == ["fast", "quiet"]
    # A wrong word leaves the list as it was, and is told.
    assert found("agnts > 0") == ["fast", "quiet"]
    told = tab.shown("startPage")["told"]
    assert "'agnts' is not known; the nearest is agents" in told
    assert tab.shown("startPage")["isWrong"]
    tab.tab.workspace.library.remove("quiet")
    until(lambda: listed(tab) == ["fast"])
    tab.tab.workspace.library.put_back("quiet")
    find(tab, "")
    tab.hear("startPage", kind="facet", name="sort", value="name")
    assert listed(tab) == ["fast", "quiet"]
    assert "<b>" not in tab.text()


def test_what_is_found_is_tagged_at_once(tabs):
    tab, other = tabs
    star(tab, name="one", tags=("a",))
    drive(tab, 9.0)
    star(tab, name="two", note="the fast one")
    assert bar(tab)["tag"] == "Tag 2"
    act(tab, "tag", " b, c ")
    assert lines(tab, "one")[0] == "a · b · c"
    # The state at hand has them, too, so that saving it again loses none.
    assert tab.session.variant.tags == ("b", "c")
    until(lambda: lines(other, "one")[0] == "a · b · c")
    find(tab, "fast")
    act(tab, "untag", "b")
    assert lines(tab, "two")[:2] == ["c", "the fast one"]
    one, two = tab.tab.workspace.library.cards()
    assert (one.row.tags, two.row.tags) == (("a", "b", "c"), ("c",))
    act(tab, "tag", " ,")
    until(lambda: "Enter tags first" in str(tab.notices))


def test_a_shell_on_the_same_library_is_followed(tmp_path: Path):
    folder = tmp_path / "kept"
    with (
        running_app(tmp_path / "state", "crosswalk", library=folder) as app,
        connected_tab(app) as tab,
    ):
        star(tab, name="mine", tags=("a",))
        assert bar(tab)
        assert str(folder) in tab.shown("startPage")["told"]
        pd_editor.library.add(folder, "merge")
        until(lambda: listed(tab) == ["merge", "mine"])
        pd_editor.library.tag(folder, "*", add=("b",), note="seen")
        until(lambda: lines(tab, "mine")[:2] == ["a · b", "seen"])
        until(lambda: tab.session.variant.note == "seen")
        tab.press("Save to library")
        assert tab.notices[-1] == IS_KEPT
        tick(tab, "merge")
        assert tab.elements.start.library.chosen == ["merge"]
        tab.choose("library", "merge")
        assert tab.tab.workspace.session.base.scenario_id == "merge"


def test_all_that_is_found_is_ticked_at_once(tabs):
    tab, _ = tabs
    star(tab, name="slow")
    drive(tab, 9.0)
    star(tab, name="fast")
    drive(tab, 12.0)
    star(tab, name="faster")
    find(tab, "fast")
    until(lambda: listed(tab) == ["faster", "fast"])
    assert bar(tab)["tick"] == "Tick all"
    act(tab, "tick")
    assert bar(tab)["remove"] == "Remove 2"
    find(tab, "")
    assert len(listed(tab)) == 3
    assert tab.elements.start.library.chosen == ["faster", "fast"]
    with mock.patch.object(tab.ui.client, "send_file_download") as send:
        act(tab, "compare")
    (name, content), _ = send.call_args
    assert name == "faster-beside-fast.html"
    # (The page showed nothing.)
    assert tab.notices[-1][0] == "Comparison downloaded"
    assert [one["name"] for one in scenes_in(content)] == ["faster", "fast"]
    assert b"data-pair>" in content
    find(tab, "fast")
    assert bar(tab)["tick"] == "Tick none"
    act(tab, "tick")
    assert len(tab.elements.start.library.chosen) == 2
    assert not {"compare", "remove"} & set(bar(tab))


def test_members_of_a_family_are_found_by_their_values(tmp_path: Path):
    folder = tmp_path / "kept"
    bent = pd_editor.warp(
        "merge", kind="smooth-turn", power=5, name="bend", out=tmp_path
    )
    made = pd_editor.family(
        bent.folder,
        vary="power=2..6",
        num=2,
        model="lane-follower",
        out=tmp_path / "of",
    )
    pd_editor.library.add(folder, made.folders[:2], note="kept")
    with (
        running_app(tmp_path / "state", "crosswalk", library=folder) as app,
        connected_tab(app) as tab,
    ):
        powers = {
            one.name: one.row.values["power"]
            for one in tab.tab.workspace.library.cards()
        }
        find(tab, "power > 4 and parent = bend")
        large = [name for name, power in powers.items() if power > 4]
        # Nothing needs to be read for that.
        until(lambda: listed(tab) == large)
        told = [f"power {powers[large[0]]:.4g}", "variant of bend", "kept"]
        shown = lines(tab, large[0])
        assert [one for one in shown if one in told] == told


def test_a_zip_of_several_is_a_source_of_the_start_page(tabs):
    tab, _ = tabs
    for speed in (3.0, 6.0):
        drive(tab, speed)
        star(tab)
    first, second = sorted(listed(tab))
    content = tab.tab.workspace.library.zipped({first, second})
    file = tab.tab.workspace.library.root.parent / "kept.zip"
    file.write_bytes(content)
    tab.type("Folder", str(file))
    tab.press("Open folder")
    assert list(tab.tiles("zip")) == [first, second]
    tab.upload("Upload files", "kept.zip", content)
    shown = tab.shown("startPage")
    assert (shown["isOpen"], shown["source"], shown["told"]) == (
        True,
        "zip",
        "kept.zip: 2 scenarios; buttons are for all of them.",
    )
    assert [one["title"] for one in shown["tiles"]] == [first, second]
    tab.hear("startPage", kind="draw", keys=[second])
    until(lambda: tab.shown("scene-picture"))
    assert tab.shown("scene-picture")["picture"].startswith("<svg")
    tab.choose("zip", second)
    assert tab.session.base.scenario_id == second
    assert [one["isOpen"] for one in tab.tiles("zip").values()] == [False, True]
    find(tab, second)
    assert list(tab.tiles("zip")) == [second]
    # What was looked for hides nothing of a zip that comes.
    tab.hear("startPage", kind="source", value="zip")
    tab.hear("startPage", kind="line", value="elsewhere")
    assert tab.shown("startPage")["told"] == "kept.zip: nothing found."
    tab.upload("Upload files", "kept.zip", content)
    assert list(tab.tiles("zip")) == [first, second]


def test_scenes_of_a_zip_are_ticked_saved_and_downloaded_without_being_opened(tabs):
    tab, _ = tabs
    for speed in (3.0, 6.0):
        drive(tab, speed)
        star(tab, name=f"at-{speed:.0f}")
    content = tab.tab.workspace.library.zipped({"at-3", "at-6"})
    tab.upload("Upload files", "kept.zip", content)
    tab.hear("startPage", kind="bulk", name="zip-save", value="")
    until(lambda: tab.notices[-1][0] == "Saved 0 scenarios")
    assert tab.notices[-1][1].endswith("first: at-3: it is in the library already.")
    for name in listed(tab):
        tab.choose("library", name, "reject")
    before = tab.session.scenario
    tab.choose("zip", "at-6", "tick")
    with mock.patch.object(tab.ui.client, "send_file_download") as send:
        tab.hear("startPage", kind="bulk", name="zip-download", value="")
    archive = zipfile.ZipFile(io.BytesIO(send.call_args.args[1]))
    assert {Path(one).parts[0] for one in archive.namelist()} == {"at-6", "index.csv"}
    tab.hear("startPage", kind="bulk", name="zip-save", value="paper")
    until(lambda: tab.notices[-1][0] == "Saved 1 scenario")
    tab.choose("zip", "at-3", "save")
    assert tab.session.scenario is before
    cards = {one.name: one.row for one in tab.tab.workspace.library.cards()}
    assert {name: row.tags for name, row in cards.items()} == {
        "at-6": ("paper",),
        "at-3": (),
    }
    assert cards["at-3"].edits
    assert tab.tiles("zip")["at-3"]["isSaved"]


@pytest.mark.parametrize("name", ["opendrive", "commonroad", "sumo", "scenarionet"])
def test_a_zip_of_several_of_another_format_is_listed_as_well(tabs, name):
    """It was refused: expected one."""
    tab, _ = tabs
    for speed in (3.0, 6.0):
        drive(tab, speed)
        star(tab, name=f"at-{speed:.0f}")
    content = tab.tab.workspace.library.zipped({"at-3", "at-6"}, name)
    tab.upload("Upload files", "kept.zip", content)
    assert list(tab.tiles("zip")) == ["at-3", "at-6"]
    tab.hear("startPage", kind="draw", keys=["at-3"])
    until(lambda: tab.shown("scene-picture"))
    assert tab.shown("scene-picture")["picture"].startswith("<svg")
    tab.choose("zip", "at-6")
    assert tab.session.base.scenario_id == "at-6"
    assert len(tab.session.base.agents) == len(tab.session.scenario.agents) > 0


def test_a_zip_of_several_that_the_shell_names_is_listed_at_first(tabs, tmp_path):
    """The command ended with a sentence, though the page opened such a zip."""
    tab, _ = tabs
    for speed in (3.0, 6.0):
        drive(tab, speed)
        star(tab, name=f"at-{speed:.0f}")
    file = tmp_path / "many.zip"
    file.write_bytes(tab.tab.workspace.library.zipped({"at-3", "at-6"}))
    with (
        running_app(tmp_path / "other", str(file)) as app,
        connected_tab(app) as one,
        connected_tab(app) as other,
    ):
        shown = one.shown("startPage")
        assert (shown["isOpen"], shown["source"]) == (True, "zip")
        assert shown["told"].startswith("many.zip: 2 scenarios")
        assert list(one.tiles("zip")) == ["at-3", "at-6"]
        one.choose("zip", "at-6", "tick")
        assert [tile["isTicked"] for tile in one.tiles("zip").values()] == [False, True]
        assert not any(tile["isTicked"] for tile in other.tiles("zip").values())
        one.choose("zip", "at-6")
        assert one.session.base.scenario_id == "at-6"


def test_the_page_goes_on_while_metrics_are_computed(tabs, monkeypatch):
    """A crowded scene held the page for seconds."""
    tab, _ = tabs
    for speed in (3.0, 6.0):
        drive(tab, speed)
        star(tab, name=f"at-{speed:.0f}")
    library, scenes = tab.tab.workspace.library, tab.elements.start.library
    measure, go_on = library.measure, threading.Event()

    def slowly(name: str) -> None:
        assert go_on.wait(30)
        measure(name)

    monkeypatch.setattr(library, "measure", slowly)
    tab.tiles("library")
    act(tab, "metrics")
    tab.hear("startPage", kind="source", value="demos")
    until(lambda: tab.shown("startPage")["source"] == "demos")
    tab.hear("startPage", kind="source", value="library")
    until(lambda: tab.shown("startPage")["told"].startswith("Measured 0 of 2; "))
    act(tab, "metrics")
    until(lambda: tab.notices[-1][0] == "Measured 0 scenarios")
    assert scenes.batch is None
    go_on.set()
    # The one at hand is kept, and no other one follows.
    until(lambda: any(one.metrics for one in library.cards()))
    assert sum(bool(one.metrics) for one in library.cards()) == 1
    assert scenes.batch is None


def test_the_table_has_the_metrics_that_cards_hold(tabs):
    tab, _ = tabs
    for speed in (3.0, 6.0):
        drive(tab, speed)
        star(tab, name=f"at-{speed:.0f}")
    library = tab.tab.workspace.library
    assert b"path_length" not in library.table({"at-3", "at-6"})
    library.measure("at-6")
    lines = csv.DictReader(io.StringIO(library.table({"at-3", "at-6"}).decode()))
    rows = {one["name"]: one for one in lines}
    metrics = library.card("at-6").metrics
    assert float(rows["at-6"]["path_length"]) == pytest.approx(metrics["path_length"])
    assert set(metrics) <= set(rows["at-6"])
    assert rows["at-3"]["path_length"] == ""


def test_metrics_of_many_sort_and_find_and_can_be_cancelled(tabs):
    tab, _ = tabs
    for speed in (3.0, 6.0, 12.0):
        drive(tab, speed)
        star(tab, name=f"at-{speed:.0f}")
    library, start = tab.tab.workspace.library, tab.elements.start
    scenes = start.library
    tab.tiles("library")
    tick(tab, "at-6")

    def press_twice() -> None:
        start.acted.emit("metrics", "")
        assert scenes.batch.told == "Measured 0 of 1"
        assert [one.text for one in scenes.bulk() if one.name == "metrics"] == [
            "Cancel"
        ]
        start.acted.emit("metrics", "")

    tab.run(press_twice)
    until(lambda: tab.notices[-1][0] == "Measured 0 scenarios")
    assert not any(one.metrics for one in library.cards())
    assert "path_length" not in [one.value for one in scenes.facets()[0].choices]
    act(tab, "tick")
    act(tab, "metrics")
    until(lambda: tab.notices[-1][0] == "Measured 3 scenarios")
    tab.hear("startPage", kind="facet", name="sort", value="path_length")
    assert listed(tab) == ["at-12", "at-6", "at-3"]
    values = {one.name: one.metrics["path_length"] for one in library.cards()}
    assert lines(tab, "at-6")[0].startswith(f"Path length: {values['at-6']:.1f} m")
    find(tab, f"path_length > {values['at-6'] + 0.1:.3f}")
    assert listed(tab) == ["at-12"]
    library.describe(["at-12"], lambda one: one.tagged(("fast",), ()))
    assert library.card("at-12").metrics["path_length"] == values["at-12"]


def test_what_cannot_be_read_or_indexed_is_told(tabs):
    """Broken cards were passed over, and a failed index was "Nothing found."."""
    tab, _ = tabs
    star(tab)
    (name,) = listed(tab)
    library = tab.tab.workspace.library
    (library.root / "<b>").mkdir()
    library.describe([name], lambda one: one.tagged(("a",), ()))
    find(tab, "")
    assert "1 cannot be read, first: <b>." in tab.shown("startPage")["told"]
    run = tab.elements.start.library.run
    find(tab, "density > 1e9")
    until(lambda: run.fraction is None)
    with mock.patch.object(run, "words", "x: cannot be written."):
        tab.run(tab.elements.start.look)
        assert tab.shown("startPage")["told"].startswith("Nothing found. 1 cannot")
        assert tab.shown("startPage")["told"].endswith("x: cannot be written.")


def test_what_was_opened_from_the_library_is_no_second_time_saved(tabs):
    """Its tags were not shown, and each star made a copy of it."""
    tab, other = tabs
    drive(tab, 3.0)
    star(tab, name="kept", tags=("cut-in",), note="near miss")
    recipe = tab.tab.workspace.library.root / "kept/recipe.json"
    edits = json.loads(recipe.read_text())["commands"]
    other.choose("library", "kept", "open")
    until(lambda: other.session.scenario.scenario_id == "kept")
    assert other.session.variant.tags == ("cut-in",)
    assert other.session.variant.note == "near miss"
    other.press("Save to library")
    assert other.notices[-1] == IS_KEPT
    other.type("Tags", "merge")
    other.press("Save to library")
    assert other.notices[-1][0] == "Updated in the library: kept"
    assert listed(other) == ["kept"]
    assert other.tab.workspace.library.card("kept").row.tags == ("merge",)
    assert json.loads(recipe.read_text())["commands"] == edits
    # Edited, or named, it is another one.
    drive(other, 6.0)
    other.press("Save to library")
    assert len(listed(other)) == 2
    assert other.tab.workspace.library.card("kept").row.tags == ("merge",)


def test_edits_of_the_library_that_are_continued_are_no_second_time_saved(tabs):
    """Saving them made a copy, although they were the entry's."""
    tab, other = tabs
    drive(tab, 3.0)
    star(tab, name="kept")
    other.choose("library", "kept", "open")
    until(lambda: other.session.scenario.scenario_id == "kept")
    other.run(other.tab.workspace.continue_export)
    assert len(other.session.entries) == 1
    other.press("Save to library")
    assert other.notices[-1] == IS_KEPT
    other.type("Note", "slow")
    other.press("Save to library")
    assert other.notices[-1][0] == "Updated in the library: kept"
    assert listed(other) == ["kept"]
    drive(other, 6.0)
    other.press("Save to library")
    assert sorted(listed(other)) == ["kept", "kept-2"]


def test_what_is_put_back_gets_a_free_name_where_its_own_is_taken(tabs):
    """Another one had to be renamed by hand first."""
    tab, other = tabs
    drive(tab, 3.0)
    star(tab, name="kept")
    tab.choose("library", "kept", "reject")
    drive(other, 6.0)
    star(other, name="kept")
    act(tab, "put-back")
    assert tab.notices[-1] == (
        "1 scenario put back",
        "kept as kept-2, for another one has its name by now.",
    )
    assert sorted(listed(tab)) == ["kept", "kept-2"]
    assert "put-back" not in bar(tab)
    # It is the state at hand under its new name.
    tab.press("Save to library")
    assert tab.notices[-1] == IS_KEPT
    assert sorted(listed(tab)) == ["kept", "kept-2"]


def test_what_the_disk_refuses_is_told_with_what_where_and_why(tabs, monkeypatch):
    """The title was "Not possible" alone, and what was removed before was lost."""
    tab, _ = tabs
    for name in ("one", "two"):
        drive(tab, 3.0 if name == "one" else 6.0)
        star(tab, name=name)
    library = tab.tab.workspace.library

    def refused(_path: Path, *_args: object, **_options: object) -> None:
        raise OSError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "mkdir", refused)
        act(tab, "tag", "late")
    assert tab.notices[-1] == (
        "Not possible: Tag 2",
        f"{library.root}: cannot be written (Permission denied).",
    )
    rename = Path.rename

    def first_only(path: Path, target: Path) -> Path:
        if path.name == "one":
            refused(path)
        return rename(path, target)

    for name in ("one", "two"):
        tick(tab, name)
    told = f"{library.root / 'one'}: cannot be removed (Permission denied)."
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", first_only)
        act(tab, "remove")
        assert tab.notices[-1] == ("Not possible: Remove 2", told)
        tab.choose("library", "one", "reject")
        assert tab.notices[-1] == ("Not possible: Remove one", told)
    assert bar(tab)["put-back"] == "Put back 1"


def test_the_name_field_tells_what_was_written(tabs):
    """It kept the name that was taken, under which the state is not."""
    tab, _ = tabs
    drive(tab, 3.0)
    star(tab, name="slow")
    drive(tab, 6.0)
    star(tab, name="slow")
    name = tab.field("Name")
    assert name.value == "slow-2"
    tab.press("Save to library")
    assert tab.notices[-1] == IS_KEPT
    tab.type("Note", "faster")
    tab.press("Save to library")
    assert tab.notices[-1][0] == "Updated in the library: slow-2"
    # Each state has its own, and a further one the next number.
    tab.run(tab.session.undo)
    assert name.value == "slow"
    drive(tab, 7.0)
    tab.press("Save to library")
    assert name.value == tab.notices[-1][0].removeprefix("Saved to library: ")
    # Proposed names, too, here of a zip.
    tab.type("Name", "東京")
    tab.press("Save to library")
    told = "Name: 東京 has no letter or digit; type another name, or none for the proposed one."
    assert tab.notices[-1] == ("Not possible: Save to library", told)
    tab.type("Name", "")
    proposed = tab.session.name
    with mock.patch.object(tab.ui.client, "send_file_download") as send:
        tab.press("Download zip")
        tab.run(tab.session.undo)
        drive(tab, 8.0)
        tab.press("Download zip")
    assert [call.args[0] for call in send.call_args_list] == [
        f"{proposed}.zip",
        f"{proposed}-2.zip",
    ]
    assert name.value == f"{proposed}-2"
    drive(tab, 9.0)
    assert name.value == "crosswalk-3-edits"
