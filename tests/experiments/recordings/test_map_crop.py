import numpy as np
import pytest
import shapely

from pd_editor.experiments.recordings.clip import MAP_MARGIN_M, cropped_map
from pd_editor.scene.agent_kind import AgentCategory
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.road_map import Crosswalk, DrivableArea, RoadMap
from tests.builders import straight_lane


def ring(*points: tuple[float, float]) -> np.ndarray:
    return np.array([[x, y, 7.0] for x, y in points])


def crossing(number: int, x: float) -> Crosswalk:
    return Crosswalk(
        crosswalk_id=number,
        edge1=np.array([[x, -5.0, 0], [x, 5.0, 0]]),
        edge2=np.array([[x + 3, -5.0, 0], [x + 3, 5.0, 0]]),
    )


def long_road() -> RoadMap:
    """Lanes of 20 m one after the other from 0 to 2 km, all on one paved area."""
    lanes = tuple(
        straight_lane(number, (20.0 * number, 0), (20.0 * number + 20, 0))
        for number in range(100)
    )
    areas = (
        DrivableArea(area_id=5, boundary=ring((0, -4), (2000, -4), (2000, 4), (0, 4))),
        DrivableArea(
            area_id=6, boundary=ring((500, 9), (520, 9), (520, 11), (500, 11))
        ),
    )
    walks = (crossing(1, 510.0), crossing(2, 900.0))
    return RoadMap(lanes=lanes, crosswalks=walks, drivable_areas=areas)


def test_what_is_near_a_path_is_kept():
    path = np.stack([np.linspace(500, 540, 30), np.full(30, 1.0)], axis=-1)
    cut = cropped_map(long_road(), path[None])
    reach = [500 - MAP_MARGIN_M, 540 + MAP_MARGIN_M]
    expected = [
        number
        for number in range(100)
        if 20 * number + 20 >= reach[0] and 20 * number <= reach[1]
    ]
    assert [lane.lane_id for lane in cut.lanes] == expected
    assert [one.crosswalk_id for one in cut.crosswalks] == [1]


def test_ground_is_cut_off_beyond_the_lanes():
    path = np.stack([np.linspace(500, 540, 30), np.full(30, 1.0)], axis=-1)
    cut = cropped_map(long_road(), path[None])
    small, large = cut.drivable_areas
    assert small.area_id == 6
    assert large.area_id not in {5, 6}
    assert shapely.Polygon(large.boundary).area == pytest.approx(
        (120 + 2 * 15) * 8, abs=1
    )
    assert (large.boundary[:, 2] == 7.0).all()


def test_areas_that_cross_themselves_do_no_harm():
    bow_tie = DrivableArea(
        area_id=1, boundary=ring((0, -4), (2000, 4), (2000, -4), (0, 4))
    )
    road = RoadMap(lanes=long_road().lanes, drivable_areas=(bow_tie,))
    path = np.array([[[100.0, 0], [110, 0]]])
    assert len(cropped_map(road, path).drivable_areas) >= 1


@pytest.mark.real_data
def test_real_maps_are_cut_like_this(av2_scenario_folders):
    """All but a few lanes of a real map are within the margin of its main agents."""
    folder = next(one for one in av2_scenario_folders if one.parent.name == "train")
    real = read_scenario(folder)
    rows = [
        row
        for row, name in enumerate(real.agents.ids)
        if name == "AV" or real.agents.categories[row] >= AgentCategory.SCORED
    ]
    cut = cropped_map(real.road_map, real.agents.position_m[rows])
    assert len(cut.lanes) >= 0.95 * len(real.road_map.lanes)
