import numpy as np
import pytest

from benchmarks.repair import shaken
from pd_editor.analysis.metrics.box_overlaps import overlapping_pairs
from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.analysis.repair.state_repairs import project_to_lanes, separate_overlaps
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario
from tests.analysis.repair.scenes import off_lane_m


def num_off_road(scenario: Scenario) -> int:
    agents, now = scenario.agents, scenario.current_step
    here = agents.is_valid[:, now] & agents.kind_mask(LANE_FOLLOWER_KINDS)
    return int(is_off_road(scenario, agents.position_m[here, now]).sum())


@pytest.mark.real_data
def test_shaken_recordings_get_better(av2_scenario_folders):
    for seed, folder in enumerate(av2_scenario_folders[::16]):
        scenario = shaken(read_scenario(folder), seed)
        now = scenario.current_step
        there = scenario.agents.is_valid[:, now]
        on_lanes = project_to_lanes(scenario)
        repaired = separate_overlaps(on_lanes)
        before, after = scenario.agents, repaired.agents
        assert len(overlapping_pairs(after, now)) <= len(overlapping_pairs(before, now))
        further = off_lane_m(repaired)[there] - off_lane_m(scenario)[there]
        assert further.max() <= 1e-4
        assert num_off_road(repaired) <= num_off_road(scenario)
        assert separate_overlaps(repaired) is repaired
        np.testing.assert_array_equal(after.is_valid, before.is_valid)
