"""CommonRoad files that the editor writes."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.formats.commonroad import read
from pd_editor.scene.formats.commonroad_writer import IDS_NAME, write
from pd_editor.scene.scenario import EGO_ID, Scenario
from tests.scene.formats.agreement import Worst, aside_m

CENTERS_M = 0.05
BOUNDS_M = 0.4
"""Bounds are moved so that the centre line is midway between all of their points."""


def there_and_back(scenario: Scenario, folder: Path) -> tuple[Scenario, dict[str, str]]:
    """The scene read from its own CommonRoad file, and its ids there."""
    written = write(scenario)
    path = folder / f"{scenario.scenario_id}.xml"
    path.write_bytes(written.files[path.name])
    table = io.StringIO(written.files[IDS_NAME].decode())
    ids = {row["agent"]: row["obstacle"] for row in csv.DictReader(table)}
    return read(path), ids


def check_same(scenario: Scenario, folder: Path) -> Worst:
    worst = Worst()
    found, ids = there_and_back(scenario, folder)
    assert found.scenario_id == scenario.scenario_id
    agents, others = scenario.agents, found.agents
    assert set(ids) == set(agents.ids)
    ego = EGO_ID if EGO_ID in agents.row_of else scenario.focal_id
    later = found.current_step - scenario.current_step
    for name, number in ids.items():
        row = agents.row_of[name]
        other = others.row_of[EGO_ID if name == ego else number]
        steps = np.flatnonzero(agents.is_valid[row])
        steps = steps if name != ego else np.array([scenario.current_step])
        if name == ego or (np.diff(steps) == 1).all():
            there = np.flatnonzero(others.is_valid[other]) - later
            assert np.isin(there, steps).all()
            assert len(there) == len(steps)
            steps = there
        place = agents.position_m[row, steps] + scenario.origin_city_m
        gap = place - others.position_m[other, steps + later] - found.origin_city_m
        is_there = others.is_valid[other, steps + later]
        assert worst.note("position_m", gap[is_there]) <= 1e-3
        turn = agents.heading_rad[row, steps] - others.heading_rad[other, steps + later]
        assert worst.turns(turn[is_there]) < 0.1
        speeds = (
            agents.speed_mps()[row, steps],
            others.speed_mps()[other, steps + later],
        )
        assert worst.note("speed_mps", (speeds[0] - speeds[1])[is_there]) <= 0.05
        if name != ego:
            np.testing.assert_allclose(
                others.size_m[other], agents.size_m[row], atol=1e-3
            )
    mine, theirs = scenario.road_map.lane_of, found.road_map.lane_of
    assert mine.keys() == theirs.keys()
    for number, lane in mine.items():
        known = tuple(one for one in lane.successors if one in mine)
        assert set(theirs[number].successors) == set(known)
        assert theirs[number].is_intersection == lane.is_intersection
        assert theirs[number].kind == lane.kind
        shift = found.origin_city_m - scenario.origin_city_m
        for side in ("left_m", "right_m"):
            one, other = getattr(lane, side), getattr(theirs[number], side) + shift
            gap = shapely.LineString(one).hausdorff_distance(shapely.LineString(other))
            assert worst.note("bound_m", gap) <= BOUNDS_M
        one, other = lane.centerline_m, theirs[number].centerline_m + shift
        worst.note("own_center_m", aside_m(one, other))
        gaps = np.concatenate([aside_m(one, other), aside_m(other, one)])
        assert worst.note("center_m", gaps) <= CENTERS_M
    assert len(found.road_map.crosswalks) == len(scenario.road_map.crosswalks)
    return worst


@pytest.mark.parametrize("demo", ["roundabout", "crosswalk", "queue"])
def test_a_demo_comes_back_as_it_was(demo: str, tmp_path: Path):
    check_same(open_scenario(demo), tmp_path)


@pytest.mark.real_data
def test_real_scenes_come_back_as_they_were(
    av2_scenario_folders: list[Path], tmp_path: Path
):
    for folder in av2_scenario_folders[::26]:
        worst = check_same(open_scenario(folder), tmp_path)
        assert worst["own_center_m"] < 0.02


def test_a_scene_without_an_agent_has_no_planning_problem(tmp_path: Path):
    scenario = open_scenario("roundabout")
    bare = replace(scenario.without_agents(scenario.agents.ids), focal_id="")
    written = write(bare)
    assert any("planning problem" in loss for loss in written.losses)
    (tmp_path / "bare.xml").write_bytes(written.files[f"{bare.scenario_id}.xml"])
    again = open_scenario(tmp_path / "bare.xml")
    assert not len(again.agents)
    assert len(again.road_map.lanes) == len(bare.road_map.lanes)


def test_equal_scenes_have_equal_files_and_tell_what_is_lost():
    one, other = (write(open_scenario("roundabout")) for _ in range(2))
    assert one.files == other.files
    assert any("lane markings" in loss for loss in one.losses)
