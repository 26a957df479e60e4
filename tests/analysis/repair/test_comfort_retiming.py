"""Harsh motion is smoothed along its own path, without new collisions."""

import dataclasses

import numpy as np
import pytest

from pd_editor.analysis.findings.scorecard import scorecard
from pd_editor.analysis.metrics.box_overlaps import first_overlap
from pd_editor.analysis.repair.retimed_trajectories import (
    harsh_rows,
    retime_for_comfort,
)
from pd_editor.editor.commands import SlowToComfort, YieldToOthers
from pd_editor.editor.cures import cures
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario
from tests.analysis.repair.scenes import changed_ids
from tests.builders import scenario_with, straight_drivers


def braking(rate_mps2: float = 8.0, *, gap_m: float = 0.0) -> Scenario:
    """A driver at 16 m/s that brakes hard after 2.2 s, and one behind it."""
    states = [(0.0, 0.0, 0.0, 16.0)]
    if gap_m:
        states.append((-gap_m, 0.0, 0.0, 15.0))
    agents = straight_drivers(states)
    scenario = scenario_with(agents)
    now, step_s = scenario.current_step, scenario.time_axis.step_s
    later = np.arange(agents.num_steps - now) * step_s
    speed = 16.0 - rate_mps2 * np.clip(later - 2.2, 0.0, 1.5)
    position, velocity = agents.position_m.copy(), agents.velocity_mps.copy()
    moved = np.concatenate([[0.0], np.cumsum(speed[:-1] * step_s)])
    position[0, now:, 0] = position[0, now, 0] + moved
    velocity[0, now:, 0] = speed
    return scenario.with_agents(
        dataclasses.replace(agents, position_m=position, velocity_mps=velocity)
    )


def overlaps(scenario: Scenario) -> set[tuple[int, ...]]:
    steps = np.arange(scenario.current_step + 1, scenario.agents.num_steps)
    return {tuple(pair) for pair in first_overlap(scenario.agents, steps)[0].tolist()}


def test_a_hard_braking_agent_brakes_earlier_on_its_own_path():
    scenario = braking()
    assert harsh_rows(scenario).tolist() == [0]
    after = retime_for_comfort(scenario)
    assert not len(harsh_rows(after))
    now = scenario.current_step
    before_x, after_x = (one.agents.position_m[0, :, 0] for one in (scenario, after))
    assert np.array_equal(before_x[: now + 1], after_x[: now + 1])
    assert np.all(after_x <= before_x + 1e-9)
    assert np.ptp(after.agents.position_m[0, :, 1]) < 1e-9
    # Where the agent stops braking it is as fast as before.
    assert np.isclose(after.agents.speed_mps()[0, -1], 4.0, atol=0.5)
    assert retime_for_comfort(after) is after


def test_one_behind_yields_if_it_may_and_else_nothing_changes():
    scenario = braking(gap_m=14.0)
    assert not overlaps(braking(gap_m=60.0))
    alone, both = scenario.agents.ids[:1], scenario.agents.ids
    for names in (alone, both):
        after = retime_for_comfort(scenario, names)
        assert overlaps(after) <= overlaps(scenario)
        assert changed_ids(scenario, after) <= set(names)


@pytest.mark.parametrize("index", [2, 10])
def test_recordings_get_smoother_without_new_collisions(av2_root, index):
    scenario = read_scenario(sorted((av2_root / "train").iterdir())[index])
    before, known = set(harsh_rows(scenario).tolist()), overlaps(scenario)
    after = retime_for_comfort(scenario)
    left = set(harsh_rows(after).tolist())
    assert len(left) <= 0.5 * len(before)
    assert left <= before
    # An agent that was slowed is not harsh any more.
    slowed = changed_ids(scenario, after) & {scenario.agents.ids[row] for row in before}
    assert left.isdisjoint(scenario.agents.rows(sorted(slowed)).tolist())
    here = scenario.agents.is_valid[:, scenario.current_step]
    assert all(not here[list(pair)].all() for pair in overlaps(after) - known)


def test_the_scorecard_offers_what_cures_harsh_motion():
    scenario = braking()
    (name,) = scenario.agents.ids
    (row,) = [one for one in scorecard(scenario) if one.name == "uncomfortable"]
    offered = cures(scenario, row.findings[0], row.findings)
    assert offered[0].label == f"Smooth the motion of {name}"
    command = offered[0].command
    assert isinstance(command, SlowToComfort)
    assert command == SlowToComfort(agent_ids=(name,))
    (cured,) = [
        one for one in scorecard(command.apply(scenario)) if one.name == row.name
    ]
    assert not cured.findings
    # Nothing is offered against a property of the scene.
    (fastest,) = [one for one in scorecard(scenario) if one.name == "speed"]
    assert not cures(scenario, fastest.findings[0], fastest.findings)


def test_an_agent_that_would_run_into_another_can_yield():
    agents = straight_drivers([(0.0, 0.0, 0.0, 12.0), (60.0, -60.0, np.pi / 2, 12.0)])
    scenario = scenario_with(agents)
    assert overlaps(scenario)
    yields = [
        after
        for name in agents.ids
        if (after := YieldToOthers(agent_ids=(name,)).apply(scenario)) is not scenario
    ]
    assert yields
    assert not any(overlaps(after) for after in yields)
    (row,) = [one for one in scorecard(scenario) if one.name == "new_overlap"]
    labels = [one.label for one in cures(scenario, row.findings[0], row.findings)]
    assert any(label.endswith("yield") for label in labels)
