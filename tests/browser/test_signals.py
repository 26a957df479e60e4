"""Signals of a junction: sampled, switched by a real click on a stop line, removed."""

import numpy as np
import pytest

from pd_editor.scene.roles.focal_agent import focal_place_m
from pd_editor.scene.signals import SignalState, states_at

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def told(scenario) -> dict[int, SignalState]:
    return states_at(scenario.signals, scenario.current_step)


def test_a_click_on_a_stop_line_gives_its_lane_green(open_editor):
    editor = open_editor()
    editor.go_to_now()
    session = editor.session
    editor.open_tab("Road")
    editor.press("Sample signals")
    editor.until(lambda: session.scenario.signals, "signals")
    before = told(session.scenario)
    assert set(before.values()) == {SignalState.GO, SignalState.STOP}
    lines = session.scenario.stop_lines_m()[:, 1]
    agents, now = session.scenario.agents, session.scenario.current_step
    place = agents.position_m[agents.is_valid[:, now], now]
    far = np.linalg.norm(lines - focal_place_m(session.scenario), axis=-1)
    is_red = np.array([state is SignalState.STOP for state in before.values()])
    is_clear = np.linalg.norm(lines[:, None] - place, axis=-1).min(axis=1) > 1.5
    row = int(np.where(is_red & is_clear, far, np.inf).argmin())
    editor.click_at(lines[row])
    lane = list(before)[row]
    editor.until(lambda: told(session.scenario) != before, "another phase")
    after = told(session.scenario)
    near = np.linalg.norm(lines - lines[row], axis=-1) < 0.5
    beside = [name for name, one in zip(before, near, strict=True) if one]
    assert SignalState.GO in [after[name] for name in beside]
    assert after.keys() == before.keys()
    assert lane in after
    session.undo()
    assert told(session.scenario) == before
    editor.press("Remove signals")
    editor.until(lambda: not session.scenario.signals, "no signals")
