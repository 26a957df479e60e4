"""Findings: which agents and times a metric is about."""

import dataclasses

import numpy as np
import pytest

from pd_editor.av2_io.read import read_scenario
from pd_editor.metrics.findings import FAR_FROM_LANE_M
from pd_editor.metrics.scorecard import scorecard
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
    assert found.text.startswith(words)
    told = float(found.text.split()[2])
    assert told == pytest.approx(abs(rate_mps2), rel=0.25)
    now, step_s = scenario.current_step, scenario.time_axis.step_s
    assert 2.2 <= (found.worst_step - now) * step_s <= 3.7
    first, last = found.spans[0][0], found.spans[-1][1]
    # Fits over two seconds smear the ends by up to a second.
    assert 1.2 <= (first - now) * step_s <= 2.6
    assert 3.3 <= (last - now) * step_s <= 4.7


def test_findings_are_the_agents_that_the_metrics_count(av2_root):
    folder = sorted((av2_root / "train").iterdir())[2]
    scenario = read_scenario(folder)
    num_movers = None
    for row in scorecard(scenario):
        ids = [one.agent_id for one in row.findings]
        assert len(set(ids)) == len(ids)
        assert all(one.metric == row.name for one in row.findings)
        for one in row.findings:
            assert one.holds_at(one.worst_step)
            assert scenario.agents.is_valid[
                scenario.agents.row_of[one.agent_id], one.worst_step
            ]
        if row.name in ("init_overlap", "off_drivable", "uncomfortable", "standing"):
            assert bool(ids) == (row.value > 0)
        if row.name == "init_overlap":
            num_movers = round(len(ids) / row.value)
        if row.name == "standing":
            assert len(ids) == round(row.value * num_movers)
    assert FAR_FROM_LANE_M > 0
