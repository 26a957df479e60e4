from dataclasses import replace

import numpy as np
import pytest

from pd_editor.experiments.training.augmentation import augmented, crawling_share
from pd_editor.experiments.training.run_config import Augmentation
from pd_editor.generation.features.scene_features import scene_features
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, Activity, AgentCategory
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.road_map import RoadMap
from tests.builders import empty_tracks, scenario_with, straight_drivers, two_lane_road

NOTHING = Augmentation(
    warp_share=0.0,
    jitter_m=0.0,
    lanes_dropped_share=0.0,
    agents_dropped_share=0.0,
    center_m=0.0,
)
ROW = [(-80.0 + 10 * place, 0.0, 0.0, 5.0) for place in range(25)]


def road_of_drivers():
    return scenario_with(straight_drivers(ROW))


def test_switched_off_only_those_not_here_are_left_out(av2_scenario_folders):
    scenario = read_scenario(av2_scenario_folders[0])
    found = augmented(scenario, NOTHING, np.random.default_rng(0), hides_agents=False)
    assert found.road_map.lanes == scenario.road_map.lanes
    agents, step = scenario.agents, scenario.current_step
    here = agents.is_valid[:, step] & agents.kind_mask(ROAD_USER_KINDS)
    assert found.agents.ids == tuple(np.array(agents.ids)[here])
    one, two = scene_features(scenario), scene_features(found)
    for name in ("agent_pose", "piece_pose", "candidate_m", "future_m"):
        assert np.array_equal(getattr(one, name), getattr(two, name))


def test_the_same_chance_gives_the_same():
    scenario = road_of_drivers()
    one, two, other = (
        augmented(
            scenario, Augmentation(), np.random.default_rng(seed), hides_agents=True
        )
        for seed in (5, 5, 6)
    )
    assert one.agents.ids == two.agents.ids
    assert np.array_equal(one.agents.position_m, two.agents.position_m)
    lines = [scene.road_map.polylines for scene in (one, two)]
    assert all(np.array_equal(a, b) for a, b in zip(*lines, strict=True))
    assert not np.array_equal(one.road_map.polylines[0], other.road_map.polylines[0])


def test_jitter_moves_the_road_by_as_much_as_is_said():
    scenario = road_of_drivers()
    shift = []
    for seed in range(300):
        jitter = replace(NOTHING, jitter_m=0.3)
        found = augmented(
            scenario, jitter, np.random.default_rng(seed), hides_agents=False
        )
        assert np.array_equal(found.agents.position_m, scenario.agents.position_m)
        gap = found.road_map.polylines[0] - scenario.road_map.polylines[0]
        shift.append(gap[:, :2])
        # Neighbouring lanes move alike: the road stays one.
        gap_beside = found.road_map.polylines[6] - scenario.road_map.polylines[6]
        assert np.abs(gap - gap_beside)[:, :2].max() < 0.8
    assert np.std(shift) == pytest.approx(0.3, rel=0.15)
    assert np.abs(np.mean(shift)) < 0.05


def test_warped_scenes_keep_whom_they_are_about_in_place():
    bent = replace(NOTHING, warp_share=1.0)
    scenario = road_of_drivers()
    bends = 0
    for seed in range(20):
        found = augmented(
            scenario, bent, np.random.default_rng(seed), hides_agents=False
        )
        (row,) = found.agents.rows([scenario.focal_id])
        step = scenario.current_step
        place = scenario.agents.position_m[row, step]
        assert np.allclose(found.agents.position_m[row, step], place)
        bends += np.abs(found.road_map.polylines[0][:, 1]).max() > 0.5
        # Agents lie on their lane before and after.
        seen = scene_features(found)
        pieces = seen.piece_pose[seen.near_pieces[:, 0], :2]
        gap = np.linalg.norm(pieces - seen.agent_pose[:, :2], axis=-1)
        assert np.median(gap) < 6
    assert bends >= 18


def test_shares_are_kept():
    scenario = road_of_drivers()
    warped = sum(
        augmented(
            scenario,
            replace(NOTHING, warp_share=0.3),
            np.random.default_rng(seed),
            hides_agents=False,
        ).applied_warp
        is not None
        for seed in range(300)
    )
    assert 65 <= warped <= 115


def test_the_focal_agent_and_the_ego_stay():
    hiding = replace(NOTHING, agents_dropped_share=1.0)
    scenario = road_of_drivers()
    kept = []
    for seed in range(60):
        found = augmented(
            scenario, hiding, np.random.default_rng(seed), hides_agents=True
        )
        assert scenario.focal_id in found.agents.row_of
        kept.append(len(found.agents))
    assert 10 < np.mean(kept) < 22


def test_parked_agents_are_seen_less_often_off_the_road_and_far_away():
    # A row on the road, and one beside it; the focal agent at the origin sees them.
    row = [(4.0 * place, 0.0, 0.0, 0.0) for place in range(1, 11)]
    beside = [(x, 40.0, 0.0, 0.0) for x, *_ in row]
    tracks = straight_drivers([(0.0, 0.0, 0.0, 5.0), *row, *beside])
    rows = np.arange(1, len(tracks))
    parked = replace(
        tracks.with_rows(rows, activity=np.full(len(rows), Activity.PARKED)),
        categories=(
            AgentCategory.FOCAL,
            *[AgentCategory.FRAGMENT] * len(rows),
        ),
    )
    scenario = scenario_with(parked)
    settings = replace(NOTHING, parked_seen=0.8, parked_off_road_seen=0.3)

    def share_kept(scenario, hides: bool) -> tuple[float, float]:
        kept = np.zeros(len(tracks))
        for seed in range(80):
            random = np.random.default_rng(seed)
            found = augmented(scenario, settings, random, hides_agents=hides)
            kept += [name in found.agents.row_of for name in tracks.ids]
        assert kept[0] == 80
        return kept[1:11].mean() / 80, kept[11:].mean() / 80

    assert share_kept(scenario, True) == pytest.approx((0.8, 0.3), abs=0.08)
    assert share_kept(scenario, False) == (1.0, 1.0)
    far = scenario_with(
        parked.with_rows(rows, position_m=parked.position_m[rows] + [70.0, 0.0])
    )
    on_road, off_road = share_kept(far, True)
    assert on_road < 0.5
    assert off_road < 0.25


def test_lanes_are_left_out():
    dropping = replace(NOTHING, lanes_dropped_share=1.0, lane_dropped=0.5)
    counts = [
        len(
            augmented(
                road_of_drivers(),
                dropping,
                np.random.default_rng(seed),
                hides_agents=False,
            ).road_map.lanes
        )
        for seed in range(100)
    ]
    assert np.mean(counts) == pytest.approx(2, abs=0.3)
    assert len(two_lane_road().lanes) == 4


def test_empty_and_no_road_do_no_harm():
    always = Augmentation(
        warp_share=1.0, lanes_dropped_share=1.0, agents_dropped_share=1.0
    )
    random = np.random.default_rng(0)
    empty = replace(scenario_with(empty_tracks(110)), focal_id="")
    assert not len(augmented(empty, always, random, hides_agents=True).agents)
    no_road = scenario_with(straight_drivers(ROW), RoadMap(lanes=()))
    assert scenario_features_are_finite(
        augmented(no_road, always, random, hides_agents=True)
    )


def scenario_features_are_finite(scenario) -> bool:
    found = scene_features(scenario)
    return all(np.isfinite(values).all() for values in vars(found).values())


@pytest.mark.parametrize(
    ("speeds", "share"),
    [([0.0, 0.4, 1.0, 2.9, 3.1, 9.0], 0.5), ([0.0, 1.0, 2.0], 0.0), ([5.0] * 4, 0.0)],
)
def test_the_share_that_crawls_is_of_moving_vehicles_nearby(speeds, share):
    """With fewer than three that move there is no share; those 200 m away do not count."""
    near = [(10.0 * place, 0.0, 0.0, one) for place, one in enumerate(speeds)]
    far = [(200.0, 0.0, 0.0, 1.0), (-200.0, 0.0, 0.0, 1.0)]
    scenario = scenario_with(straight_drivers([*near, *far]))
    assert crawling_share(scenario, np.zeros(2)) == share
