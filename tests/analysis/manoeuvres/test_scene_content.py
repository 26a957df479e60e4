"""Events and facts of scenes: hand-made ones with known answers, and laws."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.analysis.manoeuvres.events import SceneEvent
from pd_editor.analysis.manoeuvres.scene_facts import scene_content
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import DEFAULT_SIZE_M, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.road_map import Crosswalk, Lane, RoadMap
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers, straight_lane

DEMOS = ("signalised-junction", "roundabout", "crosswalk")
LANE_M = 3.5


def road(num_lanes: int = 3, length_m: float = 400.0) -> RoadMap:
    """Lanes eastwards beside one another, the lowest id at y = 0."""
    return RoadMap(
        lanes=tuple(
            straight_lane(
                10 + row,
                (-length_m / 2, LANE_M * row),
                (length_m / 2, LANE_M * row),
                left_neighbor=11 + row if row + 1 < num_lanes else None,
                right_neighbor=9 + row if row else None,
            )
            for row in range(num_lanes)
        )
    )


def driven(
    paths: list[Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]],
    kinds: tuple[AgentKind, ...] | None = None,
) -> AgentTracks:
    """Agents along functions of the time, which give x and y."""
    base = straight_drivers([(0.0, 0.0, 0.0, 1.0)] * len(paths), kinds=kinds)
    time = np.arange(base.num_steps) * 0.1 - 4.9
    place = np.stack([np.stack(path(time), axis=-1) for path in paths])
    velocity = np.gradient(place, 0.1, axis=1)
    course = np.arctan2(velocity[..., 1], velocity[..., 0])
    stands = np.hypot(velocity[..., 0], velocity[..., 1]) < 0.1
    for step in range(1, course.shape[1]):
        course[:, step] = np.where(
            stands[:, step], course[:, step - 1], course[:, step]
        )
    return replace(base, position_m=place, velocity_mps=velocity, heading_rad=course)


def along(
    x: float, speed: float, y: float = 0.0, to_y: float | None = None, at: float = 0.0
):
    """Eastwards, and to another y within 4 s around a time."""

    def path(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        share = np.clip((time - at) / 4 + 0.5, 0, 1)
        end = y if to_y is None else to_y
        return x + speed * time, y + (end - y) * (1 - np.cos(np.pi * share)) / 2

    return path


def events(scenario: Scenario, *kinds: str) -> list[SceneEvent]:
    found = scene_content(scenario).events
    return [one for one in found if not kinds or one.kind in kinds]


def named(scenario: Scenario) -> list[tuple[str, str, str]]:
    return sorted((one.kind, one.agent_id, one.other_id) for one in events(scenario))


@pytest.mark.parametrize(("to_y", "side"), [(LANE_M, "left"), (-LANE_M, "right")])
@pytest.mark.parametrize("at", [-1.0, 0.0, 1.5])
def test_a_lane_change_is_told_with_its_time(to_y: float, side: str, at: float):
    agents = driven([along(0, 12, LANE_M, LANE_M + to_y, at)])
    (change,) = events(scenario_with(agents, road()))
    assert change.kind == f"lane-change-{side}"
    assert change.begin_s <= at <= change.end_s
    assert 1.5 <= change.end_s - change.begin_s <= 4.5


def test_to_swerve_within_the_lane_is_no_lane_change():
    agents = driven([along(0, 12, LANE_M, LANE_M + 1.2), along(-20, 12, 0, 1.0)])
    assert not events(scenario_with(agents, road()), "lane-change-left")


def test_who_changes_lanes_close_in_front_cuts_in():
    agents = driven([along(14, 10, LANE_M, 0.0), along(0, 10)])
    scenario = scenario_with(agents, road())
    (cut,) = events(scenario, "cut-in")
    assert (cut.agent_id, cut.other_id) == ("100", "101")
    assert cut.value == pytest.approx((14 - 4.6) / 10, abs=0.05)
    far = driven([along(60, 10, LANE_M, 0.0), along(0, 10)])
    assert not events(scenario_with(far, road()), "cut-in")


def test_a_follower_has_its_headway():
    agents = driven([along(0, 10), along(20, 10), along(80, 10)])
    found = events(scenario_with(agents, road()), "following")
    assert [(one.agent_id, one.other_id) for one in found] == [("100", "101")]
    assert found[0].value == pytest.approx((20 - 4.6) / 10, abs=0.01)


@pytest.mark.parametrize("gap_s", [1.4, 2.4, 4.0])
def test_paths_that_cross_have_the_time_between(gap_s: float):
    """The time from when the first leaves the place to when the second comes."""

    def north(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(time), 10.0 * (time - gap_s)

    agents = driven([along(0, 10), north])
    (one,) = events(scenario_with(agents, road(1)), "crossing")
    assert (one.agent_id, one.other_id) == ("101", "100")
    # Half of each box, along and across, is passed at 10 m/s.
    assert one.value == pytest.approx(gap_s - (4.6 + 1.9) / 10, abs=0.3)


def test_who_stops_and_goes_on_is_told_apart_from_parked_cars_that_jitter():
    def halting(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        speed = np.interp(time, [-3, -1, 1, 3], [8.0, 0.0, 0.0, 8.0])
        return np.cumsum(speed) * 0.1, np.zeros_like(time)

    random = np.random.default_rng(0)

    def jitters(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 5 + 0.1 * random.normal(size=time.shape), np.full_like(time, -2.5)

    agents = driven([halting, jitters])
    still = agents.velocity_mps.copy()
    still[1] *= 0.02
    agents = replace(agents, velocity_mps=still)
    found = events(scenario_with(agents, road(1)))
    assert {(one.kind, one.agent_id) for one in found} == {
        ("stands", "100"),
        ("stop-and-go", "100"),
        ("parked", "101"),
    }


def test_a_box_that_only_the_tracker_turns_makes_no_turn():
    agents = driven([along(0, 3, 9.0)])
    heading = agents.heading_rad + np.linspace(0, np.pi / 2, agents.num_steps)
    agents = replace(agents, heading_rad=heading)
    assert not events(scenario_with(agents, RoadMap(lanes=())))


def test_a_track_that_goes_on_under_a_new_id_crosses_nobody():
    """Its first box is where the other's last ones are, turned by noise."""
    agents = driven([along(0, 10), along(1, 10)])
    is_valid = agents.is_valid.copy()
    is_valid[0, 52:], is_valid[1, :50] = False, False
    heading = agents.heading_rad.copy()
    heading[1, 50:54] += 0.8
    agents = replace(agents, is_valid=is_valid, heading_rad=heading)
    assert not events(scenario_with(agents, road()), "crossing", "near-miss", "merge")


def braking(x: float, at: float):
    """Eastwards at 12 m/s, and from a time on with 6 m/s2 to a stop at some x."""

    def path(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        left = np.clip(at + 2.0 - time, 0, 2)
        return x - 3 * left**2 + 12 * np.minimum(time - at, 0), np.zeros_like(time)

    return path


def test_who_halts_hard_behind_one_that_stands_nearly_hits_it():
    agents = driven([braking(0.0, 0.0), braking(5.2, -3.5)])
    (one,) = events(scenario_with(agents, road(1)), "near-miss")
    assert set(one.agent_ids) == {"100", "101"}
    assert one.value == pytest.approx(0.4, abs=0.3)
    gentle = driven([along(0, 3), along(12, 2.5)])
    assert not events(scenario_with(gentle, road(1)), "near-miss")


@pytest.mark.parametrize("kind", [AgentKind.VEHICLE, AgentKind.PEDESTRIAN])
def test_who_halts_hard_before_one_that_never_moves_nearly_hits_it(kind: AgentKind):
    """Only agents that move were looked at."""
    random = np.random.default_rng(0)

    def standing(x: float, y: float = 0.0):
        def path(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return x + random.normal(0, 0.03, len(time)), np.full_like(time, y)

        return path

    def near(*paths: Callable[..., tuple[np.ndarray, np.ndarray]]) -> list[SceneEvent]:
        agents = driven(list(paths), (AgentKind.VEHICLE, kind))
        heading = agents.heading_rad.copy()
        heading[1] = 0.0
        agents = replace(agents, heading_rad=heading)
        return events(scenario_with(agents, road(1)), "near-miss")

    half_m = DEFAULT_SIZE_M[kind][0] / 2 + DEFAULT_SIZE_M[AgentKind.VEHICLE][0] / 2
    (one,) = near(braking(0.0, 0.0), standing(half_m + 0.6))
    assert set(one.agent_ids) == {"100", "101"}
    assert not near(braking(0.0, 0.0), standing(half_m + 12.0))
    assert not near(along(0, 12), standing(10.0, 3.0))
    assert not near(standing(half_m + 0.6), standing(0.0))


def test_how_a_track_that_ends_would_have_met_another_is_not_known():
    agents = driven([braking(0.0, 0.0), braking(5.2, -3.5)])
    is_valid = agents.is_valid.copy()
    is_valid[0, 66:] = False
    agents = replace(agents, is_valid=is_valid)
    assert not events(scenario_with(agents, road(1)), "near-miss")


@pytest.mark.parametrize("slip_rad", [0.0, 0.12])
def test_who_passes_in_the_lane_beside_misses_nobody(slip_rad: float):
    """Even if the tracker turns its velocity towards the other's lane."""
    agents = driven([along(0, 8), along(-14, 14, 2.7)])
    velocity = agents.velocity_mps.copy()
    velocity[1] = 14 * np.array([np.cos(slip_rad), -np.sin(slip_rad)])
    agents = replace(agents, velocity_mps=velocity)
    assert not events(scenario_with(agents, road()), "near-miss")


def test_two_tracks_of_one_agent_miss_nobody():
    """They lag by a second and then catch up: the boxes overlap."""
    agents = driven([along(0, 10), along(-11, 10)])
    place = agents.position_m.copy()
    place[1, 60:, 0] += np.minimum(np.arange(50) * 0.6, 9)
    agents = replace(agents, position_m=place)
    assert not events(scenario_with(agents, road()), "near-miss")


def ramp() -> RoadMap:
    """A lane that another one joins at x = 0, under an angle of 8 degrees."""
    return RoadMap(
        lanes=(
            straight_lane(1, (-150, 0), (0, 0), successors=(3,)),
            straight_lane(2, (-150, -21), (0, 0), successors=(3,)),
            straight_lane(3, (0, 0), (150, 0), predecessors=(1, 2)),
        )
    )


def on_ramp(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 10 * time, np.minimum(1.4 * time, 0.0)


@pytest.mark.parametrize(("ahead_m", "merges"), [(15, True), (-18, True), (45, False)])
def test_who_comes_from_another_lane_behind_another_merges(
    ahead_m: float, merges: bool
):
    agents = driven([on_ramp, along(ahead_m, 10)])
    found = events(scenario_with(agents, ramp()), "merge")
    who = ("100", "101") if ahead_m > 0 else ("101", "100")
    assert [(one.agent_id, one.other_id) for one in found] == [who] * merges
    for one in found:
        assert one.value == pytest.approx((abs(ahead_m) - 4.6) / 10, abs=0.3)


def test_who_follows_on_one_lane_does_not_merge():
    agents = driven([along(0, 10), along(15, 10)])
    assert not events(scenario_with(agents, ramp()), "merge")
    beside = driven([along(0, 10, LANE_M, 0.0), along(15, 10)])
    assert not events(scenario_with(beside, road()), "merge")


def test_a_walker_is_on_the_crosswalk():
    def walks(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(time), 1.5 * time

    ends = np.array([[-2.0, -5.0, 0.0], [-2.0, 5.0, 0.0]])
    crosswalk = Crosswalk(
        crosswalk_id=1, edge1=ends, edge2=ends + np.array([4.0, 0.0, 0.0])
    )
    agents = driven([walks], kinds=(AgentKind.PEDESTRIAN,))
    lanes = replace(road(), crosswalks=(crosswalk,))
    (one,) = events(scenario_with(agents, lanes))
    assert one.kind == "on-crosswalk"
    assert (one.begin_s, one.end_s) == pytest.approx((-3.2, 3.2), abs=0.3)


@pytest.mark.parametrize("demo", DEMOS)
@settings(max_examples=2, deadline=None)
@given(angle=st.floats(-3, 3), dx=st.floats(-500, 500), dy=st.floats(-500, 500))
def test_a_motion_of_the_plane_changes_nothing(
    demo: str, angle: float, dx: float, dy: float
):
    scenario = open_scenario(demo)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    moved = changed(scenario, lambda points: points @ turn + [dx, dy], turn)
    heading = wrap_angle(scenario.agents.heading_rad + angle)
    moved = replace(moved, agents=replace(moved.agents, heading_rad=heading))
    assert named(moved) == named(scenario)


@pytest.mark.parametrize("demo", DEMOS)
def test_a_mirror_swaps_left_and_right(demo: str):
    scenario = open_scenario(demo)
    flip = np.diag([1.0, -1.0])
    mirrored = changed(scenario, lambda points: points @ flip, flip)
    lanes = tuple(
        replace(
            one,
            left=one.right,
            right=one.left,
            left_neighbor=one.right_neighbor,
            right_neighbor=one.left_neighbor,
        )
        for one in mirrored.road_map.lanes
    )
    mirrored = replace(
        mirrored,
        road_map=replace(mirrored.road_map, lanes=lanes),
        agents=replace(mirrored.agents, heading_rad=-scenario.agents.heading_rad),
    )
    swap = {"left-turn": "right-turn", "lane-change-left": "lane-change-right"}
    swap |= {right: left for left, right in swap.items()}
    expected = sorted((swap.get(kind, kind), a, b) for kind, a, b in named(scenario))
    assert named(mirrored) == expected


@pytest.mark.parametrize("demo", DEMOS)
@pytest.mark.parametrize("share", [0.3, 0.5])
def test_lanes_may_be_cut_into_pieces(demo: str, share: float):
    scenario = open_scenario(demo)
    lanes = tuple(piece for one in scenario.road_map.lanes for piece in cut(one, share))
    apart = replace(scenario, road_map=replace(scenario.road_map, lanes=lanes))
    assert named(apart) == named(scenario)


@pytest.mark.parametrize("demo", DEMOS)
def test_a_scene_without_a_map_has_its_stops_and_crossings(demo: str):
    scenario = open_scenario(demo)
    bare = replace(scenario, road_map=RoadMap(lanes=()))
    kept = ("crossing", "hard-braking", "near-miss")
    assert [one for one in named(bare) if one[0] in kept] == [
        one for one in named(scenario) if one[0] in kept
    ]


def changed(
    scenario: Scenario, motion: Callable[[np.ndarray], np.ndarray], turn: np.ndarray
) -> Scenario:
    agents = scenario.agents
    return replace(
        scenario,
        road_map=scenario.road_map.moved(motion),
        agents=replace(
            agents,
            position_m=motion(agents.position_m),
            velocity_mps=agents.velocity_mps @ turn,
        ),
    )


def cut(lane: Lane, share: float) -> tuple[Lane, Lane]:
    """A lane in two pieces; every lane has a second one with its id plus a million."""
    later = 1_000_000

    def parts(line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        way = np.append(
            0.0, np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1).cumsum()
        )
        at = share * way[-1]
        middle = np.array([[np.interp(at, way, axis) for axis in line.T]])
        return (
            np.concatenate([line[way < at], middle]),
            np.concatenate([middle, line[way > at]]),
        )

    (center, center2), (left, left2), (right, right2) = map(
        parts, (lane.centerline, lane.left, lane.right)
    )
    beside = {
        name: None if (other := getattr(lane, name)) is None else other + later
        for name in ("left_neighbor", "right_neighbor")
    }
    first = replace(
        lane,
        centerline=center,
        left=left,
        right=right,
        successors=(lane.lane_id + later,),
        predecessors=tuple(one + later for one in lane.predecessors),
    )
    second = replace(
        lane,
        lane_id=lane.lane_id + later,
        centerline=center2,
        left=left2,
        right=right2,
        predecessors=(lane.lane_id,),
        **beside,
    )
    return first, second
