import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from assets.demos.draw_demos import DEMOS, draw_demos
from pd_editor.av2_io.read import read_scenario
from pd_editor.metrics.collision import first_overlap
from pd_editor.metrics.off_road import off_road
from pd_editor.metrics.scene_warnings import scene_warnings
from pd_editor.scene.agent_kind import AgentCategory, AgentKind
from pd_editor.scene.scenario import EGO_ID

FOLDER = Path(__file__).parent.parent / "assets" / "demos"
ALL_STEPS = np.arange(110)


@pytest.fixture(scope="module", params=sorted(DEMOS))
def demo(request):
    return read_scenario(FOLDER / request.param)


def test_it_is_complete(demo):
    agents = demo.agents
    assert agents.is_valid.all()
    assert demo.current_step == 50
    assert EGO_ID in agents.row_of
    focal = agents.row_of[demo.focal_id]
    assert agents.categories[focal] == AgentCategory.FOCAL
    assert agents.has_known_size.all()


def test_focal_agent_turns(demo):
    heading = demo.agents.heading_rad[demo.agents.row_of[demo.focal_id]]
    assert np.ptp(np.unwrap(heading)[demo.current_step :]) > 0.8


def test_nobody_overlaps_anybody_ever(demo):
    pairs, _ = first_overlap(demo.agents, ALL_STEPS)
    assert len(pairs) == 0
    assert scene_warnings(demo, with_future=True) == ()


def test_everybody_is_on_the_road(demo):
    found = off_road(demo, ALL_STEPS)
    assert found.share() == 0
    assert (found.num_corners[found.is_judged] == 0).mean() > 0.98


def test_motion_is_physical(demo):
    agents = demo.agents
    speed = agents.speed_mps()
    acceleration = np.diff(speed, axis=1) / 0.1
    assert acceleration.min() > -4.5
    assert acceleration.max() < 2.5
    jerk = np.diff(acceleration, axis=1) / 0.1
    assert np.abs(jerk).max() < 25
    drives = ~agents.kind_mask([AgentKind.PEDESTRIAN])
    turn = np.diff(np.unwrap(agents.heading_rad[drives], axis=1), axis=1) / 0.1
    lateral = np.abs(turn) * speed[drives][:, 1:]
    assert lateral.max() < 3.5
    moved = np.diff(agents.position_m, axis=1) / 0.1
    mean = (agents.velocity_mps[:, 1:] + agents.velocity_mps[:, :-1]) / 2
    np.testing.assert_allclose(moved, mean, atol=0.15)
    along = np.stack([np.cos(agents.heading_rad), np.sin(agents.heading_rad)], axis=-1)
    sideways = np.abs(
        along[..., 0] * agents.velocity_mps[..., 1]
        - along[..., 1] * agents.velocity_mps[..., 0]
    )
    assert sideways.max() < 0.5


def test_lanes_connect(demo):
    lane_of = demo.road_map.lane_of
    for lane in demo.road_map.lanes:
        assert lane.successors or not lane.is_intersection
        for name in lane.successors:
            after = lane_of[name]
            assert lane.lane_id in after.predecessors
            gap = np.linalg.norm(lane.centerline_m[-1] - after.centerline_m[0])
            assert gap < 0.1
            before = lane.centerline_m[-1] - lane.centerline_m[-2]
            ahead = after.centerline_m[1] - after.centerline_m[0]
            cosine = before @ ahead / np.linalg.norm(before) / np.linalg.norm(ahead)
            assert cosine > np.cos(0.2)
        for name, mine, theirs in (
            (lane.left_neighbor, "left_m", "right_m"),
            (lane.right_neighbor, "right_m", "left_m"),
        ):
            if name is not None:
                edge = getattr(lane_of[name], theirs)[-1]
                assert np.linalg.norm(getattr(lane, mine)[-1] - edge) < 0.1


def test_it_is_small(demo):
    files = list((FOLDER / demo.scenario_id).iterdir())
    assert sum(path.stat().st_size for path in files) <= 400_000


def test_the_signals_change_in_the_clip():
    demo = read_scenario(FOLDER / "signalised-junction")
    speed = demo.agents.speed_mps()
    step = demo.current_step
    starts = (speed[:, : step + 1].max(axis=1) == 0) & (speed[:, -1] > 2)
    stops = (speed[:, 0] > 8) & (speed[:, -1] < 0.5)
    assert starts[demo.agents.kind_mask([AgentKind.VEHICLE])].sum() >= 4
    assert stops.sum() >= 4
    kinds = set(demo.agents.kinds)
    assert {AgentKind.BUS, AgentKind.MOTORCYCLIST, AgentKind.CYCLIST} <= kinds


def test_the_script_draws_the_committed_files(tmp_path):
    draw_demos(tmp_path)
    for path in sorted(tmp_path.rglob("*.*")):
        committed = FOLDER / path.relative_to(tmp_path)
        if path.suffix == ".json":
            assert json.loads(path.read_text()) == json.loads(committed.read_text())
            continue
        # Parquet bytes name the library's version; the rows are what must be equal.
        drawn, kept = pq.read_table(path), pq.read_table(committed)
        assert drawn.column_names == kept.column_names
        for column in drawn.column_names:
            mine, theirs = drawn[column].to_numpy(), kept[column].to_numpy()
            if mine.dtype == float:
                np.testing.assert_allclose(mine, theirs, atol=2e-4)
            else:
                np.testing.assert_array_equal(mine, theirs)


@pytest.mark.slow
def test_the_script_draws_the_same_bytes_again(tmp_path):
    draw_demos(tmp_path / "first")
    draw_demos(tmp_path / "second")
    for path in sorted((tmp_path / "first").rglob("*.*")):
        other = tmp_path / "second" / path.relative_to(tmp_path / "first")
        assert path.read_bytes() == other.read_bytes()
