"""The library in its panel: stars that are described anew, and tabs that share it."""

import csv
import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from pd_editor.editor.commands import SetAgentSpeed
from pd_editor.editor.variant import Variant
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until


@pytest.fixture
def tabs(tmp_path: Path) -> Iterator[tuple[FakeTab, FakeTab]]:
    with (
        running_app(tmp_path / "library", "crosswalk") as app,
        connected_tab(app) as one,
        connected_tab(app) as other,
    ):
        yield one, other


def star(tab: FakeTab, **about: Any) -> None:
    tab.run(lambda: tab.session.describe(Variant(**about)))
    tab.run(tab.elements.library.star)


def drive(tab: FakeTab, speed_mps: float) -> None:
    ids = (tab.session.scenario.focal_id,)
    command = SetAgentSpeed(agent_ids=ids, speed_mps=speed_mps)
    tab.run(lambda: tab.ui.apply(command))


def listed(tab: FakeTab) -> list[str]:
    return list(tab.elements.library._rows)


def notices(tab: FakeTab) -> Any:
    return mock.patch.object(tab.ui, "notify")


def downloaded(tab: FakeTab) -> zipfile.ZipFile:
    with mock.patch.object(tab.ui.client, "send_file_download") as send:
        tab.run(tab.elements.library.download)
    return zipfile.ZipFile(io.BytesIO(send.call_args.args[1]))


def test_a_star_takes_the_name_tags_and_note_that_were_typed_after_it(tabs):
    """Pressed again, it said that the state is there already, and kept the old ones."""
    tab, _ = tabs
    drive(tab, 3.0)
    star(tab)
    (former,) = listed(tab)
    first = tab.tab.workspace.library.card(former)
    with notices(tab) as told:
        star(tab, tags=("cut-in",), note="near miss")
        assert told.call_args.args[0] == f"Updated in the library: {former}"
        star(tab, name="near-miss", tags=("cut-in",))
        star(tab, name="near-miss", tags=("cut-in",))
        assert told.call_args.args == ("This state is in the library already",)
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
    assert listed(tab) == ["slow", "slow-2"]
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
    """A tab listed what another had removed, until it starred something itself."""
    one, other = tabs
    for speed in (3.0, 6.0):
        drive(one, speed)
        star(one)
    until(lambda: listed(other) == listed(one))
    assert len(listed(other)) == 2
    tab_one = one.elements.library
    one.run(lambda: tab_one._toggle(listed(one)[0]))
    one.run(tab_one._remove_ticked)
    assert len(listed(one)) == 1
    until(lambda: listed(other) == listed(one))
    download = other.elements.library._download
    until(lambda: download.label == "Download 1 scenario")


def test_a_download_tells_what_another_tab_has_removed(tabs):
    """The zip had one scenario fewer than the button said, without a word."""
    one, other = tabs
    for name, speed in (("kept", 3.0), ("gone", 6.0)):
        drive(one, speed)
        star(one, name=name)
    until(lambda: len(listed(other)) == 2)
    with notices(other) as told:
        # Before the list of the other tab follows.
        with mock.patch.object(other.elements.library, "follow"):
            one.tab.workspace.library.remove("gone")
            archive = downloaded(other)
        assert told.call_args.args[0] == "1 scenario not in the zip"
        assert "removed gone from" in told.call_args.args[1]
    assert {name.split("/")[0] for name in archive.namelist()} == {"index.csv", "kept"}
    assert listed(other) == ["kept"]


def test_what_was_removed_can_be_put_back(tabs):
    tab, _ = tabs
    panel = tab.elements.library
    for speed in (3.0, 6.0):
        drive(tab, speed)
        star(tab)
    before = tab.tab.workspace.library.cards()
    assert not panel._put_back.visible
    tab.run(panel._remove_ticked)
    assert (listed(tab), panel._download.disabled) == ([], True)
    assert panel._put_back.visible
    assert panel._put_back.label == "Put back 2 scenarios"
    tab.run(panel._put_removed_back)
    assert tab.tab.workspace.library.cards() == before
    assert listed(tab) == [entry.name for entry in before]
    assert not panel._put_back.visible
    with notices(tab) as told:
        tab.run(tab.elements.library.star)
        assert told.call_args.args == ("This state is in the library already",)


def test_the_library_is_downloaded_in_the_chosen_format(tabs):
    tab, _ = tabs
    star(tab, name="near_miss")
    tab.elements.export._format.value = "CommonRoad"
    names = downloaded(tab).namelist()
    assert {"index.csv", "near_miss/near_miss.xml", "near_miss/recipe.json"} <= set(
        names
    )
    assert not any(name.endswith(".parquet") for name in names)
