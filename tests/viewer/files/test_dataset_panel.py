"""The list of a dataset's scenarios, without a browser."""

from pd_editor.viewer.files.dataset_panel import ANY_SPLIT
from tests.builders import two_agents_that_pass
from tests.experiments.evaluation.small_dataset import (
    without_future,
    write_dataset,
    write_scenario,
)
from tests.viewer.fake_browser import connected_tab, running_app, until


def test_the_list_names_city_and_agents_first_and_opens_by_id(tmp_path):
    """Ids are as long as the list is wide: what came after them could not be seen."""
    root = write_dataset(tmp_path / "data")
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        panel = tab.elements.dataset
        until(lambda: len(panel._list.options) == 3)
        parts = [label.split(" · ") for label in panel._list.options]
        assert [name for *_, name in parts] == ["aaa", "bbb", "ccc"]
        assert {count for _, count, *_ in parts} == {"2 agents", "3 agents"}
        panel._list.value = next(
            label for label in panel._list.options if label.endswith("bbb")
        )
        tab.run(panel._open_chosen)
        until(lambda: tab.session.base.scenario_id == "bbb")


def test_the_end_of_the_search_is_told(tmp_path):
    """Its last turn may find nothing more than that there is nothing more."""
    root = write_dataset(tmp_path / "data")
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        panel, search = tab.elements.dataset, tab.tab.workspace.search
        until(lambda: search.is_complete)
        tab.run(lambda: setattr(search, "is_complete", False) or panel.show())
        assert panel._count.content == "3 of 3 scenarios, still reading"
        tab.run(lambda: setattr(search, "is_complete", True) or panel.show())
        assert panel._count.content == "3 of 3 scenarios"


def test_scenes_that_cannot_be_read_are_told_with_the_first_reason(tmp_path):
    """They were left out without a word."""
    root = write_dataset(tmp_path / "data")
    for path in (root / "train").glob("*/scenario_*.parquet"):
        path.write_bytes(b"no_table")
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        panel, search = tab.elements.dataset, tab.tab.workspace.search
        until(lambda: search.is_complete)
        tab.run(panel.show)
        count, told = panel._count.content.split("\n\n")
        assert count == "1 of 3 scenarios"
        assert told.startswith("2 cannot be read, first: train/aaa\\: ")


def test_splits_and_missing_futures_are_named_and_filtered(tmp_path):
    """Which scenarios end at t = 0 was seen only after they had been opened."""
    root = write_dataset(tmp_path / "data")
    ends = without_future(two_agents_that_pass())
    write_scenario(root, "test", "ddd", ends)
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        panel, workspace = tab.elements.dataset, tab.tab.workspace
        until(lambda: workspace.search.is_complete)
        until(lambda: len(panel._list.options) == 4)
        parts = {label.split(" · ")[-1]: label for label in panel._list.options}
        assert [label.split(" · ")[2:-1] for label in parts.values()] == [
            ["test", "no logged future"],
            ["train"],
            ["train"],
            ["val"],
        ]
        assert panel._split.options == (ANY_SPLIT, "test", "train", "val")

        def ids() -> list[str]:
            tab.run(panel._filter)
            until(lambda: workspace.search.is_complete)
            return [card.scenario_id for card in workspace.search.cards]

        panel._with_future.value = True
        assert ids() == ["aaa", "bbb", "ccc"]
        panel._split.value = "val"
        assert ids() == ["ccc"]
        panel._split.value = "test"
        assert ids() == []
