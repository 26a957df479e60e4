import numpy as np
import pytest
from hypothesis import given, settings

from pd_editor.analysis.repair.state_repairs import (
    _TOUCH_M,
    STANDING_GAP_M,
    slow_for_gaps,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.paths.retiming import MAX_BRAKING_MPS2
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.analysis.repair.scenes import changed_ids, crowded_road, crowds, overlaps_at
from tests.builders import scenario_with, straight_drivers

NOW = TimeAxis().current_step
State = tuple[float, float, float, float]


def slowed(*states: State, kinds=None) -> tuple[np.ndarray, Scenario]:
    scenario = scenario_with(straight_drivers(list(states), kinds=kinds))
    repaired = slow_for_gaps(scenario)
    assert (repaired is scenario) == (not changed_ids(scenario, repaired))
    return repaired.agents.speed_mps()[:, NOW], repaired


def allowed(gap_m: float, ahead_mps: float = 0.0) -> float:
    braking = 2 * MAX_BRAKING_MPS2 * max(gap_m - STANDING_GAP_M, 0.0)
    return float(np.sqrt(ahead_mps**2 + braking))


@pytest.mark.parametrize(
    ("distance_m", "ahead_mps"), [(12, 0), (12, 5), (30, 0), (6, 9)]
)
def test_the_closed_form(distance_m: float, ahead_mps: float):
    speed, repaired = slowed((0, 0, 0, 15), (distance_m, 0, 0, ahead_mps))
    length = repaired.agents.size_m[0, 0]
    wanted = min(15.0, allowed(distance_m - length, ahead_mps))
    assert speed == pytest.approx([wanted, ahead_mps])


def test_a_queue_slows_from_its_head_on():
    speed, repaired = slowed(*((-9.0 * k, 0, 0, 12) for k in range(4)), (9, 0, 0, 0))
    gap = 9 - repaired.agents.size_m[0, 0]
    expected, ahead = [], 0.0
    for _ in range(4):
        ahead = allowed(gap, ahead)
        expected.append(min(ahead, 12.0))
    assert speed[:4] == pytest.approx(expected)
    assert expected[0] < expected[1] < expected[2]


@pytest.mark.parametrize(
    "other",
    [(-10, 0, 0, 0), (8, 3.5, 0, 0), (-8, 0.0, 0, 15), (300, 0, 0, 0)],
    ids=["behind", "beside", "following", "far"],
)
def test_who_has_a_free_way_keeps_its_speed(other: State):
    speed, _ = slowed((0, 0, 0, 15), other)
    assert speed[0] == pytest.approx(15)


def test_walkers_are_braked_for_and_never_slowed():
    kinds = (AgentKind.VEHICLE, AgentKind.PEDESTRIAN, AgentKind.VEHICLE)
    states = ((0, 0, 0, 15), (10, 0, np.pi / 2, 1.4), (10, 4, 0, 0))
    speed, _ = slowed(*states, kinds=kinds)
    assert speed[0] < 8
    assert speed[1] == pytest.approx(1.4)


@given(crowds())
@settings(max_examples=60, deadline=None)
def test_who_brakes_hard_stops_behind_all_that_stand(crowd):
    scenario = crowded_road(crowd)
    repaired = slow_for_gaps(scenario)
    before, after = scenario.agents, repaired.agents
    np.testing.assert_array_equal(before.position_m, after.position_m)
    old, new = before.speed_mps()[:, NOW], after.speed_mps()[:, NOW]
    assert (new <= old + 1e-9).all()
    changed = {before.ids[row] for row in np.flatnonzero(old - new > 1e-6)}
    assert changed_ids(scenario, repaired) == changed
    assert slow_for_gaps(repaired) is repaired
    # Driven on until all stand, no agents overlap that did not already.
    follows = after.kind_mask(LANE_FOLLOWER_KINDS)
    stands = new < 1e-9
    moved = after.position_m.copy()
    way = new**2 / (2 * MAX_BRAKING_MPS2)
    moved[:, NOW] += way[:, None] * unit_vector(after.heading_rad[:, NOW])
    for row in np.flatnonzero(follows & ~stands).tolist():
        late = repaired.with_agents(
            after.with_rows(np.array([row]), position_m=moved[row][None])
        )
        new_pairs = overlaps_at(late, NOW) - overlaps_at(repaired, NOW)
        hit = {one for pair in new_pairs if row in pair for one in pair} - {row}
        assert not any(stands[one] and ahead_of(repaired, row, one) for one in hit)


def ahead_of(scenario: Scenario, row: int, other: int) -> bool:
    """Whether another one is clear in front, and braked for."""
    agents = scenario.agents
    kinds = (agents.kinds[row], agents.kinds[other])
    if kinds[0] is AgentKind.CYCLIST and kinds[1] in (
        AgentKind.PEDESTRIAN,
        AgentKind.RIDERLESS_BICYCLE,
    ):
        return False
    forward = unit_vector(agents.heading_rad[:, NOW])[row]
    offset = agents.position_m[other, NOW] - agents.position_m[row, NOW]
    half = (np.hypot(*agents.size_m[row]) + np.hypot(*agents.size_m[other])) / 2
    corners = box_corners(
        (agents.position_m[:, NOW] - agents.position_m[row, NOW])[[other]],
        agents.heading_rad[[other], NOW],
        agents.size_m[[other]],
    )
    aside = corners @ np.array([-forward[1], forward[0]])
    reach = agents.size_m[row, 1] / 2 - _TOUCH_M
    is_in_strip = aside.min() < reach and aside.max() > -reach
    return bool(is_in_strip and offset @ forward > half + STANDING_GAP_M)
