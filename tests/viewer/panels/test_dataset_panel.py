"""The list of a dataset's scenarios, without a browser."""

from tests.evaluation.small_dataset import write_dataset
from tests.viewer.fake_browser import connected_tab, running_app, until


def test_the_list_names_city_and_agents_first_and_opens_by_id(tmp_path):
    """Ids are as long as the list is wide: what came after them could not be seen."""
    root = write_dataset(tmp_path / "data")
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        panel = tab.tab.panels.dataset
        until(lambda: len(panel._list.options) == 3)
        parts = [label.split(" · ") for label in panel._list.options]
        assert sorted(name for _, _, name in parts) == ["aaa", "bbb", "ccc"]
        assert {count for _, count, _ in parts} == {"2 agents", "3 agents"}
        panel._list.value = next(
            label for label in panel._list.options if label.endswith("bbb")
        )
        tab.run(panel._open_chosen)
        until(lambda: tab.session.base.scenario_id == "bbb")
