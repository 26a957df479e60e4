"""The list of a dataset's scenarios, without a browser."""

from typing import Any

from pd_editor.viewer.files.dataset_panel import ANY_SPLIT, NONE_FOUND
from tests.builders import two_agents_that_pass
from tests.experiments.evaluation.small_dataset import (
    without_future,
    write_dataset,
    write_scenario,
)
from tests.scene.test_time_cut import recording_of_minutes
from tests.viewer.fake_browser import connected_tab, running_app, until


def test_the_list_names_city_and_agents_first_and_opens_by_id(tmp_path):
    """Ids are as long as the list is wide: what came after them could not be seen."""
    root = write_dataset(tmp_path / "data")
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        listed = tab.field("Scenario")
        until(lambda: len(listed.options) == 3)
        parts = [label.split(" · ") for label in listed.options]
        assert [name for *_, name in parts] == ["aaa", "bbb", "ccc"]
        assert {count for _, count, *_ in parts} == {"2 agents", "3 agents"}
        (label,) = (one for one in listed.options if one.endswith("bbb"))
        tab.type("Scenario", label)
        tab.press("Open scenario")
        assert tab.session.base.scenario_id == "bbb"


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
        assert "3 of 3 scenarios, still reading" in tab.text().splitlines()
        tab.run(lambda: setattr(search, "is_complete", True) or panel.show())
        assert "3 of 3 scenarios" in tab.text().splitlines()


def test_scenes_that_cannot_be_read_are_told_with_the_first_reason(tmp_path):
    """They were left out without a word."""
    root = write_dataset(tmp_path / "data")
    for path in (root / "train").glob("*/scenario_*.parquet"):
        path.write_bytes(b"no_table")
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        until(lambda: "1 of 3 scenarios" in tab.text().splitlines())
        assert "\n2 cannot be read, first: train/aaa\\: " in tab.text()


def test_splits_and_missing_futures_are_named_and_filtered(tmp_path):
    """Which scenarios end at t = 0 was seen only after they had been opened."""
    root = write_dataset(tmp_path / "data")
    ends = without_future(two_agents_that_pass())
    write_scenario(root, "test", "ddd", ends)
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        listed, workspace = tab.field("Scenario"), tab.tab.workspace
        until(lambda: workspace.search.is_complete)
        until(lambda: len(listed.options) == 4)
        parts = {label.split(" · ")[-1]: label for label in listed.options}
        assert [label.split(" · ")[2:-1] for label in parts.values()] == [
            ["test", "no logged future"],
            ["train"],
            ["train"],
            ["val"],
        ]
        assert tab.field("Split").options == (ANY_SPLIT, "test", "train", "val")

        def found(label: str, value: Any) -> list[str]:
            tab.type(label, value)
            until(lambda: workspace.search.is_complete)
            tab.run(tab.elements.dataset.show)
            return [label.split(" · ")[-1] for label in listed.options]

        assert found("Logged future only", True) == ["aaa", "bbb", "ccc"]
        assert found("Split", "val") == ["ccc"]
        assert found("Split", "test") == [NONE_FOUND]
        tab.press("Open scenario")
        assert "No scenario passes the filter" in tab.refusal()


def test_recordings_of_minutes_are_listed_and_asked_for_a_moment(tmp_path):
    """They were counted among what cannot be read."""
    root = write_dataset(tmp_path / "data")
    recording_of_minutes(root / "train" / "bab")
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        listed = tab.field("Scenario")
        until(lambda: len(listed.options) == 4)
        (label,) = (one for one in listed.options if "minutes" in one)
        assert "11 agents" in label
        tab.type("Scenario", label)
        tab.press("Open scenario")
        tab.press("Open this part")
        assert tab.session.base.time_axis.num_steps == 110
        assert listed.value == label
        # Who asks for the next and cancels is not asked again.
        tab.press("Previous")
        before = tab.session.base.scenario_id
        assert before == "aaa"
        for after in (before, "bbb"):
            tab.press("Next")
            assert tab.session.base.scenario_id == after
