"""What the timeline makes of the page's events."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.editor.commands import ContinueScene
from pd_editor.editor.commands.roll_out import RolledMotion
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.viewer.scene.timeline import marks_of
from tests.builders import two_agents_that_pass
from tests.viewer.fake_browser import connected_tab, running_app, until


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
        found = marks(tab)
        timeline.set_marks("problem", ())
        timeline.set_marks("finding", ())
        return found

    assert tab.run(shown) == [
        ("finding", 70, "C brakes\nD brakes"),
        ("problem", 60, "A and B collide.\nA collides"),
    ]


def test_hard_braking_in_a_roll_out_is_marked(tab):
    """Braking is no problem, but is looked for in a long scene."""
    agents = tab.session.scenario.agents.cut_to(slice(49, 110))
    time = np.arange(61) * 0.1
    braking = np.clip(time - 2.0, 0.0, 1.5) * 6.0
    speed = agents.velocity_mps[0, :, 0] - braking
    position, velocity = agents.position_m.copy(), agents.velocity_mps.copy()
    position[0, 1:, 0] = position[0, 0, 0] + np.cumsum((speed[1:] + speed[:-1]) / 20)
    velocity[0, :, 0] = speed
    slower = replace(agents, position_m=position, velocity_mps=velocity)
    command = ContinueScene(motion=RolledMotion.of(slower), generator="test")
    tab.run(lambda: tab.session.apply(command))
    until(lambda: marks(tab))
    ((kind, step, text),) = marks(tab)
    assert kind == "notice"
    assert 69 <= step <= 85
    assert "brakes with " in text
    tab.hear("timeline", kind="notice", value=step - 49)
    tab.run(lambda: None)
    assert tab.session.selection == agents.ids[:1]
    tab.run(tab.session.undo)
    until(lambda: not marks(tab))


def marks(tab) -> list[tuple[str, int, str]]:
    shown = tab.shown("timeline")
    now = tab.session.scenario.current_step
    return [(one["kind"], one["step"] + now, one["text"]) for one in shown["marks"]]


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
