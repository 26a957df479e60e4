"""Lanelets, links and centre lines, as Lanelet2's own library has them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.geometry.polyline import densify
from pd_editor.scene.road_map import Lane, LaneKind
from tests.oracles.environment import Oracle
from tests.scene.formats.test_lanelet2 import ALL_WAYS, PLACES, lanelet, tags, text

pytestmark = [pytest.mark.slow, pytest.mark.oracle]
SAME_M = 0.05


def in_degrees(content: str) -> str:
    """A map made by hand, moved to where degrees are so many metres."""
    for n, (x, y) in PLACES.items():
        where = f'lat="{48 + y / 111_200:.9f}" lon="{9 + x / 74_600:.9f}"'
        content = content.replace(
            f'<node id="{n}" lat="" lon="">', f'<node id="{n}" {where}>'
        )
        content = content.replace(tags(local_x=f"{x}", local_y=f"{y}"), "")
    return content  # fmt: skip


def check(path: Path, oracle: Oracle) -> None:
    scene = open_scenario(path)
    theirs = oracle.ask("lanelet2_graph.py", str(path))
    lines = {
        name: shapely.LineString(np.array(one["center"]))
        for name, one in theirs.items()
    }
    name_of = {
        lane.lane_id: name_by_place(lane, scene.origin_city_m, lines)
        for lane in scene.road_map.lanes
    }
    known = scene.road_map.lane_of
    assert sorted(name_of.values()) == sorted(theirs)
    for lane in scene.road_map.lanes:
        its = theirs[name_of[lane.lane_id]]
        after = sorted(name_of[one] for one in lane.successors)
        assert after == sorted(its["after"]), lane.lane_id
        for beside, name in (
            (lane.left_neighbor, "left"),
            (lane.right_neighbor, "right"),
        ):
            own = None if beside is None else name_of[beside]
            # To Lanelet2, vehicles have no neighbours that are for bicycles alone.
            if beside is None or LaneKind.BIKE is not known[beside].kind:
                assert own == its[name]


def name_by_place(
    lane: Lane, origin_m: np.ndarray, lines: dict[str, shapely.LineString]
) -> str:
    """The lanelet whose centre line, in its direction, is that of a lane."""
    own = shapely.LineString(densify(lane.centerline_m + origin_m, 0.5))
    found = [
        name
        for name, line in lines.items()
        if shapely.hausdorff_distance(own, line, densify=0.05) < SAME_M
        and shapely.distance(shapely.get_point(own, 0), shapely.get_point(line, 0))
        < SAME_M
    ]
    assert len(found) == 1, (lane.lane_id, found)
    return found[0]


def test_real_maps(format_files: Path, oracle: Callable[[str], Oracle]):
    for path in sorted((format_files / "lanelet2").glob("*.osm")):
        check(path, oracle("lanelet2"))


@pytest.mark.parametrize("flips", [(), (11,), (10, 15)])
def test_neighbours_kinds_and_both_directions(
    tmp_path: Path, oracle: Callable[[str], Oracle], flips: tuple[int, ...]
):
    ways = {n: one[::-1] if n in flips else one for n, one in ALL_WAYS.items()}
    content = text(
        (
            lanelet(1, 10, 11, one_way="no"),
            lanelet(2, 11, 12, subtype="bicycle_lane"),
            lanelet(3, 13, 15, one_way__vehicle="no"),
            lanelet(4, 11, 12, subtype="walkway"),
        ),
        ways,
    )
    path = tmp_path / "map.osm"
    path.write_text(in_degrees(content))
    check(path, oracle("lanelet2"))
