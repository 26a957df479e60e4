"""Lanelet2 maps, made by hand and real."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import FormatError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.road_map import Lane, LaneKind, LaneMark

WAYS = {10: (1, 2), 11: (4, 3), 12: (5, 6), 13: (2, 7), 14: (3, 8)}
"""Way 11 runs against the others."""
PLACES = {1: (0, 6), 2: (20, 6), 3: (0, 3), 4: (20, 3), 5: (0, 0), 6: (20, 0)}
PLACES |= {7: (40, 9), 8: (40, 5)}
ROAD = {"type": "lanelet", "subtype": "road"}


def tags(**found: str) -> str:
    return "".join(
        f'<tag k="{key.replace("__", ":")}" v="{value}"/>'
        for key, value in found.items()
    )


def lanelet(number: int, left: int, right: int, **more: str) -> str:
    return (
        f'<relation id="{number}"><member type="way" ref="{left}" role="left"/>'
        f'<member type="way" ref="{right}" role="right"/>{tags(**(ROAD | more))}</relation>'
    )


def text(
    relations: Iterable[str],
    ways: dict[int, tuple[int, ...]] = WAYS,
    places: dict[int, tuple[float, float]] = PLACES,
    way_tags: str = "",
) -> str:
    """A file whose elements each have a line."""
    nodes = (
        f'<node id="{n}" lat="" lon="">{tags(local_x=f"{x}", local_y=f"{y}")}</node>'
        for n, (x, y) in places.items()
    )
    lines = (
        f'<way id="{n}">{"".join(f"""<nd ref="{one}"/>""" for one in nodes)}{way_tags}</way>'
        for n, nodes in ways.items()
    )
    return "\n".join(["<osm>", *nodes, *lines, *relations, "</osm>"])


def opened(folder: Path, content: str) -> tuple[dict[int, Lane], Path]:
    path = folder / "map.osm"
    path.write_text(content)
    scene = open_scenario(path)
    return scene.road_map.lane_of, path


STREET = (
    lanelet(1, 10, 11),
    lanelet(2, 11, 12),
    # The way 14 begins at the node 3, and is no continuation of the way 11 but of its end.
    lanelet(3, 13, 15),
)
ALL_WAYS = WAYS | {15: (4, 8)}


def test_neighbours_share_a_way_and_links_share_both_end_nodes(tmp_path: Path):
    lanes, _ = opened(tmp_path, text(STREET, ALL_WAYS))
    assert (lanes[1].right_neighbor, lanes[2].left_neighbor) == (2, 1)
    assert (lanes[1].left_neighbor, lanes[2].right_neighbor) == (None, None)
    assert lanes[1].successors == (3,)
    assert lanes[3].predecessors == (1,)
    assert lanes[2].successors == ()
    for lane in lanes.values():
        assert (np.diff(lane.centerline_m[:, 0]) > 0).all()
        assert (lane.left_m[:, 1] > lane.right_m[:, 1].max() - 1e-9).all()


def test_lanelets_that_share_a_way_of_one_place_are_left_out(tmp_path: Path):
    """The second one made an error without a sentence."""
    lanes, path = opened(tmp_path, text(STREET, ALL_WAYS, PLACES | {4: (0, 3)}))
    assert {*lanes} == {3}
    notes = " ".join(open_scenario(path).provenance.notes)
    assert "are left out (2)" in notes


def test_traffic_lights_are_at_the_stop_lines_of_their_lanelets(tmp_path: Path):
    """They were left out."""
    obeys = '<member type="relation" ref="50" role="regulatory_element"/>'
    light = f"""<relation id="50"><member type="way" ref="16" role="ref_line"/><member
    type="way" ref="99" role="refers"/>{tags(type="regulatory_element", subtype="traffic_light")}
    </relation>"""
    street = [one.replace("</relation>", f"{obeys}</relation>") for one in STREET[:2]]
    places = PLACES | {20: (15, 0), 21: (15, 6)}
    content = text([*street, STREET[2], light], ALL_WAYS | {16: (20, 21)}, places)
    _, path = opened(tmp_path, content)
    scene = open_scenario(path)
    (signal,) = scene.signals
    assert sorted(signal.lane_ids) == [1, 2]
    np.testing.assert_allclose(signal.stop_share, 0.75)
    assert not signal.states.any()
    assert "1 traffic lights have unknown states." in scene.provenance.notes


@pytest.mark.parametrize("flips", [(), (10,), (11,), (12,), (10, 11, 12)])
def test_the_direction_follows_from_the_sides_and_not_from_the_ways(
    tmp_path: Path, flips: tuple[int, ...]
):
    ways = {n: one[::-1] if n in flips else one for n, one in ALL_WAYS.items()}
    lanes, _ = opened(tmp_path, text(STREET, ways))
    assert lanes[1].right_neighbor == 2
    assert lanes[1].successors == (3,)
    assert lanes[1].left_m[-1, 0] > lanes[1].left_m[0, 0]


def test_who_may_use_a_lanelet_makes_its_kind(tmp_path: Path):
    lanes, _ = opened(
        tmp_path,
        text(
            (
                lanelet(1, 10, 11),
                lanelet(2, 11, 12, subtype="bicycle_lane"),
                lanelet(3, 13, 15, participant__bus="yes"),
                lanelet(4, 13, 15, subtype="walkway"),
                lanelet(5, 13, 15, participant__vehicle="no", participant__pedestrian="yes"),
                lanelet(6, 13, 15, subtype="crosswalk"),
            ),
            ALL_WAYS,
        ),
    )  # fmt: skip
    kinds = {number: lane.kind for number, lane in lanes.items()}
    assert kinds == {1: LaneKind.VEHICLE, 2: LaneKind.BIKE, 3: LaneKind.BUS}
    scene = open_scenario(tmp_path / "map.osm")
    assert len(scene.road_map.crosswalks) == 1


def test_a_lanelet_for_both_directions_is_two_lanes(tmp_path: Path):
    both = tuple(
        lanelet(n, left, right, one_way="no")
        for n, left, right in ((1, 10, 11), (3, 13, 15))
    )
    lanes, _ = opened(tmp_path, text(both, ALL_WAYS))
    assert len(lanes) == 4
    assert lanes[1].successors == (3,)
    assert lanes[5].successors == (4,)
    np.testing.assert_allclose(lanes[1].left_m, lanes[4].right_m[::-1])


@pytest.mark.parametrize(
    ("found", "marks"),
    [
        (tags(type="line_thin", subtype="dashed"), {LaneMark.DASHED_WHITE}),
        (
            tags(type="line_thick", subtype="solid_solid", color="yellow"),
            {LaneMark.DOUBLE_SOLID_YELLOW},
        ),
        (
            tags(type="line_thin", subtype="solid_dashed"),
            {LaneMark.SOLID_DASH_WHITE, LaneMark.DASH_SOLID_WHITE},
        ),
        (tags(type="curbstone", subtype="high"), {LaneMark.NONE}),
        ("", {LaneMark.UNKNOWN}),
    ],
)
def test_markings(tmp_path: Path, found: str, marks: set[LaneMark]):
    lanes, _ = opened(tmp_path, text(STREET, ALL_WAYS, way_tags=found))
    assert {lanes[1].left_mark, lanes[1].right_mark} == marks


def test_ids_that_scenes_cannot_have_are_new(tmp_path: Path):
    lanes, _ = opened(tmp_path, text((lanelet(-5, 10, 11), lanelet(7, 11, 12))))
    assert sorted(lanes) == [7, 8]


def test_a_map_is_known_by_its_root_where_its_name_says_nothing(tmp_path: Path):
    path = tmp_path / "map.xml"
    path.write_text(text(STREET, ALL_WAYS))
    assert len(open_scenario(path).road_map.lanes) == 3


def test_degrees_become_metres(tmp_path: Path):
    """A square of 0.001 degrees at 49 degrees north is 73.1 m wide and 111.2 m high."""
    places = {1: (49, 8.4), 2: (49.001, 8.4), 3: (49, 8.401), 4: (49.001, 8.401)}
    nodes = "".join(
        f'<node id="{n}" lat="{lat}" lon="{lon}"/>' for n, (lat, lon) in places.items()
    )
    content = text((lanelet(1, 10, 11),), {10: (1, 2), 11: (3, 4)}, {})
    lanes, _ = opened(tmp_path, content.replace("<osm>", f"<osm>{nodes}"))
    left, right = lanes[1].left_m, lanes[1].right_m
    # UTM is shorter by 0.04 % in the middle of a zone.
    assert np.linalg.norm(left[1] - left[0]) == pytest.approx(111.2, rel=1e-3)
    assert np.linalg.norm(left[0] - right[0]) == pytest.approx(73.1, rel=1e-3)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (text(()), "has no lanelets; expected relations"),
        (text((lanelet(1, 10, 99),)), r"line 15: <relation> 1 names the way 99"),
        (
            text(STREET[:2], ALL_WAYS | {11: (4, 77)}),
            r"line 11: <way> 11 names the node 77",
        ),
        (text(STREET[:2], ALL_WAYS | {11: (4, 4)}), "fewer than two different"),
        (
            text(STREET, ALL_WAYS, {n: (x / 1e6, y / 1e6) for n, (x, y) in PLACES.items()}),
            "spans less than a metre",
        ),
        (
            text(STREET, ALL_WAYS).replace('lat="" lon=""', 'lat="5334000" lon="691000"').replace("local", "other"),
            "line 2: <node> 1 lies at 5.334e",
        ),
        (
            text(STREET, ALL_WAYS).replace("local_x", "x"),
            "<node> 1 has no place; expected lat and lon",
        ),
        (
            text(STREET, ALL_WAYS).replace('role="left"', 'role="outer"'),
            "needs one way as left bound",
        ),
        (text((lanelet(1, 10, 11, subtype="walkway"),)), "has no lane for vehicles"),
    ],
)  # fmt: skip
def test_what_cannot_be_opened_is_one_sentence(tmp_path: Path, content: str, told: str):
    with pytest.raises(FormatError, match=told) as found:
        opened(tmp_path, content)
    assert "\n" not in str(found.value)


def test_a_lanelet_that_ends_where_it_begins_follows_itself(tmp_path: Path):
    ring = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    places = {
        100 * (1 + k) + n: (r * np.cos(a), r * np.sin(a))
        for k, r in enumerate((10.0, 14.0))
        for n, a in enumerate(ring)
    }
    ways = {k: (*(100 * k + n for n in range(24)), 100 * k) for k in (1, 2)}
    lanes, _ = opened(tmp_path, text((lanelet(1, 1, 2),), ways, places))
    assert lanes[1].successors == (1,)
    assert np.linalg.norm(lanes[1].centerline_m - np.mean(
        [lanes[1].left_m.mean(axis=0), lanes[1].right_m.mean(axis=0)], axis=0
    ), axis=1) == pytest.approx(12, abs=0.8)  # fmt: skip


def test_real_files(format_files: Path):
    for path in (format_files / "lanelet2").glob("*.osm"):
        scene = open_scenario(path)
        known = scene.road_map.lane_of
        links = [(a, known[b]) for a in known.values() for b in a.successors]
        assert links
        for a, b in links:
            np.testing.assert_allclose(a.centerline_m[-1], b.centerline_m[0], atol=1e-9)


@pytest.mark.parametrize(
    ("places", "is_used"),
    [
        ([(0, 4), (10, 5), (20, 4)], True),
        ([(20, 4), (10, 5), (0, 4)], True),
        ([(0, 4), (10, 8), (20, 4)], False),
        ([(9, 4), (10, 5)], False),
    ],
)
def test_the_own_centre_line_of_a_lanelet_is_used_within_its_bounds(
    tmp_path: Path, places: list[tuple[float, float]], is_used: bool
):
    """It was passed over."""
    numbers = range(50, 50 + len(places))
    relation = lanelet(1, 10, 11).replace(
        "<tag", '<member type="way" ref="40" role="centerline"/><tag', 1
    )
    content = text(
        [relation],
        WAYS | {40: tuple(numbers)},
        PLACES | dict(zip(numbers, places, strict=True)),
    )
    path = tmp_path / "map.osm"
    path.write_text(content)
    scene = open_scenario(path)
    (lane,) = scene.road_map.lanes
    line = lane.centerline_m + scene.origin_city_m
    assert line[0].tolist() == [0.0, 4.0 if is_used else 4.5]
    assert (line[:, 1].max() == 5.0) == is_used
    told = any("Centre lines of 1 lanelets" in one for one in scene.provenance.notes)
    assert told != is_used


@pytest.mark.parametrize(
    ("relation", "told"),
    [
        (lanelet(9, 10, 99), "names the way 99, which the file lacks"),
        (lanelet(9, 10, 20), "names the node 77, which the file lacks"),
        (lanelet(9, 10, 21), "has fewer than two different nodes"),
        (lanelet(9, 10, 10), "needs one way as left bound"),
        (
            lanelet(9, 10, 11).replace('role="right"', 'role=""'),
            "needs one way as left",
        ),
    ],
)
def test_damaged_lanelets_are_left_out_and_told(
    tmp_path: Path, relation: str, told: str
):
    """One of them, as at the edge of a cut map, kept the whole map from opening."""
    ways = ALL_WAYS | {20: (5, 77), 21: (5, 5)}
    lanes, path = opened(tmp_path, text((*STREET, relation), ways))
    assert sorted(lanes) == [1, 2, 3]
    assert lanes[1].successors == (3,)
    (note,) = open_scenario(path).provenance.notes[1:]
    assert note.startswith("Damaged lanelets and areas are left out (1): line ")
    assert told in note


def test_lanelets_that_share_no_nodes_follow_each_other_where_they_meet(tmp_path: Path):
    """Each had nodes of its own, so that no lane led anywhere."""
    places = PLACES | {102: PLACES[2], 104: PLACES[4]}
    ways = ALL_WAYS | {13: (102, 7), 15: (104, 8)}
    lanes, path = opened(tmp_path, text(STREET, ways, places))
    assert lanes[1].successors == (3,)
    assert lanes[3].predecessors == (1,)
    assert lanes[2].successors == ()
    assert any("1 links" in one for one in open_scenario(path).provenance.notes)


def test_links_are_made_where_only_some_lanelets_share_nodes(tmp_path: Path):
    """Maps of CommonRoad's converter had every second link."""
    places = PLACES | {102: PLACES[2], 104: PLACES[4], 20: (60, 9), 21: (60, 5)}
    ways = ALL_WAYS | {13: (102, 7), 15: (104, 8), 16: (7, 20), 17: (8, 21)}
    lanes, _ = opened(tmp_path, text((*STREET, lanelet(4, 16, 17)), ways, places))
    found = [lanes[n].successors for n in (1, 2, 3, 4)]
    assert found == [(3,), (), (4,), ()]
