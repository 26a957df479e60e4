"""Locks by real mouse: set, kept through generation and edits, unlocked and undone."""

import re

import numpy as np
import pytest

from pd_editor.scene.locks import STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids

pytestmark = [pytest.mark.browser, pytest.mark.slow]
MOTION = ("position_m", "heading_rad", "velocity_mps", "is_valid")
AWAY_M = np.array([6.0, 0.0])
HALF_M = np.array([9.0, 9.0])


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.go_to_now()
    page.look_from_above()
    page.settle()
    return page


def place_of(editor, agent_id: str) -> np.ndarray:
    scenario = editor.session.scenario
    row, step = scenario.agents.row_of[agent_id], scenario.current_step
    return scenario.agents.position_m[row, step]


def kept_bytes(scenario, agent_id: str, steps: slice) -> tuple[bytes, ...]:
    agents = scenario.agents
    row = agents.row_of[agent_id]
    return tuple(getattr(agents, name)[row, steps].tobytes() for name in MOTION)


def select_focal(editor) -> str:
    agent_id = editor.session.scenario.focal_id
    editor.click_at(place_of(editor, agent_id))
    editor.until(lambda: editor.session.selection == (agent_id,), "the focal agent")
    return agent_id


def padlock(editor, what: str, agent_id: str):
    return editor.page.get_by_role("img", name=f"Locked: {what} of agent {agent_id}")


def test_a_locked_agent_is_kept_and_edits_of_it_offer_to_unlock(editor):
    session, page = editor.session, editor.page
    opened = session.scenario
    agent_id = select_focal(editor)
    editor.key("Shift+K")
    editor.until(lambda: session.scenario.locks == {agent_id: TRAJECTORY_LOCK}, "K")
    padlock(editor, "trajectory", agent_id).wait_for()

    # A drag is refused in one sentence, and changes nothing.
    locked = session.scenario
    here = place_of(editor, agent_id)
    editor.drag(here, here + AWAY_M)
    banner = page.get_by_role("status", name="Mode")
    banner.get_by_text(f"The trajectory of agent {agent_id} is locked").wait_for()
    assert session.scenario is locked

    # All trajectories are regenerated, those of locked agents are not.
    editor.open_tab("Generate")
    editor.choose_scope("All agents")
    editor.run("Regenerate", "all but 1 locked")
    editor.until(lambda: len(session.entries) == 2, "trajectories", 120)
    after = session.scenario
    assert agent_id not in session.entries[1].command.sample.ids
    every = slice(None)
    assert kept_bytes(after, agent_id, every) == kept_bytes(opened, agent_id, every)
    assert not np.array_equal(after.agents.position_m, opened.agents.position_m)

    # New agents take the place of all but the locked one, focal or not.
    editor.open_folder("More settings")
    editor.tick("Keep focal agent")
    editor.open_folder("How many")
    for kind in ("Buses", "Motorcyclists", "Cyclists", "Pedestrians"):
        editor.fill(kind, 0)
    editor.fill("Vehicles", 3)
    editor.run("Resample", "all but 1 locked")
    editor.until(lambda: len(session.entries) == 3, "agents", 120)
    resampled = session.scenario
    assert kept_bytes(resampled, agent_id, every) == kept_bytes(after, agent_id, every)
    assert resampled.locks == {agent_id: TRAJECTORY_LOCK}
    assert len(resampled.agents) < len(after.agents)

    # The offer unlocks; undo takes everything back.
    editor.drag(here, here + AWAY_M)
    banner.get_by_role("button", name="Unlock", exact=True).click()
    editor.until(lambda: not session.scenario.locks, "no lock")
    padlock(editor, "trajectory", agent_id).wait_for(state="hidden")
    banner.wait_for(state="hidden")
    for _ in range(len(session.entries)):
        before = session.state.position
        editor.key("Control+z")
        editor.until(lambda at=before: session.state.position < at, "an undo")
    assert session.scenario is opened


def test_state_and_first_seconds_are_locked_by_menu_and_panel(editor):
    session, page = editor.session, editor.page
    opened = session.scenario
    now = opened.current_step
    agent_id = select_focal(editor)
    page.mouse.click(*editor.pixel(place_of(editor, agent_id)), button="right")
    page.get_by_role("menuitem", name="Lock state").click()
    editor.until(lambda: session.scenario.locks == {agent_id: STATE_LOCK}, "a state")
    padlock(editor, "state", agent_id).wait_for()

    editor.open_tab("Agents")
    editor.choose("Lock", "First seconds")
    editor.fill("Locked seconds", 3)
    wanted = {agent_id: Lock(kept_s=3.0)}
    editor.until(lambda: session.scenario.locks == wanted, "three seconds")
    padlock(editor, "first 3 s", agent_id).wait_for()
    editor.screenshot("41_locked_beginning")

    editor.open_tab("Generate")
    number = len(session.entries)
    editor.run("Regenerate", agent_id)
    editor.until(lambda: len(session.entries) == number + 1, "a trajectory", 120)
    kept, rest = slice(now, now + 31), slice(now + 31, None)
    after = session.scenario
    assert kept_bytes(after, agent_id, kept) == kept_bytes(opened, agent_id, kept)
    assert kept_bytes(after, agent_id, rest) != kept_bytes(opened, agent_id, rest)

    # The list shows the lock, and its button unlocks.
    editor.key("Control+f")
    row = page.get_by_role(
        "option", name=re.compile(f"{agent_id}.*focal agent.*locked")
    )
    row.wait_for()
    region = page.get_by_role("region", name="Agent list")
    region.get_by_role("button", name="Lock", exact=True).click()
    editor.until(lambda: not session.scenario.locks, "no lock")


def test_only_agents_in_a_drawn_region_are_regenerated(editor):
    session = editor.session
    opened = session.scenario
    editor.choose_scope("In the region I draw")
    editor.page.get_by_text("Drawing a region").first.wait_for()
    corner = place_of(editor, opened.focal_id)
    editor.drag(corner + HALF_M, corner - HALF_M)
    region = editor.until(lambda: editor.tab().elements.region.region, "a region")
    inside = region.held(opened, drivable_agent_ids(opened))
    assert 0 < len(inside) < len(drivable_agent_ids(opened))
    editor.run("Regenerate", "region")
    editor.until(lambda: len(session.entries) == 1, "trajectories", 120)
    assert session.entries[0].command.sample.ids == inside
