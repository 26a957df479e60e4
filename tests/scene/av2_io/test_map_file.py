import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import MapFileError
from pd_editor.scene.av2_io.map_file import map_bytes, read_map
from pd_editor.scene.geometry.polyline import midline
from pd_editor.scene.road_map import Crosswalk, LaneKind, LaneMark, RoadMap
from tests.scene.av2_io.small_files import MAP, SCENARIO, changed_map

FILE = "log_map_archive_x.json"
ORIGIN = SCENARIO.origin_city_m


def read(data: bytes) -> RoadMap:
    return read_map(data, FILE, ORIGIN)


def assert_same_map(found: RoadMap, expected: RoadMap, tolerance_m: float) -> None:
    for section in ("lanes", "crosswalks", "drivable_areas"):
        ones, twos = getattr(found, section), getattr(expected, section)
        assert len(ones) == len(twos)
        for one, two in zip(ones, twos, strict=True):
            for name, value in vars(two).items():
                if not isinstance(value, np.ndarray):
                    assert vars(one)[name] == value, name
    for one, two in zip(found.polylines, expected.polylines, strict=True):
        np.testing.assert_allclose(one, two, rtol=0, atol=tolerance_m)
    assert found.source_fields == expected.source_fields


def lane(archive: dict[str, Any]) -> dict[str, Any]:
    return archive["lane_segments"]["1"]


def test_a_map_reads_back_equal() -> None:
    assert_same_map(read(MAP), SCENARIO.road_map, 1e-9)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        # Six points of such a square stay under the limit of a crosswalk's length.
        st.tuples(*[st.floats(-300, 300)] * 2, st.floats(-100, 3000)),
        min_size=2,
        max_size=6,
    )
)
def test_any_coordinates_read_back_within_a_tenth_of_a_millimetre(
    points: list[tuple[float, float, float]],
) -> None:
    edge = np.array(points)
    crosswalk = Crosswalk(crosswalk_id=5, edge1=edge, edge2=edge[::-1].copy())
    road_map = RoadMap(lanes=SCENARIO.road_map.lanes, crosswalks=(crosswalk,))
    found = read(map_bytes(road_map, ORIGIN))
    assert_same_map(found, road_map, 0.51e-4)


def test_unknown_fields_are_kept() -> None:
    def change(archive: dict[str, Any]) -> None:
        archive["version"] = {"major": 2}
        lane(archive)["speed_limit"] = [13.4, None]
        archive["drivable_areas"]["1"]["paved"] = True
        crossing = {"id": 9, "colour": "zebra"}
        line = [{"x": 1.0, "y": 2.0, "z": 3.0}] * 2
        archive["pedestrian_crossings"]["9"] = {
            **crossing,
            "edge1": line,
            "edge2": line,
        }

    data = changed_map(change)
    found = read(data)
    assert found.source_fields == {"version": {"major": 2}}
    assert found.lane_of[1].source_fields == {"speed_limit": [13.4, None]}
    assert found.crosswalks[0].source_fields == {"colour": "zebra"}
    assert json.loads(map_bytes(found, ORIGIN)) == json.loads(data)


def test_links_out_of_the_map_are_kept() -> None:
    def change(archive: dict[str, Any]) -> None:
        lane(archive).update(
            successors=[2, 777], predecessors=[888], left_neighbor_id=999
        )

    found = read(changed_map(change)).lane_of[1]
    assert (found.successors, found.predecessors) == ((2, 777), (888,))
    assert (found.left_neighbor, found.right_neighbor) == (999, None)


def test_every_kind_and_mark_is_known() -> None:
    for kind in LaneKind:
        data = changed_map(lambda m, kind=kind: lane(m).update(lane_type=kind))
        assert read(data).lane_of[1].kind is kind
    for mark in LaneMark:
        data = changed_map(
            lambda m, mark=mark: lane(m).update(left_lane_mark_type=mark)
        )
        assert read(data).lane_of[1].left_mark is mark


def test_a_map_of_lanes_alone_is_enough() -> None:
    def change(archive: dict[str, Any]) -> None:
        del archive["drivable_areas"], archive["pedestrian_crossings"]

    found = read(changed_map(change))
    assert len(found.lanes) == 4
    assert found.crosswalks == found.drivable_areas == ()
    assert json.loads(map_bytes(found, ORIGIN))["drivable_areas"] == {}


def test_a_lane_that_crosses_itself_is_accepted() -> None:
    def change(archive: dict[str, Any]) -> None:
        knot = [(0, 0), (10, 10), (10, 0), (0, 10)]
        lane(archive)["left_lane_boundary"] = [
            {"x": x, "y": y, "z": 0} for x, y in knot
        ]

    assert len(read(changed_map(change)).lane_of[1].left) == 4


def test_lanes_without_a_centre_line_get_one() -> None:
    def change(archive: dict[str, Any]) -> None:
        for entry in archive["lane_segments"].values():
            del entry["centerline"]

    for found, expected in zip(
        read(changed_map(change)).lanes, SCENARIO.road_map.lanes, strict=True
    ):
        assert len(found.centerline) >= 10
        np.testing.assert_allclose(found.centerline[0], expected.centerline[0])
        np.testing.assert_allclose(found.centerline[-1], expected.centerline[-1])
        np.testing.assert_allclose(found.centerline[:, 1], expected.centerline[0, 1])


def test_midline_of_concentric_arcs_is_the_arc_between() -> None:
    def arc(radius: float, num_points: int, height: float) -> np.ndarray:
        angle = np.linspace(0, np.pi / 2, num_points)
        flat = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.column_stack([flat, np.full(num_points, height)])

    line = midline(arc(10, 400, 1.0), arc(14, 600, 3.0))
    np.testing.assert_allclose(np.hypot(line[:, 0], line[:, 1]), 12, atol=1e-3)
    np.testing.assert_allclose(line[:, 2], 2)


def spoiled(**fields: Any) -> Callable[[dict[str, Any]], None]:
    return lambda archive: lane(archive).update(fields)


POINT = {"x": 0.0, "y": 0.0, "z": 0.0}
BAD_MAPS = {
    "nothing": (b"", "not readable JSON"),
    "cut off": (MAP[: len(MAP) // 2], "not readable JSON"),
    "binary": (b"\xff\xfe\x00\xd8", "not readable JSON"),
    "nested deeply": (b"[" * 100_000, "not readable JSON"),
    "list": (b"[1, 2]", "expected an Argoverse 2 map"),
    "no map": (b'{"a": 1}', "no 'lane_segments'; expected an Argoverse 2 map"),
    "no lanes": (changed_map(lambda m: m["lane_segments"].clear()), "'lane_segments'"),
    "section": (
        changed_map(lambda m: m.update(lane_segments=[1])),
        "'lane_segments' is not a JSON object",
    ),
    "entry": (
        changed_map(lambda m: m["lane_segments"].update({"1": 5})),
        "lane_segments, 1: expected a JSON object",
    ),
    "same id": (changed_map(spoiled(id=2)), "lane_segments has id 2 twice"),
    "id": (changed_map(spoiled(id="1")), "'id' is '1', not a whole number"),
    "huge id": (changed_map(spoiled(id=2**70)), "'id' is .* not a whole number"),
    "one point": (
        changed_map(spoiled(left_lane_boundary=[POINT])),
        r"lane_segments, 1: field 'left_lane_boundary' has 1 point\(s\)",
    ),
    "NaN": (
        changed_map(spoiled(right_lane_boundary=[POINT, {**POINT, "z": float("nan")}])),
        "'right_lane_boundary' holds a coordinate that is not finite",
    ),
    "far": (
        changed_map(spoiled(centerline=[POINT, {**POINT, "x": 1e12}])),
        "not finite, or beyond 1e\\+08 m",
    ),
    "text": (
        changed_map(spoiled(centerline=[POINT, {**POINT, "x": "1"}])),
        "coordinates that are not numbers",
    ),
    "lists": (
        changed_map(spoiled(centerline=[{"x": [1], "y": [2], "z": [3]}] * 3)),
        "coordinates that are not numbers",
    ),
    "no z": (
        changed_map(spoiled(centerline=[{"x": 0.0, "y": 1.0}] * 3)),
        "'centerline' is not a list of points with x, y and z",
    ),
    "no list": (changed_map(spoiled(centerline=7)), "'centerline' is not a list"),
    "lane type": (
        changed_map(spoiled(lane_type="TRAM")),
        "'lane_type' is 'TRAM'; expected one of VEHICLE, BIKE, BUS",
    ),
    "mark": (
        changed_map(spoiled(left_lane_mark_type=["NONE"])),
        r"'left_lane_mark_type' is \['NONE'\]; expected one of DASH_SOLID_YELLOW",
    ),
    "flag": (changed_map(spoiled(is_intersection=1)), "'is_intersection' is 1, not"),
    "links": (changed_map(spoiled(successors=[1.5])), "'successors' is not a list of"),
    "neighbour": (changed_map(spoiled(left_neighbor_id="a")), "'left_neighbor_id' is"),
    "area": (
        changed_map(
            lambda m: m["drivable_areas"]["1"].update(area_boundary=[POINT, POINT])
        ),
        r"drivable_areas, 1: field 'area_boundary' has 2 point\(s\); .* at least 3",
    ),
}


@pytest.mark.parametrize(("data", "message"), BAD_MAPS.values(), ids=BAD_MAPS)
def test_bad_maps_are_refused_in_one_sentence(data: bytes, message: str) -> None:
    with pytest.raises(MapFileError, match=message) as refusal:
        read(data)
    text = str(refusal.value)
    assert text.startswith(FILE)
    assert text.endswith(".")
    assert "\n" not in text


@pytest.mark.parametrize(
    "name",
    [
        "id",
        "is_intersection",
        "lane_type",
        "left_lane_boundary",
        "right_lane_boundary",
        "left_lane_mark_type",
        "right_lane_mark_type",
        "predecessors",
        "successors",
    ],
)
def test_each_lane_field_must_be_there(name: str) -> None:
    with pytest.raises(MapFileError, match=f"field '{name}' is missing"):
        read(changed_map(lambda archive: lane(archive).pop(name)))


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["x", "y", "z", "id"]), inner)
    ),
    max_leaves=6,
)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(sorted(lane(json.loads(MAP)))), JSON_VALUES)
def test_any_value_in_a_lane_is_read_or_refused(name: str, value: Any) -> None:
    data = changed_map(spoiled(**{name: value}))
    try:
        found = read(data)
    except MapFileError:
        return
    assert_same_map(read(map_bytes(found, ORIGIN)), found, 1e-3)


def boxed(number: int, x: float, y: float, size: float) -> dict[str, Any]:
    ring = [(x, y), (x + size, y), (x + size, y + size), (x, y + size)]
    corners = [{"x": a, "y": b, "z": 0.0} for a, b in ring]
    return {"id": number, "area_boundary": corners}


def straight(number: int, length: float) -> dict[str, Any]:
    lines = {
        name: [{"x": 0.0, "y": y, "z": 0.0}, {"x": length, "y": y, "z": 0.0}]
        for name, y in (
            ("centerline", 0.0),
            ("left_lane_boundary", 2.0),
            ("right_lane_boundary", -2.0),
        )
    }
    return {**lane(json.loads(MAP)), **lines, "id": number}


def tangle(count: int, size: float) -> dict[str, Any]:
    random = np.random.default_rng(0)
    corners = [
        {"x": x, "y": y, "z": 0.0} for x, y in random.uniform(0, size, (count, 2))
    ]
    return {"id": 1, "area_boundary": corners}


TOO_LARGE = {
    "2,001 lanes": (
        lambda a: a.update(
            lane_segments={str(n): straight(n, 10.0) for n in range(2001)}
        ),
        "section 'lane_segments' has 2001 entries; at most 2000",
    ),
    "100 lanes of 10 km": (
        lambda a: a.update(
            lane_segments={str(n): straight(n, 9_900.0) for n in range(100)}
        ),
        "lines are 2971 km long together; at most 200 km",
    ),
    "a lane of 100 km": (
        lambda a: a.update(lane_segments={"1": straight(1, 1e5)}),
        "spans 100.0 km; at most 10 km",
    ),
    "an area of 5 km": (
        lambda a: a.update(drivable_areas={"1": boxed(1, 0, 0, 5000)}),
        "areas span 25 km2; at most 16 km2",
    ),
    "2,000 areas": (
        lambda a: a.update(
            drivable_areas={str(n): boxed(n, n, 0, 1) for n in range(2000)}
        ),
        "section 'drivable_areas' has 2000 entries; at most 200",
    ),
    "a tangle": (
        lambda a: a.update(drivable_areas={"1": tangle(2000, 100.0)}),
        "cross one another too often",
    ),
    "a wide tangle of a minute": (
        lambda a: a.update(drivable_areas={"1": tangle(200, 1700.0)}),
        "cross one another too often",
    ),
    "links": (
        lambda a: lane(a).update(successors=list(range(20_001))),
        "20004 links between lanes; at most 20000",
    ),
}


@pytest.mark.parametrize("name", TOO_LARGE)
def test_maps_that_are_too_large_are_refused_with_the_limit(name: str) -> None:
    """What would hang or fill the memory on opening is told at once (fault 1)."""
    change, words = TOO_LARGE[name]
    with pytest.raises(MapFileError, match=words):
        read(changed_map(change))
