"""ScenarioNet, GPUDrive and tables that the editor writes."""

import csv
import io
import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import shapely

from pd_editor.base.errors import ExportError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M
from pd_editor.scene.formats.registry import formats, writer
from pd_editor.scene.formats.scene_format import WrittenScene
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.signals import Signal, states_at
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import scenario_with, straight_drivers
from tests.scene.formats.agreement import Worst


def written(scenario: Scenario, name: str) -> WrittenScene:
    write = writer(name).write
    assert write is not None
    return write(scenario)


def there_and_back(scenario: Scenario, name: str, folder: Path) -> Scenario:
    for file, data in written(scenario, name).files.items():
        (folder / file).write_bytes(data)
    return open_scenario(folder)


def check_same(scenario: Scenario, name: str, folder: Path) -> Worst:
    worst = Worst()
    found = there_and_back(scenario, name, folder)
    assert found.scenario_id == scenario.scenario_id
    agents, others = scenario.agents, found.agents
    ids = {one: one for one in agents.ids}
    if name == "gpudrive":
        rows = csv.DictReader((folder / "ids.csv").read_text().splitlines())
        ids = {row["agent"]: row["object"] for row in rows}
    ego = EGO_ID if EGO_ID in ids else scenario.focal_id
    later = found.current_step - scenario.current_step
    first = int(agents.is_valid[agents.row_of[ego]].argmax())
    for one, other in ids.items():
        mine = agents.row_of[one]
        if name == "scenarionet" and not agents.is_valid[mine, first:].any():
            continue
        theirs = others.row_of[EGO_ID if one == ego else other]
        np.testing.assert_allclose(others.size_m[theirs], agents.size_m[mine])
        there = np.flatnonzero(others.is_valid[theirs])
        assert len(there)
        steps = there - later
        assert agents.is_valid[mine, steps].all()
        if name == "scenarionet":
            assert len(there) == agents.is_valid[mine, first:].sum()
        place = agents.position_m[mine, steps] + scenario.origin_city_m
        gap = place - others.position_m[theirs, there] - found.origin_city_m
        assert worst.note("position_m", gap) < 1e-6
        turn = agents.heading_rad[mine, steps] - others.heading_rad[theirs, there]
        assert worst.turns(turn) < 1e-4
        speed = agents.velocity_mps[mine, steps] - others.velocity_mps[theirs, there]
        assert worst.note("speed_mps", speed) < 1e-6
    assert len(found.road_map.lanes) == len(scenario.road_map.lanes)
    if name == "scenarionet":
        number = {lane.lane_id: n for n, lane in enumerate(scenario.road_map.lanes, 1)}
        for lane, other in zip(
            scenario.road_map.lanes, found.road_map.lanes, strict=True
        ):
            expected = {number[one] for one in lane.successors if one in number}
            assert set(number.values()).intersection(other.successors) == expected
    for lane, other in zip(scenario.road_map.lanes, found.road_map.lanes, strict=True):
        lines = [
            shapely.LineString(one.centerline_m + scene.origin_city_m)
            for one, scene in ((lane, scenario), (other, found))
        ]
        gap = lines[0].hausdorff_distance(lines[1])
        assert worst.note("center_m", gap) < 0.05
    return worst


@pytest.mark.parametrize("name", ["scenarionet", "gpudrive"])
@pytest.mark.parametrize("demo", ["roundabout", "crosswalk"])
def test_a_demo_comes_back_as_it_was(demo: str, name: str, tmp_path: Path):
    check_same(open_scenario(demo), name, tmp_path)


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["scenarionet", "gpudrive"])
def test_real_scenes_come_back_as_they_were(
    name: str, av2_scenario_folders: list[Path], tmp_path: Path
):
    for number, folder in enumerate(av2_scenario_folders[::26]):
        own = tmp_path / str(number)
        own.mkdir()
        check_same(open_scenario(folder), name, own)


@pytest.mark.parametrize("name", ["scenarionet", "gpudrive"])
def test_a_scene_without_an_agent_is_refused(name: str):
    scenario = open_scenario("roundabout")
    with pytest.raises(ExportError, match="neither ego nor focal agent"):
        written(scenario.without_agents(scenario.agents.ids), name)


@pytest.mark.parametrize("gone", [20, 49])
def test_a_data_set_begins_with_the_ego(gone: int, tmp_path: Path):
    """MetaDrive's replay ended at once where the ego of a filled scene came later.

    Where it came with the current step, that was 3 s later when the file was read.
    """
    scenario = signalled()
    agents = scenario.agents
    is_valid = agents.is_valid.copy()
    is_valid[agents.row_of[EGO_ID], :gone] = False
    is_valid[agents.row_of[agents.ids[-1]], 15:] = False
    agents = replace(agents, is_valid=is_valid, observed=agents.observed & is_valid)
    check_same(late := replace(scenario, agents=agents), "scenarionet", tmp_path)
    (path,) = tmp_path.glob("sd_*.pkl")
    found = pickle.loads(path.read_bytes())
    assert found["tracks"][found["metadata"]["sdc_id"]]["state"]["valid"][0]
    assert found["metadata"]["current_time_index"] == scenario.current_step - gone
    (light, *_) = found["dynamic_map_states"].values()
    assert len(light["state"]["object_state"]) == found["length"] == 110 - gone
    told = f"The first {gone} steps, when the ego is not there."
    assert told in written(late, "scenarionet").losses


def signalled() -> Scenario:
    """A demo with a signal at the beginning of a lane and the end of another."""
    scenario = open_scenario("signalised-junction")
    inside = next(one for one in scenario.road_map.lanes if one.is_intersection)
    steps = np.arange(scenario.time_axis.num_steps)
    signal = Signal(
        signal_id="one",
        lane_ids=(inside.lane_id, inside.predecessors[0]),
        stop_share=np.array([0.0, 0.9]),
        states=np.clip(steps // 25, 0, 3).astype(np.int8),
    )
    return replace(scenario, signals=(signal,))


@pytest.mark.parametrize("name", ["scenarionet", "gpudrive", "commonroad"])
def test_signals_come_back_bent_as_the_road_is(name: str, tmp_path: Path):
    flat = signalled()
    term = WarpTerm(kind="ripple-road", power=2.0, length_m=40.0, border_m=0.0)
    away = RigidMotion(x_m=-200.0, y_m=0.0, rotation_rad=0.0)
    for scenario in (flat, warp_scenario(flat, RoadWarp(anchor=away, terms=(term,)))):
        folder = tmp_path / str(scenario.is_warped)
        folder.mkdir()
        found = there_and_back(scenario, name, folder)
        stops = found.stop_lines_m()[:, 1] + found.origin_city_m
        expected = scenario.stop_lines_m()[:, 1] + scenario.origin_city_m
        np.testing.assert_allclose(stops, expected, atol=0.2)
        later = found.current_step - scenario.current_step
        for row in range(len(scenario.time_axis.times_s())):
            if name == "gpudrive" and not -10 <= row - scenario.current_step <= 60:
                continue
            (theirs,) = set(states_at(found.signals, row + later).values())
            assert theirs == scenario.signals[0].states[row]


def test_formats_without_signals_tell_so():
    scenario = signalled()
    for name in ("av2", "tables"):
        (told,) = written(scenario, name).losses
        assert told.startswith("Traffic signals and their states")
        plain = written(replace(scenario, signals=()), name).losses
        assert "signal" not in " ".join(plain)


@pytest.mark.parametrize("name", ["scenarionet", "gpudrive", "sumo"])
def test_short_gaps_and_the_focal_agent_of_a_scene_without_future_come_back(
    name: str, tmp_path: Path
):
    """Up to three steps were filled, and another agent was the focal one."""
    scenario = signalled()
    agents, now = scenario.agents, scenario.current_step
    is_valid = agents.is_valid.copy()
    is_valid[:, now + 1 :] = False
    other = next(
        row
        for row in np.flatnonzero(is_valid[:, now - 9 : now + 1].all(axis=1)).tolist()
        if agents.ids[row] not in (EGO_ID, scenario.focal_id)
    )
    is_valid[other, now - 3] = False
    agents = replace(agents, is_valid=is_valid, observed=agents.observed & is_valid)
    name_of = agents.ids[other]
    there_of = is_valid[other, now - 9 : now + 1]
    scene = replace(scenario, agents=agents, focal_id=name_of)
    found = there_and_back(scene, name, tmp_path)
    at = found.agents.position_m[:, found.current_step] + found.origin_city_m
    place = agents.position_m[other, now] + scenario.origin_city_m
    row = int(np.hypot(*(at - place).T).argmin())
    steps = slice(found.current_step - 9, found.current_step + 1)
    if name != "sumo":
        assert found.focal_id == found.agents.ids[row]
        np.testing.assert_array_equal(found.agents.is_valid[row, steps], there_of)
    else:
        assert found.agents.is_valid[row].sum() == is_valid[other].sum()


@pytest.mark.parametrize("step_s", [0.04, 0.05, 0.2])
def test_gpudrive_gets_scenes_of_other_rates_at_its_own(step_s: float, tmp_path: Path):
    """All agents drove twice as fast, or half."""
    axis = TimeAxis(step_s=step_s).lasting(110)
    states = [(0.0, 0.0, 0.0, 10.0), (-30.0, 3.5, 0.0, 5.0)]
    scene = scenario_with(straight_drivers(states, time_axis=axis))
    scene = replace(scene, time_axis=axis)
    found = there_and_back(scene, "gpudrive", tmp_path)
    agents = found.agents
    for row, speed in enumerate((10.0, 5.0)):
        there = np.flatnonzero(agents.is_valid[row])
        way = np.ptp(agents.position_m[row, there, 0])
        assert len(there) == 11 + min(80, round(60 * step_s * 10))
        assert way == pytest.approx(speed * 0.1 * (len(there) - 1), abs=1e-6)


def test_gpudrive_files_of_made_up_maps_open(tmp_path: Path):
    """Their lights are an empty list."""
    files = written(open_scenario("roundabout"), "gpudrive").files
    content = json.loads(files["roundabout.json"])
    content["tl_states"] = []
    content["metadata"]["sdc_track_index"] = -1
    (tmp_path / "map.json").write_text(json.dumps(content))
    assert not open_scenario(tmp_path / "map.json").signals


def test_tables_hold_every_state_once():
    scenario = open_scenario("roundabout")
    files = written(scenario, "tables").files
    table = pq.read_table(io.BytesIO(files["tracks.parquet"])).to_pydict()
    assert len(table["agent"]) == scenario.agents.is_valid.sum()
    row = scenario.agents.row_of[table["agent"][7]]
    place = scenario.agents.position_m[row, table["step"][7]] + scenario.origin_city_m
    assert (table["x_m"][7], table["y_m"][7]) == tuple(place.tolist())
    rows = list(csv.DictReader(io.StringIO(files["tracks.csv"].decode())))
    assert [one["agent"] for one in rows] == table["agent"]
    lanes = list(csv.DictReader(io.StringIO(files["lanes.csv"].decode())))
    assert {int(one["lane"]) for one in lanes} == set(scenario.road_map.lane_of)


@pytest.mark.slow
def test_equal_scenes_have_equal_files():
    for kind in formats().values():
        if kind.write is not None:
            one, other = (kind.write(open_scenario("queue")) for _ in range(2))
            assert one.files == other.files, kind.name


def test_boxes_are_as_high_as_on_the_screen(tmp_path: Path):
    """Every box was 1.6 m high: people and buses, too."""
    scenario = open_scenario("bus-stop")
    kinds = dict(zip(scenario.agents.ids, scenario.agents.kinds, strict=True))
    files = written(scenario, "gpudrive").files
    content = json.loads(files[f"{scenario.scenario_id}.json"])
    rows = csv.DictReader(files["ids.csv"].decode().splitlines())
    heights = {
        kinds[row["agent"]]: content["objects"][int(row["object"])]["height"]
        for row in rows
    }
    assert len(set(heights.values())) > 1
    assert heights == {kind: DEFAULT_HEIGHT_M[kind] for kind in heights}
