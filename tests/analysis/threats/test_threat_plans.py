"""Plans of threats on hand-made and real scenes; boxes are checked with shapely."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import shapely

from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.threats.encounter import (
    IN_FRONT,
    Approach,
    Track,
    encounter,
    exertion,
    limits_of,
)
from pd_editor.analysis.threats.threat_feasibility import (
    recorded_track,
    threat_obstacle,
)
from pd_editor.analysis.threats.threat_plans import (
    GAP_TOLERANCE_M,
    ModelFit,
    ThreatAim,
    ThreatObstacle,
    ThreatPlans,
    threat_plans,
)
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.road_map import DrivableArea, RoadMap
from pd_editor.scene.scenario import Scenario
from tests.analysis.threats.tracks import only_one
from tests.builders import (
    LANE_WIDTH_M,
    scenario_with,
    straight_drivers,
    straight_lane,
    two_lane_road,
)

SEVERITIES = (0.0, 0.3, 0.6, 0.9, 1.0)


def obstacle_of(scenario: Scenario, term: Threaten) -> ThreatObstacle | None:
    aim = ThreatAim.of(term.approach, term.severity)
    return threat_obstacle(scenario, term.named_ids, aim)


def crossing() -> RoadMap:
    """The two-lane road, and a lane southwards across it at x = 30 m."""
    road = two_lane_road()
    corners = [[28.0, -60, 0], [32, -60, 0], [32, 60, 0], [28, 60, 0]]
    return replace(
        road,
        lanes=(*road.lanes, straight_lane(9, (30, 60), (30, -60))),
        drivable_areas=(
            *road.drivable_areas,
            DrivableArea(area_id=2, boundary=np.array(corners)),
        ),
    )


def scene(approach: Approach) -> Scenario:
    """Agent 100 is threatened; agent 101 can do so by the approach."""
    width = LANE_WIDTH_M
    states = {
        "rear": [(0, 0, 0, 10), (-15, 0, 0, 11)],
        "cut-in": [(0, 0, 0, 10), (3, width, 0, 11)],
        "side": [(0, 0, 0, 8), (30, 30, -np.pi / 2, 9)],
        "head-on": [(0, 0, 0, 6), (60, width, np.pi, 8)],
        "brakes": [(0, 0, 0, 12), (22, 0, 0, 12)],
        "pulls-out": [(0, 0, 0, 8), (25, width, 0, 0)],
    }
    return scenario_with(straight_drivers(states[approach]), crossing())


def planned(
    scenario: Scenario, approach: Approach, severity: float
) -> tuple[ThreatPlans, Track, ThreatAim]:
    other = recorded_track(scenario, 0)
    aim = ThreatAim.of(approach, severity)
    return threat_plans(scenario, 1, other, aim), other, aim


def shapely_gap(first: Track, second: Track) -> float:
    one, two = (
        np.asarray(shapely.polygons(track.at().corners_m()))
        for track in (first, second)
    )
    return float(shapely.distance(one, two)[1:].min())


@pytest.mark.parametrize("severity", SEVERITIES)
@pytest.mark.parametrize("approach", get_args(Approach))
def test_plans_come_to_the_asked_gap_within_limits(
    approach: Approach, severity: float
) -> None:
    scenario = scene(approach)
    plans, other, aim = planned(scenario, approach, severity)
    assert len(plans)
    limits = limits_of(scenario.agents.kinds[1])
    now = scenario.current_step
    for index in range(len(plans)):
        plan = plans.track.taken(np.array([index]))
        gap = shapely_gap(only_one(plan), other)
        if approach in IN_FRONT:
            # Beside the other agent it may be nearer than in its path.
            assert gap <= plans.gap_m[index] + 1e-6
        else:
            assert gap == pytest.approx(plans.gap_m[index], abs=1e-6)
        if aim.is_contact:
            assert gap == 0
        else:
            assert gap > 0
            assert abs(plans.gap_m[index] - aim.gap_m) <= GAP_TOLERANCE_M
        until = plans.meeting_step[index] if aim.is_contact else 999
        used = exertion(
            plan.position_m,
            scenario.agents.velocity_mps[1, now],
            float(scenario.agents.heading_rad[1, now]),
            limits,
            scenario.time_axis.step_s,
            until=np.array([until]),
        )
        assert used.is_possible.all()
        assert np.array_equal(plan.position_m[0, 0], scenario.agents.position_m[1, now])


@pytest.mark.parametrize(
    ("approach", "sides"),
    [
        ("rear", {"rear"}),
        ("cut-in", {"front", "left"}),
        ("side", {"left", "right"}),
        ("head-on", {"front"}),
        ("brakes", {"front"}),
        ("pulls-out", {"front", "left"}),
    ],
)
def test_contact_is_at_the_side_of_the_approach(
    approach: Approach, sides: set[str]
) -> None:
    plans, other, _ = planned(scene(approach), approach, 1.0)
    assert encounter(only_one(plans.best()), other, 0.1).side in sides


def test_gap_decreases_with_the_severity() -> None:
    gaps = [planned(scene("rear"), "rear", one)[0].gap_m[0] for one in SEVERITIES]
    assert (np.diff(gaps) < 0).all()
    assert gaps[0] == pytest.approx(3.0, abs=0.3)
    assert gaps[-1] == 0


def test_plans_near_the_reference_come_first() -> None:
    scenario = scene("rear")
    other = recorded_track(scenario, 0)
    aim = ThreatAim.of("rear", 0.5)
    some = threat_plans(scenario, 1, other, aim, most=30).track.position_m
    apart = np.linalg.norm(some - some[0], axis=-1).mean(axis=1)
    far = some[np.argmax(apart)]
    step_s = scenario.time_axis.step_s
    model = ModelFit(reference_m=far, step_s=step_s, fitted=lambda one: one)
    near = threat_plans(scenario, 1, other, aim, model=model, most=1)
    apart_now = np.linalg.norm(near.track.position_m[0] - far, axis=-1).mean()
    assert apart_now < 0.6 * apart.max()


def test_plans_that_hit_others_on_the_way_come_last() -> None:
    scenario = scene("side")
    other = recorded_track(scenario, 0)
    aim = ThreatAim.of("side", 1.0)
    free = threat_plans(scenario, 1, other, aim, most=24)
    # Agents are in the way of the first plan, three steps before its meeting.
    step = int(free.meeting_step[0]) - 3
    moments = np.arange(free.track.position_m.shape[1])
    is_then = (moments == step)[:, None]
    obstacle = Track(
        position_m=np.where(is_then, free.track.position_m[0, step], 1e3),
        heading_rad=np.zeros(len(moments)),
        velocity_mps=np.zeros((len(moments), 2)),
        size_m=np.array([0.2, 0.2]),
    )
    kept = threat_plans(scenario, 1, other, aim, others=[obstacle], most=24)
    gaps = np.array(
        [
            shapely_gap(only_one(kept.track.taken(np.array([index]))), obstacle)
            for index in range(len(kept))
        ]
    )
    assert gaps[0] > 0
    assert gaps[-1] == 0
    assert len(kept) == len(free)


def test_an_agent_that_stands_in_the_way_is_not_driven_through() -> None:
    """Agent 101 would come to agent 100 from behind, through one that stands between."""
    states = [(0, 0, 0, 10), (-25, 0, 0, 12)]
    narrow = replace(two_lane_road(), lanes=(straight_lane(1, (-60, 0), (200, 0)),))
    term = Threaten(agent_id="101", other_id="100", approach="rear")
    free = scenario_with(straight_drivers(states), narrow)
    assert obstacle_of(free, term) is None
    queue = [(-12, y, 0, 0) for y in (-4, -2, 0, 2, 4)]
    blocked = scenario_with(straight_drivers([*states, *queue]), narrow)
    assert obstacle_of(blocked, term) == ThreatObstacle(kind="traffic")
    aside = scenario_with(straight_drivers([*states, (-12, 9, 0, 0)]), narrow)
    assert obstacle_of(aside, term) is None


def test_agents_that_drive_apart_cannot_threaten_each_other() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (-40, 0, np.pi, 10)]))
    term = Threaten(agent_id="101", other_id="100", approach="rear")
    obstacle = obstacle_of(scenario, term)
    assert obstacle is not None
    assert obstacle.kind == "limits"
    assert obstacle.times_limits > 3.0


def test_cut_in_needs_an_agent_beside_the_path() -> None:
    # Ahead in the same lane: braking would be no cut-in.
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (15, 0, 0, 10)]))
    term = Threaten(agent_id="101", other_id="100", approach="cut-in")
    assert obstacle_of(scenario, term) == ThreatObstacle(kind="course")


@pytest.mark.parametrize("severity", SEVERITIES)
def test_a_leader_brakes_hard_on_its_way(severity: float) -> None:
    scenario = scene("brakes")
    plans, _, _ = planned(scenario, "brakes", severity)
    speed = np.linalg.norm(np.diff(plans.track.position_m, axis=1), axis=-1) / 0.1
    for one, step in zip(speed, plans.meeting_step, strict=True):
        assert np.max(one[: step - 4] - one[5 : step + 1]) / 0.5 > 2.5
    assert np.abs(plans.track.position_m[..., 1]).max() < 1.5


def test_only_the_direct_leader_brakes() -> None:
    for states, kind in (
        ([(0, 0, 0, 12), (22, LANE_WIDTH_M, 0, 12)], "course"),  # beside
        ([(0, 0, 0, 12), (-22, 0, 0, 12)], "course"),  # behind
        ([(0, 0, 0, 12), (24, 0, 0, 12), (12, 0, 0, 12)], "course"),  # one between
        ([(0, 0, 0, 12), (22, 0, 0, 0)], "course"),  # stands
    ):
        scenario = scenario_with(straight_drivers(states))
        term = Threaten(agent_id="101", other_id="100", approach="brakes")
        obstacle = obstacle_of(scenario, term)
        assert obstacle is not None
        assert obstacle.kind == kind


@pytest.mark.parametrize("severity", SEVERITIES)
def test_who_pulls_out_starts_forwards_and_not_sideways(severity: float) -> None:
    scenario = scene("pulls-out")
    plans, _, _ = planned(scenario, "pulls-out", severity)
    step = np.diff(plans.track.position_m, axis=1)
    moves = np.linalg.norm(step, axis=-1) > 0.02
    turn = np.abs(np.arctan2(step[..., 1], step[..., 0]))
    first = moves.argmax(axis=1)
    assert (turn[np.arange(len(turn)), first] < 0.2).all()
    end = plans.track.position_m[np.arange(len(turn)), plans.meeting_step]
    assert (end[:, 1] < 2.5).all()


@pytest.mark.parametrize(
    "state",
    [
        (25, LANE_WIDTH_M, 0, 5),  # moves already
        (-25, LANE_WIDTH_M, 0, 0),  # behind
        (25, 0, 0, 0),  # on the way of the other one
        (25, LANE_WIDTH_M, np.pi, 0),  # faces the other one
    ],
)
def test_only_who_stands_ahead_and_aside_pulls_out(
    state: tuple[float, float, float, float],
) -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 8), state]))
    term = Threaten(agent_id="101", other_id="100", approach="pulls-out")
    obstacle = obstacle_of(scenario, term)
    assert obstacle is not None
    assert obstacle.kind == "course"


def test_an_agent_too_far_behind_is_told_how_much_it_would_need() -> None:
    """It was told to be infeasible, and not why."""
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (-150, 0, 0, 10)]))
    term = Threaten(agent_id="101", other_id="100", approach="rear")
    obstacle = obstacle_of(scenario, term)
    assert obstacle is not None
    assert obstacle.kind == "limits"
    # 145 m further in 5.9 s by one constant acceleration are 8 m/s2; it has 4.
    assert 2.0 < obstacle.times_limits < 6.0


def test_real_scenes_offer_threats_on_the_road(av2_root: Path) -> None:
    folder = av2_root / "train" / "000a07a3-fec1-47d5-8ba7-e8610409efb3"
    if not folder.is_dir():
        pytest.skip(f"no folder {folder.name}")
    scenario = read_scenario(folder)
    agents, now = scenario.agents, scenario.current_step
    focal = agents.row_of[scenario.focal_id]
    away = np.hypot(*(agents.position_m[:, now] - agents.position_m[focal, now]).T)
    found = 0
    other = recorded_track(scenario, focal)
    away = np.where(agents.is_valid[:, now], away, np.inf)
    for row in np.argsort(away)[1:12].tolist():
        plans = threat_plans(scenario, row, other, ThreatAim.of("rear", 1.0))
        found += len(plans) > 0
        if len(plans):
            assert shapely_gap(only_one(plans.best()), other) == 0
    assert found
