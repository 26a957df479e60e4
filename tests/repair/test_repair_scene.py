import json
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings

from pd_editor.av2_io.read import read_scenario
from pd_editor.metrics.collisions.box_tests import first_overlap, overlapping_pairs
from pd_editor.metrics.road.off_road import off_road
from pd_editor.repair import repair_scene
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS
from pd_editor.scene.agent_tracks import empty_tracks
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with
from tests.repair.scenes import crowded_road, crowds, off_lane_m


@given(crowds(max_agents=5))
@settings(max_examples=10, deadline=None)
def test_once_is_enough_and_reports_are_plain_values(crowd):
    scenario = crowded_road(crowd)
    repaired, report = repair_scene(scenario)
    assert json.loads(json.dumps(asdict(report)))["changes"] is not None
    again, second = repair_scene(repaired)
    assert again is repaired
    assert second.changes == ()


def test_an_empty_scene_stays():
    scenario = scenario_with(empty_tracks(110))
    repaired, report = repair_scene(scenario)
    assert repaired is scenario
    assert report.changes == report.problems == ()


def shaken(scenario: Scenario, seed: int) -> Scenario:
    """Vehicles moved aside at random, as a model without manners would put them."""
    agents = scenario.agents
    shift = np.random.default_rng(seed).normal(0, 2.0, (len(agents), 1, 2))
    rows = np.flatnonzero(agents.kind_mask(MOTOR_VEHICLE_KINDS))
    moved = (agents.position_m + shift)[rows] * agents.is_valid[rows][..., None]
    return scenario.with_agents(agents.with_rows(rows, position_m=moved))


def check_laws(scenario: Scenario) -> None:
    now = scenario.current_step
    later = np.arange(now + 1, scenario.time_axis.num_steps)
    repaired, _ = repair_scene(scenario, keep_ids=())
    before, after = scenario.agents, repaired.agents
    assert len(overlapping_pairs(after, now)) <= len(overlapping_pairs(before, now))
    there = before.is_valid[:, now]
    off_before, off_after = off_lane_m(scenario)[there], off_lane_m(repaired)[there]
    assert (off_after <= off_before + 1e-4).all()
    at_now = np.array([now])
    assert off_road(repaired, at_now).share() <= off_road(scenario, at_now).share()
    again, second = repair_scene(repaired, keep_ids=())
    assert again is repaired
    assert second.changes == ()
    first_overlap(after, later)


@pytest.mark.real_data
def test_shaken_recordings_get_better(av2_scenario_folders):
    for seed, folder in enumerate(av2_scenario_folders[::16]):
        check_laws(shaken(read_scenario(folder), seed))


@pytest.mark.slow
@pytest.mark.real_data
def test_every_shaken_recording_gets_better(av2_scenario_folders):
    for seed, folder in enumerate(av2_scenario_folders):
        check_laws(shaken(read_scenario(folder), seed))
