"""CommonRoad scenarios as scenes."""

import re
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import FormatError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.commonroad import COMMONROAD, read
from pd_editor.scene.formats.registry import format_of
from pd_editor.scene.road_map import LaneKind, LaneMark

FAR_M = (431_000.0, 5_412_000.0)
"""Places in projected coordinates."""


def point(x: float, y: float) -> str:
    return f"<point><x>{x + FAR_M[0]}</x><y>{y + FAR_M[1]}</y></point>"


def bound(side: str, y: float, mark: str, start: float, end: float) -> str:
    return (
        f"<{side}Bound>{point(start, y)}{point(end, y)}"
        f"<lineMarking>{mark}</lineMarking></{side}Bound>"
    )


def lanelet(number: int, y: float, start: float, end: float, more: str) -> str:
    return (
        f'<lanelet id="{number}">{bound("left", y + 1.5, "dashed", start, end)}'
        f"{bound('right', y - 1.5, 'solid', start, end)}{more}</lanelet>"
    )


def state(tag: str, step: int, x: float, y: float, heading: float, speed: float) -> str:
    return (
        f"<{tag}><position>{point(x, y)}</position><orientation><exact>{heading}</exact>"
        f"</orientation><time><exact>{step}</exact></time><velocity><exact>{speed}"
        f"</exact></velocity></{tag}>"
    )


CAR = (
    "<type>car</type><shape><rectangle><length>4.2</length><width>1.8</width>"
    "</rectangle></shape>"
)


def text(step_s: float = 0.1, version: str = "2020a", more: str = "") -> str:
    states = "".join(state("state", n, n * 1.0, 0.0, 0.0, 10.0) for n in range(1, 31))
    return (
        f'<commonRoad commonRoadVersion="{version}" benchmarkID="ZAM_Road-1_1_T-1" '
        f'timeStepSize="{step_s}" author="A. Author" source="by hand">'
        + lanelet(
            10,
            0.0,
            0.0,
            50.0,
            '<successor ref="11"/><adjacentLeft ref="12" drivingDir="same"/>'
            '<adjacentRight ref="13" drivingDir="opposite"/>',
        )
        + lanelet(11, 0.0, 50.0, 90.0, '<predecessor ref="10"/>')
        + lanelet(12, 3.0, 0.0, 50.0, "<laneletType>busLane</laneletType>")
        + lanelet(14, -9.0, 0.0, 50.0, "<laneletType>sidewalk</laneletType>")
        + lanelet(15, 20.0, 0.0, 4.0, "<laneletType>crosswalk</laneletType>")
        + f'<dynamicObstacle id="100">{CAR}'
        + state("initialState", 0, 0.0, 0.0, 0.0, 10.0)
        + f"<trajectory>{states}</trajectory></dynamicObstacle>"
        + f'<staticObstacle id="101">{CAR.replace("car", "parkedVehicle")}'
        + state("initialState", 0, 20.0, 3.0, 1.0, 0.0)
        + "</staticObstacle>"
        + '<planningProblem id="7">'
        + state("initialState", 0, 5.0, 3.0, 0.5, 6.0)
        + f"</planningProblem>{more}</commonRoad>"
    )


def write(folder: Path, content: str) -> Path:
    path = folder / "scene.xml"
    path.write_text(content)
    return path


def test_lanelets_become_lanes_with_their_links(tmp_path: Path):
    path = write(tmp_path, text())
    assert format_of(path) is COMMONROAD
    scene = open_scenario(path)
    assert scene.scenario_id == "ZAM_Road-1_1_T-1"
    assert scene.provenance.attribution == "author: A. Author; source: by hand"
    lanes = scene.road_map.lane_of
    assert sorted(lanes) == [10, 11, 12]
    one = lanes[10]
    assert (one.successors, lanes[11].predecessors) == ((11,), (10,))
    assert (one.left_neighbor, one.right_neighbor) == (12, None)
    assert (one.left_mark, one.right_mark) == (
        LaneMark.DASHED_WHITE,
        LaneMark.SOLID_WHITE,
    )
    assert lanes[12].kind == LaneKind.BUS
    line = one.centerline_m + scene.origin_city_m - FAR_M
    np.testing.assert_allclose(line[[0, -1]], [[0, 0], [50, 0]], atol=1e-6)
    assert len(scene.road_map.crosswalks) == 1
    assert scene.road_map.drivable_areas


def test_obstacles_keep_their_boxes_and_motion(tmp_path: Path):
    scene = read(write(tmp_path, text()))
    agents, now = scene.agents, scene.current_step
    assert agents.ids == ("100", "101", "AV")
    car, parked, ego = agents.rows(("100", "101", "AV"))
    assert agents.size_m[car].tolist() == [4.2, 1.8]
    assert agents.has_known_size.tolist() == [True, True, False]
    place = agents.position_m + scene.origin_city_m - FAR_M
    np.testing.assert_allclose(
        place[car, now : now + 31], [[n, 0] for n in range(31)], atol=1e-6
    )
    assert agents.is_valid[car].sum() == 31
    np.testing.assert_allclose(agents.velocity_mps[car, now], [10, 0])
    assert agents.is_valid[parked].sum() == 31
    assert agents.heading_rad[parked, now] == pytest.approx(1.0)
    assert agents.is_valid[ego].sum() == 1
    np.testing.assert_allclose(
        agents.velocity_mps[ego, now], [6 * np.cos(0.5), 6 * np.sin(0.5)]
    )
    assert agents.kinds == (AgentKind.VEHICLE,) * 3
    assert scene.focal_id == "100"
    # As long as an Argoverse 2 scenario, so that a past and a future fit in.
    assert (scene.time_axis.num_steps, now) == (110, 49)


LIGHT = """<trafficLight id="50"><cycle>
<cycleElement><duration>20</duration><color>red</color></cycleElement>
<cycleElement><duration>{green}</duration><color>green</color></cycleElement>
<timeOffset>5</timeOffset></cycle></trafficLight>"""


def with_light(more: str, **numbers: float) -> str:
    light = LIGHT.format(**{"green": 10} | numbers)
    return text(more=light).replace(
        '<successor ref="11"/>', f'<successor ref="11"/>{more}'
    )


def test_lights_stand_at_stop_lines_and_have_their_cycles(tmp_path: Path):
    line = f"<stopLine>{point(45, -1.5)}{point(45, 1.5)}</stopLine>"
    for more, x in (("", 50.0), (line, 45.0)):
        reference = '<trafficLightRef ref="50"/>'
        scene = open_scenario(write(tmp_path, with_light(more + reference)))
        (signal,) = scene.signals
        assert signal.lane_ids == (10,)
        middle = scene.stop_lines_m()[0, 1] + scene.origin_city_m
        np.testing.assert_allclose(middle, [x + FAR_M[0], FAR_M[1]], atol=1e-6)
        first = scene.current_step
        # From the file's step 5 on 20 red ones, 10 green ones, 20 red ones.
        states = signal.states[first + 5 : first + 55]
        assert states.tolist() == [1] * 20 + [3] * 10 + [1] * 20


def test_a_light_without_duration_is_refused(tmp_path: Path):
    path = write(tmp_path, with_light('<trafficLightRef ref="50"/>', green=0))
    with pytest.raises(
        FormatError, match=r"line \d+: <trafficLight> 50 has an element that does"
    ):
        open_scenario(path)


def test_other_rates_are_resampled_to_ten_a_second(tmp_path: Path):
    scene = read(write(tmp_path, text(step_s=0.04)))
    row, now = scene.agents.row_of["100"], scene.current_step
    place = scene.agents.position_m[row, now : now + 13] + scene.origin_city_m - FAR_M
    # 1 m in 0.04 s: 2.5 m in a step.
    np.testing.assert_allclose(place[:, 0], 2.5 * np.arange(13), atol=1e-6)
    assert scene.agents.is_valid[row].sum() == 13
    scene = read(write(tmp_path, text(step_s=1.0)))
    there = scene.agents.is_valid[scene.agents.row_of["100"]]
    assert there.sum() == 301


def test_states_follow_from_occupancies_and_those_without_a_place_are_left_out(
    tmp_path: Path,
):
    """One had the first state alone, the other was refused."""
    occupancies = "".join(
        f"<occupancy><shape><rectangle><length>4.2</length><width>1.8</width>"
        f"<orientation>{0.01 * n}</orientation>{point(0.9 * n, 2.0)}</rectangle></shape>"
        f"<time><exact>{n}</exact></time></occupancy>".replace("point>", "center>")
        for n in range(31)
    )
    unplaced = "<state><time><exact>1</exact></time></state>" * 3
    first = state("initialState", 0, 0.0, 2.0, 0.0, 9.0)
    scene = read(
        write(
            tmp_path,
            text(
                more=f'<dynamicObstacle id="200">{CAR}{first}<occupancySet>{occupancies}'
                f'</occupancySet></dynamicObstacle><dynamicObstacle id="201">{CAR}{first}'
                f"<trajectory>{unplaced}</trajectory></dynamicObstacle>"
            ),
        )
    )
    agents, now = scene.agents, scene.current_step
    row = agents.row_of["200"]
    place = agents.position_m[row, now : now + 31] + scene.origin_city_m - FAR_M
    np.testing.assert_allclose(place[:, 0], 0.9 * np.arange(31), atol=1e-6)
    heading = agents.heading_rad[row, now : now + 31]
    np.testing.assert_allclose(heading, 0.01 * np.arange(31), atol=1e-6)
    assert agents.is_valid[agents.row_of["201"]].sum() == 1


@pytest.mark.parametrize("is_repeated", [True, False])
def test_trajectories_may_have_the_first_state(tmp_path: Path, is_repeated: bool):
    """Repeated it was refused, as were files of version 2017a, which have it there alone."""
    first = state("initialState", 0, 0.0, 0.0, 0.0, 10.0)
    own = first.replace("initialState", "state")
    content = text(version="2017a").replace("<trajectory>", f"<trajectory>{own}")
    content = content if is_repeated else content.replace(first, "", 1)
    agents = (scene := read(write(tmp_path, content))).agents
    row, now = agents.row_of["100"], scene.current_step
    place = agents.position_m[row, now : now + 31] + scene.origin_city_m - FAR_M
    np.testing.assert_allclose(place, [[n, 0] for n in range(31)], atol=1e-6)


def test_states_may_be_areas_without_an_orientation(tmp_path: Path):
    content = text()
    for n in range(1, 31):
        corners = "".join(
            point(n + x, y) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        )
        full = state("state", n, n * 1.0, 0.0, 0.0, 10.0)
        area = full.replace(point(n * 1.0, 0.0), f"<polygon>{corners}</polygon>")
        area = area.replace("<orientation><exact>0.0</exact></orientation>", "")
        content = content.replace(full, area)
    agents = (scene := read(write(tmp_path, content))).agents
    row, now = agents.row_of["100"], scene.current_step
    place = agents.position_m[row, now : now + 31] + scene.origin_city_m - FAR_M
    np.testing.assert_allclose(place, [[n, 0] for n in range(31)], atol=1e-6)
    np.testing.assert_allclose(agents.velocity_mps[row, now : now + 31, 0], 10)
    np.testing.assert_allclose(agents.heading_rad[row], 0, atol=1e-6)


@pytest.mark.parametrize(
    "size", ["<length>4</length><width>2</width>", "<radius>2</radius>"]
)
def test_several_shapes_have_one_box_and_what_is_left_out_is_told(
    tmp_path: Path, size: str
):
    tag = "circle" if "radius" in size else "rectangle"
    trailer = f"<{tag}>{size}<center><x>-5</x><y>0</y></center></{tag}>"
    content = text(more='<phantomObstacle id="300"/>')
    scene = read(write(tmp_path, content.replace("</shape>", f"{trailer}</shape>", 1)))
    row = scene.agents.row_of["100"]
    width_m = 4 if tag == "circle" else 2
    assert scene.agents.size_m[row].tolist() == pytest.approx([9.1, width_m])
    place = scene.agents.position_m[row, scene.current_step] + scene.origin_city_m
    np.testing.assert_allclose(place - FAR_M, [(2.1 - 7) / 2, 0], atol=1e-6)
    assert any("phantom obstacles" in one for one in scene.provenance.notes)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (
            text(version="2024a"),
            "is of version '2024a'; expected 2017a or 2018b or 2020a",
        ),
        (text(step_s=-1), "has steps of -1 s"),
        (text(more='<lanelet id="10"/>'), "<lanelet> 10 comes twice"),
        (text(more='<lanelet id="99"/>'), "<lanelet> 99 has no <leftBound>"),
        (text().replace('ref="11"', 'ref="x"'), "a finite number for ref, not 'x'"),
        (text().replace("<exact>1.0</exact>", "<exact>up</exact>"), "not 'up'"),
        (text().replace("lanelet", "nothing"), "has no lane for vehicles"),
        (
            text().replace("<leftBound>", f"<leftBound>{point(50.0, 1.5)}", 1),
            "<lanelet> 10 has a bound that leads back to where it begins",
        ),
    ],
)
def test_bad_files_are_refused_in_one_sentence(tmp_path: Path, content: str, told: str):
    path = write(tmp_path, content)
    with pytest.raises(FormatError) as caught:
        read(path)
    assert told in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.real_data
def test_real_files_open_with_all_their_obstacles(format_files: Path):
    paths = sorted((format_files / "commonroad").glob("*.xml"))
    assert paths
    for path in paths:
        content = path.read_text()
        scene = open_scenario(path)
        count = sum(
            content.count(f"<{tag} ")
            for tag in ("obstacle", "dynamicObstacle", "staticObstacle")
        )
        assert len(scene.agents) == count + ("<planningProblem " in content), path
        assert scene.agents.has_known_size.sum() == count
        assert scene.scenario_id in content


@pytest.mark.real_data
def test_real_lights_follow_the_cycles_of_their_files(format_files: Path):
    scene = open_scenario(format_files / "commonroad/DEU_Starnberg-1_1_T-1.xml")
    lanes = {one.signal_id: len(one.lane_ids) for one in scene.signals}
    assert lanes == {"152": 1, "153": 4, "154": 2, "156": 1}


def swapped(content: str, how: str) -> str:
    """The first lanelet with its bounds exchanged, or one of them in reverse."""
    start, end = content.index("<leftBound>"), content.index("</rightBound>")
    part = content[start:end]
    if how == "exchanged":
        new = part.replace("left", "_").replace("right", "left").replace("_", "right")
    else:
        first, second = re.findall(r"<point>.*?</point>", part)[:2]
        new = part.replace(first + second, second + first)
    return (
        content[:start]
        + new
        + content[end:].replace(
            "</rightBound>",
            "</leftBound>" if how == "exchanged" else "</rightBound>",
            1,
        )
    )


@pytest.mark.parametrize("how", ["exchanged", "reversed"])
def test_bounds_the_wrong_way_round_are_mended_and_told(tmp_path: Path, how: str):
    """Such a lane led on its own left side, or crossed itself."""
    right, wrong = tmp_path / "right.xml", tmp_path / "wrong.xml"
    right.write_text(text())
    wrong.write_text(swapped(text(), how))
    expected, scene = read(right), read(wrong)
    one, other = expected.road_map.lane_of[10], scene.road_map.lane_of[10]
    for name in ("centerline", "left", "right"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name), atol=1e-6)
    assert (other.left_mark, other.right_mark) == (one.left_mark, one.right_mark)
    told = "Bounds of 1 lanelets lay the wrong way round: 10."
    assert told in scene.provenance.notes
    assert told not in expected.provenance.notes


@pytest.mark.parametrize("places", [(30, 10, 20), (10, 45, 40, 35)])
def test_bounds_that_turn_back_go_on_and_are_told(tmp_path: Path, places):
    """Points of real lanelets are out of order; such a lane ran back and forth."""
    first = "".join(point(x, 1.5) for x in places)
    told = text().replace(point(50, 1.5), first + point(50, 1.5), 1)
    scene = read(write(tmp_path, told))
    lane = scene.road_map.lane_of[10]
    for name in ("centerline", "left", "right"):
        assert (np.diff(getattr(lane, name)[:, 0]) > 0).all()
    np.testing.assert_allclose(lane.left[[0, -1]], [[0, 1.5, 0], [50, 1.5, 0]])
    assert len(lane.left) > 2
    assert any("1 lanelets turned back" in one for one in scene.provenance.notes)
    assert not any(
        "turned" in one for one in read(write(tmp_path, text())).provenance.notes
    )


def test_lanes_that_begin_elsewhere_are_told(tmp_path: Path):
    path = tmp_path / "scene.xml"
    path.write_text(text().replace(bound("left", 1.5, "dashed", 50.0, 90.0), bound("left", 1.5, "dashed", 54.0, 90.0)).replace(bound("right", -1.5, "solid", 50.0, 90.0), bound("right", -1.5, "solid", 54.0, 90.0)))  # fmt: skip
    assert "1 lane begins up to 4.0 m from those before them." in read(path).provenance.notes  # fmt: skip


def test_lanelets_for_both_ways_are_two_lanes(tmp_path: Path):
    """They were read as if for one way."""
    users = "<userBidirectional>{}</userBidirectional>"
    more = (
        lanelet(20, 40.0, 0.0, 30.0, '<successor ref="21"/>' + users.format("vehicle"))
        + lanelet(21, 40.0, 30.0, 60.0, f'<predecessor ref="20"/><adjacentLeft ref="23" '
                  f'drivingDir="same"/>{users.format("car")}')
        + lanelet(22, 60.0, 0.0, 30.0, users.format("priorityVehicle"))
        + lanelet(23, 43.0, 30.0, 60.0, users.format("truck"))
    )  # fmt: skip
    path = tmp_path / "road.xml"
    path.write_text(text(more=more))
    scene = read(path)
    lane_of = scene.road_map.lane_of
    assert {*lane_of} == {10, 11, 12, 20, 21, 22, 23, 24, 25, 26}
    np.testing.assert_allclose(lane_of[24].centerline, lane_of[20].centerline[::-1])
    np.testing.assert_allclose(lane_of[24].left, lane_of[20].right[::-1])
    assert (lane_of[25].successors, lane_of[24].predecessors) == ((24,), (25,))
    assert (lane_of[20].successors, lane_of[20].predecessors) == ((21,), ())
    assert (lane_of[25].left_neighbor, lane_of[25].right_neighbor) == (None, 26)
    assert lane_of[21].left_neighbor == 23
    assert "3 lanelets are for both ways, each as two lanes." in scene.provenance.notes


def test_lanes_of_two_way_lanelets_lead_on_into_one_way_ones(tmp_path: Path):
    """Files have no links for their second way."""
    back = lanelet(21, 40.0, 0.0, 30.0, "")
    left, right = bound("left", 41.5, "dashed", 0.0, 30.0), bound("right", 38.5, "solid", 0.0, 30.0)  # fmt: skip
    turned = bound("left", 38.5, "dashed", 30.0, 0.0), bound("right", 41.5, "solid", 30.0, 0.0)  # fmt: skip
    back = back.replace(left, turned[0]).replace(right, turned[1])
    two_way = lanelet(20, 40.0, 30.0, 60.0, "<userBidirectional>vehicle</userBidirectional>")  # fmt: skip
    path = tmp_path / "road.xml"
    path.write_text(text(more=back + two_way))
    lane_of = read(path).road_map.lane_of
    assert lane_of[22].successors == (21,)
    assert lane_of[21].predecessors == (22,)
    assert lane_of[20].successors == ()


@pytest.mark.parametrize("shape", ["circle", "polygon", "group", "rectangle"])
def test_obstacles_are_in_the_middle_of_areas_that_they_may_occupy(
    tmp_path: Path, shape: str
):
    """Of set-based predictions the first state alone was read."""

    def area(x: float, y: float, grown: float) -> str:
        center = point(x, y).replace("point>", "center>")
        circle = f"<circle><radius>{1 + grown}</radius>{center}</circle>"
        corners = "".join(
            point(x + a * (2 + grown), y + b) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        )  # fmt: skip
        polygon = f"<polygon>{corners}</polygon>"
        box = f"<rectangle><length>{4 + grown}</length><width>2</width>{center}</rectangle>"
        return {"circle": circle, "polygon": polygon, "group": polygon + circle, "rectangle": box}[shape]  # fmt: skip

    occupancies = "".join(
        f"<occupancy><shape>{area(9.0 * (n + 0.5), 0.0, 0.1 * n)}</shape><time><intervalStart>{n}"
        f"</intervalStart><intervalEnd>{n + 1}</intervalEnd></time></occupancy>"
        for n in range(20)
    )  # fmt: skip
    first = state("initialState", 0, 0.0, 0.0, 0.0, 9.0)
    more = f'<dynamicObstacle id="200">{CAR}{first}<occupancySet>{occupancies}</occupancySet></dynamicObstacle>'  # fmt: skip
    scene = read(write(tmp_path, text(more=more)))
    row, now = scene.agents.row_of["200"], scene.current_step
    place = scene.agents.position_m[row, now : now + 20] + scene.origin_city_m - FAR_M
    np.testing.assert_allclose(place, [[9.0 * n, 0] for n in range(20)], atol=1e-6)
    assert np.abs(scene.agents.heading_rad[row]).max() < 1e-6
    assert scene.agents.size_m[row].tolist() == [4.2, 1.8]
