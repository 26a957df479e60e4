"""Scenes written as SUMO networks: by SUMO's own tools, and back again."""

import csv
import subprocess
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity
import sumolib
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.installed_files import demo_names
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.synthesis.sumo.sumo_tools import sumo_tool
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.registry import writer
from pd_editor.scene.formats.sumo_writer import write
from pd_editor.scene.road_map import Lane, LaneKind
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal
from tests.scene.formats.agreement import Worst

DEMO = "signalised-junction"


def written(scenario: Scenario, folder: Path) -> tuple[Path, dict[str, str]]:
    """The net file, and ids in it by ours."""
    format_ = writer("sumo")
    assert format_.write is not None
    result = format_.write(scenario)
    for name, content in result.files.items():
        (folder / name).write_bytes(content)
    rows = csv.reader(result.files["ids.csv"].decode().splitlines()[1:])
    return folder / f"{scenario.scenario_id}.net.xml", dict(tuple(row) for row in rows)


def links_of(scenario: Scenario, ids: dict[str, str]) -> dict[str, set[str]]:
    known = scenario.road_map.lane_of
    return {
        ids[f"lane {one.lane_id}"]: {
            ids[f"lane {after}"] for after in one.successors if after in known
        }
        for one in known.values()
    }


def check(scenario: Scenario, folder: Path) -> Worst:
    """Graph and lanes by sumolib, all by our reader, routes by sumo."""
    net_file, ids = written(scenario, folder)
    known, worst = scenario.road_map.lane_of, Worst()
    net = sumolib.net.readNet(str(net_file), withInternal=True)
    lanes = [lane for edge in net.getEdges() for lane in edge.getLanes()]
    graph = {
        lane.getID(): {
            one.getViaLaneID() or one.getToLane().getID() for one in lane.getOutgoing()
        }
        for lane in lanes
    }
    assert graph == links_of(scenario, ids)
    ours = {other: known[int(one[5:])] for one, other in ids.items() if "lane" in one}
    for lane in lanes:
        own = ours[lane.getID()].centerline_m + scenario.origin_city_m
        assert worst.note("center_m", np.subtract(lane.getShape(), own)) < 1e-3
    back = open_scenario(net_file)
    names = dict(zip([one.lane_id for one in back.road_map.lanes],
                     [lane.getID() for lane in lanes], strict=True))  # fmt: skip
    for one in back.road_map.lanes:
        own = ours[names[one.lane_id]]
        assert {names[after] for after in one.successors} == graph[names[one.lane_id]]
        assert one.kind is own.kind
    worst |= same_agents(scenario, back, ids)
    done = subprocess.run(
        [str(sumo_tool("sumo")), "-c", str(net_file).replace(".net.xml", ".sumocfg"),
         "--no-step-log"],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert (done.returncode, "Error" in done.stderr) == (0, False), done.stderr
    return worst


def same_agents(scenario: Scenario, back: Scenario, ids: dict[str, str]) -> Worst:
    one, two, worst = scenario.agents, back.agents, Worst()
    there = one.is_valid.any(axis=1)
    rows = two.rows(ids[f"agent {name}"] for name in np.array(one.ids)[there])
    steps = slice(0, one.num_steps)
    shift = back.current_step - scenario.current_step
    assert shift == 0
    valid = one.is_valid[there]
    np.testing.assert_array_equal(two.is_valid[rows][:, steps], valid)
    place = (one.position_m + scenario.origin_city_m)[there][valid]
    its = (two.position_m + back.origin_city_m)[rows][:, steps][valid]
    assert worst.note("position_m", its - place) < 1e-3
    turn = two.heading_rad[rows][:, steps][valid] - one.heading_rad[there][valid]
    assert worst.turns(turn) < 0.1
    speed = two.velocity_mps[rows][:, steps][valid] - one.velocity_mps[there][valid]
    assert worst.note("speed_mps", speed) < 0.05
    np.testing.assert_allclose(two.size_m[rows], one.size_m[there], atol=1e-3)
    assert [two.kinds[row] for row in rows] == [
        kind for kind, is_there in zip(one.kinds, there, strict=True) if is_there
    ]
    return worst


def crossings(scenario: Scenario) -> list[tuple[tuple[Lane, Lane, Lane], ...]]:
    """Pairs of lanes that cross in a junction, each with those before and after it."""
    known = scenario.road_map.lane_of
    before: dict[int, list[int]] = {}
    for lane in known.values():
        for after in set(lane.successors) & known.keys():
            before.setdefault(after, []).append(lane.lane_id)
    ways = []
    for lane in known.values():
        behind, ahead = before.get(lane.lane_id, []), {*lane.successors} & known.keys()
        if lane.is_intersection and len(behind) == len(ahead) == 1:
            ways.append((known[behind[0]], lane, known[min(ahead)]))
    lines = [shapely.LineString(way[1].centerline_m) for way in ways]
    return [
        (ways[n], ways[m])
        for n, m in shapely.STRtree(lines).query(np.array(lines, object), "crosses").T
        if n < m and not {*ways[n]} & {*ways[m]}
    ]


def closest_m(
    net_file: Path, ids: dict[str, str], ways: tuple[tuple[Lane, Lane, Lane], ...]
) -> float:
    """Least gap of two cars that would be where their lanes cross at the same time.

    They drive 8 m/s at most. inf: their lanes are too short for it.
    """
    lines = [shapely.LineString(way[1].centerline_m) for way in ways]
    point = shapely.get_geometry(lines[0].intersection(lines[1]), 0)
    length = [shapely.LineString(way[0].centerline_m).length for way in ways]
    place = [a + line.project(point) for a, line in zip(length, lines, strict=True)]
    start = [one - min(place) + 5.0 for one in place]
    brakes = min(a - b for a, b in zip(length, start, strict=True)) > 12.0
    if not brakes or {one.kind for way in ways for one in way} != {LaneKind.VEHICLE}:
        return np.inf
    cars = []
    for way, at in zip(ways, start, strict=True):
        names = [ids[f"lane {one.lane_id}"] for one in way]
        edges = [one.rpartition("_")[0] for one in names if one[0] != ":"]
        cars.append(
            f'<vehicle id="{len(cars)}" type="car" depart="0" departPos="{at}" '
            f'departLane="{names[0].rpartition("_")[2]}" departSpeed="8">'
            f'<route edges="{" ".join(edges)}"/></vehicle>'
        )
    routes, driven = (net_file.with_name(f"two.{one}.xml") for one in ("rou", "fcd"))
    car = '<vType id="car" length="4" width="1.8" maxSpeed="8" sigma="0"/>'
    routes.write_text(f"<routes>{car}{''.join(cars)}</routes>")
    subprocess.run(
        [str(sumo_tool("sumo")), "-n", str(net_file), "-r", str(routes), "--end", "40",
         "--step-length", "0.1", "--fcd-output", str(driven), "--no-step-log"],
        check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    gaps = [np.inf]
    for step in etree.parse(driven).iterfind("timestep"):
        boxes = [car_box(one.attrib) for one in step]
        gaps += [boxes[0].distance(boxes[1])] if len(boxes) == 2 else []
    return min(gaps)


def car_box(car: Mapping[str, str]) -> shapely.Polygon:
    """Box of a car of 4 m, whose place is that of its front."""
    x, y, angle = (float(car[key]) for key in ("x", "y", "angle"))
    box = shapely.affinity.rotate(
        shapely.box(-0.9, -4.0, 0.9, 0.0), -angle, origin=(0.0, 0.0)
    )
    return shapely.affinity.translate(box, x, y)


def check_no_overlap(scenario: Scenario, folder: Path, at_most: int) -> int:
    """Number of crossings where two cars drove; none of them touched."""
    net_file, ids = written(scenario, folder)
    gaps = (closest_m(net_file, ids, ways) for ways in crossings(scenario))
    found = list(islice(filter(np.isfinite, gaps), at_most))
    assert min(found, default=1.0) > 0.1, np.round(found, 2)
    return len(found)


@pytest.mark.parametrize("name", ["bus-stop", "winding-street"])
def test_cars_on_lanes_that_cross_wait_for_each_other(tmp_path: Path, name: str):
    """They drove through each other."""
    assert check_no_overlap(open_scenario(name), tmp_path, 8) == 8


@pytest.mark.slow
@pytest.mark.oracle
def test_cars_on_lanes_that_cross_wait_in_real_scenes(
    tmp_path: Path, av2_scenario_folders: list[Path]
):
    scenes = map(open_scenario, av2_scenario_folders)
    assert sum(check_no_overlap(one, tmp_path, 12) for one in scenes) > 20


@pytest.mark.parametrize("name", demo_names())
def test_a_demo_is_the_same_for_sumolib_for_sumo_and_back_again(
    tmp_path: Path, name: str
):
    check(open_scenario(name), tmp_path)


@pytest.mark.slow
@pytest.mark.oracle
def test_real_scenes_are_the_same_for_all(
    tmp_path: Path, av2_scenario_folders: list[Path]
):
    for number, folder in enumerate(av2_scenario_folders):
        there = tmp_path / str(number)
        there.mkdir()
        check(open_scenario(folder), there)


def test_crosswalks_and_paved_ground_come_back(tmp_path: Path):
    scenario = open_scenario(DEMO)
    back = open_scenario(written(scenario, tmp_path)[0])
    assert len(back.road_map.crosswalks) == len(scenario.road_map.crosswalks)
    for lane, own in zip(
        sorted(one.is_intersection for one in back.road_map.lanes),
        sorted(one.is_intersection for one in scenario.road_map.lanes),
        strict=True,
    ):
        assert lane == own


def test_vehicles_on_lanes_that_are_not_for_them_have_no_route(tmp_path: Path):
    """A car in a bus lane was a route that sumo refused, where no other edge followed."""
    scenario = open_scenario(DEMO)
    road_map = scenario.road_map
    lanes = tuple(replace(one, kind=LaneKind.BUS) for one in road_map.lanes)
    check(replace(scenario, road_map=replace(road_map, lanes=lanes)), tmp_path)


def test_signals_come_back_and_run_in_sumo(tmp_path: Path):
    """At the start of a lane, at the end of another one, and where no lane leads on."""
    scenario = open_scenario(DEMO)
    known, steps = scenario.road_map.lane_of, scenario.agents.num_steps
    first = [n for n, one in known.items() if known.keys() & {*one.predecessors}]
    inside = [n for n in first if known[n].is_intersection]
    before = next(
        n
        for n, one in known.items()
        if not one.is_intersection and known.keys() & {*one.successors}
        if inside[0] not in one.successors
    )
    dead_end = next(
        n for n, one in known.items() if not known.keys() & {*one.successors}
    )
    states = np.repeat(np.array([0, 1, 3, 2], np.int8), [10, 40, 40, steps - 90])
    signals = (
        Signal(signal_id='"a"', lane_ids=(inside[0],), stop_share=np.zeros(1), states=states),
        Signal(signal_id="b", lane_ids=(before,), stop_share=np.ones(1), states=states[::-1].copy()),
        Signal(signal_id="c", lane_ids=(dead_end,), stop_share=np.ones(1), states=states.copy()),
    )  # fmt: skip
    scene = replace(scenario, signals=signals)
    check(scene, tmp_path)
    assert "1 signals of lanes that lead nowhere." in write(scene).losses
    net_file, ids = written(scene, tmp_path)
    back = open_scenario(net_file)
    found = {ids_of.partition(":")[0]: n for n, ids_of in enumerate(
        one.signal_id for one in back.signals)}  # fmt: skip
    for own, line in zip(signals[:2], scene.stop_lines_m(), strict=False):
        row = found[ids[f"signal {own.signal_id}"]]
        np.testing.assert_array_equal(back.signals[row].states[:steps], own.states)
        gap = back.stop_lines_m()[:, 1] + back.origin_city_m - line[1]
        assert np.hypot(*(gap - scene.origin_city_m).T).min() < 1e-3


def test_a_zip_of_an_export_keeps_its_motion(tmp_path: Path):
    scenario = open_scenario(DEMO)
    written(scenario, tmp_path)
    path = tmp_path / "scene.zip"
    with zipfile.ZipFile(path, "w") as file:
        for one in tmp_path.glob("*.xml"):
            file.write(one, f"{DEMO}/{one.name}")
    assert len(open_scenario(path).agents) == len(scenario.agents)


def test_vehicles_begin_where_they_are_recorded(tmp_path: Path):
    """SUMO's first states, of the vehicles that it starts at once, are ours."""
    scenario = open_scenario(DEMO)
    net_file, ids = written(scenario, tmp_path)
    found = tmp_path / "driven.fcd.xml"
    subprocess.run(
        [str(sumo_tool("sumo")), "-c", str(net_file).replace(".net.xml", ".sumocfg"),
         "--fcd-output", str(found), "--no-step-log", "--precision", "4"],
        check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    (tmp_path / f"{scenario.scenario_id}.fcd.xml").unlink()
    found.rename(tmp_path / f"{scenario.scenario_id}.fcd.xml")
    driven, agents = open_scenario(net_file), scenario.agents
    near = []
    for name in driven.agents.ids:
        own = {other: one[6:] for one, other in ids.items() if "agent" in one}[name]
        row, its = agents.row_of[own], driven.agents.row_of[name]
        if not (agents.is_valid[row, 0] and driven.agents.is_valid[its, 0]):
            continue
        place = driven.agents.position_m[its, 0] + driven.origin_city_m
        gap = place - agents.position_m[row, 0] - scenario.origin_city_m
        near.append(float(np.hypot(*gap)))
    assert len(near) >= 3
    assert np.median(near) < 1.5


def test_ids_that_sumo_refuses_are_told_in_the_table(tmp_path: Path):
    scenario = open_scenario(DEMO)
    odd = ('a "b" <c>', "x;y", "d|\u00e9", "'&'")
    agents = replace(scenario.agents, ids=(*odd, *scenario.agents.ids[len(odd) :]))
    check(replace(scenario, agents=agents, focal_id=agents.ids[0]), tmp_path)


def test_a_scene_without_agents_and_static_objects_can_be_written(tmp_path: Path):
    scenario = open_scenario(DEMO)
    agents = scenario.agents.taken(np.arange(3))
    kinds = (AgentKind.CONSTRUCTION, AgentKind.UNKNOWN, AgentKind.RIDERLESS_BICYCLE)
    check(replace(scenario, agents=replace(agents, kinds=kinds)), tmp_path)
    empty = replace(scenario, agents=agents.taken(np.arange(0)), focal_id="")
    assert not len(open_scenario(written(empty, tmp_path)[0]).agents)
