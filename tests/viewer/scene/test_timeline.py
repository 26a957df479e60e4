"""What the timeline makes of the page's events."""

import pytest

from pd_editor.editor.commands import ContinueScene
from pd_editor.editor.commands.roll_out import RolledMotion
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.exporters.bundle import write_files
from pd_editor.viewer.scene.timeline import marks_of
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
        opened.tab.workspace.playback.pause()
        yield opened


def test_steps_of_any_size_are_clamped_and_garbage_is_dropped(tab):
    playback = tab.tab.workspace.playback

    def heard(**event):
        tab.hear("timeline", **event)
        return playback.step

    assert heard(kind="seek", value=7) == 56
    assert heard(kind="seek", value=10**400) == 109
    assert heard(kind="seek", value=-(10**400)) == 0
    assert heard(kind="step", value=10**400) == 109
    assert heard(kind="step", value=-9) == 100
    for value in (None, 1.5, "3", [1], {}):
        assert heard(kind="seek", value=value) == 100
    assert heard(kind="nothing of ours") == 100
    assert heard() == 100
    assert heard(kind="current") == 49


def test_a_seek_draws_the_picture_at_once(tab):
    tab.run(lambda: tab.elements.timeline.seek(80.0))
    tab.run(lambda: None)
    agents, poses = tab.session.scenario.agents, tab.elements.picture.agents.poses
    assert poses.position_m == pytest.approx(agents.position_m[:, 80])


def test_a_finding_at_the_step_of_a_problem_is_told_by_its_mark(tab):
    """The problem's mark covered it, so that it could not be pressed."""
    timeline = tab.elements.timeline

    def shown():
        problems = marks_of([(60, "A and B collide.")])
        findings = marks_of([(70, "C brakes"), (60, "A collides"), (70, "D brakes")])
        timeline.set_marks("problem", problems)
        timeline.set_marks("finding", findings)
        found = timeline._shown_marks()
        timeline.set_marks("problem", ())
        timeline.set_marks("finding", ())
        return [(kind, mark.step, mark.text) for kind, mark in found]

    assert tab.run(shown) == [
        ("finding", 70, "C brakes\nD brakes"),
        ("problem", 60, "A and B collide.\nA collides"),
    ]


def test_a_roll_out_makes_the_timeline_longer_and_undo_shorter(tab):
    session, playback = tab.session, tab.tab.workspace.playback
    agents = session.scenario.agents.cut_to(slice(49, 110))
    longer = agents.without_future(0, 201, agents.is_valid.any(axis=1))
    command = ContinueScene(motion=RolledMotion.of(longer), generator="test")
    tab.run(lambda: session.apply(command))
    tab.run(lambda: None)
    assert session.scenario.time_axis.num_steps == 250
    assert playback.axis == session.scenario.time_axis
    tab.hear("timeline", kind="seek", value=150)
    assert playback.step == 199
    tab.run(session.undo)
    tab.run(lambda: None)
    assert playback.axis.num_steps == 110
    assert playback.step == 49
