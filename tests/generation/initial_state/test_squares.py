"""Which agents are placed in which square of a scene."""

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torch import Tensor

from pd_editor.base.errors import GenerationError
from pd_editor.generation.core.sampler import Denoise, SamplerStep, sample_steps
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.pipeline import SquarePlacement
from pd_editor.generation.initial_state.sampler import InitialStateSamplerConfig
from pd_editor.generation.initial_state.squares import (
    placings_of,
    squares_of,
)
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.scene.agent_kind import Activity, AgentKind
from pd_editor.scene.generation import GenerationRequest, Region
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers, straight_lane
from tests.generation.generated_traffic import SINGLE, generated
from tests.generation.initial_state.scenes import placed_states

CENTER = (0.0, 0.0)
FAR = ((-110.0, 0.0, 0.0, 0.0), (100.0, 0.0, 0.0, 0.0), (118.0, 3.5, 0.0, 0.0))


def long_road(start: float = -170.0, end: float = 170.0) -> RoadMap:
    """Two lanes along x, in parts of 20 m."""
    starts = np.arange(start, end, 20.0)
    return RoadMap(
        lanes=tuple(
            straight_lane(
                2 * index + side, (float(x), 3.5 * side), (float(x) + 20, 3.5 * side)
            )
            for index, x in enumerate(starts)
            for side in (0, 1)
        )
    )


@pytest.fixture
def wide() -> Scenario:
    """The focal agent in the middle, others up to 118 m away."""
    agents = straight_drivers([(0.0, 0.0, 0.0, 5.0), (20.0, 3.5, 0.0, 5.0), *FAR])
    return scenario_with(agents, long_road())


@pytest.fixture
def model(diffuser: PathDiffuser) -> InitialStateDenoiser:
    network = diffuser.model().stage("init").model
    assert isinstance(network, InitialStateDenoiser)
    return network


def placed(
    model: InitialStateDenoiser,
    scenario: Scenario,
    seed: int = 0,
    *,
    density: float = 1.0,
    resampled_ids: tuple[str, ...] = (),
    **asked: Any,
) -> tuple[SquarePlacement, ...]:
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=resampled_ids,
        resampled_state_ids=resampled_ids,
        **asked,
    )
    return placings_of(model, request, density, np.random.default_rng(seed))


def test_squares_cover_the_mapped_road_from_the_focal_agent_outwards(wide: Scenario):
    squares = squares_of(wide, None)
    centers = [one.region.center_m for one in squares]
    assert centers == [(0.0, 0.0), (-124.0, 0.0), (124.0, 0.0)]
    assert all(one.region.half_side_m == 62.0 for one in squares)
    assert squares[0].lane_m == pytest.approx(240.0)
    assert [one.density for one in squares] == [1.0, 0.56, 0.56]


@pytest.mark.parametrize("half_side", [63.0, 124.0, 150.0, 300.0])
def test_a_large_region_is_covered_by_squares_that_the_network_knows(
    wide: Scenario, half_side: float
):
    region = Region(center_m=(10.0, 5.0), half_side_m=half_side)
    squares = squares_of(wide, region)
    sides = {one.region.half_side_m for one in squares}
    assert len(sides) == 1
    assert 31.0 <= max(sides) <= 62.0
    for x in np.arange(-165.0, 170.0, 5.0):
        if abs(x - 10.0) < half_side:
            offset = [
                np.abs(np.array([x, 0.0]) - one.region.center_m).max()
                for one in squares
            ]
            assert min(offset) <= max(sides) + 1e-6
    for one in squares:
        reach = np.abs(np.array(one.region.center_m) - region.center_m) + max(sides)
        assert (reach <= half_side + 1e-6).all()


def test_a_region_within_one_square_is_that_square(wide: Scenario):
    region = Region(center_m=(10.0, 5.0), half_side_m=40.0)
    assert [one.region for one in squares_of(wide, region)] == [region]


def test_a_place_without_a_road_is_refused_with_where_roads_are(
    diffuser: PathDiffuser, wide: Scenario
):
    for half_side in (30.0, 100.0):
        region = Region(center_m=(900.0, 0.0), half_side_m=half_side)
        with pytest.raises(
            GenerationError,
            match=r"no lanes around \(900, 0\) m; lanes lie at x from -\d+ to \d+ m",
        ):
            generated(
                diffuser,
                wide,
                (),
                num_new_agents={AgentKind.VEHICLE: 2},
                region=region,
            )
    bare = replace(wide, road_map=RoadMap(lanes=()))
    with pytest.raises(GenerationError, match="nor anywhere in this scene"):
        squares_of(bare, None)


def test_agents_that_get_another_state_stay_in_their_square(
    model: InitialStateDenoiser, wide: Scenario
):
    """All recorded agents used to be crowded into 124 m around the focal agent."""
    ids = wide.agents.ids
    placings = placed(model, wide, resampled_ids=ids)
    assert [one.resampled_ids for one in placings] == [ids[:2], ids[2:3], ids[3:]]
    assert len({one.square for one in placings}) == 3


def test_agents_from_beyond_all_squares_go_anywhere_on_the_road(
    model: InitialStateDenoiser, wide: Scenario
):
    """In the nearest square they would crowd the edge of the map."""
    ids = wide.agents.ids
    beyond = wide.agents.position_m.copy()
    beyond[4, :, 0] = 400.0
    moved = wide.with_agents(replace(wide.agents, position_m=beyond))
    found = Counter(
        placing.square
        for seed in range(30)
        for placing in placed(model, moved, seed, resampled_ids=ids)
        if ids[4] in placing.resampled_ids
    )
    assert found.total() == 30
    assert len(found) == 3


@pytest.fixture
def crowd() -> Scenario:
    """130 agents on 1.2 km of road."""
    places = np.linspace(-580.0, 580.0, 130)
    states = [(float(x), 3.5 * (n % 2), 0.0, 0.0) for n, x in enumerate(places)]
    return scenario_with(straight_drivers(states), long_road(-600.0, 600.0))


def test_the_agents_of_a_crowd_stay_where_they_are(
    model: InitialStateDenoiser, crowd: Scenario
):
    """They used to be crowded into the squares around the focal agent."""
    ids = crowd.agents.ids
    placings = placed(model, crowd, resampled_ids=ids)
    assert sorted(name for one in placings for name in one.ids) == sorted(ids)
    for one in placings:
        rows = crowd.agents.rows(one.ids)
        place = crowd.agents.position_m[rows, crowd.current_step]
        assert (np.abs(place - one.region.center_m) <= 62.0).all()
    for turn in {one.turn for one in placings}:
        own = [one.region.center_m for one in placings if one.turn == turn]
        for first, second in itertools.combinations(own, 2):
            assert np.abs(np.subtract(first, second)).max() > 4 * 62.0 - 1e-6
    # New agents are still placed around the focal agent only.
    more = placed(
        model, crowd, resampled_ids=ids, num_new_agents={AgentKind.VEHICLE: 40}
    )
    new = [one.region.center_m[0] for one in more if one.new_ids]
    assert new == [-580.0, -456.0]


def test_a_sample_of_a_crowd_is_the_same_alone(
    model: InitialStateDenoiser, crowd: Scenario
):
    placings = placed(model, crowd, resampled_ids=crowd.agents.ids)
    both = placed_states(model, crowd, {0: placings, 1: placings}, seed=3)
    (alone,) = placed_states(model, crowd, {1: placings}, seed=3)
    now = crowd.current_step
    first, second = (one.agents.position_m[:, now] for one in both)
    assert both[1].agents.ids == alone.agents.ids
    np.testing.assert_allclose(second, alone.agents.position_m[:, now], atol=0.02)
    assert np.hypot(*(first - second).T).max() > 1.0


def test_agents_far_from_all_lanes_keep_their_states(
    diffuser: PathDiffuser, wide: Scenario
):
    """They used to be crowded onto the mapped roads."""
    position = wide.agents.position_m.copy()
    position[3, :, 1], position[4, :, 1] = 22.0, 24.5
    moved = wide.with_agents(replace(wide.agents, position_m=position))
    ids = moved.agents.ids
    traffic = generated(diffuser, moved, ids, resampled_state_ids=ids)
    (sample,) = traffic.samples
    step = moved.current_step
    stays = (sample.position_m[:, 0] == moved.agents.position_m[:, step]).all(axis=1)
    assert stays.tolist() == [False, False, False, False, True]
    assert (
        "1 of 5 agents, more than 20 m from all mapped lanes, keeps its state."
        in traffic.notes
    )


def test_agents_that_are_all_far_from_lanes_go_onto_them(
    diffuser: PathDiffuser, wide: Scenario
):
    position = wide.agents.position_m.copy()
    position[4, :, 1] = 90.0
    moved = wide.with_agents(replace(wide.agents, position_m=position))
    ids = moved.agents.ids[4:]
    region = Region(center_m=(0.0, 0.0), half_side_m=62.0)
    for more in ({}, {"region": region}):
        traffic = generated(diffuser, moved, ids, resampled_state_ids=ids, **more)
        assert abs(traffic.samples[0].position_m[0, 0, 1]) < 30.0
        assert not any("all mapped lanes" in note for note in traffic.notes)


def test_agents_from_elsewhere_go_anywhere_in_a_region(
    model: InitialStateDenoiser, wide: Scenario
):
    region = Region(center_m=(-60.0, 0.0), half_side_m=100.0)
    found = Counter(
        placing.region.center_m[0]
        for seed in range(30)
        for placing in placed(
            model, wide, seed, resampled_ids=wide.agents.ids[4:], region=region
        )
    )
    assert len(found) == 2
    assert min(found.values()) > 5


def test_new_agents_are_spread_along_the_lanes(
    model: InitialStateDenoiser, wide: Scenario
):
    asked = {AgentKind.VEHICLE: 20, AgentKind.PEDESTRIAN: 10}
    placings = placed(model, wide, num_new_agents=asked)
    kinds = Counter(kind for one in placings for kind in one.new_kinds)
    assert kinds == Counter(asked)
    ids = [name for one in placings for name in one.new_ids]
    assert ids == [f"new-{number}" for number in range(1, 31)]
    lanes = [one.lane_m * one.density for one in squares_of(wide, None)]
    for placing in placings:
        share = lanes[placing.square] / sum(lanes)
        assert abs(len(placing.new_ids) - 30 * share) <= 2


def test_as_many_as_suit_the_road_are_as_dense_everywhere(
    model: InitialStateDenoiser, wide: Scenario
):
    bare = wide.without_agents(wide.agents.ids[1:])
    numbers = dict.fromkeys(range(3), 0)
    for seed in range(40):
        for placing in placed(model, bare, seed, samples_num_agents=True):
            numbers[placing.square] += len(placing.new_ids)
    # Seven in each training square, and one of them is here already.
    assert numbers[0] == 6 * 40
    for square in (1, 2):
        share = 0.56 * squares_of(wide, None)[square].lane_m / 240.0
        assert numbers[square] / 40 == pytest.approx(7 * share, abs=0.6)
    fewer = placed(model, bare, samples_num_agents=True, density=0.5)
    usual = placed(model, bare, samples_num_agents=True)
    few, many = (sum(len(one.new_ids) for one in some) for some in (fewer, usual))
    assert 0 < few < 0.7 * many


def test_a_whole_scene_is_sampled_in_one_call(diffuser: PathDiffuser, wide: Scenario):
    ids = wide.agents.ids
    traffic = generated(
        diffuser, wide, ids, resampled_state_ids=ids, guidance=(SINGLE,)
    )
    (sample,) = traffic.samples
    assert sorted(sample.ids) == sorted(ids)
    place = dict(zip(sample.ids, sample.position_m[:, 0], strict=True))
    # Agents may be moved apart over the border of their square.
    for name, x in zip(ids, (0, 0, -124, 124, 124), strict=True):
        assert abs(place[name][0] - x) <= 62 + 6
        before = wide.agents.position_m[wide.agents.row_of[name], wide.current_step]
        assert np.hypot(*(place[name] - before)) > 1e-3


def test_each_square_has_random_numbers_of_its_own(
    diffuser: PathDiffuser, wide: Scenario
):
    agents = straight_drivers([(x, 0.0, 0.0, 0.0) for x in (-124.0, 0.0, 124.0)])
    alike = scenario_with(agents, long_road())
    ids = agents.ids
    (sample,) = generated(
        diffuser, alike, ids, resampled_state_ids=ids, guidance=(SINGLE,)
    ).samples
    along = np.sort(sample.position_m[:, 0, 0]) - [-124.0, 0.0, 124.0]
    assert len(set(along.round(1))) == 3


def test_high_quality_takes_more_steps(model_folder: Path, scenario: Scenario):
    steps: list[int] = []

    def counted(denoise: Denoise, *given: Any) -> Iterator[SamplerStep]:
        def counted_step(noisy: Tensor, step: int) -> Tensor:
            steps.append(step)
            return denoise(noisy, step)

        return sample_steps(counted_step, *given)

    diffuser, found = PathDiffuser(model_folder, sampler=counted), {}
    ids = scenario.agents.ids
    for quality in ("fast", "high"):
        steps.clear()
        generated(
            diffuser,
            scenario,
            ids,
            resampled_state_ids=ids,
            quality=quality,
            refines_states=False,
        )
        found[quality] = len(steps)
    more = found["high"] - found["fast"]
    assert more == InitialStateSamplerConfig().num_steps


def test_placed_agents_are_parked_wait_or_drive(
    model: InitialStateDenoiser, wide: Scenario
):
    """Stage 2 reads it; kept agents keep theirs, also if it is unknown."""
    known = np.array([Activity.UNKNOWN, Activity.WAITING, 0, 0, 0], np.int8)
    scenario = wide.with_agents(replace(wide.agents, activity=known))
    ids, found = wide.agents.ids[2:], set()
    for seed in range(4):
        placings = placed(model, scenario, resampled_ids=ids)
        (scene,) = placed_states(model, scenario, {0: placings}, seed=seed)
        agents = scene.agents
        rows = agents.rows(ids)
        speed = np.hypot(*agents.velocity_mps[rows, scenario.current_step].T)
        assert ((agents.activity[rows] == Activity.DRIVING) == (speed > 0)).all()
        found |= set(agents.activity[rows].tolist())
        kept = agents.activity[agents.rows(wide.agents.ids[:2])]
        assert kept.tolist() == [Activity.UNKNOWN, Activity.WAITING]
    assert Activity.UNKNOWN not in found
    assert len(found) > 1
