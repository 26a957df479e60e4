"""Activities of selected agents, set in the agent panel by a real mouse."""

import numpy as np
import pytest

from pd_editor.scene.agent_kind import Activity
from pd_editor.viewer.agents.agent_panel import MORE

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def test_standing_agents_are_parked_and_moving_ones_stay_driving(open_editor):
    editor = open_editor()
    editor.go_to_now()
    session = editor.session
    before, now = session.scenario, session.scenario.current_step
    speed = before.agents.speed_mps()[:, now]
    there = before.agents.is_valid[:, now]
    standing = tuple(
        before.agents.ids[r] for r in np.flatnonzero(there & (speed < 0.1))
    )
    moving = before.agents.ids[np.flatnonzero(there & (speed > 3.0))[0]]
    field = editor.row("Activity").locator("input:not([type=hidden])").first
    editor.open_tab("Agents")
    editor.select(standing[:2])
    editor.open_folder(MORE)
    editor.until(lambda: field.input_value() == "not known", "what is recorded")
    editor.choose("Activity", "parked")
    editor.until(lambda: len(session.entries) == 1, "an edit")
    rows = before.agents.rows(standing[:2])
    assert session.scenario.activity()[rows].tolist() == [Activity.PARKED] * 2
    editor.select((standing[0], moving))
    editor.until(lambda: field.input_value() == "mixed", "mixed values")

    # What contradicts the speed is refused in a sentence, and the field shows it.
    editor.select((moving,))
    editor.until(lambda: field.input_value() == "moving", "what moves")
    editor.choose("Activity", "waiting")
    editor.page.get_by_text("cannot be waiting at").first.wait_for()
    editor.until(lambda: field.input_value() == "moving", "driving again")
    assert len(session.entries) == 1
    editor.key("Control+z")
    editor.until(lambda: session.scenario is before, "the scenario before")
