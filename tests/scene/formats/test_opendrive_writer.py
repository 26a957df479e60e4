"""OpenDRIVE networks and OpenSCENARIO scenarios that the editor writes."""

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree
from lxml.etree import _Element

from pd_editor.base.errors import ExportError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.synthesis.sumo.sumo_tools import run_sumo_tool
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.commonroad_writer import IDS_NAME
from pd_editor.scene.formats.opendrive import read
from pd_editor.scene.formats.opendrive_writer import JOINT, JOINT_M, write
from pd_editor.scene.perturbation.warp_scenario import (
    pose_on_original_road,
    warp_scenario,
)
from pd_editor.scene.road_map import Lane, RoadMap
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M, WARP_KINDS, RoadWarp, WarpTerm
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.signals import Signal
from tests.builders import (
    scenario_with,
    straight_drivers,
    straight_lane,
    two_agents_that_pass,
)
from tests.oracles.environment import Oracle
from tests.scene.formats.agreement import Worst

CENTERS_M = 0.05
"""Corners are rounded, and where lanes meet they have one heading."""


def warped(scenario: Scenario, number: int) -> Scenario:
    """The scenario on a road that is bent as strongly as usual, in one of three ways."""
    kind = WARP_KINDS[number % len(WARP_KINDS)]
    anchor = pose_on_original_road(scenario, scenario.focal_id)
    term = WarpTerm(kind=kind, power=6.0, length_m=DEFAULT_LENGTH_M[kind])
    return warp_scenario(scenario, RoadWarp(anchor=anchor, terms=(term,)))


def written(scenario: Scenario, folder: Path) -> Path:
    """The scenario's road network in a folder, beside its other files."""
    for name, data in write(scenario).files.items():
        (folder / name).write_bytes(data)
    return folder / f"{scenario.scenario_id}.xodr"


Lanes = tuple[str, str]
"""Ids of a road and of a lane in it."""


def links_of(root: _Element) -> set[tuple[Lanes, Lanes]]:
    """Links of lanes, of which those of connecting roads are passed through."""
    found = set()
    for road in root.findall("road"):
        ends = [road.find(f"link/{tag}") for tag in ("predecessor", "successor")]
        is_bridge = road.get("junction") != "-1"
        is_joint = road.find(f"userData[@code='{JOINT}']") is not None
        assert not is_bridge or is_joint or float(road.get("length", "")) < JOINT_M
        for lane in road.findall(".//right/lane"):
            own = [lane.find(f"link/{tag}") for tag in ("predecessor", "successor")]
            before, after = (
                None if one is None else (end.get("elementId"), one.get("id"))
                for one, end in zip(own, ends, strict=True)
            )
            before = before if is_bridge else (road.get("id"), lane.get("id"))
            if after is not None:
                found.add((before, after))
    return found


def own_links(scenario: Scenario, path: Path) -> set[tuple[Lanes, Lanes]]:
    lane_of, name = scenario.road_map.lane_of, lane_names(path)
    return {
        (name[lane.lane_id], name[one])
        for lane in lane_of.values()
        for one in lane.successors
        if one in lane_of
    }


def lane_names(path: Path) -> dict[int, Lanes]:
    """Ids of roads and lanes by our ids of lanes, as the table beside a file tells them."""
    table = io.StringIO((path.parent / IDS_NAME).read_text())
    rows = [one for one in csv.DictReader(table) if one["kind"] == "lane"]
    names = [one["id in the file"].split() for one in rows]
    return {int(one["id"]): (a, b) for one, (a, b) in zip(rows, names, strict=True)}


def check_roads(scenario: Scenario, path: Path) -> Worst:
    """The file, and what our reader makes of it, has the scenario's lanes."""
    worst = Worst()
    root = etree.parse(path).getroot()
    assert links_of(root) == own_links(scenario, path)
    found, names = read(path), lane_names(path)
    order = [
        (road.get("id", ""), lane.get("id", ""))
        for road in root.findall("road[@junction='-1']")
        for lane in road.findall(".//right/lane")
    ]
    theirs = dict(zip(order, found.road_map.lanes, strict=True))
    mine = scenario.road_map.lanes
    of_name = {names[lane.lane_id]: lane for lane in mine}
    theirs = [theirs[names[lane.lane_id]] for lane in mine]
    number = {a.lane_id: b.lane_id for a, b in zip(mine, theirs, strict=True)}
    for lane, other in zip(mine, theirs, strict=True):
        for name in ("successors", "predecessors"):
            known = {number[one] for one in getattr(lane, name) if one in number}
            assert set(getattr(other, name)) == known
        for name in ("left_neighbor", "right_neighbor"):
            assert getattr(other, name) == number.get(getattr(lane, name))
        for name in ("kind", "is_intersection", "right_mark"):
            assert getattr(other, name) == getattr(lane, name)
        road, place = names[lane.lane_id]
        # Neighbours have one marking between them.
        beside = of_name.get((road, str(int(place) + 1)), lane)
        mark = lane.left_mark if beside is lane else beside.right_mark
        assert other.left_mark == mark
        lines = [
            shapely.LineString(one.centerline_m + scene.origin_city_m)
            for one, scene in ((lane, scenario), (other, found))
        ]
        gap = max(
            shapely.distance(points_along(one), line).max()
            for one, line in (lines, lines[::-1])
        )
        assert worst.note("center_m", gap) <= CENTERS_M, lane.lane_id
    walks, others = (
        [
            shapely.Polygon(one.outline_m() + scene.origin_city_m)
            for one in scene.road_map.crosswalks
        ]
        for scene in (scenario, found)
    )
    assert len(walks) == len(others)
    for one in walks:
        gap = min(one.symmetric_difference(other).area for other in others)
        assert gap <= 0.02 * one.area
    areas = [
        shapely.union_all(
            [
                shapely.make_valid(shapely.Polygon(one.boundary[:, :2] + origin))
                for one in scene.road_map.drivable_areas
            ]
        )
        for scene in (scenario, found)
        for origin in [scene.origin_city_m]
    ]
    assert areas[0].difference(areas[1].buffer(0.5)).area <= 1e-3 * areas[0].area
    return worst


def points_along(line: shapely.LineString) -> np.ndarray:
    return shapely.line_interpolate_point(line, np.linspace(0.0, line.length, 400))


Part = tuple[float, float, np.ndarray]
"""Times of coming and of leaving, and a table of time, x, y, heading."""


def tracks_of(root: _Element, end_s: float) -> dict[str, list[Part]]:
    """Where entities are, as a player of the file sees it."""
    found: dict[str, list[Part]] = {}
    begins = {
        one.get("entityRef", ""): one.find(".//WorldPosition")
        for one in root.findall(".//Init//Private")
    }
    for group in root.findall(".//ManeuverGroup"):
        (name,) = (one.get("entityRef", "") for one in group.findall(".//EntityRef"))
        place, since, table = begins.get(name), 0.0, []
        for event in group.findall(".//Event"):
            at = float(event.find(".//SimulationTimeCondition").get("value"))
            if (added := event.find(".//AddEntityAction//WorldPosition")) is not None:
                assert place is None, "it is there already"
                place, since, table = added, at, []
            for vertex in event.findall(".//Vertex"):
                state = vertex.find("Position/WorldPosition")
                table.append([float(vertex.get("time")), *values(state)])
            if event.find(".//DeleteEntityAction") is not None:
                assert place is not None, "it is not there"
                part = (since, at, np.array(table or [[since, *values(place)]]))
                found.setdefault(name, []).append(part)
                place = None
        if place is not None:
            part = (since, end_s, np.array(table or [[since, *values(place)]]))
            found.setdefault(name, []).append(part)
    return found


def values(place: _Element) -> list[float]:
    return [float(place.get(name, "")) for name in "xyh"]


def check_agents(scenario: Scenario, path: Path) -> Worst:
    """The trajectories beside a road network are the scenario's."""
    worst = Worst()
    root = etree.parse(path.with_suffix(".xosc")).getroot()
    assert root.find("RoadNetwork/LogicFile").get("filepath") == path.name
    table = io.StringIO((path.parent / IDS_NAME).read_text())
    rows = [one for one in csv.DictReader(table) if one["kind"] == "agent"]
    names = {one["id"]: one["id in the file"] for one in rows}
    agents, step_s = scenario.agents, scenario.time_axis.step_s
    assert set(names) == set(agents.ids)
    assert EGO_ID not in names or names[EGO_ID] == "Ego"
    objects = {one.get("name"): one for one in root.findall(".//ScenarioObject")}
    tracks = tracks_of(root, agents.num_steps * step_s)
    for row, (own, name) in enumerate(names.items()):
        assert own == agents.ids[row]
        box = objects[name].find(".//Dimensions")
        size = [float(box.get(one)) for one in ("length", "width")]
        np.testing.assert_allclose(size, agents.size_m[row], atol=1e-6)
        center = objects[name].find(".//Center")
        assert (center.get("x"), center.get("y")) == ("0", "0")
        is_there = np.zeros(agents.num_steps, bool)
        for since, until, states in tracks[name]:
            steps = np.rint(states[:, 0] / step_s).astype(int)
            assert since == pytest.approx(states[0, 0])
            assert until == pytest.approx(states[-1, 0] + step_s)
            is_there[steps] = True
            gap = states[:, 1:3] - agents.position_m[row, steps]
            assert worst.note("position_m", gap) <= 1e-3
            assert worst.turns(states[:, 3] - agents.heading_rad[row, steps]) <= 0.1
            speeds = [
                np.hypot(*np.diff(line, axis=0).T) / step_s
                for line in (states[:, 1:3], agents.position_m[row, steps])
            ]
            assert worst.note("speed_mps", speeds[0] - speeds[1]) <= 0.05
        np.testing.assert_array_equal(is_there, agents.is_valid[row])
    return worst


@pytest.mark.parametrize("demo", ["roundabout", "crosswalk", "queue", "merge"])
def test_a_demo_comes_back_as_it_was(demo: str, tmp_path: Path):
    scenario = open_scenario(demo)
    path = written(scenario, tmp_path)
    check_roads(scenario, path)
    check_agents(scenario, path)


def real_scenes(folders: list[Path], every: int) -> Iterator[Scenario]:
    for number, folder in enumerate(folders[::every]):
        scenario = open_scenario(folder)
        yield scenario
        yield warped(scenario, number)


@pytest.mark.real_data
def test_real_scenes_come_back_as_they_were(
    av2_scenario_folders: list[Path], tmp_path: Path
):
    for scenario in real_scenes(av2_scenario_folders, 48):
        path = written(scenario, tmp_path)
        check_roads(scenario, path)
        check_agents(scenario, path)


@settings(max_examples=20)
@given(
    turns=st.lists(st.floats(-0.6, 0.6), min_size=1, max_size=8),
    steps=st.lists(st.floats(0.3, 20.0), min_size=9, max_size=9),
    fork=st.floats(-0.8, 0.8),
)
def test_crooked_lanes_that_part_come_back(
    tmp_path_factory: pytest.TempPathFactory,
    turns: list[float],
    steps: list[float],
    fork: float,
):
    heading = np.append(0.0, np.cumsum(turns))
    ways = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    line = np.cumsum([[0.0, 0.0], *(ways * np.array(steps[: len(ways)])[:, None])], 0)

    def lane(
        number: int, line: np.ndarray, after: tuple[int, ...], before: tuple[int, ...]
    ):
        plain = straight_lane(
            number, (0, 0), (1, 0), successors=after, predecessors=before
        )
        side = np.array([0.0, 1.75])
        points = [line, line + side, line - side]
        lifted = [np.column_stack([one, np.zeros(len(one))]) for one in points]
        return replace(
            plain,
            is_intersection=number > 1,
            centerline=lifted[0],
            left=lifted[1],
            right=lifted[2],
        )

    def beyond(turn: float) -> np.ndarray:
        angle = heading[-1] + turn
        return line[-1] + np.outer([0.0, 12.0], [np.cos(angle), np.sin(angle)])

    lanes = (
        lane(1, line, (2, 3), ()),
        lane(2, beyond(0.0), (), (1,)),
        lane(3, beyond(fork), (), (1,)),
    )
    scene = replace(two_agents_that_pass(), road_map=RoadMap(lanes=lanes))
    check_roads(scene, written(scene, tmp_path_factory.mktemp("road")))


@pytest.mark.parametrize("gap_m", [0.5, 3.0])
def test_lanes_that_begin_further_on_come_back(tmp_path: Path, gap_m: float):
    """The roads between them came back as lanes."""
    lanes = (
        straight_lane(1, (0, 0), (20, 0), successors=(2, 3)),
        straight_lane(2, (20 + gap_m, 0), (40, 0), predecessors=(1,)),
        straight_lane(3, (20 + gap_m, 0.5), (40, 8), predecessors=(1,)),
    )
    scene = replace(two_agents_that_pass(), road_map=RoadMap(lanes=lanes))
    check_roads(scene, written(scene, tmp_path))


def narrow(lane: Lane, width_m: float) -> Lane:
    share = width_m / 3.5
    sides = (lane.centerline + share * (n - lane.centerline) for n in (lane.left, lane.right))  # fmt: skip
    left, right = sides
    return replace(lane, left=left, right=right)


def test_lanes_that_meet_without_a_link_and_narrow_ones_come_back(tmp_path: Path):
    """Links were made, and lanes of less than 0.3 m left out."""
    lanes = (
        straight_lane(1, (0, 0), (20, 0)),
        straight_lane(2, (20, 0), (40, 0)),
        narrow(straight_lane(3, (0, 9), (20, 9), successors=(4,)), 0.2),
        narrow(straight_lane(4, (20, 9), (40, 9), predecessors=(3,)), 0.06),
    )
    scene = replace(two_agents_that_pass(), road_map=RoadMap(lanes=lanes))
    check_roads(scene, written(scene, tmp_path))


def test_roads_that_meet_have_one_heading(tmp_path: Path):
    """Also at the straight end of a short lane whose other end is turned."""
    points = ((0, 0), (10, 0), (13, 0.1), (23, 0.1 + 1 / 3))
    scene = two_agents_that_pass()
    lanes = tuple(
        replace(
            straight_lane(number, start, end, successors=(number + 1,)),
            centerline=np.array([(*start, 0.0), (*end, 0.0)]),
        )
        for number, (start, end) in enumerate(pairwise(points), start=1)
    )
    scene = replace(scene, road_map=RoadMap(lanes=lanes))
    root = etree.parse(written(scene, tmp_path)).getroot()
    pieces = [road.findall("planView/geometry") for road in root.findall("road")]
    for one, other in pairwise(pieces):
        turn = float(other[0].get("hdg")) - float(one[-1].get("hdg"))
        assert abs(turn) <= 1e-3


def test_roads_alone_are_written_without_agents_and_told_losses(tmp_path: Path):
    scenario = open_scenario("roundabout")
    bare = scenario.without_agents(scenario.agents.ids)
    files = write(bare).files
    assert [Path(name).suffix for name in files] == [".xodr", ".csv"]
    assert write(bare).files == files
    assert any(" neighbours" in loss for loss in write(scenario).losses)


def test_heights_are_those_of_the_boundaries(tmp_path: Path):
    """Argoverse 2 has center lines at height 0: all roads were there, and nobody was told."""
    scene = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 5.0)]))
    lanes = tuple(
        replace(
            one,
            left=one.left + np.outer(one.left[:, 0], [0.0, 0.0, 0.02]),
            right=one.right + np.outer(one.right[:, 0], [0.0, 0.0, 0.02]),
        )
        for one in scene.road_map.lanes
    )
    scene = replace(scene, road_map=replace(scene.road_map, lanes=lanes))
    found = open_scenario(written(scene, tmp_path))
    for one in found.road_map.lanes:
        place = one.left[:, 0] + (found.origin_city_m - scene.origin_city_m)[0]
        np.testing.assert_allclose(one.left[:, 2], 0.02 * place, atol=0.02)


def test_lights_of_one_signal_stay_one_without_agents(tmp_path: Path):
    """They were one for each lane: nobody read the controllers of the roads."""
    scenario = with_signals(open_scenario("signalised-junction"))
    bare = replace(scenario.without_agents(scenario.agents.ids), focal_id="")
    found = open_scenario(written(bare, tmp_path))
    assert [(one.signal_id, len(one.lane_ids)) for one in found.signals] == [
        (one.signal_id, len(one.lane_ids)) for one in bare.signals
    ]


def test_lanes_without_length_are_refused():
    scene = two_agents_that_pass()
    lane = replace(scene.road_map.lanes[0], centerline=np.zeros((2, 3)))
    flat = replace(scene, road_map=RoadMap(lanes=(lane,)))
    with pytest.raises(ExportError, match="Lane 1 has no length"):
        write(flat)


def test_kinds_have_categories_and_odd_ids_other_names(tmp_path: Path):
    scenario = open_scenario("roundabout")
    agents = scenario.agents.taken(np.arange(3))
    kinds = (AgentKind.VEHICLE, AgentKind.PEDESTRIAN, AgentKind.CONSTRUCTION)
    agents = replace(agents, ids=("Ego", "$ä", "AV"), kinds=kinds)
    scene = replace(scenario, agents=agents, focal_id="AV")
    path = written(scene, tmp_path)
    check_agents(scene, path)
    root = etree.parse(path.with_suffix(".xosc")).getroot()
    found = {one.get("name"): one[0].tag for one in root.findall(".//ScenarioObject")}
    assert found == {"agent_0": "Vehicle", "agent_1": "Pedestrian", "Ego": "MiscObject"}


def with_signals(scenario: Scenario) -> Scenario:
    """Two signals, one of two lanes; one stops in the middle of its lane."""
    known, steps = scenario.road_map.lane_of, scenario.agents.num_steps
    inside = [n for n, one in known.items() if one.is_intersection][:2]
    outside = next(n for n, one in known.items() if not one.is_intersection)
    states = np.repeat(np.array([0, 1, 3, 2], np.int8), [10, 40, 40, steps - 90])
    signals = (
        Signal(
            signal_id='"a" <b>',
            lane_ids=tuple(inside),
            stop_share=np.zeros(2),
            states=states,
        ),
        Signal(
            signal_id="c",
            lane_ids=(outside,),
            stop_share=np.full(1, 0.5),
            states=np.ones(steps, np.int8),
        ),
    )
    return replace(scenario, signals=signals)


def test_signals_have_lights_and_phases(tmp_path: Path):
    scene = with_signals(open_scenario("crosswalk"))
    path = written(scene, tmp_path)
    check_roads(scene, path)
    places = [
        one.stop_lines_m()[:, 1] + one.origin_city_m for one in (scene, read(path))
    ]
    np.testing.assert_allclose(*places, atol=0.05)
    names, root = lane_names(path), etree.parse(path).getroot()
    states = etree.parse(path.with_suffix(".xosc")).getroot()
    lamps = {"off;off;off": 0, "on;off;off": 1, "off;on;off": 2, "off;off;on": 3}
    for own in scene.signals:
        (control,) = root.xpath("controller[@name=$name]", name=own.signal_id)
        lights = [one.get("signalId", "") for one in control]
        for light, lane in zip(lights, own.lane_ids, strict=True):
            road, number = names[lane]
            (found,) = root.xpath(f"road[@id={road}]/signals/signal[@id={light}]")
            assert found[0].get("fromLane") == found[0].get("toLane") == number
        (control,) = states.xpath(
            "//TrafficSignalController[@name=$name]", name=own.signal_id
        )
        phases = [
            (lamps[phase[0].get("state")], round(float(phase.get("duration")) * 10))
            for phase in control
        ]
        assert np.repeat(*zip(*phases, strict=True)).tolist() == own.states.tolist()
        assert [one.get("trafficSignalId") for one in control[0]] == lights


@pytest.mark.slow
@pytest.mark.oracle
@pytest.mark.real_data
def test_checkers_of_asam_find_nothing(
    oracle: Callable[[str], Oracle],
    av2_scenario_folders: list[Path],
    tmp_path: Path,
):
    """XSDs of OpenDRIVE 1.7 and OpenSCENARIO 1.2, and all rules that have a checker."""
    paths = []
    scenes = map(with_signals, real_scenes(av2_scenario_folders, 26))
    for number, scenario in enumerate(scenes):
        folder = tmp_path / str(number)
        folder.mkdir()
        road = written(scenario, folder)
        paths += [str(road), str(road.with_suffix(".xosc"))]
    answers = oracle("asam").ask("asam_issues.py", paths)
    for path, answer in zip(paths, answers, strict=True):
        assert answer["issues"] == [], path
        assert answer["completed"] >= 17


@pytest.mark.slow
@pytest.mark.oracle
@pytest.mark.real_data
def test_netconvert_reads_the_same_links(
    av2_scenario_folders: list[Path], tmp_path: Path
):
    for scenario in real_scenes(av2_scenario_folders, 26):
        check_netconvert(scenario, written(scenario, tmp_path))


def check_netconvert(scenario: Scenario, path: Path) -> None:
    """SUMO's network of a road network has the scenario's lanes and links."""
    net = netconverted(path)
    edges = [one for one in net.findall("edge") if one.get("function") is None]
    width = {one.get("id"): len(one.findall("lane")) for one in edges}

    def name(edge: str, lane: str) -> Lanes:
        """SUMO counts lanes from the right."""
        return edge.removeprefix("-"), str(int(lane) - width[edge])

    names = {name(edge, str(lane)) for edge in width for lane in range(width[edge])}
    assert names == set(lane_names(path).values())
    assert {
        (
            name(one.get("from"), one.get("fromLane")),
            name(one.get("to"), one.get("toLane")),
        )
        for one in net.findall("connection")
        if not one.get("from").startswith(":")
    } == own_links(scenario, path)


def netconverted(path: Path) -> _Element:
    """SUMO's network of a road network."""
    net = path.with_suffix(".net.xml")
    arguments = ["--opendrive-files", str(path), "-o", str(net)]
    # By default it leaves out lanes for bicycles, and those narrower than 1.8 m.
    arguments += ["--opendrive.import-all-lanes", "--opendrive.min-width", "0.01"]
    run_sumo_tool("netconvert", arguments, path.parent)
    return etree.parse(net).getroot()
