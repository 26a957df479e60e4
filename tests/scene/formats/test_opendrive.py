"""OpenDRIVE road networks as scenes."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.base.errors import FormatError
from pd_editor.scene.formats.opendrive import OPENDRIVE, read
from pd_editor.scene.formats.reference_line import ReferenceLine
from pd_editor.scene.formats.registry import format_of
from pd_editor.scene.formats.xml_file import parse_xml
from pd_editor.scene.geometry.polyline import turns_back
from pd_editor.scene.road_map import Lane, LaneKind, LaneMark
from pd_editor.scene.scenario import Scenario

LINE = '<geometry s="0" x="0" y="0" hdg="0" length="50"><line/></geometry>'
WIDTH = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'


def lane(number: int, kind: str = "driving", more: str = "", width: str = WIDTH) -> str:
    return f'<lane id="{number}" type="{kind}" level="false">{more}{width}</lane>'


def section(*lanes: str, s: float = 0.0) -> str:
    left = "".join(one for one in lanes if 'id="-' not in one)
    right = "".join(one for one in lanes if 'id="-' in one)
    center = '<center><lane id="0" type="none"><roadMark type="solid solid" color="yellow"/></lane></center>'
    return (
        f'<laneSection s="{s}"><left>{left}</left>{center}<right>{right}</right>'
        "</laneSection>"
    )


def road(
    sections: str,
    name: str = "1",
    *,
    geometry: str = LINE,
    length: float = 50,
    link: str = "",
    more: str = "",
    offset: str = "",
    attributes: str = 'junction="-1"',
) -> str:
    return (
        f'<road id="{name}" length="{length}" {attributes}><link>{link}</link>'
        f"<planView>{geometry}</planView>{more}<lanes>{offset}{sections}</lanes></road>"
    )


def write(
    folder: Path, *parts: str, version: str = 'revMajor="1" revMinor="6"'
) -> Path:
    path = folder / "road.xodr"
    path.write_text(f"<OpenDRIVE><header {version}/>{''.join(parts)}</OpenDRIVE>")
    return path


def opened(folder: Path, *parts: str) -> Scenario:
    return read(write(folder, *parts))


def at(scene: Scenario, line: np.ndarray) -> np.ndarray:
    """Points in the frame of the file."""
    return line[:, :2] + scene.origin_city_m


def lane_at(scene: Scenario, x: float, y: float) -> Lane:
    """The lane whose centre line is nearest to a place."""

    def gap(one: Lane) -> float:
        line = at(scene, one.centerline)
        count = 200
        places = np.linspace(0, 1, count)[:, None]
        parts = [a + places * (b - a) for a, b in pairwise(line)]
        return float(np.linalg.norm(np.concatenate(parts) - [x, y], axis=1).min())

    return min(scene.road_map.lanes, key=gap)


def corners(*places: tuple[float, float]) -> str:
    each = "".join(f'<cornerLocal u="{u}" v="{v}" z="0"/>' for u, v in places)
    return f"<outline>{each}</outline>"


def test_each_outline_is_a_crosswalk_and_parking_spaces_are_paved(tmp_path: Path):
    """Two in one object were one that crossed itself; named ones of RoadRunner were lost."""
    first = corners((-2, -4), (2, -4), (2, 4), (-2, 4))
    second = corners((8, -4), (12, -4), (12, 4), (8, 4))
    place = 's="20" t="0" hdg="0"'
    objects = (
        f'<object type="crosswalk" {place}><outlines>{first}{second}</outlines></object>'
        f'<object type="-1" name="LadderCrosswalk" {place}>{first}</object>'
        '<object type="-1" name="SimpleCrosswalk" s="40" t="0" length="8" width="4"/>'
        '<object type="crosswalk" s="30" t="0"><outlines/></object>'
        '<object type="parkingSpace" s="40" t="-6" length="5" width="2.5"/>'
    )
    street = road(section(lane(1), lane(-1)))
    scene = opened(
        tmp_path, street.replace("</road>", f"<objects>{objects}</objects></road>")
    )
    walks = scene.road_map.crosswalks
    middles = [at(scene, one.outline_m()).mean(axis=0) for one in walks]
    np.testing.assert_allclose(middles, [[20, 0], [30, 0], [40, 0]], atol=1e-9)
    paved = sum(
        shapely.Polygon(one.boundary[:, :2]).area
        for one in scene.road_map.drivable_areas
    )
    assert paved == pytest.approx(2 * 3.5 * 50 + 5 * 2.5)


def test_a_section_for_one_side_may_be_the_only_one(tmp_path: Path):
    """Its road made an error without a sentence."""
    one = section(lane(-1)).replace("<laneSection", '<laneSection singleSide="true"')
    scene = opened(tmp_path, road(one))
    assert len(scene.road_map.lanes) == 1


def test_roads_whose_line_begins_late_are_told_or_refused(tmp_path: Path):
    """They were read without a word, or made an error without a sentence."""
    late = LINE.replace('s="0"', 's="{}"')
    scene = opened(tmp_path, road(section(lane(-1)), geometry=late.format(10)))
    assert "Reference lines with gaps: 1." in scene.provenance.notes
    parts = section(lane(-1)) + section(lane(-1), s=30)
    with pytest.raises(FormatError, match="<laneSection> has no geometry along it"):
        opened(tmp_path, road(parts, geometry=late.format(60)))


def test_lanes_lead_where_roadrunner_says(tmp_path: Path):
    """Its files of version 1.4 have no rule, and left-hand traffic led the wrong way."""
    user = '<userData code="vectorLane"><vectorLane sOffset="0" travelDir="{}"/></userData>'
    words = {2: "bidirectional", 1: "forward", -1: "backward", -2: "undirected"}
    lanes = [lane(n, more=user.format(word)) for n, word in words.items()]
    scene = opened(tmp_path, road(section(*lanes)))
    ways = [
        at(scene, n.centerline)[[0, -1]].round(6).tolist() for n in scene.road_map.lanes
    ]
    there, back = (0.0, 50.0), (50.0, 0.0)
    assert sorted((one[0][1], one[0][0], one[1][0]) for one in ways) == [
        (-5.25, *there), (-1.75, *back), (1.75, *there), (5.25, *there), (5.25, *back),
    ]  # fmt: skip


@pytest.mark.parametrize("most", [1.0, 50.0])
def test_curves_without_a_range_are_as_long_as_told(tmp_path: Path, most: float):
    """They were taken as normalized; those of lengths became points."""
    cubic = f'<paramPoly3 aU="0" bU="{50 / most}" cU="0" dU="0" aV="0" bV="0" cV="0" dV="0"/>'
    scene = opened(tmp_path, road(section(lane(-1)), geometry=LINE.replace("<line/>", cubic)))  # fmt: skip
    np.testing.assert_allclose(
        at(scene, scene.road_map.lanes[0].centerline)[-1], [50, -1.75], atol=1e-6
    )


def test_names_in_another_encoding_than_told_and_pointers_to_files(tmp_path: Path):
    """Names in Latin-1 were refused."""
    path = write(tmp_path, road(section(lane(-1)), name="Straße"))
    path.write_bytes(path.read_text().encode("latin-1"))
    assert len(read(path).road_map.lanes) == 1
    path.write_text(
        "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"
    )
    with pytest.raises(FormatError, match="only points to the file"):
        read(path)


def test_a_border_has_the_marking_of_most_of_it(tmp_path: Path):
    """It had that of its first metres."""
    marks = "".join(
        f'<roadMark sOffset="{s}" type="{kind}" color="standard"/>'
        for s, kind in ((5, "broken"), (0, "solid"), (45, "none"))
    )
    scene = opened(tmp_path, road(section(lane(-1, more=marks))))
    assert scene.road_map.lanes[0].right_mark == LaneMark.DASHED_WHITE


@pytest.mark.parametrize("about", ['type="1.000.001" dynamic="yes"', 'type="1000001"'])
def test_lights_are_known_by_their_type(tmp_path: Path, about: str):
    """Those of older files, and those that leave out whether they change, were signs."""
    light = f'<signals><signal id="5" s="45" t="-5" orientation="+" {about}/></signals>'
    street = road(section(lane(1), lane(-1)))
    scene = opened(tmp_path, street.replace("</road>", f"{light}</road>"))
    assert [one.signal_id for one in scene.signals] == ["5"]


def test_lanes_lie_side_by_side_where_numbers_are_left_out(tmp_path: Path):
    """Such files were refused, as were sections before 0 by a rounding, and bare links."""
    bare = "<link><predecessor/></link>"
    lanes = lane(2), lane(-2, more=bare), lane(-4)
    scene = opened(tmp_path, road(section(*lanes, s=-1e-9)))
    one, two = (lane_at(scene, 25, y) for y in (-1.75, -5.25))
    assert (one.right_neighbor, two.left_neighbor) == (two.lane_id, one.lane_id)
    np.testing.assert_allclose(at(scene, two.right)[:, 1], -7.0)


def test_parameters_by_length_are_so_in_any_case(tmp_path: Path):
    """A road with ``arclength`` was a point."""
    cubic = '<paramPoly3 pRange="arclength" aU="0" bU="1" cU="0" dU="0" aV="0" bV="0" cV="0" dV="0"/>'
    scene = opened(
        tmp_path, road(section(lane(-1)), geometry=LINE.replace("<line/>", cubic))
    )
    line = at(scene, scene.road_map.lanes[0].centerline)
    np.testing.assert_allclose(line, [[0, -1.75], [50, -1.75]])


def test_lanes_lie_beside_the_reference_line_and_lead_the_right_way(tmp_path: Path):
    scene = opened(tmp_path, road(section(lane(1), lane(-1), lane(-2, "biking"))))
    assert len(scene.road_map.lanes) == 3
    assert len(scene.agents) == 0
    one = lane_at(scene, 25, -1.75)
    np.testing.assert_allclose(at(scene, one.centerline), [[0, -1.75], [50, -1.75]])
    np.testing.assert_allclose(at(scene, one.left), [[0, 0], [50, 0]])
    np.testing.assert_allclose(at(scene, one.right), [[0, -3.5], [50, -3.5]])
    assert one.left_mark == LaneMark.DOUBLE_SOLID_YELLOW
    bike = lane_at(scene, 25, -5.25)
    assert (bike.kind, one.kind) == (LaneKind.BIKE, LaneKind.VEHICLE)
    assert (one.right_neighbor, bike.left_neighbor) == (bike.lane_id, one.lane_id)
    back = lane_at(scene, 25, 1.75)
    np.testing.assert_allclose(at(scene, back.centerline), [[50, 1.75], [0, 1.75]])
    np.testing.assert_allclose(at(scene, back.left), [[50, 0], [0, 0]])
    assert back.left_neighbor is None, "it leads the other way"


def test_traffic_drives_on_the_left_where_the_file_says_so(tmp_path: Path):
    scene = opened(
        tmp_path,
        road(section(lane(1), lane(-1)), attributes='junction="-1" rule="LHT"'),
    )
    one = lane_at(scene, 25, -1.75)
    np.testing.assert_allclose(at(scene, one.centerline), [[50, -1.75], [0, -1.75]])
    np.testing.assert_allclose(at(scene, one.left), [[50, -3.5], [0, -3.5]])
    np.testing.assert_allclose(at(scene, one.right), [[50, 0], [0, 0]])


def reference_line(folder: Path, geometry: str, length: float) -> ReferenceLine:
    path = write(folder, road(section(lane(-1)), geometry=geometry, length=length))
    root, _ = parse_xml(path, "OpenDRIVE")
    plan = root.child("road").child("planView")
    return ReferenceLine.of(plan, None, length)


@given(
    first=st.floats(-0.1, 0.1),
    last=st.floats(-0.1, 0.1),
    length=st.floats(1.0, 200.0),
    heading=st.floats(-3.0, 3.0),
)
def test_spirals_turn_evenly_faster(
    tmp_path_factory: pytest.TempPathFactory,
    first: float,
    last: float,
    length: float,
    heading: float,
):
    """Against an integral in small steps; arcs and lines are spirals, too."""
    geometry = (
        f'<geometry s="0" x="3" y="-7" hdg="{heading}" length="{length}">'
        f'<spiral curvStart="{first}" curvEnd="{last}"/></geometry>'
    )
    line = reference_line(tmp_path_factory.mktemp("road"), geometry, length)
    s = np.linspace(0, length, 4001)
    turn = heading + first * s + (last - first) * s**2 / (2 * length)
    middle = (turn[1:] + turn[:-1]) / 2
    step = length / 4000
    x = 3 + np.append(0, np.cumsum(np.cos(middle)) * step)
    y = -7 + np.append(0, np.cumsum(np.sin(middle)) * step)
    found = line.at(s[::500])
    np.testing.assert_allclose(
        found[:, :3], np.stack([x, y, turn], -1)[::500], atol=1e-3
    )


def test_parametric_cubics_follow_their_polynomials(tmp_path: Path):
    geometry = (
        '<geometry s="0" x="1" y="2" hdg="1.5707963267948966" length="10.4">'
        '<paramPoly3 aU="0" bU="10" cU="0" dU="0" aV="0" bV="0" cV="2" dV="1" '
        'pRange="normalized"/></geometry>'
    )
    found = reference_line(tmp_path, geometry, 10.4).at(np.array([0.0, 5.2, 10.4]))
    np.testing.assert_allclose(
        found[:, :2], [[1, 2], [1 - 0.625, 7], [1 - 3, 12]], atol=1e-9
    )
    assert found[0, 2] == pytest.approx(np.pi / 2)


def test_cubics_of_length_advance_by_their_length(tmp_path: Path):
    geometry = (
        '<geometry s="0" x="0" y="0" hdg="0" length="20">'
        '<poly3 a="0" b="0" c="0.05" d="0"/></geometry>'
    )
    found = reference_line(tmp_path, geometry, 20).at(np.linspace(0, 20, 401))
    steps = np.hypot(*np.diff(found[:, :2], axis=0).T)
    np.testing.assert_allclose(steps, 0.05, atol=2e-4)
    np.testing.assert_allclose(found[:, 1], 0.05 * found[:, 0] ** 2, atol=1e-9)


def test_offsets_and_changing_widths_move_the_lanes(tmp_path: Path):
    scene = opened(
        tmp_path,
        road(
            section(lane(-1, width='<width sOffset="0" a="2" b="0.04" c="0" d="0"/>')),
            offset='<laneOffset s="0" a="1" b="0" c="0" d="0"/>',
        ),
    )
    (one,) = scene.road_map.lanes
    np.testing.assert_allclose(at(scene, one.left), [[0, 1], [50, 1]], atol=1e-9)
    np.testing.assert_allclose(at(scene, one.right), [[0, -1], [50, -3]], atol=1e-9)


def test_lanes_lead_through_sections_roads_and_junctions(tmp_path: Path):
    successor = '<link><successor id="-1"/></link>'
    predecessor = '<link><predecessor id="-1"/></link>'
    first = road(
        section(lane(-1, more=successor), lane(1))
        + section(lane(-1, more=predecessor), s=20),
        "a",
        link='<successor elementType="junction" elementId="j"/>',
    )
    through = road(
        section(lane(-1, more=predecessor + successor)),
        "b",
        geometry='<geometry s="0" x="50" y="0" hdg="0" length="20"><line/></geometry>',
        length=20,
        link='<successor elementType="road" elementId="c" contactPoint="start"/>',
        attributes='junction="j"',
    )
    last = road(
        section(lane(-1)),
        "c",
        geometry='<geometry s="0" x="70" y="0" hdg="0" length="30"><line/></geometry>',
        length=30,
    )
    junction = (
        '<junction id="j"><connection id="0" incomingRoad="a" connectingRoad="b" '
        'contactPoint="start"><laneLink from="-1" to="-1"/></connection></junction>'
    )
    scene = opened(tmp_path, first, through, last, junction)
    way = [lane_at(scene, x, -1.75) for x in (10, 35, 60, 85)]
    for one, other in pairwise(way):
        assert other.lane_id in one.successors
        assert one.lane_id in other.predecessors
        gap = at(scene, one.centerline)[-1] - at(scene, other.centerline)[0]
        assert np.hypot(*gap) < 1e-6
    assert [one.is_intersection for one in way] == [False, False, True, False]
    assert lane_at(scene, 10, 1.75).successors == ()


def test_virtual_junctions_join_nothing_and_say_so(tmp_path: Path):
    """Their roads began where the main road begins."""
    main = road(section(lane(-1, "shared")), "a")
    drive = road(
        section(lane(-1, more='<link><predecessor id="-1"/></link>')),
        "b",
        geometry=LINE.replace('x="0"', 'x="25"').replace('hdg="0"', 'hdg="-0.3"'),
        link='<predecessor elementType="road" elementId="a" elementS="25" elementDir="+"/>',
        attributes='junction="j"',
    )
    junction = (
        '<junction id="j" type="virtual" mainRoad="a" sStart="20" sEnd="30"><connection '
        'id="0" incomingRoad="a" connectingRoad="b" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection></junction>'
    )
    scene = opened(tmp_path, main, drive, junction)
    assert [one.successors for one in scene.road_map.lanes] == [(), ()]
    assert "1 virtual junctions join nothing." in scene.provenance.notes


def test_borders_are_drivable_unless_they_are_as_wide_as_a_verge(tmp_path: Path):
    verge = '<width sOffset="0" a="6" b="0" c="0" d="0"/>'
    edge = verge.replace('"6"', '"1.5"')
    border, beyond = lane(-2, "border", width=edge), lane(-3, "border", width=verge)
    scene = opened(tmp_path, road(section(lane(-1), border, beyond)))
    ring = at(scene, scene.road_map.drivable_areas[0].boundary)
    assert (ring[:, 1].min(), ring[:, 1].max()) == pytest.approx((-5.0, 0.0), abs=0.01)


def test_shoulders_are_drivable_and_crosswalks_are_crossings(tmp_path: Path):
    walk = (
        '<objects><object id="1" type="crosswalk" s="25" t="0" hdg="0" length="4" '
        'width="7"/></objects>'
    )
    scene = opened(
        tmp_path,
        road(section(lane(-1), lane(-2, "shoulder"), lane(-3, "sidewalk")), more=walk),
    )
    assert len(scene.road_map.lanes) == 1
    ring = at(scene, scene.road_map.drivable_areas[0].boundary)
    assert (ring[:, 1].min(), ring[:, 1].max()) == pytest.approx((-7.0, 0.0), abs=0.01)
    (crosswalk,) = scene.road_map.crosswalks
    outline = crosswalk.outline_m() + scene.origin_city_m
    np.testing.assert_allclose(outline.min(axis=0), [23, -3.5])
    np.testing.assert_allclose(outline.max(axis=0), [27, 3.5])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<OpenDRIVE>", "is no valid XML"),
        ("<roads/>", "its root is <roads>; expected <OpenDRIVE>"),
        (
            '<!DOCTYPE x [<!ENTITY a "aaaa">]><OpenDRIVE>&a;</OpenDRIVE>',
            "declares entities",
        ),
        ('<OpenDRIVE><header revMajor="2" revMinor="0"/></OpenDRIVE>', "version 2.0"),
        ("<OpenDRIVE/>", "has no lane for vehicles; expected a road"),
        (
            '<OpenDRIVE><header revMajor="1" revMinor="4"/></OpenDRIVE>',
            "has no lane for vehicles",
        ),
        (
            '<OpenDRIVE><header revMajor="1" revMinor="4"/>\n'
            + road(section(lane(-1)), length=-3)
            + "</OpenDRIVE>",
            "line 2: <road> 1 is -3 m long",
        ),
        (
            '<OpenDRIVE><header revMajor="1" revMinor="4"/>'
            + road(section(lane(-1)), geometry=LINE.replace("<line/>", "<circle/>"))
            + "</OpenDRIVE>",
            "<geometry> has no known shape",
        ),
        (
            '<OpenDRIVE><header revMajor="1" revMinor="4"/>'
            + road(section(lane(-1)), geometry=LINE.replace('x="0"', 'x="nan"'))
            + "</OpenDRIVE>",
            "needs a finite number for x, not 'nan'",
        ),
    ],
)
def test_bad_files_are_refused_in_one_sentence(tmp_path: Path, text: str, told: str):
    path = tmp_path / "bad.xodr"
    path.write_text(text)
    with pytest.raises(FormatError) as caught:
        read(path)
    assert told in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.real_data
def test_real_files_open_with_lanes_that_meet_at_their_links(format_files: Path):
    paths = sorted((format_files / "opendrive").glob("*.xodr"))
    assert paths
    for path in paths:
        assert format_of(path) is OPENDRIVE
        scene = read(path)
        lane_of = scene.road_map.lane_of
        gaps = [
            float(np.hypot(*(one.centerline_m[-1] - lane_of[name].centerline_m[0])))
            for one in lane_of.values()
            for name in one.successors
        ]
        # Lanes that begin or end beside another one are linked from side to side.
        assert np.mean(np.array([0.0, *gaps]) < 0.1) > 0.8, path


def test_the_sign_of_an_id_tells_the_side_of_a_lane(tmp_path: Path):
    """As netconvert writes left-hand traffic."""
    found = section(lane(-1)).replace("<left></left>", "").replace("right>", "left>")
    offset = '<laneOffset s="0" a="3.5" b="0" c="0" d="0"/>'
    scene = opened(tmp_path, road(found, offset=offset))
    np.testing.assert_allclose(
        at(scene, scene.road_map.lanes[0].centerline)[[0, -1]], [[0, 1.75], [50, 1.75]]
    )


def test_lanes_may_lead_against_their_side(tmp_path: Path):
    turned = lane(-2).replace("level=", 'direction="reversed" level=')
    scene = opened(tmp_path, road(section(lane(1), lane(-1), turned)))
    right, back = lane_at(scene, 25, -1.75), lane_at(scene, 25, -5.25)
    assert at(scene, right.centerline)[0, 0] == pytest.approx(0)
    assert at(scene, back.centerline)[0, 0] == pytest.approx(50)
    assert at(scene, back.left)[0, 1] == pytest.approx(-7)
    assert right.right_neighbor is None
    assert back.left_neighbor is None


def test_objects_without_a_size_are_no_crosswalks(tmp_path: Path):
    walk = '<objects><object id="1" type="crosswalk" s="25" t="0"/></objects>'
    scene = opened(tmp_path, road(section(lane(-1)), more=walk))
    assert not scene.road_map.crosswalks


def test_sections_of_one_side_leave_the_other_as_it_is(tmp_path: Path):
    """Roads with them were refused."""

    def alone(*lanes: str, s: float = 0.0) -> str:
        found = section(*lanes, s=s).replace(
            "<laneSection", '<laneSection singleSide="1"'
        )
        return found.replace("<left></left>", "").replace("<right></right>", "")

    def linked(number: int, tag: str, other: int) -> str:
        return lane(number, more=f'<link><{tag} id="{other}"/></link>')

    sections = (
        section(linked(1, "successor", 2), linked(-1, "successor", -1)),
        alone(lane(1), linked(2, "predecessor", 1), s=20),
        alone(linked(-1, "predecessor", -1), lane(-2), s=30),
    )
    link = '<successor elementType="road" elementId="2" contactPoint="start"/>'
    next_link = '<predecessor elementType="road" elementId="1" contactPoint="end"/>'
    after = linked(1, "predecessor", 2), linked(-1, "predecessor", -2)
    beyond = road(
        section(*after), "2", geometry=LINE.replace('x="0"', 'x="50"'), link=next_link
    )
    scene = opened(tmp_path, road("".join(sections), link=link), beyond)
    spans = {
        (x, y): tuple(
            sorted(at(scene, lane_at(scene, x, y).centerline)[[0, -1], 0].round())
        )
        for x, y in [(10, 1.75), (10, -1.75), (40, 5.25), (40, -1.75), (40, -5.25)]
    }
    assert spans == {
        (10, 1.75): (0, 20), (10, -1.75): (0, 30),
        (40, 5.25): (20, 50), (40, -1.75): (30, 50), (40, -5.25): (30, 50),
    }  # fmt: skip
    right, outer = lane_at(scene, 10, -1.75), lane_at(scene, 40, -5.25)
    assert right.successors == (lane_at(scene, 40, -1.75).lane_id,)
    assert outer.successors == (lane_at(scene, 70, -1.75).lane_id,)
    assert outer.left_neighbor == lane_at(scene, 40, -1.75).lane_id
    assert lane_at(scene, 40, 5.25).predecessors == (lane_at(scene, 70, 1.75).lane_id,)
    assert lane_at(scene, 40, 5.25).successors == (lane_at(scene, 10, 1.75).lane_id,)


def test_lanes_are_of_the_kind_of_those_who_may_use_them(tmp_path: Path):
    """Lanes for buses were for cars, and those closed to all were driven on."""

    def rule(rule: str, *users: str) -> str:
        return "".join(
            f'<access sOffset="0" rule="{rule}" restriction="{one}"/>' for one in users
        )

    newer = '<access sOffset="0" rule="allow"><restriction type="bus"/></access>'
    rules = [
        newer, rule("allow", "bicycle"), rule("allow", "emergency"), rule("deny", "truck"),
        rule("deny", "passengerCar", "autonomousTraffic", "throughTraffic"), "",
    ]  # fmt: skip
    lanes = [lane(-n, more=one) for n, one in enumerate(rules, start=1)]
    scene = opened(tmp_path, road(section(*lanes)))
    kinds = [one.kind for one in scene.road_map.lanes]
    bus, bike, vehicle = LaneKind.BUS, LaneKind.BIKE, LaneKind.VEHICLE
    assert kinds == [bus, bike, vehicle, bus, vehicle]


@pytest.mark.parametrize("header", ["", '<header name="" version="1.00"/>'])
def test_files_without_a_version_are_read(tmp_path: Path, header: str):
    """Those of some editors were refused."""
    path = write(tmp_path, road(section(lane(-1))))
    text = path.read_text().replace('<header revMajor="1" revMinor="6"/>', header)
    path.write_text(text)
    assert len(read(path).road_map.lanes) == 1


def test_borders_do_not_turn_back_within_narrow_curves(tmp_path: Path):
    """Those within curves did, and maps of many were refused."""
    curve = LINE.replace("50", "10") + (
        f'<geometry s="10" x="10" y="0" hdg="0" length="{np.pi}"><arc curvature="-0.5"/>'
        f'</geometry><geometry s="{10 + np.pi}" x="12" y="-2" hdg="{-np.pi / 2}" '
        'length="10"><line/></geometry>'
    )
    scene = opened(tmp_path, road(section(lane(-1)), geometry=curve, length=20 + np.pi))
    (only,) = scene.road_map.lanes
    for line in (only.left_m, only.right_m, only.centerline_m):
        assert not len(turns_back(line))
    np.testing.assert_allclose(at(scene, only.right)[[0, -1]], [(0, -3.5), (8.5, -12)])


def test_temporary_lanes_are_left_out_and_told(tmp_path: Path):
    """Their road was read instead, and the version refused."""
    links = '<link><successor id="-1" layer="permanent"/><successor id="-2" layer='
    own = lane(-1, more=f'{links}"temporary"/></link>'), lane(-2)
    lasting = road(section(*own) + section(*own, s=20))
    others = f'<lanes layer="temporary">{section(lane(-5))}</lanes><lanes layer="p">'
    path = write(
        tmp_path,
        lasting.replace("<lanes>", others),
        version='revMajor="1" revMinor="9"',
    )
    scene = read(path)
    assert [one.successors for one in scene.road_map.lanes] == [(3,), (), (), ()]
    assert any("Temporary lanes of 1 roads" in one for one in scene.provenance.notes)


def test_namespaces_and_long_comments_change_nothing(tmp_path: Path):
    path = write(tmp_path, road(section(lane(-1))))
    text = path.read_text().replace("<OpenDRIVE>", '<OpenDRIVE xmlns="http://a/b">')
    path = tmp_path / "road.xml"
    path.write_text(f"<!--{'x' * 9000}-->{text}")
    assert format_of(path) is OPENDRIVE
    assert len(read(path).road_map.lanes) == 1


def sign(name: str, s: float, kind: str, more: str = "", *, way: str = "+") -> str:
    dynamic = "yes" if kind.startswith("10000") else "no"
    return (
        f'<signal id="{name}" s="{s}" t="-5" type="{kind}" dynamic="{dynamic}" '
        f'orientation="{way}">{more}</signal>'
    )


def test_traffic_lights_stand_at_the_stop_lines_of_their_lanes(tmp_path: Path):
    """They were left out without a word."""
    right_one = '<validity fromLane="-1" toLane="-1"/>'
    nobody = '<validity fromLane="0" toLane="0"/>'
    signs = "".join(
        [
            sign("9", 40, "1000011", right_one),
            sign("8", 50, "1000001"),
            sign("7", 50, "1000001"),
            sign("6", 0, "1000001", nobody, way="-"),
            sign("5", 45, "294", '<validity fromLane="-2" toLane="-2"/>'),
            sign("4", 10, "294", way="-"),
            sign("3", 10, "1000002"),
            sign("2", 10, "205"),
            '<signalReference id="6" s="5" t="4" orientation="-"/>',
        ]
    )
    lanes = section(lane(1), lane(-1), lane(-2))
    scene = opened(tmp_path, road(lanes, more=f"<signals>{signs}</signals>"))
    found = {one.signal_id: one for one in scene.signals}
    places = {
        (name, lane_id): round(float(share), 3)
        for name, one in found.items()
        for lane_id, share in zip(one.lane_ids, one.stop_share, strict=True)
    }
    one, two, back = (lane_at(scene, 25, y).lane_id for y in (-1.75, -5.25, 1.75))
    # The stop line of its lane is nearer than the light itself.
    assert places == {("9", one): 0.8, ("8", two): 0.9, ("6", back): 0.8}
    assert not any(one.states.any() for one in scene.signals)
    notes = " ".join(scene.provenance.notes)
    assert "3 traffic lights have unknown states" in notes
    assert "2 signs and other signals are left out" in notes


def test_lights_of_a_controller_of_others_are_apart(tmp_path: Path):
    """netconvert has one for all lights of a junction, which are not green at once."""
    signs = sign("7", 50, "1000001") + sign("8", 50, "1000001", way="-")
    text = road(section(lane(1), lane(-1)), more=f"<signals>{signs}</signals>")
    both = '<control signalId="7"/><control signalId="8"/>'
    scene = opened(tmp_path, f'{text}<controller id="1" name="all">{both}</controller>')
    assert {one.signal_id for one in scene.signals} == {"7", "8"}


def test_a_stop_line_without_a_light_is_told(tmp_path: Path):
    signs = f"<signals>{sign('5', 45, '294')}</signals>"
    scene = opened(tmp_path, road(section(lane(-1)), more=signs))
    assert scene.signals == ()
    assert "Stop lines without a traffic light are left out: 1" in " ".join(
        scene.provenance.notes
    )


def test_a_road_without_length_joins_its_neighbours(tmp_path: Path):
    """The whole file was refused."""

    def link(before: str | None, after: str | None) -> str:
        parts = (("predecessor", before, "end"), ("successor", after, "start"))
        return "".join(
            f'<{tag} elementType="road" elementId="{name}" contactPoint="{end}"/>'
            for tag, name, end in parts
            if name
        )

    def part(name: str, x: float, length: float, road_link: str) -> str:
        line = f'<geometry s="0" x="{x}" y="0" hdg="0" length="{length}"><line/></geometry>'
        lanes = section(lane(-1, more='<link><predecessor id="-1"/><successor id="-1"/></link>'))  # fmt: skip
        return road(lanes, name, geometry=line, length=length, link=road_link)

    scene = opened(
        tmp_path,
        part("1", 0, 50, link(None, "2")),
        part("2", 50, 0, link("1", "3")),
        part("3", 50, 50, link("2", None)),
    )
    first, last = scene.road_map.lanes
    assert (first.successors, last.predecessors) == ((last.lane_id,), (first.lane_id,))
    assert "1 roads without length" in " ".join(scene.provenance.notes)


@pytest.mark.parametrize("how", ["type", "direction"])
def test_lanes_of_both_directions_are_two_lanes(tmp_path: Path, how: str):
    """They led one way only."""
    link = '<link><predecessor id="-1"/><successor id="-1"/></link>'
    middle = lane(-1, "bidirectional" if how == "type" else "driving", link)
    if how == "direction":
        middle = middle.replace("level=", 'direction="both" level=')
    sections = [section(lane(1), middle, lane(-2), s=s) for s in (0, 25)]
    scene = opened(tmp_path, road("".join(sections)))
    lanes = scene.road_map.lane_of
    pairs = [one for one in lanes.values() if np.allclose(at(scene, one.centerline)[:, 1], -1.75)]  # fmt: skip
    onward = {one.lane_id: at(scene, one.centerline)[-1, 0] > at(scene, one.centerline)[0, 0] for one in pairs}  # fmt: skip
    assert sorted(onward.values()) == [False, False, True, True]
    for one in pairs:
        left, right = at(scene, one.left)[0, 1], at(scene, one.right)[0, 1]
        assert (left > right) == onward[one.lane_id]
        for after in one.successors:
            assert onward[after] == onward[one.lane_id]
            np.testing.assert_allclose(lanes[after].centerline[0], one.centerline[-1])
        assert one.left_neighbor is None
        beside = at(scene, lanes[one.right_neighbor or 0].centerline)[0, 1]
        assert beside == pytest.approx(-5.25 if onward[one.lane_id] else 1.75)
    assert sum(len(one.successors) for one in pairs) == 2


@pytest.mark.parametrize(
    ("lengths", "told"), [((20, 30), False), ((20, 25), True), ((15, 30), True)]
)
def test_reference_lines_with_gaps_are_told(
    tmp_path: Path, lengths: tuple[float, float], told: bool
):
    """The rest of the road was drawn as a point."""
    first, second = lengths
    geometry = LINE.replace("50", str(first))
    geometry += (
        f'<geometry s="20" x="20" y="0" hdg="0" length="{second}"><line/></geometry>'
    )
    scene = opened(tmp_path, road(section(lane(-1)), geometry=geometry))
    notes = " ".join(scene.provenance.notes)
    assert ("Reference lines with gaps: 1." in notes) == told


def test_a_line_of_many_pieces_is_the_line(tmp_path: Path):
    """Its time grew with the square of their number."""
    pieces = "".join(
        f'<geometry s="{n / 4}" x="{n / 4}" y="0" hdg="0" length="0.25"><line/></geometry>'
        for n in range(200)
    )
    line = reference_line(tmp_path, pieces, 50)
    s = np.random.default_rng(1).uniform(0, 50, 400)
    np.testing.assert_allclose(line.at(s)[:, :2], np.stack([s, 0 * s], -1), atol=1e-9)


def test_objects_without_a_size_are_left_out(tmp_path: Path):
    """A crosswalk without a width refused the whole file."""
    walk = '<object id="1" type="crosswalk" s="9" t="0" length="3"/>'
    scene = opened(tmp_path, road(section(lane(-1)), more=f"<objects>{walk}</objects>"))
    assert scene.road_map.crosswalks == ()


def two_roads(link: str, its_link: str) -> tuple[str, ...]:
    """Two roads end to end; lanes 1 lead back, and lanes -2 of the second are new."""
    second = LINE.replace('x="0"', 'x="50"')
    lanes = (lane(1), lane(-1))
    return (
        road(section(*lanes), "1", link=link),
        road(section(*lanes, lane(-2)), "2", geometry=second, link=its_link),
    )


def links_of(path: Path) -> set[tuple[int, int]]:
    return {
        (one.lane_id, other)
        for one in read(path).road_map.lanes
        for other in one.successors
    }


@pytest.mark.parametrize("gap_m", [0.0, 0.3, 5.0])
def test_lanes_without_links_lead_on_where_they_meet(tmp_path: Path, gap_m: float):
    """Roads whose writer left out the links were no network."""
    first, second = two_roads("", "")
    second = second.replace('x="50"', f'x="{50 + gap_m}"')
    scene = read(path := write(tmp_path, first, second))
    forth = lane_at(scene, 0, -1.75), lane_at(scene, 50 + gap_m, -1.75)
    told = any("links that the file lacks" in n for n in scene.provenance.notes)
    assert told == (gap_m < 1)
    assert len(links_of(path)) == (2 if told else 0)
    assert (forth[0].successors == (forth[1].lane_id,)) == told


def test_links_that_a_file_tells_are_all_there_are(tmp_path: Path):
    """Where a lane is linked, the file tells what is: the lane that leads back is not."""
    ahead = '<successor elementType="road" elementId="2" contactPoint="start"/>'
    first, second = two_roads(ahead, "")
    first = first.replace('<lane id="-1" type="driving" level="false">',
        '<lane id="-1" type="driving" level="false"><link><successor id="-1"/></link>')  # fmt: skip
    path = write(tmp_path, first, second)
    assert len(links_of(path)) == 1


@pytest.mark.parametrize(
    "text",
    [
        "\n  <?xml version='1.0'?>{}",
        "<?xml version='1.0'?><!DOCTYPE OpenDRIVE SYSTEM 'OpenDRIVE.dtd'>{}",
        "\ufeff{}",
    ],
)
def test_what_other_writers_put_before_the_root_is_passed_over(
    tmp_path: Path, text: str
):
    path = write(tmp_path, road(section(lane(-1, "Driving"))), version='revMajor="1"')
    path.write_text(text.format(path.read_text()), "utf-8")
    assert len(read(path).road_map.lanes) == 1


def test_roads_that_connect_are_known_where_they_do_not_tell_it(tmp_path: Path):
    junction = '<junction id="7"><connection id="0" incomingRoad="1" connectingRoad="2"/></junction>'
    roads = two_roads("", "")
    path = write(tmp_path, roads[0], roads[1].replace('junction="-1"', ""), junction)
    inside = {
        one.is_intersection for one in read(path).road_map.lanes if one.successors
    }
    assert inside == {False, True}
