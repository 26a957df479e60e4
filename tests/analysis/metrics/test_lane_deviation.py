import numpy as np
import shapely

from pd_editor.analysis.metrics.lanes import (
    lane_deviation,
    nearest_edge,
    off_lane_values,
    path_length_m,
    reachable_lanes,
    start_to_start_m,
)
from pd_editor.analysis.metrics.road import map_points, nearest_points, paths_within
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.paths.lanes.lane_graph import DEAD_END_M, lane_graph
from pd_editor.scene.road_map import RoadMap
from tests.analysis.metrics.traffic_builders import generated, recorded
from tests.builders import scenario_with, straight_drivers, straight_lane

TIME = np.arange(61) * 0.1


def test_a_parallel_offset_is_the_deviation():
    values = lane_deviation(recorded([(0, 0.4, 0, 10), (0, 4.5, 0, 10)])).values()
    np.testing.assert_allclose(values["lateral_deviation_mean"].value, [0.4, 1.0])
    np.testing.assert_allclose(values["lateral_deviation_final"].value, [0.4, 1.0])
    np.testing.assert_allclose(values["angular_deviation_mean"].value, 0, atol=1e-5)


def test_drifting_off_the_road_is_seen_at_the_end():
    # 1 m/s to the right of the right lane; heading atan(1/10).
    values = lane_deviation(recorded([(0, 0, np.arctan(-0.1), 101**0.5)])).values()
    np.testing.assert_allclose(values["lateral_deviation_final"].value, 6.0)
    np.testing.assert_allclose(values["lateral_deviation_mean"].value, TIME[1:].mean())
    np.testing.assert_allclose(
        values["angular_deviation_mean"].value, np.degrees(np.arctan(0.1))
    )


def test_a_dead_end_goes_straight_on_and_a_lane_change_costs_nothing():
    x = 190 + 10 * TIME
    y = 3.5 * TIME / 6.0
    scenario = scenario_with(straight_drivers([(190, 0, 0, 10)]))
    view = generated(scenario, ("100",), np.stack([x, y], axis=-1)[None])
    final = lane_deviation(view).values()["lateral_deviation_final"]
    np.testing.assert_allclose(final.value, 0, atol=1e-9)


def crossing_road() -> RoadMap:
    """Eastwards lane 1 -> 2, and northwards lane 3 across it, not reachable from 1."""
    return RoadMap(
        lanes=(
            straight_lane(1, (-50, 0), (0, 0), successors=(2,)),
            straight_lane(2, (0, 0), (60, 0), predecessors=(1,)),
            straight_lane(3, (10, -60), (10, 60)),
        )
    )


def test_lanes_that_cannot_be_reached_do_not_help():
    scenario = scenario_with(straight_drivers([(-10, 0, 0, 5)]), crossing_road())
    corner = np.where(TIME < 3, -10 + 20 / 3 * TIME, 10.0)
    up = np.maximum(TIME - 3, 0) * 10
    view = generated(scenario, ("100",), np.stack([corner, up], axis=-1)[None])
    final = lane_deviation(view).values()["lateral_deviation_final"]
    np.testing.assert_allclose(final.value, 30.0)


def test_the_wrong_way_is_against_every_lane_below():
    values = lane_deviation(
        recorded([(0, 0, np.pi, 10), (0, 0, 0, 10), (9, 3.5, np.pi, 0), (0, 40, 0, 5)])
    ).values()["wrong_way"]
    assert values.value.tolist() == [1, 0, 0, 0]
    assert values.is_valid.tolist() == [True, True, False, False]


def test_pedestrians_have_no_lane():
    view = recorded([(0, 0, 0, 1)], (AgentKind.PEDESTRIAN,))
    for values in (*lane_deviation(view).values().values(), *nearest_edge(view)):
        assert not values.is_valid.any()
    assert not any(v.is_valid.any() for v in off_lane_values(view).values())


def test_one_point_on_the_road_saves_a_path_in_the_papers_rule_only():
    # Leaves the road to the right at 10 m/s; within 4 m of a centre point at first.
    values = off_lane_values(recorded([(0, 0, -np.pi / 2, 10), (0, -30, 0, 10)]))
    assert values["off_road_4m_whole_path"].value.tolist() == [0, 1]
    assert values["off_road_4m"].value.tolist() == [1, 1]
    np.testing.assert_allclose(values["off_road_4m_steps"].value, [56 / 61, 1])
    # The drivable area ends at y = -1.75.
    np.testing.assert_allclose(values["off_drivable_steps"].value, [59 / 61, 1])
    assert values["init_off_road_4m"].value.tolist() == [0, 1]


def test_nearest_lanes_are_those_of_shapely(av2_scenario_folders):
    """Distances to all lanes that agents may reach, on real maps and tracks."""
    for folder in av2_scenario_folders[:12]:
        view = recorded_traffic(read_scenario(folder))
        graph, agents = lane_graph(view.scenario.road_map), view.agents
        found = lane_deviation(view)
        reachable = reachable_lanes(
            view.scenario.road_map,
            agents.position_m[:, 0],
            agents.heading_rad[:, 0],
            agents.kinds,
            path_length_m(agents.position_m, agents.is_valid),
        )
        lines = []
        for line, after in zip(graph.centerlines_m, graph.successors, strict=True):
            along = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
            longer = [] if after else [line[-1:] + DEAD_END_M * along]
            lines.append(shapely.LineString(np.concatenate([line, *longer])))
        lines = np.array(lines)
        for row in np.flatnonzero(found.is_valid.any(axis=1)):
            steps = np.flatnonzero(found.is_valid[row])
            points = shapely.points(agents.position_m[row, steps])
            lanes = lines[reachable[row]]
            least = shapely.distance(points[:, None], lanes).min(axis=1)
            np.testing.assert_allclose(found.lateral_m[row, steps], least, atol=1e-6)
            mine = shapely.distance(points, lines[found.lane[row, steps]])
            np.testing.assert_allclose(mine, least, atol=1e-6)


def test_points_within_reach_are_those_of_all_distances(av2_scenario_folders):
    for folder in av2_scenario_folders[:12]:
        view = recorded_traffic(read_scenario(folder))
        center = map_points(view.scenario.road_map).center_m
        position, is_valid = view.agents.position_m, view.agents.is_valid
        near = paths_within(position, is_valid, center, 4.0)
        distance = nearest_points(position[is_valid], center)[1]
        np.testing.assert_array_equal(near[is_valid], distance <= 4.0)
        assert not near[~is_valid].any()
        index, edge = nearest_points(position[:, 0], center)
        brute = np.linalg.norm(position[:, :1] - center, axis=-1)
        np.testing.assert_allclose(edge, brute.min(axis=1))
        assert (brute[np.arange(len(index)), index] == brute.min(axis=1)).all()


def test_driving_distances_follow_lanes_and_lane_changes():
    graph = lane_graph(scenario_with(straight_drivers([])).road_map)
    road_map = scenario_with(straight_drivers([])).road_map
    distance = start_to_start_m(road_map)
    row = graph.row_of
    assert distance[row[1], row[2]] == 150
    assert distance[row[1], row[4]] == 150
    assert distance[row[1], row[3]] == 0
    assert np.isinf(distance[row[2], row[1]])


def test_path_length_skips_gaps():
    position = np.stack([np.arange(5.0), np.zeros(5)], axis=-1)[None]
    is_valid = np.array([[True, True, False, True, True]])
    assert path_length_m(position, is_valid).tolist() == [2]
