from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.findings.check import SceneCheck, scene_findings
from pd_editor.analysis.findings.sample_ranking import (
    MOST_APART_M,
    RANKING_WORDS,
    RANKINGS,
    SampleNumbers,
    distances_m,
    numbers_of,
    ranked,
    spread_pick,
    with_fullness,
)
from pd_editor.editor.commands import traffic_command
from pd_editor.scene.generation import GeneratedTraffic, GenerationRequest
from tests.analysis.findings.builders import finding
from tests.analysis.metrics.traffic_builders import sample_of
from tests.builders import scenario_with, straight_drivers

PLAIN = SampleNumbers(
    num_agents=10,
    num_collisions=0,
    off_road_share=0.0,
    lateral_deviation_m=0.2,
    moving_share=0.5,
    mean_speed_mps=8.0,
    time_to_collision_s=2.0,
    harsh_share=0.0,
)


def paths(*rows: tuple[float, float, float]) -> np.ndarray:
    """Paths along x: start, y, speed."""
    time = 0.1 * np.arange(61)
    return np.stack(
        [np.stack([x + speed * time, np.full(61, y)], axis=-1) for x, y, speed in rows]
    )


def numbers(scenario, ids, position_m) -> SampleNumbers:
    """Numbers of a sample along paths, applied to a scenario."""
    request = GenerationRequest(scenario=scenario, agent_ids=ids)
    traffic = GeneratedTraffic(samples=(sample_of(ids, position_m),), generator="fake")
    after = traffic_command(request, traffic).apply(scenario)
    return numbers_of(after, ids, SceneCheck(new=scene_findings(after)))


def test_numbers_are_those_of_the_generated_agents():
    scenario = scenario_with(
        straight_drivers([(0, 0, 0, 5), (40, 0, 0, 0), (0, 3.5, 0, 5)])
    )
    ids = scenario.agents.ids[:2]
    apart = numbers(scenario, ids, paths((0, 0, 5), (60, 0, 0.0)))
    meets = numbers(scenario, ids, paths((0, 0, 10), (40, 0, 0.0)))
    assert (apart.num_agents, apart.num_collisions) == (2, 0)
    assert meets.num_collisions == 2
    assert apart.moving_share == 0.5
    assert apart.mean_speed_mps == pytest.approx(5.0)
    assert meets.mean_speed_mps == pytest.approx(10.0, rel=0.02)
    assert meets.time_to_collision_s == pytest.approx(0.0)
    assert meets.realism < apart.realism


def test_off_road_counts_moving_vehicles():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 5), (20, 0, 0, 0)]))
    ids = scenario.agents.ids
    away = numbers(scenario, ids, paths((0, 60, 5), (20, 60, 0.0)))
    assert away.off_road_share == 1.0
    stands = numbers(scenario, ids, paths((0, 0, 5), (20, 60, 0.0)))
    assert stands.off_road_share < 0.5


def test_leaving_the_map_is_not_off_the_road():
    """The fastest sample near the map's edge was ranked last for it."""
    scenario = scenario_with(straight_drivers([(150, 0, 0, 15)]))
    leaves = numbers(scenario, scenario.agents.ids, paths((150, 0, 15)))
    assert 150 + 15 * 5.9 > 205
    assert leaves.off_road_share == 0.0


def test_rankings():
    samples = (
        replace(PLAIN, num_hits=2, num_problems=2, time_to_collision_s=0.1),
        PLAIN,
        replace(PLAIN, off_road_share=0.3, mean_speed_mps=11.0),
        replace(PLAIN, time_to_collision_s=None, num_hits=1, num_problems=1),
    )
    assert set(RANKING_WORDS) == set(RANKINGS)
    assert ranked(samples)[0] == 1
    assert ranked(samples, "collisions") == (1, 2, 3, 0)
    assert ranked(samples, "off-road") == (1, 3, 0, 2)
    assert ranked(samples, "interaction") == (0, 1, 2, 3)
    assert ranked(samples, "movement")[0] == 2
    assert ranked(()) == ()
    assert ranked(samples) == (1, 2, 3, 0)
    assert PLAIN.realism > 90 > samples[2].realism > 0


def test_the_most_realistic_sample_has_the_fewest_problems_that_its_card_tells():
    """One with 8 problems was before one with 6, of finer measures not shown."""
    kinds = ["later-collision"] * 5 + ["off-road", "later-off-road", "friction"]
    found = [finding(kind, str(number)) for number, kind in enumerate(kinds)]
    harsh = [finding("harsh-motion", "a")]
    many = PLAIN.counted([*found, *harsh])
    assert (many.num_problems, many.num_notices) == (8, 1)
    assert (many.num_hits, many.num_off_road) == (5, 2)
    fewer = replace(PLAIN, lateral_deviation_m=4.0, harsh_share=0.3).counted(found[:6])
    assert fewer.realism < many.realism
    assert ranked((many, fewer)) == (1, 0)
    assert ranked((PLAIN.counted(harsh), PLAIN)) == (1, 0)
    assert ranked((PLAIN.counted(found[5:7]), many), "collisions") == (0, 1)


def test_scenes_that_are_empty_or_stand_are_not_the_most_realistic():
    """Agents that stand have no faults, those that are left out neither."""
    scenario = scenario_with(straight_drivers([(12.0 * i, 0, 0, 0) for i in range(16)]))
    rows = [(12.0 * i, 0.0, 4.0 * (i % 2)) for i in range(16)]
    stands = [(x, y, 0.0) for x, y, _ in rows]
    drives = [(x, y, 5.0) for x, y, _ in rows]
    full, still, few = with_fullness(
        numbers(scenario, scenario.agents.ids[: len(one)], paths(*one))
        for one in (drives, stands, stands[:2])
    )
    assert (full.fullness, still.fullness, few.fullness) == (1.0, 1.0, 0.125)
    assert ranked((few, still, full)) == (2, 1, 0)
    assert few.realism < 0.2 * full.realism
    one_stands = replace(PLAIN, num_agents=1, moving_share=0.0)
    assert one_stands.realism == PLAIN.realism
    assert with_fullness(()) == ()


def test_a_sample_without_agents_is_the_last_one():
    """It has no collisions, and was called the most realistic."""
    empty = replace(PLAIN, num_agents=0)
    worse = replace(PLAIN, num_collisions=3, off_road_share=0.5)
    for ranking in RANKINGS:
        assert ranked((empty, worse, PLAIN), ranking)[-1] == 0


def test_the_pick_spreads():
    near, also_near, far, farther = (
        sample_of(("a", "b"), paths((0, y, 5), (50, 0, 5))) for y in (0, 0.5, 9, 20)
    )
    samples = [near, also_near, far, farther]
    assert spread_pick(samples, 2) == (0, 3)
    assert spread_pick(samples, 3) == (0, 3, 2)
    assert spread_pick(samples, 9, first=2) == (2, 3, 0, 1)
    assert spread_pick([], 3) == ()
    apart = distances_m(samples)
    assert np.allclose(apart, apart.T)
    assert apart[0, 3] == pytest.approx(10.0)


def test_an_agent_that_one_sample_lacks_is_far_away():
    one = sample_of(("a", "b"), paths((0, 0, 5), (50, 0, 5)))
    two = sample_of(("a",), paths((0, 0, 5)))
    assert distances_m([one, two])[0, 1] == pytest.approx(MOST_APART_M / 2)
    nothing = sample_of((), np.zeros((0, 61, 2)))
    assert distances_m([nothing, nothing])[0, 1] == 0
