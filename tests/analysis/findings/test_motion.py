"""Findings on motion, and rows of the scorecard as their totals."""

import dataclasses

import numpy as np
import pytest

from pd_editor.analysis.findings.check import scene_findings, scene_problems
from pd_editor.analysis.findings.scorecard import TOTALS, scorecard
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers


def with_speeds(speed_mps: np.ndarray) -> Scenario:
    """One driver along x with given speeds from the current step on."""
    agents = straight_drivers([(0.0, 0.0, 0.0, float(speed_mps[0]))])
    now = agents.num_steps - len(speed_mps)
    position, velocity = agents.position_m.copy(), agents.velocity_mps.copy()
    moved = np.concatenate([[0.0], np.cumsum(speed_mps[:-1] * 0.1)])
    position[0, now:, 0] = position[0, now, 0] + moved
    velocity[0, now:, 0] = speed_mps
    return scenario_with(
        dataclasses.replace(agents, position_m=position, velocity_mps=velocity)
    )


@pytest.mark.parametrize(
    ("rate_mps2", "words"), [(-7.0, "brakes with"), (4.0, "accelerates with")]
)
def test_harsh_motion_is_found_when_it_happens(rate_mps2, words):
    later = np.arange(60) * 0.1
    speed = 20.0 + rate_mps2 * np.clip(later - 2.2, 0.0, 1.5)
    scenario = with_speeds(speed)
    rows = {row.name: row.findings for row in scorecard(scenario)}
    (found,) = rows["uncomfortable"]
    assert found.headline.startswith(f"100 {words}")
    told = float(found.headline.split()[3])
    assert told == pytest.approx(abs(rate_mps2), rel=0.25)
    now, step_s = scenario.current_step, scenario.time_axis.step_s
    assert 2.2 <= (found.worst_step - now) * step_s <= 3.7
    first, last = found.spans[0][0], found.spans[-1][1]
    # Fits over two seconds smear the ends by up to a second.
    assert 1.2 <= (first - now) * step_s <= 2.6
    assert 3.3 <= (last - now) * step_s <= 4.7


def test_rows_are_totals_of_the_list(av2_root):
    """A row's share is that of the motor vehicles which its findings name."""
    folder = sorted((av2_root / "train").iterdir())[2]
    scenario = read_scenario(folder)
    agents, now = scenario.agents, scenario.current_step
    here = agents.is_valid[:, now] & agents.is_in("movers")
    movers = {agents.ids[row] for row in np.flatnonzero(here)}
    found = scene_findings(scenario)
    rows = {row.name: row for row in scorecard(scenario, found)}
    for name, total in TOTALS.items():
        named = {
            agent
            for one in found
            if one.kind in total.kinds
            for agent in one.agent_ids
            if agent in movers
        }
        assert rows[name].value == pytest.approx(len(named) / len(movers)), name
        assert bool(rows[name].findings) == bool(named)
    for row in rows.values():
        assert len({one.key for one in row.findings}) == len(row.findings)
        for one in row.findings:
            assert one.holds_at(one.worst_step)
            there = agents.rows(one.agent_ids)
            assert agents.is_valid[there, one.worst_step].all()


def oncoming(seconds: float) -> Scenario:
    """A driver of the lane to the east that faces west for a time."""
    scenario = scenario_with(straight_drivers([(60.0, 0.0, np.pi, 8.0)]))
    agents, now = scenario.agents, scenario.current_step
    valid = agents.is_valid.copy()
    valid[0, now + round(10 * seconds) :] = False
    return scenario.with_agents(dataclasses.replace(agents, is_valid=valid))


def test_driving_against_the_lane_is_a_problem():
    found = [one for one in scene_findings(oncoming(5.0)) if one.is_problem]
    (wrong,) = found
    assert wrong.kind == "against-traffic"
    assert wrong.agent_ids == ("100",)
    assert wrong.value == pytest.approx(5.0, abs=0.11)
    assert not scene_problems(oncoming(0.5)), "too short to be a way along the lane"
    ahead = scenario_with(straight_drivers([(60.0, 0.0, 0.0, 8.0)]))
    assert not scene_problems(ahead)


def test_an_agent_without_a_past_is_told_but_is_no_problem():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 5), (40, 0, 0, 5)]))
    agents, now = scenario.agents, scenario.current_step
    valid = agents.is_valid.copy()
    valid[1, :now] = False
    scenario = scenario.with_agents(dataclasses.replace(agents, is_valid=valid))
    (found,) = scene_findings(scenario)
    assert (found.kind, found.agent_ids) == ("no-past", ("101",))
    assert found.severity == "remark"
    assert not found.is_fault
    assert scene_problems(scenario) == ()


def turning_before_now(first: int, *, is_made_up: bool) -> Scenario:
    """A driver that turned left by a right angle within 4 m, 0.6 s before t = 0."""
    agents = straight_drivers([(0.0, 0.0, 0.0, 8.0)])
    now = agents.num_steps - 61
    steps = np.arange(agents.num_steps)
    heading = np.interp(steps, [now - 8, now - 3], [-np.pi / 2, 0.0])
    velocity = 8.0 * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    position = np.cumsum(0.1 * velocity, axis=0)
    agents = dataclasses.replace(
        agents,
        position_m=(position - position[now])[None],
        heading_rad=heading[None],
        velocity_mps=velocity[None],
        is_valid=(steps >= first)[None],
        has_made_up_past=np.array([is_made_up]),
    )
    scenario = scenario_with(agents)
    assert scenario.current_step == now
    return scenario


@pytest.mark.parametrize("first", [0, 41])
def test_a_made_up_past_that_turns_as_no_vehicle_can_is_a_problem(first):
    """Of an agent that enters within the second as well; recorded noise is no finding."""
    scenario = turning_before_now(first, is_made_up=True)
    found = {one.kind: one for one in scene_findings(scenario)}
    worst = found["impossible-past"]
    assert worst.is_problem
    assert first <= worst.first_step <= worst.worst_step < scenario.current_step
    assert 9.81 < worst.value < 40
    assert "before t = 0" in worst.message
    assert worst in scene_findings(scenario, with_future=False)
    assert found["harsh-past"].severity == "notice"
    recorded = turning_before_now(first, is_made_up=False)
    assert not any("past" in one.kind for one in scene_findings(recorded))
