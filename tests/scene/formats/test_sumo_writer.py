"""Scenes written as SUMO networks: by SUMO's own tools, and back again."""

import csv
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sumolib

from pd_editor.base.installed_files import demo_names
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.synthesis.sumo.sumo_tools import sumo_tool
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.registry import writer
from pd_editor.scene.formats.sumo_writer import write
from pd_editor.scene.road_map import LaneKind
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
        lane.getID(): {one.getToLane().getID() for one in lane.getOutgoing()}
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
    assert write(scene).losses[-1].startswith("1 signals of lanes that lead nowhere")
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
