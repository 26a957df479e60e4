import numpy as np
import pytest
import shapely

from pd_editor.analysis.metrics.box_overlaps import MIN_OVERLAP_M2, boxes_touch
from pd_editor.analysis.metrics.safety import box_gap_m, safety_values, sweep_times_s
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.oriented_box import Boxes, box_corners, overlap_area
from tests.analysis.metrics.traffic_builders import recorded
from tests.builders import LANE_WIDTH_M

LENGTH, WIDTH = 4.6, 1.9


def random_boxes(count: int, seed: int = 0, spread_m: float = 5.0) -> tuple[Boxes, ...]:
    random = np.random.default_rng(seed)
    offset = random.uniform(-spread_m, spread_m, (count, 2))
    heading = random.uniform(-np.pi, np.pi, (2, count))
    size = random.uniform([0.4, 0.4], [12.0, 3.0], (2, count, 2))
    centers = (np.zeros((count, 2)), offset)
    return tuple(
        Boxes(position_m=center, heading_rad=angle, size_m=sides)
        for center, angle, sides in zip(centers, heading, size, strict=True)
    )


def test_ten_thousand_random_pairs_of_boxes_are_those_of_shapely():
    one_box, two_box = random_boxes(10_000)
    first, second = one_box.corners_m(), two_box.corners_m()
    one, two = shapely.polygons(first), shapely.polygons(second)
    area = shapely.area(shapely.intersection(one, two))
    assert 0.25 < np.mean(area > MIN_OVERLAP_M2) < 0.75
    np.testing.assert_array_equal(
        overlap_area(first, second) > MIN_OVERLAP_M2, area > MIN_OVERLAP_M2
    )
    np.testing.assert_array_equal(
        boxes_touch(one_box, two_box), shapely.intersects(one, two)
    )
    np.testing.assert_allclose(
        box_gap_m(one_box, two_box), shapely.distance(one, two), atol=1e-9
    )


def test_boxes_meet_just_when_a_swept_box_does():
    """Times against boxes moved in small steps, by shapely."""
    count = 150
    one_box, two_box = random_boxes(count, seed=1, spread_m=20)
    first, second = one_box.corners_m(), two_box.corners_m()
    velocity = np.random.default_rng(2).uniform(-9, 9, (count, 2))
    enter, leave = sweep_times_s(one_box, two_box, velocity)
    one = np.asarray(shapely.polygons(first))
    time = np.arange(0, 5, 0.01)
    moved = second[:, None] + (time[:, None] * velocity[:, None])[:, :, None]
    meets = shapely.intersects(one[:, None], shapely.polygons(moved))
    expected = (enter[:, None] < time) & (time < leave[:, None])
    near = np.abs(time - enter[:, None]) < 1e-6
    near |= np.abs(time - leave[:, None]) < 1e-6
    assert (meets == (expected & (enter < leave)[:, None]))[~near].all()
    assert 10 < meets.any(axis=1).sum() < count - 10


def test_closed_form_behind_a_slower_car():
    closer = safety_values(recorded([(0, 0, 0, 10), (20, 0, 0, 8)]))
    gap = 20 - LENGTH - 2 * 6.0
    np.testing.assert_allclose(closer["minimum_gap"].value, gap)
    np.testing.assert_allclose(closer["time_to_collision"].value, gap / 2)
    assert closer["critical_time_to_collision"].value.tolist() == [0, 0]


def test_beyond_the_horizon_there_is_no_time_to_collision():
    apart = safety_values(recorded([(0, 0, 0, 10), (40, 0, 0, 8)]))
    assert not apart["time_to_collision"].is_valid.any()


def test_time_to_collision_falls_to_nothing_in_a_crash():
    values = safety_values(recorded([(0, 0, 0, 10), (20, 0, 0, 6)]))
    np.testing.assert_allclose(values["time_to_collision"].value, 0)
    assert values["critical_time_to_collision"].value.tolist() == [1, 1]


def test_side_by_side_nobody_is_on_a_collision_course():
    values = safety_values(recorded([(0, 0, 0, 10), (0, LANE_WIDTH_M, 0, 10)]))
    assert not values["time_to_collision"].is_valid.any()
    assert not values["post_encroachment_time"].is_valid.any()
    np.testing.assert_allclose(values["minimum_gap"].value, LANE_WIDTH_M - WIDTH)


def test_post_encroachment_of_crossing_paths():
    # One crosses the other's lane at x = 30 m from t = 0; the other comes 3 s later.
    values = safety_values(recorded([(0, 0, 0, 10), (30, 0, np.pi / 2, 10)]))
    # The crossing car has left once its tail, 2.3 m behind, clears half a width; the
    # other enters when its nose, 2.3 m ahead, is half a width before x = 30 m.
    leaves = (LENGTH / 2 + WIDTH / 2) / 10
    enters = (30 - WIDTH / 2 - LENGTH / 2) / 10
    found = values["post_encroachment_time"].value
    assert (found >= enters - leaves).all()
    assert (found <= enters - leaves + 0.2).all()


def test_a_follower_reaches_places_after_the_leader_left_them():
    values = safety_values(recorded([(0, 0, 0, 10), (20, 0, 0, 10)]))
    gap_s = (20 - LENGTH) / 10
    found = values["post_encroachment_time"].value
    assert ((found >= gap_s) & (found <= gap_s + 0.1)).all()


def test_pairs_that_overlap_at_the_state_have_no_time():
    values = safety_values(recorded([(0, 0, 0, 10), (2, 0, 0, 5)]))
    assert not values["time_to_collision"].is_valid.any()
    assert not values["post_encroachment_time"].is_valid.any()
    assert values["minimum_gap"].value.tolist() == [0, 0]


def test_alone_there_is_no_gap():
    values = safety_values(recorded([(0, 0, 0, 10)]))
    assert not values["minimum_gap"].is_valid.any()
    walks = AgentKind.PEDESTRIAN
    crowd = safety_values(recorded([(0, 0, 0, 1), (3, 0, 0, 1)], (walks, walks)))
    assert not crowd["minimum_gap"].is_valid.any()


def test_gaps_of_real_scenes_are_those_of_all_pairs(
    av2_scenario_folders,
):
    folders = [f for f in av2_scenario_folders if f.parent.name != "test50"][:6]
    for folder in folders:
        view = recorded_traffic(read_scenario(folder))
        agents = view.agents
        shape = agents.is_valid.shape
        size = np.broadcast_to(agents.size_m[:, None], (*shape, 2))
        boxes = np.asarray(
            shapely.polygons(box_corners(agents.position_m, agents.heading_rad, size))
        )
        walks = agents.is_in("pedestrians")
        gap = np.full(len(view), np.inf)
        for one in range(len(view)):
            for two in range(one + 1, len(view)):
                both = agents.is_valid[one] & agents.is_valid[two]
                if both.any() and not (walks[one] and walks[two]):
                    least = shapely.distance(boxes[one, both], boxes[two, both]).min()
                    gap[[one, two]] = np.minimum(gap[[one, two]], least)
        found = safety_values(view)["minimum_gap"]
        np.testing.assert_array_equal(found.is_valid, np.isfinite(gap))
        np.testing.assert_allclose(found.valid(), gap[found.is_valid], atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_post_encroachment_is_the_least_lag_at_which_boxes_meet(seed):
    random = np.random.default_rng(seed)
    states = random.uniform([-30, -30, -np.pi, 2], [30, 30, np.pi, 12], (6, 4))
    view = recorded([tuple(state) for state in states.tolist()])
    agents = view.agents
    size = np.broadcast_to(agents.size_m[:, None], (6, 61, 2))
    boxes = np.asarray(
        shapely.polygons(box_corners(agents.position_m, agents.heading_rad, size))
    )
    lag = np.abs(np.arange(61)[:, None] - np.arange(61)) * 0.1
    expected = np.full(6, np.inf)
    for one in range(6):
        for two in range(one + 1, 6):
            meets = shapely.intersects(boxes[one][:, None], boxes[two])
            if meets.any() and not meets[0, 0]:
                least = lag[meets].min()
                expected[[one, two]] = np.minimum(expected[[one, two]], least)
    found = safety_values(view)["post_encroachment_time"]
    np.testing.assert_array_equal(found.is_valid, np.isfinite(expected))
    np.testing.assert_allclose(found.valid(), expected[found.is_valid])
