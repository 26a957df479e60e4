"""Tracks that last: gaps, and what comes after the last recorded step."""

from dataclasses import replace

import numpy as np

from pd_editor.scene.paths.lasting_tracks import lasting
from pd_editor.scene.road_map import RoadMap
from tests.builders import scenario_with, straight_drivers, straight_lane


def gone(scenario, row: int, steps: slice):
    is_valid = scenario.agents.is_valid.copy()
    is_valid[row, steps] = False
    kept = is_valid[..., None]
    agents = replace(
        scenario.agents,
        is_valid=is_valid,
        position_m=np.where(kept, scenario.agents.position_m, 0.0),
        velocity_mps=np.where(kept, scenario.agents.velocity_mps, 0.0),
        heading_rad=np.where(is_valid, scenario.agents.heading_rad, 0.0),
    )
    return replace(scenario, agents=agents)


def test_an_agent_that_leaves_drives_on_and_gaps_are_bridged() -> None:
    whole = scenario_with(straight_drivers([(0, 0, 0, 10), (-30, 3.5, 0, 7)]))
    now = whole.current_step
    for steps in (
        slice(now + 20, None),
        slice(now + 10, now + 30),
        slice(now + 1, None),
    ):
        found = lasting(gone(whole, 1, steps), ("101", "nobody")).agents
        assert found.is_valid[:, now:].all()
        for name in ("position_m", "velocity_mps", "heading_rad"):
            there, asked = getattr(found, name), getattr(whole.agents, name)
            assert np.allclose(there[:, now:], asked[:, now:], atol=0.05), name


def test_an_agent_that_leaves_follows_its_lane_around_a_corner() -> None:
    road = RoadMap(
        lanes=(
            straight_lane(1, (-60, 0), (40, 0), successors=(2,)),
            straight_lane(2, (40, 0), (80, 40), predecessors=(1,)),
        ),
        drivable_areas=(),
    )
    scenario = scenario_with(straight_drivers([(0, 0, 0, 12)]), road)
    now = scenario.current_step
    found = lasting(gone(scenario, 0, slice(now + 15, None)), ("100",)).agents
    x, y = found.position_m[0, -1]
    assert y > 15
    assert abs((y - (x - 40)) / np.sqrt(2)) < 1.5


def test_what_lasts_or_is_not_there_stays_the_same_value() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (-30, 3.5, 0, 7)]))
    now = scenario.current_step
    assert lasting(scenario, ("100", "101")) is scenario
    absent = gone(scenario, 1, slice(now, None))
    assert lasting(absent, ("101",)) is absent
    short = gone(scenario, 1, slice(now + 5, None))
    # Equal edits of guidance alone keep the tracks, and what is cached for them.
    assert lasting(short, ("101",)).agents is lasting(replace(short), ("101",)).agents
