from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.findings.check import (
    checked,
    scene_findings,
    scene_problems,
    split,
)
from pd_editor.analysis.findings.collisions import MAX_COLLISIONS
from pd_editor.analysis.findings.scorecard import scorecard
from pd_editor.analysis.guidance.report import AgentRealism
from pd_editor.editor.cures import cures
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.analysis.findings.builders import finding
from tests.builders import (
    scenario_with,
    straight_drivers,
    two_agents_that_collide,
    two_agents_that_pass,
    two_lane_road,
)


def messages(scenario, *, with_future=True):
    return [p.message for p in scene_problems(scenario, with_future=with_future)]


def test_nothing_to_say_about_two_who_pass():
    agents = straight_drivers([(0, 0, 0, 10), (0, 3.5, 0, 10)])
    assert messages(scenario_with(agents)) == []
    assert messages(two_agents_that_pass()) == []


def test_a_later_collision_is_announced_only_if_asked_for():
    scenario = two_agents_that_collide()
    assert messages(scenario, with_future=False) == []
    (problem,) = scene_problems(scenario)
    assert problem.kind == "later-collision"
    assert problem.agent_ids == ("100", "101")
    now = scenario.current_step
    assert problem.first_step == now + 16
    assert problem.message == "Vehicle 100 and vehicle 101 collide at 1.6 s."
    assert problem.holds_at(now + 16.4)
    assert not problem.holds_at(now + 15.4)
    assert problem.first_step <= problem.worst_step
    assert problem.num_steps() > 1


def test_what_is_wrong_now_is_not_announced_again():
    kinds = (AgentKind.VEHICLE, AgentKind.BUS)
    agents = straight_drivers([(0, 0, 0, 3), (4, 0, 0, 3)], kinds=kinds)
    assert messages(scenario_with(agents)) == ["Vehicle 100 and bus 101 collide."]


def test_driving_on_past_the_end_of_the_map_is_not_off_the_road():
    """What is past the last lane is unknown; leaving the road beside it is told."""
    scenario = scenario_with(straight_drivers([(0, 0, 0, 40.0)]))
    now, agents = scenario.current_step, scenario.agents
    assert agents.position_m[0, -1, 0] > 210.0
    assert messages(scenario) == []
    aside = agents.position_m.copy()
    aside[0, now:, 1] -= np.linspace(0.0, 60.0, aside.shape[1] - now)
    off = scenario.with_agents(agents.with_rows(np.array([0]), position_m=aside))
    (problem,) = scene_problems(off)
    assert problem.kind == "later-off-road"


def test_beyond_the_mapped_road_is_a_class_of_its_own():
    """Cards, ranking, scorecard and cost called it off the road, the list did not."""
    scenario = scenario_with(straight_drivers([(0, 0, 0, 40.0)]))
    (beyond,) = [one for one in scene_findings(scenario) if one.kind == "beyond-map"]
    assert beyond.severity == "remark"
    assert not beyond.is_fault
    assert cures(scenario, beyond, [beyond]) == ()
    rows = {row.name: row for row in scorecard(scenario)}
    assert rows["off_drivable"].value == 0.0
    assert rows["off_drivable"].findings == ()
    agents, now = scenario.agents, scenario.current_step
    sample = TrafficSample(
        ids=agents.ids,
        kinds=agents.kinds,
        size_m=agents.size_m,
        position_m=agents.position_m[:, now:],
        heading_rad=agents.heading_rad[:, now:],
        velocity_mps=agents.velocity_mps[:, now:],
    )
    assert AgentRealism.of(scenario, sample).over().off_road == 0.0


def test_who_comes_in_over_the_start_of_the_map_is_not_off_the_road():
    scenario = scenario_with(straight_drivers([(-60.0, 0.0, 0.0, 10.0)]))
    agents, now = scenario.agents, scenario.current_step
    back = agents.position_m - np.array([60.0, 0.0])
    scenario = scenario.with_agents(agents.with_rows(np.array([0]), position_m=back))
    assert scenario.agents.position_m[0, now, 0] < -100.0 < back[0, -1, 0]
    assert {one.kind for one in scene_findings(scenario)} == {"beyond-map"}


def test_a_near_pass_is_a_notice():
    """Boxes 2 m wide, 0.2 m apart; with both standing nothing is told."""
    width = float(straight_drivers([(0, 0, 0, 5)]).size_m[0, 1])
    for speed, kinds in ((5.0, ["near-pass"]), (0.0, [])):
        states = [(0, 0, 0, 0.0), (-10.0 * (speed > 0), width + 0.2, 0, speed)]
        found = scene_findings(scenario_with(straight_drivers(states)))
        assert [one.kind for one in found] == kinds
        for one in found:
            assert one.severity == "notice"
            assert one.value == pytest.approx(0.2)
            assert one.headline == "100 and 101 0.20 m apart"


def test_an_agent_that_is_off_the_road_is_told_with_its_present_distance():
    """Where it gets further away later, both distances are told."""
    scenario = scenario_with(straight_drivers([(0, -4.0, 0, 10.0)]))
    now, agents = scenario.current_step, scenario.agents
    assert messages(scenario) == ["Vehicle 100 is 2.2 m off the road."]
    away = agents.position_m.copy()
    away[0, now:, 1] -= np.linspace(0.0, 30.0, away.shape[1] - now)
    off = scenario.with_agents(agents.with_rows(np.array([0]), position_m=away))
    (problem,) = scene_problems(off)
    assert problem.message == "Vehicle 100 is 2.2 m off the road, later up to 32.2 m."
    assert problem.headline == "100 off the road, 2.2 m"


def test_an_agent_at_the_edge_is_not_told_to_be_nought_metres_away():
    agents = straight_drivers([(0, -1.77, 0, 0)])
    (problem,) = scene_problems(scenario_with(agents))
    assert problem.message == "Vehicle 100 is 0.1 m off the road."
    assert problem.headline == "100 off the road, 0.1 m"


def hook_shaped_road():
    """The two-lane road with an arm to the north, so that its hull is wide."""
    road_map = two_lane_road()
    ring = np.array(
        [
            [-100.0, -1.75, 0],
            [200, -1.75, 0],
            [200, 5.25, 0],
            [-96, 5.25, 0],
            [-96, 40, 0],
            [-100, 40, 0],
        ]
    )
    area = replace(road_map.drivable_areas[0], boundary=ring)
    return replace(road_map, drivable_areas=(area,))


def test_off_the_road_now_and_later():
    agents = straight_drivers([(-40, 8, 0, 0), (-60, 3.5, 0.8, 5)])
    assert messages(scenario_with(agents, hook_shaped_road())) == [
        "Vehicle 100 is 2.8 m off the road.",
        "Vehicle 101 leaves the road at 0.5 s, by up to 19.8 m.",
    ]


@pytest.mark.parametrize("y", [8.0, 30.0, 300.0])
def test_off_road_is_said_however_far_away(y):
    (message,) = messages(scenario_with(straight_drivers([(0, y, 0, 0)])))
    assert "off the road" in message


@pytest.mark.parametrize(
    ("one", "two", "warns"),
    [
        (AgentKind.VEHICLE, AgentKind.STATIC, True),
        (AgentKind.VEHICLE, AgentKind.PEDESTRIAN, True),
        (AgentKind.VEHICLE, AgentKind.RIDERLESS_BICYCLE, True),
        (AgentKind.PEDESTRIAN, AgentKind.PEDESTRIAN, False),
        (AgentKind.PEDESTRIAN, AgentKind.RIDERLESS_BICYCLE, False),
        (AgentKind.CONSTRUCTION, AgentKind.STATIC, False),
    ],
)
def test_only_overlaps_that_matter(one, two, warns):
    agents = straight_drivers([(0, 0, 0, 0), (0.1, 0, 0, 0)], kinds=(one, two))
    assert bool(messages(scenario_with(agents))) == warns


def test_parked_cars_that_come_into_view_do_not_collide():
    agents = straight_drivers([(0, 0, 0, 0), (4, 0, 0, 0)])
    valid = agents.is_valid.copy()
    valid[1, :70] = False
    assert messages(scenario_with(replace(agents, is_valid=valid))) == []


def test_things_have_plain_names():
    kinds = (AgentKind.VEHICLE, AgentKind.STATIC)
    agents = straight_drivers([(0, 0, 0, 0), (1, 0, 0, 0)], kinds=kinds)
    assert messages(scenario_with(agents)) == [
        "Vehicle 100 and static object 101 collide."
    ]


def test_problems_of_the_recording_are_a_group_of_their_own():
    problems = scene_problems(two_agents_that_collide())
    later = [replace(problem, spans=((3, 4),)) for problem in problems]
    assert problems
    both, one = ("100", "101"), ("100",)

    def new(recorded, unmoved, untouched):
        return split(problems, recorded, unmoved=unmoved, untouched=untouched).new

    assert new(later, both, both) == ()
    own = split(problems, later, unmoved=both, untouched=both).recorded
    assert own == tuple(replace(one, source="recorded") for one in problems)
    assert new([], both, both) == problems
    # One of the two has another future: the user should hear of it again.
    assert {p.kind for p in problems} == {"later-collision"}
    assert new(later, both, one) == problems
    assert new(later, one, both) == ()


def test_a_recorded_finding_that_an_edit_made_clearly_worse_is_new():
    """41043 brakes with 7.7 m/s² before a bend, 8.4 after: it was in the recording."""
    was = finding("harsh-motion", "a", value=7.7)
    for value, words, is_new in (
        (8.4, "8.4", True),
        (7.8, "7.8", False),
        (6, "6", False),
    ):
        one = replace(was, value=value, headline=f"a brakes with {words} m/s²")
        check = split([one], [was], unmoved=("a",), untouched=("a",))
        assert bool(check.new) == is_new
        assert len(check.all) == 1
    # What reads the same is the same: a distance of 2 cm, told as 0.1 m.
    near = replace(was, kind="off-road", value=0.02)
    check = split([replace(near, value=0.03)], [near], unmoved=("a",), untouched=("a",))
    assert not check.new


def test_a_pair_that_collides_has_no_time_to_collision():
    """It was listed three times: the pair, and 0.0 s for each agent."""
    found = scene_findings(two_agents_that_collide())
    assert [one.kind for one in found] == ["later-collision"]
    # A third agent, which brakes in time, is told still.
    speeds = [(0, 0, 0, 8.0), (20, 0, 0, 4.0), (0, 3.5, 0, 12.0), (16, 3.5, 0, 0.0)]
    scenario = scenario_with(straight_drivers(speeds))
    agents, now = scenario.agents, scenario.current_step
    path, velocity = agents.position_m.copy(), agents.velocity_mps.copy()
    path[2, now + 8 :], velocity[2, now + 9 :] = path[2, now + 8], 0.0
    agents = agents.with_rows(np.arange(4), position_m=path, velocity_mps=velocity)
    found = scene_findings(scenario.with_agents(agents))
    told = {(one.kind, one.agent_ids) for one in found}
    assert ("later-collision", ("100", "101")) in told
    short = {one.agent_ids[0] for one in found if one.kind == "short-time"}
    assert short == {"102", "103"}


def test_an_agent_that_appears_later_is_said_to():
    """(D13) Regenerating does not move an agent that is not there yet."""
    scenario = two_agents_that_collide()
    valid = scenario.agents.is_valid.copy()
    valid[1, : scenario.current_step + 8] = False
    scenario = scenario.with_agents(replace(scenario.agents, is_valid=valid))
    assert messages(scenario) == [
        "Vehicle 100 and vehicle 101 (appears at 0.8 s) collide at 1.6 s."
    ]


@pytest.mark.slow
def test_hundreds_of_agents_in_one_place_take_bounded_time():
    """(reliability 1) 400 agents on one spot: 80,000 pairs that all collide."""
    states = [(0.01 * number, 0.0, 0.0, 5.0) for number in range(400)]
    found = scene_problems(scenario_with(straight_drivers(states)))
    assert len([p for p in found if p.kind == "collision"]) == MAX_COLLISIONS


@pytest.mark.real_data
def test_a_warp_adds_no_off_road_problems(av2_scenario_folders):
    """(D9) A bend moves the drivable area along with the agents."""
    for folder in av2_scenario_folders[::16]:
        scenario = read_scenario(folder)
        recorded = scene_problems(scenario)
        x, y = scenario.agents.position_m[:, scenario.current_step].mean(axis=0)
        term = WarpTerm(kind="ripple-road", power=5.0, length_m=60.0)
        anchor = RigidMotion(x_m=float(x), y_m=float(y), rotation_rad=1.0)
        warped = warp_scenario(scenario, RoadWarp(anchor=anchor, terms=(term,)))
        found = checked(warped, scenario, recorded)
        assert not [p for p in found.new if "off-road" in p.kind]
