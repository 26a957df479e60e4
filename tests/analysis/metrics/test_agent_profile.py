from dataclasses import replace

import numpy as np
import pytest
import shapely

from pd_editor.analysis.metrics.scene_metrics import agent_profile
from pd_editor.base.errors import EditError
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.oriented_box import box_corners
from tests.builders import scenario_with, straight_drivers


def test_steady_drivers():
    states = [(0.0, 0.0, 0.0, 10.0), (30.0, 0.0, 0.0, 10.0)]
    scenario = scenario_with(straight_drivers(states))
    found = agent_profile(scenario, scenario.agents.ids[0])
    assert found.time_s[scenario.current_step] == 0.0
    assert np.allclose(found.speed_mps, 10.0)
    within = found.acceleration_mps2[10:-10]
    assert np.allclose(within, 0.0, atol=1e-6)
    assert np.allclose(found.gap_m, 30.0 - scenario.agents.size_m[:, 0].mean())


def test_the_ends_of_a_recorded_track_give_no_acceleration():
    """The first position of a tracker, half a metre off, drew a peak of 12 m/s2."""
    scenario = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 10.0)]))
    agents = scenario.agents
    position = np.array(agents.position_m)
    position[0, 0, 0] -= 0.5
    recorded = scenario.with_agents(replace(agents, position_m=position))
    found = agent_profile(recorded, agents.ids[0]).acceleration_mps2
    assert np.nanmax(np.abs(found)) < 0.5
    assert np.isfinite(found[10:-10]).all()
    # One that begins at t = 0 was placed or sampled: there is nothing wrong with it.
    is_valid = np.array(agents.is_valid)
    is_valid[:, : scenario.current_step] = False
    placed = scenario.with_agents(replace(agents, is_valid=is_valid))
    found = agent_profile(placed, agents.ids[0]).acceleration_mps2
    assert np.isfinite(found[scenario.current_step])


def test_alone_there_is_no_gap():
    scenario = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 5.0)]))
    assert np.isnan(agent_profile(scenario, scenario.agents.ids[0]).gap_m).all()


def test_gaps_are_those_of_shapely(av2_root):
    scenario = read_scenario(sorted((av2_root / "val").iterdir())[1])
    agents = scenario.agents
    counted = np.flatnonzero(agents.kind_mask(ROAD_USER_KINDS))
    for row in counted[agents.is_valid[counted].sum(axis=1) > 90][:3]:
        found = agent_profile(scenario, agents.ids[row])
        for step in (0, 50, 90):
            if not agents.is_valid[row, step]:
                assert np.isnan(found.gap_m[step])
                continue
            there = [r for r in counted if r != row and agents.is_valid[r, step]]
            rows = [row, *there]
            boxes = shapely.polygons(
                box_corners(
                    agents.position_m[rows, step],
                    agents.heading_rad[rows, step],
                    agents.size_m[rows],
                )
            )
            expected = shapely.distance(boxes[0], boxes[1:]).min()
            assert found.gap_m[step] == pytest.approx(expected, abs=1e-6)


def test_an_agent_that_is_not_there():
    scenario = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 5.0)]))
    with pytest.raises(EditError):
        agent_profile(scenario, "missing")
