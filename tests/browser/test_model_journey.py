"""From a bare road to traffic with the shipped model, in a real browser."""

import time

import numpy as np
import pytest

from pd_editor.analysis.metrics.road import map_points, nearest_points
from pd_editor.generation.generators import GENERATORS, SHIPPED_MODEL
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.viewer.generation.generation_panel import REDRAW_SELECTION
from pd_editor.viewer.generation.generation_run import GenerationInput
from tests.browser.editor_page import PATIENCE_S

pytestmark = pytest.mark.browser


@pytest.fixture
def editor(open_editor):
    assert SHIPPED_MODEL in GENERATORS, "the weights are part of the project"
    page = open_editor()
    page.workspace.playback.pause()
    return page


def test_a_bare_road_gets_agents_and_trajectories(editor):
    session, opened = editor.session, editor.session.scenario
    editor.open_tab("Generate")
    editor.press("Clear the road")
    editor.until(lambda: len(session.scenario.agents) == 0, "a bare road")
    editor.page.wait_for_timeout(800)
    assert editor.page.get_by_text("A bug in the editor").count() == 0
    editor.open_folder("How many")
    editor.fill("Vehicles", 9)
    editor.fill("Pedestrians", 2)
    for label in ("Buses", "Cyclists", "Motorcyclists"):
        editor.fill(label, 0)
    editor.set_number("Samples", 2)
    editor.run("Fill", "road")
    editor.until(lambda: len(session.scenario.agents) == 11, "agents", 120)
    editor.screenshot("30_resampled")
    drawn = session.scenario
    now = drawn.current_step
    assert drawn.agents.kinds.count(AgentKind.PEDESTRIAN) == 2
    assert drawn.agents.is_valid[:, now:].all()
    assert drawn.agents.has_made_up_past.all()
    assert drawn.agents.observed[:, now].all()
    assert drawn.focal_id in drawn.agents.ids

    # The other sample takes the place of the first, as one undo step.
    editor.page.get_by_role("option", name="Sample 2", exact=True).click()
    # The first is undone before the second is applied, so wait for the history.
    swapped = ["Remove all agents", "Add 11 agents, sample 2 of 2"]
    editor.until(
        lambda: [one.label.split(" (")[0] for one in session.entries] == swapped,
        "the second sample as one entry",
    )
    assert session.scenario is not drawn

    states = session.scenario.agents.position_m[:, now].copy()
    editor.run("Regenerate", "everybody")
    editor.until(lambda: len(session.entries) == 3, "other futures")
    after = session.scenario.agents
    assert abs(after.position_m[:, now] - states).max() < 0.01
    for _ in range(3):
        editor.key("Control+z")
    editor.until(lambda: session.scenario is opened, "the very scenario again")


@pytest.mark.slow
def test_as_many_as_suit_the_road_on_the_road_only(editor):
    session = editor.session
    editor.open_tab("Generate")
    editor.tick("As many as fit")
    editor.open_folder("More settings")
    editor.choose("Moving agents", "Half")
    editor.run("Resample", "everybody")
    editor.until(lambda: len(session.entries) == 1, "agents", 120)
    editor.page.get_by_text("50% were asked for").wait_for()
    editor.page.get_by_text("off the road at t = 0.").wait_for()
    editor.screenshot("31_on_the_road")
    request = session.entries[0].command.request
    assert (request.moving_share, request.only_on_road) == (0.5, True)
    scenario = session.scenario
    drives = scenario.agents.kind_mask(LANE_FOLLOWER_KINDS)
    position_m = scenario.agents.position_m[drives, scenario.current_step]
    points_m = map_points(scenario.road_map).center_m
    assert len(position_m) > 5
    assert np.mean(nearest_points(position_m, points_m)[1] > 4) < 0.15


def test_only_the_selected_agent_is_drawn_anew(editor):
    session = editor.session
    one = session.scenario.focal_id
    editor.select((one,))
    before = session.scenario.agents
    editor.open_tab("Generate")
    editor.choose("Replace", REDRAW_SELECTION)
    editor.run("Resample", one)
    editor.until(lambda: len(session.entries) == 1, "a new state", 120)
    after = session.scenario.agents
    others = [name for name in before.ids if name != one]
    kept, same = before.taken(before.rows(others)), after.taken(after.rows(others))
    assert (kept.position_m == same.position_m).all()
    assert after.ids == before.ids


def test_playback_goes_on_while_the_model_draws(editor, monkeypatch):
    editor.open_tab("Generate")
    playback, draw, seen = editor.workspace.playback, GenerationInput.steps, set()

    def drawn_while_three_steps_pass(run, generator):
        end = time.monotonic() + PATIENCE_S
        while len(seen) < 3 and time.monotonic() < end:
            seen.add(int(playback.step))
            time.sleep(0.02)
        return (yield from draw(run, generator))

    monkeypatch.setattr(GenerationInput, "steps", drawn_while_three_steps_pass)
    playback.play()
    editor.run("Regenerate", "everybody")
    editor.until(lambda: len(editor.session.entries) == 1, "other futures")
    assert playback.is_playing
    assert len(seen) == 3
