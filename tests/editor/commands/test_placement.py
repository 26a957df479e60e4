"""Placed agents drive the lane they are put on, and have a past unless asked not to."""

import json

import numpy as np
import pytest
import shapely

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import PlaceAgent, command_from_json, command_to_json
from pd_editor.scene.agent_kind import AgentCategory, AgentKind
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.road_map import RoadMap
from tests.builders import scenario_with, straight_drivers, straight_lane
from tests.editor.command_strategies import busy_scenario

BASE = busy_scenario()
NOW = BASE.current_step


def placed(scenario=BASE, **changes):
    values = {
        "agent_id": "new",
        "kind": AgentKind.VEHICLE,
        "x_m": -60.0,
        "y_m": 0.5,
        "heading_rad": 0.0,
        "speed_mps": 8.0,
    }
    return PlaceAgent(**(values | changes)).apply(scenario)


def curved_road() -> RoadMap:
    """A straight lane, then one that bends left, then one straight on."""
    first = straight_lane(1, (-80, 0), (0, 0), successors=(2,))
    angle = np.linspace(0, np.pi / 3, 40)

    def arc(radius: float) -> np.ndarray:
        x, y = radius * np.sin(angle), 60 - radius * np.cos(angle)
        return np.column_stack([x, y, 0 * x])

    end = arc(60.0)[-1, :2]
    far = end + 80 * np.array([np.cos(np.pi / 3), np.sin(np.pi / 3)])
    second = straight_lane(2, (0, 0), (50, 0), predecessors=(1,), successors=(3,))
    second = type(second)(
        **(
            {name: getattr(second, name) for name in second.__dataclass_fields__}
            | {"centerline": arc(60.0), "left": arc(58.25), "right": arc(61.75)}
        )
    )
    third = straight_lane(3, tuple(end), tuple(far), predecessors=(2,))
    return RoadMap(lanes=(first, second, third))


def test_without_a_past_an_agent_has_a_state_and_a_future():
    agents = placed(back_cast=False).agents
    row = agents.row_of["new"]
    assert tuple(agents.position_m[row, NOW]) == (-60, 0.5)
    assert agents.speed_mps()[row, NOW] == pytest.approx(8)
    assert not agents.is_valid[row, :NOW].any()
    assert agents.is_valid[row, NOW:].all()
    assert np.flatnonzero(agents.observed[row]).tolist() == [NOW]
    assert not agents.has_made_up_past[row]
    assert agents.categories[row] is AgentCategory.UNSCORED
    assert not agents.has_known_size[row]
    assert placed(back_cast=False).provenance.notes == ()


def test_it_keeps_its_speed_along_a_bent_lane():
    road = curved_road()
    scenario = scenario_with(straight_drivers([(-70, 0, 0, 5)]), road)
    agents = placed(scenario, x_m=-10.0, y_m=0.0, speed_mps=10.0).agents
    points = agents.position_m[1, NOW:]
    lane = shapely.MultiLineString([one.centerline_m for one in road.lanes])
    assert shapely.distance(lane, shapely.points(points)).max() < 0.5
    length = np.linalg.norm(np.diff(points, axis=0), axis=-1).sum()
    assert length == pytest.approx(10 * 6.0, rel=0.05)
    assert points[-1, 1] > 8


@pytest.mark.parametrize("offset", [-1.0, 0.0, 1.5])
def test_a_back_cast_past_runs_along_the_lane(offset):
    road = curved_road()
    scenario = scenario_with(straight_drivers([(-70, 0, 0, 5)]), road)
    lane = road.lane_of[3].centerline_m
    along = np.array([np.cos(np.pi / 3), np.sin(np.pi / 3)])
    x, y = lane[0] + 5 * along + offset * np.array([-along[1], along[0]])
    result = placed(
        scenario,
        x_m=float(x),
        y_m=float(y),
        heading_rad=np.pi / 3,
        speed_mps=10.0,
    )
    agents = result.agents
    past = agents.position_m[1, : NOW + 1]
    centre = shapely.MultiLineString([one.centerline_m for one in road.lanes])
    gap = shapely.distance(centre, shapely.points(past))
    assert np.allclose(gap, abs(np.clip(offset, -1.25, 1.25)), atol=0.3)
    assert agents.is_valid[1].all()
    assert agents.has_made_up_past[1]
    assert (agents.observed[1] == result.time_axis.is_past).all()
    chord = np.diff(past, axis=0)
    turn = wrap_angle(
        np.arctan2(chord[:, 1], chord[:, 0]) - agents.heading_rad[1, :NOW]
    )
    assert np.abs(turn).max() < 0.1
    assert result.provenance.notes == ("The past of agent new was made up.",)


def test_a_back_cast_past_goes_on_straight_before_the_first_lane():
    agents = placed(x_m=-95.0, y_m=1.0, speed_mps=10.0).agents
    row = agents.row_of["new"]
    assert agents.position_m[row, 0, 0] < -125
    assert np.allclose(agents.position_m[row, : NOW + 1, 1], 1.0, atol=0.1)


@pytest.mark.parametrize("kind", [AgentKind.PEDESTRIAN, AgentKind.VEHICLE])
def test_off_the_lanes_it_goes_straight_both_ways(kind):
    agents = placed(kind=kind, y_m=-60.0, heading_rad=1.0, speed_mps=2.0).agents
    row = agents.row_of["new"]
    along = np.array([np.cos(1.0), np.sin(1.0)])
    way = agents.position_m[row] + 60.0
    assert np.allclose(way, (way @ along)[:, None] * along, atol=1e-3)
    times = BASE.time_axis.times_s()[NOW:]
    assert np.allclose(way[NOW:] @ along, 2.0 * times, atol=1e-6)
    assert (np.diff(way @ along) >= 0).all()


@pytest.mark.parametrize("speed", [0.0, -2.0])
def test_standing_and_rolling_back(speed):
    agents = placed(speed_mps=speed).agents
    row = agents.row_of["new"]
    moved = agents.position_m[row, -1] - agents.position_m[row, NOW]
    assert np.allclose(moved, [speed * 6.0, 0], atol=0.5)


@pytest.mark.parametrize(
    "changes",
    [{"agent_id": "100"}, {"agent_id": ""}, {"x_m": 1e9}, {"speed_mps": 99.0}],
)
def test_impossible_placements_are_refused(changes):
    with pytest.raises(EditError):
        placed(**changes)


def test_a_size_is_kept_and_told_in_recipes():
    command = PlaceAgent(
        agent_id="new", kind=AgentKind.VEHICLE, x_m=-60.0, y_m=0.5,
        heading_rad=0.0, speed_mps=8.0, size_m=(5.1, 2.0),
    )  # fmt: skip
    again = command_from_json(json.loads(json.dumps(command_to_json(command))), "It")
    assert again == command
    agents = again.apply(BASE).agents
    row = agents.row_of["new"]
    assert agents.size_m[row].tolist() == [5.1, 2.0]
    assert agents.has_known_size[row]
    assert not placed().agents.has_known_size[row]
    with pytest.raises(EditError):
        placed(size_m=(0.0, 2.0))
