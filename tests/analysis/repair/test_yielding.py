from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from benchmarks.repair import at_constant_velocity
from pd_editor.analysis.metrics.box_overlaps import first_overlap, overlapping_pairs
from pd_editor.analysis.metrics.motion import WINDOW_STEPS, derivative_operators
from pd_editor.analysis.repair.current_states import counted
from pd_editor.analysis.repair.yielding import (
    MAX_BRAKING_MPS2,
    Yielded,
    _cells_that_meet,
    _Stretches,
    clocks,
    yielding,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.analysis.repair.scenes import Crowd, crowded_road, crowds
from tests.builders import scenario_with, straight_drivers

NOW, STEP_S = TimeAxis().current_step, 0.1


def yielded(scenario: Scenario) -> Yielded:
    agents, now = scenario.agents, scenario.current_step
    may = agents.kind_mask(LANE_FOLLOWER_KINDS) & agents.is_valid[:, now]
    return yielding(agents, now, may, scenario.time_axis.step_s)


def driven(scenario: Scenario, found: Yielded) -> Scenario:
    agents, now = scenario.agents, scenario.current_step
    position, heading = agents.position_m.copy(), agents.heading_rad.copy()
    position[found.row, now:] = found.position_m
    heading[found.row, now:] = found.heading_rad
    rows = np.arange(len(agents))
    return scenario.with_agents(
        agents.with_rows(rows, position_m=position, heading_rad=heading)
    )


def conflicts(scenario: Scenario) -> set[tuple[int, ...]]:
    """Pairs that collide later and do not overlap now."""
    agents, now = scenario.agents, scenario.current_step
    later, _ = first_overlap(agents, np.arange(now + 1, agents.num_steps))
    later = later[counted(agents, later) & agents.is_valid[later, now].all(axis=1)]
    already = {tuple(pair) for pair in overlapping_pairs(agents, now).tolist()}
    return {tuple(pair) for pair in later.tolist()} - already


def test_clocks_never_run_ahead_of_time_nor_back() -> None:
    found = clocks(75, STEP_S)
    assert (found.step[0] == np.arange(75)).all()
    assert (found.step <= np.arange(75) + 1e-9).all()
    assert (np.diff(found.step, axis=1) >= -1e-9).all()
    assert (np.diff(found.step.sum(axis=1)) <= 1e-9).all()
    assert ((found.rate >= 0) & (found.rate <= 1)).all()


@given(crowds(max_agents=6))
@settings(max_examples=25, deadline=None)
def test_agents_that_yield_brake_within_the_limit_and_stay_on_their_paths(
    crowd: Crowd,
) -> None:
    scenario = crowded_road(crowd)
    found = yielded(scenario)
    assert len(conflicts(driven(scenario, found))) <= len(conflicts(scenario))
    way = np.linalg.norm(np.diff(found.position_m, axis=1), axis=-1)
    speed = way / STEP_S
    assert (np.diff(speed, axis=1) / STEP_S >= -MAX_BRAKING_MPS2 - 0.5).all()
    recorded = scenario.agents.position_m[found.row, NOW:]
    np.testing.assert_array_equal(found.position_m[:, 0], recorded[:, 0])
    before = np.linalg.norm(np.diff(recorded, axis=1), axis=-1)
    assert (way.cumsum(axis=1) <= before.cumsum(axis=1) + 1e-6).all()


def test_agents_that_overlap_now_are_left_alone() -> None:
    """Pairs that overlap at t = 0 do not wait for each other."""
    stack = [(0.5 * k, 0.3 * k, 0.0, 8.0) for k in range(6)]
    assert len(yielded(scenario_with(straight_drivers(stack))).row) == 0
    scenario = scenario_with(straight_drivers([*stack, (40.0, 0.0, 0.0, 0.0)]))
    found = yielded(scenario)
    assert len(found.row)
    assert len(conflicts(driven(scenario, found))) < len(conflicts(scenario))


def test_one_that_stands_waits_before_it_starts() -> None:
    """It would pull out in front of crossing traffic, and starts after it."""
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0), (12, -33, np.pi / 2, 10)]))
    agents = scenario.agents
    position = agents.position_m.copy()
    time = STEP_S * np.arange(position.shape[1] - NOW)
    position[0, NOW:, 0] = 0.5 * 2.5 * np.maximum(time - 0.2, 0) ** 2
    scenario = scenario.with_agents(agents.with_rows(np.arange(2), position_m=position))
    assert conflicts(scenario) == {(0, 1)}
    agents = scenario.agents
    found = yielding(agents, NOW, np.array([True, False]), STEP_S)
    assert found.row.tolist() == [0]
    assert conflicts(driven(scenario, found)) == set()
    assert found.position_m[0, -1, 0] > 5


def test_real_scenes_collide_less(real_scenarios: list[Scenario]) -> None:
    before = after = 0
    for scenario in real_scenarios:
        straight = at_constant_velocity(scenario)
        before += len(conflicts(straight))
        after += len(conflicts(driven(straight, yielded(straight))))
    assert before > 0
    assert after <= 0.4 * before


@pytest.fixture(scope="module")
def real_scenarios(av2_scenario_folders: list[Path]) -> list[Scenario]:
    full = [f for f in av2_scenario_folders if f.parent.name != "test50"]
    return [read_scenario(folder) for folder in full[::6]]


@pytest.mark.parametrize("count", [0, 1])
def test_no_agents_or_one_is_fine(count: int) -> None:
    scenario = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 9.0)] * count))
    assert len(yielded(scenario).row) == 0


def test_no_two_points_within_reach_are_missed() -> None:
    """The rough comparison of paths finds every pair of points that is near enough."""
    random = np.random.default_rng(5)
    one, two = (
        (random.normal(0, 8, (4, 1, 2)) + random.normal(0, 2, (4, n, 2)).cumsum(1))
        @ [1, 1j]
        for n in (37, 75)
    )
    pairs = np.argwhere(np.ones((4, 4)))
    reach = random.uniform(0.5, 6.0, len(pairs))
    steps = [np.arange(path.shape[1]) for path in (one, two)]
    index, of_one, of_two, offset = _cells_that_meet(
        _Stretches.of(one, 2 * steps[0], 4),
        _Stretches.of(two, steps[1], 5),
        *pairs.T,
        reach,
    )
    found = set(zip(index.tolist(), of_one.tolist(), of_two.tolist(), strict=True))
    gap = np.abs(one[pairs[:, 0]][:, :, None] - two[pairs[:, 1]][:, None])
    no_later = steps[1] <= 2 * steps[0][:, None]
    near = np.argwhere((gap < reach[:, None, None]) & no_later)
    assert len(near) > 100
    assert {tuple(cell) for cell in near.tolist()} == found
    assert len(found) == len(index)
    a, b = pairs[index].T
    np.testing.assert_array_equal(offset, one[a, of_one] - two[b, of_two])


def test_of_two_the_one_that_yields_last_drives_on() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 8), (32, -34, np.pi / 2, 8)]))
    agents, both = scenario.agents, np.array([True, True])
    (usual,) = yielding(agents, NOW, both, STEP_S).row.tolist()
    last = np.arange(2) == usual
    found = yielding(agents, NOW, both, STEP_S, yields_last=last)
    assert found.row.tolist() == [1 - usual]
    assert conflicts(driven(scenario, found)) == set()
    # It yields where the other one cannot.
    assert yielding(agents, NOW, last, STEP_S, yields_last=last).row.tolist() == [usual]


@pytest.mark.parametrize(("standing_m", "is_gentle"), [(25.0, True), (13.0, False)])
def test_an_agent_brakes_no_harder_than_asked_where_that_is_enough(
    standing_m: float, is_gentle: bool
) -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 7), (standing_m, 0, 0, 0)]))
    agents, first = scenario.agents, np.array([True, False])

    def hardest(asked_mps2: float | None) -> float:
        asked = None if asked_mps2 is None else np.full((2, 2), asked_mps2)
        found = yielding(agents, NOW, first, STEP_S, asked_mps2=asked)
        assert conflicts(driven(scenario, found)) == set()
        _, second, _ = derivative_operators(
            found.position_m.shape[1], WINDOW_STEPS, STEP_S
        )
        return -(second @ found.position_m[0, :, 0]).min()

    assert hardest(None) > 2.0
    assert bool(hardest(2.0) <= 2.0) is is_gentle
