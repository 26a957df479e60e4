"""Real scenarios, read, written, and read again, with av2's own objects as oracle."""

from pathlib import Path

import numpy as np
import pytest

from pd_editor.scene.av2_io.map_file import read_map
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import check_with_official_loaders
from pd_editor.scene.scenario import Scenario
from tests.scene.av2_io.round_trip import RoundTrip, compare, copy_scenario

pytestmark = pytest.mark.real_data


@pytest.fixture
def few_folders(av2_scenario_folders: list[Path]) -> list[Path]:
    """Six scenarios spread over the splits, with the odd one among them."""
    odd = [path for path in av2_scenario_folders if path.name.startswith("0a1e6f0a")]
    return [*odd, *av2_scenario_folders[:: len(av2_scenario_folders) // 4][:5]]


def assert_equal(result: RoundTrip) -> None:
    assert result.differing_columns == ()
    assert result.differing_map_fields == ()
    assert result.position_error_m < 1e-9
    assert result.map_error_m < 1e-9


def assert_tracks_as_av2_reads_them(scenario: Scenario, folder: Path) -> None:
    from av2.datasets.motion_forecasting.scenario_serialization import (
        load_argoverse_scenario_parquet,
    )

    theirs = load_argoverse_scenario_parquet(next(folder.glob("scenario_*.parquet")))
    agents, axis = scenario.agents, scenario.time_axis
    assert theirs.scenario_id == scenario.scenario_id
    assert theirs.city_name == scenario.city
    assert theirs.focal_track_id == scenario.focal_id
    assert len(theirs.timestamps_ns) == axis.num_steps
    assert theirs.timestamps_ns[0] == axis.start_timestamp_ns
    assert theirs.timestamps_ns[-1] == axis.end_timestamp_ns
    assert {track.track_id for track in theirs.tracks} == set(agents.ids)
    for track in theirs.tracks:
        row = agents.row_of[track.track_id]
        assert agents.kinds[row].value == track.object_type.value
        assert agents.categories[row] == track.category.value
        states = track.object_states
        step = np.array([state.timestep for state in states], int)
        np.testing.assert_array_equal(np.flatnonzero(agents.is_valid[row]), step)
        for ours, name in (
            (agents.observed, "observed"),
            (agents.heading_rad, "heading"),
            (agents.velocity_mps, "velocity"),
        ):
            expected = [getattr(state, name) for state in states]
            np.testing.assert_array_equal(ours[row, step], expected)
        position = agents.position_m[row, step] + scenario.origin_city_m
        expected = np.array([state.position for state in states])
        np.testing.assert_allclose(position, expected, rtol=0, atol=1e-9)


def assert_map_as_av2_reads_it(scenario: Scenario, folder: Path) -> None:
    from av2.map.map_api import ArgoverseStaticMap

    their_map = ArgoverseStaticMap.from_json(next(folder.glob("log_map_archive_*")))
    lift = np.array([*scenario.origin_city_m, 0.0])
    lanes = their_map.vector_lane_segments
    assert list(lanes) == [lane.lane_id for lane in scenario.road_map.lanes]
    for lane in scenario.road_map.lanes:
        other = lanes[lane.lane_id]
        assert lane.kind.value == other.lane_type.value
        assert lane.left_mark.value == other.left_mark_type.value
        assert lane.right_mark.value == other.right_mark_type.value
        assert lane.is_intersection == other.is_intersection
        assert list(lane.successors) == other.successors
        assert list(lane.predecessors) == other.predecessors
        assert lane.left_neighbor == other.left_neighbor_id
        assert lane.right_neighbor == other.right_neighbor_id
        for ours, line in (
            (lane.left, other.left_lane_boundary),
            (lane.right, other.right_lane_boundary),
        ):
            np.testing.assert_allclose(ours + lift, line.xyz, rtol=0, atol=1e-9)
    for area in scenario.road_map.drivable_areas:
        ring = their_map.vector_drivable_areas[area.area_id].xyz[:-1]
        np.testing.assert_allclose(area.boundary + lift, ring, rtol=0, atol=1e-9)
    for crosswalk in scenario.road_map.crosswalks:
        other = their_map.vector_pedestrian_crossings[crosswalk.crosswalk_id]
        for ours, line in (
            (crosswalk.edge1, other.edge1),
            (crosswalk.edge2, other.edge2),
        ):
            np.testing.assert_allclose(ours + lift, line.xyz, rtol=0, atol=1e-9)


def check(folder: Path, out: Path) -> None:
    copy = copy_scenario(folder, out)
    assert_equal(compare(folder, copy))
    check_with_official_loaders(copy)
    for place in (folder, copy):
        scenario = read_scenario(place)
        assert_tracks_as_av2_reads_them(scenario, place)
        assert_map_as_av2_reads_it(scenario, place)


def test_a_few_scenarios_survive_a_round_trip(
    few_folders: list[Path], tmp_path: Path
) -> None:
    assert len(few_folders) == 6
    for folder in few_folders:
        check(folder, tmp_path)


@pytest.mark.slow
def test_all_scenarios_survive_a_round_trip(
    av2_scenario_folders: list[Path], tmp_path: Path
) -> None:
    for folder in av2_scenario_folders:
        check(folder, tmp_path)


def test_every_scenario_is_read_without_a_note(
    av2_scenario_folders: list[Path],
) -> None:
    for folder in av2_scenario_folders:
        scenario = read_scenario(folder)
        assert scenario.current_step == 49
        assert scenario.time_axis.num_steps == 110
        assert scenario.time_axis.step_s == 0.1
        assert scenario.provenance.notes == ()
        focal = scenario.agents.row_of[scenario.focal_id]
        place = scenario.agents.position_m[focal, scenario.current_step]
        assert (np.abs(place) <= 0.5).all()


def test_maps_of_sensor_logs_are_read(av2_root: Path) -> None:
    paths = sorted(av2_root.glob("sensor_logs/*/map/log_map_archive_*.json"))
    assert paths
    for path in paths:
        road_map = read_map(path.read_bytes(), path.name, np.zeros(2))
        for lane in road_map.lanes:
            assert len(lane.centerline) >= 10
            ends = (lane.left[[0, -1]] + lane.right[[0, -1]]) / 2
            np.testing.assert_allclose(lane.centerline[[0, -1]], ends, atol=1e-9)
