import io
import json
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import shapely

from assets.make_demos import made_demo, write_sentences
from assets.stories import STORIES
from pd_editor.analysis.findings.check import scene_problems
from pd_editor.analysis.metrics.box_overlaps import first_overlap
from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.base.installed_files import SENTENCES_NAME, demo_names, demo_sentence
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentCategory, AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import check_with_official_loaders, scenario_files
from pd_editor.scene.scenario import EGO_ID
from pd_editor.scene.time_axis import TimeAxis

FOLDER = Path(__file__).parent.parent / "assets" / "demos"
ALL_STEPS = np.arange(110)
NOW = TimeAxis().current_step
STANDING_MPS = 0.3


@cache
def opened(name):
    return read_scenario(FOLDER / name)


@pytest.fixture(params=[story.name for story in STORIES])
def demo(request):
    return opened(request.param)


def of_kind(demo, *kinds):
    return demo.agents.kind_mask(kinds)


def drivers(demo):
    """Vehicles, buses and motorcycles that are not parked."""
    kinds = AgentKind.VEHICLE, AgentKind.BUS, AgentKind.MOTORCYCLIST
    return of_kind(demo, *kinds) & (path_m(demo) > 0.1)


def path_m(demo):
    steps = np.diff(demo.agents.position_m, axis=1)
    return np.linalg.norm(steps, axis=-1).sum(axis=1)


def parked(demo):
    return of_kind(demo, AgentKind.VEHICLE) & (path_m(demo) == 0)


def turn_rad(demo):
    return np.unwrap(demo.agents.heading_rad, axis=1)


def focal_row(demo):
    return demo.agents.row_of[demo.focal_id]


def seen_from(demo, row, step=NOW):
    """Positions of everybody ahead (0) and to the left (1) of an agent at a step."""
    agents = demo.agents
    heading = agents.heading_rad[row, step]
    ahead = np.array([np.cos(heading), np.sin(heading)])
    offset = agents.position_m - agents.position_m[row, step]
    return np.stack([offset @ ahead, offset @ [-ahead[1], ahead[0]]], axis=-1)


def is_near(demo, radius_m):
    away = seen_from(demo, focal_row(demo))[:, NOW]
    return np.linalg.norm(away, axis=-1) < radius_m


def on_crosswalk(demo):
    """Pedestrians who are crossing a street now."""
    rings = [shapely.Polygon(one.outline_m()) for one in demo.road_map.crosswalks]
    x, y = demo.agents.position_m[:, NOW].T
    inside = shapely.contains_xy(shapely.union_all(rings), x, y)
    walks = demo.agents.speed_mps()[:, NOW] > STANDING_MPS
    return of_kind(demo, AgentKind.PEDESTRIAN) & inside & walks


def test_all_demos_have_a_story():
    assert set(demo_names()) == {story.name for story in STORIES}
    assert len(STORIES) == 8


def test_they_are_small():
    files = [path for name in demo_names() for path in (FOLDER / name).iterdir()]
    assert len(files) == 16
    assert sum(path.stat().st_size for path in files) <= 3_000_000


def test_the_readme_says_what_each_shows():
    text = (FOLDER / "README.md").read_text()
    for story in STORIES:
        assert f"| `{story.name}` | {story.sentence} |" in text


def test_the_editor_can_tell_what_each_shows(tmp_path):
    write_sentences(tmp_path)
    told = (tmp_path / SENTENCES_NAME).read_bytes()
    assert (FOLDER / SENTENCES_NAME).read_bytes() == told
    assert [demo_sentence(story.name) for story in STORIES] == [
        story.sentence for story in STORIES
    ]


def test_it_is_complete(demo):
    agents = demo.agents
    assert agents.is_valid.all()
    assert demo.current_step == NOW
    assert EGO_ID in agents.row_of
    assert agents.categories[focal_row(demo)] == AgentCategory.FOCAL
    assert path_m(demo)[focal_row(demo)] > 10
    assert agents.has_known_size.all()


def test_official_readers_accept(demo):
    check_with_official_loaders(FOLDER / demo.scenario_id)


def test_nobody_overlaps_anybody_ever(demo):
    pairs, _ = first_overlap(demo.agents, ALL_STEPS)
    walks = of_kind(demo, AgentKind.PEDESTRIAN)
    assert walks[pairs].all()
    assert scene_problems(demo) == ()


def test_everybody_is_on_the_road(demo):
    agents = demo.agents
    drives = agents.is_valid & agents.kind_mask(LANE_FOLLOWER_KINDS)[:, None]
    assert not is_off_road(demo, agents.position_m[drives]).any()
    corners = agents.at(*np.nonzero(drives)).corners_m()
    assert (~is_off_road(demo, corners).any(axis=1)).mean() > 0.98


def test_motion_is_physical(demo):
    agents = demo.agents
    speed = agents.speed_mps()
    acceleration = np.diff(speed, axis=1) / 0.1
    assert acceleration.min() > -4.5
    assert acceleration.max() < 2.7
    jerk = np.diff(acceleration, axis=1) / 0.1
    assert np.abs(jerk).max() < 25
    drives = ~agents.kind_mask([AgentKind.PEDESTRIAN])
    turn = np.diff(turn_rad(demo)[drives], axis=1) / 0.1
    lateral = np.abs(turn) * speed[drives][:, 1:]
    assert lateral.max() < 4.5
    moved = np.diff(agents.position_m, axis=1) / 0.1
    mean = (agents.velocity_mps[:, 1:] + agents.velocity_mps[:, :-1]) / 2
    np.testing.assert_allclose(moved, mean, atol=0.15)
    along = np.stack([np.cos(agents.heading_rad), np.sin(agents.heading_rad)], axis=-1)
    sideways = np.abs(
        along[..., 0] * agents.velocity_mps[..., 1]
        - along[..., 1] * agents.velocity_mps[..., 0]
    )
    assert sideways.max() < 0.55


def test_lanes_connect(demo):
    lane_of = demo.road_map.lane_of
    for lane in demo.road_map.lanes:
        assert lane.successors or not lane.is_intersection
        for after in (lane_of[name] for name in lane.successors if name in lane_of):
            assert lane.lane_id in after.predecessors
            gap = np.linalg.norm(lane.centerline_m[-1] - after.centerline_m[0])
            assert gap < 0.1
            before = lane.centerline_m[-1] - lane.centerline_m[-2]
            ahead = after.centerline_m[1] - after.centerline_m[0]
            cosine = before @ ahead / np.linalg.norm(before) / np.linalg.norm(ahead)
            assert cosine > np.cos(0.6)  # recorded maps have up to 0.97
        for name, mine, theirs in (
            (lane.left_neighbor, "left_m", "right_m"),
            (lane.right_neighbor, "right_m", "left_m"),
        ):
            if name in lane_of:
                edge = getattr(lane_of[name], theirs)[-1]
                assert np.linalg.norm(getattr(lane, mine)[-1] - edge) < 0.4


def test_the_signals_change_in_the_clip():
    demo = opened("signalised-junction")
    speed = demo.agents.speed_mps()
    starts = (speed[:, : NOW + 1].max(axis=1) < STANDING_MPS) & (speed[:, -1] > 2)
    stops = (speed[:, 0] > 6) & (speed[:, -1] < 0.5)
    assert (starts & drivers(demo)).sum() >= 4
    assert (stops & drivers(demo)).sum() >= 3
    kinds = set(demo.agents.kinds)
    assert {AgentKind.BUS, AgentKind.PEDESTRIAN, AgentKind.CYCLIST} <= kinds
    heading = turn_rad(demo)[focal_row(demo)]
    assert np.ptp(heading[NOW:]) > 0.8


def test_vehicles_circulate_and_give_way_at_the_roundabout():
    demo = opened("roundabout")
    turn, speed = turn_rad(demo), demo.agents.speed_mps()
    near = drivers(demo) & is_near(demo, 50)
    rate = turn[:, NOW + 10] - turn[:, NOW - 10]
    assert (near & (rate > 0.25)).sum() >= 3
    waits = (speed[:, :NOW].min(axis=1) < 1) & (speed[:, -1] > 2.5)
    assert (near & waits & (np.ptp(turn, axis=1) > 0.5)).sum() >= 2
    assert np.ptp(turn[focal_row(demo)]) > 1.2


def test_somebody_joins_a_divided_road():
    demo = opened("merge")
    row = focal_row(demo)
    # Whoever was two lanes to the left is on the next lane, or on its own, at last.
    before, after = seen_from(demo, row, 0)[:, 0], seen_from(demo, row, 109)[:, 109]
    joined = drivers(demo) & (before[:, 1] > 6) & (np.abs(after[:, 1]) < 4.5)
    assert (joined & (np.abs(after[:, 0]) < 60)).sum() >= 2
    assert (drivers(demo) & is_near(demo, 70)).sum() >= 15
    assert demo.agents.speed_mps()[row].min() > 4


def test_the_street_winds():
    demo = opened("winding-street")
    turn = np.diff(turn_rad(demo)[focal_row(demo)])
    assert turn[turn > 0].sum() > 0.3
    assert -turn[turn < 0].sum() > 0.3
    assert path_m(demo)[focal_row(demo)] > 50
    assert (parked(demo) & is_near(demo, 50)).sum() >= 8
    opposite = np.cos(turn_rad(demo)[:, NOW] - turn_rad(demo)[focal_row(demo), NOW]) < 0
    assert (drivers(demo) & opposite & is_near(demo, 70)).any()


def test_somebody_lets_pedestrians_cross():
    demo = opened("crosswalk")
    row = focal_row(demo)
    speed = demo.agents.speed_mps()[row]
    assert speed[:NOW].max() > 4
    assert speed[NOW - 10 : NOW + 11].min() < 1.5
    assert speed[-1] > 3
    x, y = seen_from(demo, row)[:, NOW].T
    in_front = on_crosswalk(demo) & (x > 2) & (x < 14) & (np.abs(y) < 9)
    assert in_front.sum() >= 1
    assert on_crosswalk(demo).sum() >= 2


def test_a_queue_starts_to_move():
    demo = opened("queue")
    row = focal_row(demo)
    speed = demo.agents.speed_mps()
    stands = drivers(demo) & (speed[:, NOW - 10 : NOW + 1] < STANDING_MPS).all(axis=1)
    x, y = seen_from(demo, row)[:, NOW].T
    in_line = stands & (np.abs(y) < 1.7) & (np.abs(x) < 60)
    assert (in_line & (x > 1)).sum() >= 1
    assert (in_line & (x < -1)).sum() >= 3
    assert (stands & is_near(demo, 60)).sum() >= 10
    assert speed[row, -1] > 2
    assert (in_line & (speed[:, -1] > 2)).sum() >= 4


def test_a_bus_halts_and_is_overtaken():
    demo = opened("bus-stop")
    bus = of_kind(demo, AgentKind.BUS)
    speed = demo.agents.speed_mps()
    halts = bus & (speed[:, NOW - 10 : NOW + 11] < STANDING_MPS).all(axis=1)
    halts &= speed.max(axis=1) > 2.5
    assert halts.any()
    overtakes = np.zeros(len(bus), bool)
    for row in np.flatnonzero(halts):
        x, y = np.moveaxis(seen_from(demo, row), -1, 0)
        overtakes |= (
            (x[:, 0] < -8)
            & (x[:, -1] > 8)
            & (np.abs(y).max(axis=1) < 6)
            & (np.ptp(y, axis=1) > 1.2)
        )
    assert overtakes.any()


def test_downtown_is_dense():
    demo = opened("downtown")
    near = is_near(demo, 70)
    assert (parked(demo) & near).sum() >= 15
    assert (drivers(demo) & near).sum() >= 25
    assert (of_kind(demo, AgentKind.PEDESTRIAN) & near).sum() >= 10
    assert (of_kind(demo, AgentKind.CYCLIST) & near).sum() >= 3
    assert len(demo.road_map.crosswalks) >= 4


@pytest.mark.slow
def test_the_script_makes_the_committed_files_and_the_same_bytes_again():
    story = next(story for story in STORIES if story.name == "crosswalk")
    first, second = (scenario_files(made_demo(story)) for _ in range(2))
    assert first == second
    for name, content in first.items():
        committed = FOLDER / story.name / name
        if name.endswith(".json"):
            assert json.loads(content) == json.loads(committed.read_bytes())
            continue
        # Parquet bytes name the library's version; the rows are what must be equal.
        assert read_rows(content) == read_rows(committed.read_bytes())


def read_rows(content):
    return pq.read_table(io.BytesIO(content)).to_pydict()
