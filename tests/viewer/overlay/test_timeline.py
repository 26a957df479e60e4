"""What the timeline makes of the page's events."""

import pytest

from pd_editor.av2_io.write import scenario_files
from pd_editor.exporters.bundle import write_files
from tests.builders import two_agents_that_pass
from tests.viewer.fake_browser import connected_tab, running_app


@pytest.fixture
def tab(tmp_path):
    write_files(
        scenario_files(two_agents_that_pass()), tmp_path / "scene", forbidden=None
    )
    with (
        running_app(tmp_path / "library", str(tmp_path / "scene")) as app,
        connected_tab(app) as opened,
    ):
        opened.tab._workspace.playback.pause()
        yield opened


def test_steps_of_any_size_are_clamped_and_garbage_is_dropped(tab):
    timeline, playback = tab.tab._timeline, tab.tab._workspace.playback

    def heard(**event):
        tab.run(lambda: timeline._heard(event))
        return playback.step

    assert heard(kind="seek", value=7) == 57
    assert heard(kind="seek", value=10**400) == 109
    assert heard(kind="seek", value=-(10**400)) == 0
    assert heard(kind="step", value=10**400) == 109
    assert heard(kind="step", value=-9) == 100
    for value in (None, 1.5, "3", [1], {}):
        assert heard(kind="seek", value=value) == 100
    assert heard(kind="nothing of ours") == 100
    assert heard() == 100
    assert heard(kind="current") == 50


def test_a_seek_draws_the_picture_at_once(tab):
    tab.run(lambda: tab.tab._timeline.seek(80.0))
    tab.run(lambda: None)
    agents, poses = tab.session.scenario.agents, tab.tab._agents.poses
    assert poses.position_m == pytest.approx(agents.position_m[:, 80])
