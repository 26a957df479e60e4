from dataclasses import replace

import numpy as np
import pytest

from pd_editor.av2_io.read import read_scenario
from pd_editor.geometry.rigid_motion import RigidMotion
from pd_editor.metrics.scene_warnings import scene_warnings, without_known
from pd_editor.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.builders import (
    scenario_with,
    straight_drivers,
    two_agents_that_collide,
    two_agents_that_pass,
    two_lane_road,
)


def messages(scenario, *, with_future=True):
    return [w.message for w in scene_warnings(scenario, with_future=with_future)]


def test_nothing_to_say_about_two_who_pass():
    agents = straight_drivers([(0, 0, 0, 10), (0, 3.5, 0, 10)])
    assert messages(scenario_with(agents)) == []
    assert messages(two_agents_that_pass()) == []


def test_a_later_collision_is_announced_only_if_asked_for():
    scenario = two_agents_that_collide()
    assert messages(scenario, with_future=False) == []
    (warning,) = scene_warnings(scenario, with_future=True)
    assert warning.kind == "future-overlap"
    assert warning.agent_ids == ("100", "101")
    assert warning.step == 66
    assert warning.message == "Vehicle 100 and vehicle 101 overlap in 1.6 s."


def test_what_is_wrong_now_is_not_announced_again():
    kinds = (AgentKind.VEHICLE, AgentKind.BUS)
    agents = straight_drivers([(0, 0, 0, 3), (4, 0, 0, 3)], kinds=kinds)
    assert messages(scenario_with(agents)) == ["Vehicle 100 and bus 101 overlap."]


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
        "Vehicle 100 is off the road.",
        "Vehicle 101 is off the road in 0.5 s.",
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
        "Vehicle 100 and static object 101 overlap."
    ]


def test_known_warnings_can_be_left_out():
    warnings = scene_warnings(two_agents_that_collide(), with_future=True)
    later = [replace(warning, step=3) for warning in warnings]
    assert warnings
    both, one = ("100", "101"), ("100",)

    def left(known, unmoved, untouched):
        return without_known(warnings, known, unmoved=unmoved, untouched=untouched)

    assert left(later, both, both) == ()
    assert left([], both, both) == warnings
    # One of the two has another future: the user should hear of it again.
    assert {w.kind for w in warnings} == {"future-overlap"}
    assert left(later, both, one) == warnings
    assert left(later, one, both) == ()


@pytest.mark.real_data
def test_a_warp_adds_no_off_road_warnings(av2_scenario_folders):
    for folder in av2_scenario_folders[::16]:
        scenario = read_scenario(folder)
        before = scene_warnings(scenario, with_future=False)
        x, y = scenario.agents.position_m[:, scenario.current_step].mean(axis=0)
        term = WarpTerm(kind="ripple-road", power=5.0, length_m=60.0)
        anchor = RigidMotion(x_m=float(x), y_m=float(y), rotation_rad=1.0)
        warped = warp_scenario(scenario, RoadWarp(anchor=anchor, terms=(term,)))
        after = scene_warnings(warped, with_future=False)
        off = [w.agent_ids for w in before if w.kind == "off-road"]
        assert [w.agent_ids for w in after if w.kind == "off-road"] == off
