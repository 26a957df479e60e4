"""Placed agents that conflict with a neighbour are sampled again; all others stay."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.generation.initial_state import pipeline
from pd_editor.generation.initial_state.attributes import with_attributes_of
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    UNCONDITIONED,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.pipeline import (
    InitialStateOptions,
    SquarePlacement,
    placed_again,
)
from pd_editor.generation.initial_state.placement_rules import (
    PLACEMENT_RULES,
    ConflictResampling,
    ConflictSearch,
    KeptPaths,
)
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.generation.stages import INITIAL_STATES
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.generation import Region
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from tests.analysis.repair.scenes import Crowd, boxes, crowds
from tests.builders import scenario_with, straight_drivers
from tests.generation.initial_state.scenes import placed_states, scene_batch

SETTINGS = ConflictResampling()
SEARCH = ConflictSearch.of(SETTINGS, InitialStateGuidance())


def nothing_kept(scenario: Scenario) -> KeptPaths:
    return KeptPaths.of(scenario, scenario.agents.ids)


def offenders(
    scenario: Scenario, *names: str, settings: ConflictResampling = SETTINGS
) -> np.ndarray:
    """Who breaks some rules, in either order."""
    rules = [one for one in PLACEMENT_RULES if one.name in names]
    assert len(rules) == len(names)
    search = replace(SEARCH, settings=settings, rules=rules)
    return search.conflicts(scenario.agents, scenario, nothing_kept(scenario))


def in_conflict(states: list[tuple[float, float, float, float]]) -> bool:
    scenario = scenario_with(straight_drivers(states))
    pairs = offenders(scenario, "near", "brakes", "waits", "crossing")
    assert (pairs == pairs.T).all()
    return bool(pairs[0, 1])


@pytest.mark.parametrize(
    ("states", "expected"),
    [
        pytest.param(
            [(0, 0, 0, 8), (12, 0, 0, 0)], True, id="fast behind one standing"
        ),
        pytest.param(
            [(0, 0, 0, 8), (30, 0, 0, 0)], False, id="far behind one standing"
        ),
        pytest.param([(0, 0, 0, 8), (12, 0, 0, 8)], False, id="as fast as the leader"),
        pytest.param([(0, 0, 0, 0), (12, 0, 0, 6)], True, id="stands behind a leader"),
        pytest.param([(0, 0, 0, 0), (12, 0, 0, 2)], False, id="leader that starts"),
        pytest.param([(0, 0, 0, 8), (12, 3.5, 0, 0)], False, id="next lane"),
        pytest.param([(0, 0, 0, 0), (0, 2.3, 0, 0)], True, id="0.3 m beside"),
        pytest.param([(0, 0, 0, 0), (0, 2.5, 0, 0)], False, id="0.6 m beside"),
        pytest.param([(0, 0, 0, 0), (6, 2.5, 0, 0)], False, id="ahead in a next lane"),
        pytest.param([(0, 0, 0, 8), (12, 0, np.pi / 2, 8)], False, id="has crossed"),
        pytest.param(
            [(0, 0, 0, 8), (12, -12, np.pi / 2, 8)], True, id="meets in 1.5 s"
        ),
        pytest.param([(0, 0, 0, 8), (32, -32, np.pi / 2, 8)], False, id="meets in 4 s"),
        pytest.param(
            [(0, 0, 0, 8), (12, -12, np.pi / 2, 0)], False, id="waits to cross"
        ),
        pytest.param([(0, 0, 0, 8), (12, 0, np.pi, 8)], True, id="head on"),
    ],
)
def test_which_neighbours_conflict(
    states: list[tuple[float, float, float, float]], expected: bool
):
    assert in_conflict(states) is expected
    assert in_conflict(states[::-1]) is expected


@settings(max_examples=60, deadline=None)
@given(crowd=crowds())
def test_boxes_nearer_than_the_gap_conflict(crowd: Crowd):
    """Oracle: distances of polygons by shapely."""
    states, _ = crowd
    agents = straight_drivers([(x, y, turn, 0.0) for x, y, turn, _ in states])
    scenario = scenario_with(agents)
    step = scenario.current_step
    pairs = offenders(scenario, "near")
    shapes = np.array(boxes(scenario, step))
    apart = shapely.distance(shapes[:, None], shapes[None])
    np.fill_diagonal(apart, np.inf)
    # A box that grows on all sides has corners, so it reaches a little further.
    assert pairs[apart < SEARCH.gap_m - 1e-9].all()
    assert not pairs[apart > SEARCH.gap_m * 2**0.5 + 1e-9].any()


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        pytest.param((20, 0, np.pi, 8), True, id="drives the wrong way"),
        pytest.param((20, 0.5, np.pi, 0), True, id="stands the wrong way"),
        pytest.param((20, -1.5, np.pi, 0), False, id="parks on the left"),
        pytest.param((20, 0, 0, 8), False, id="drives along the lane"),
    ],
)
def test_agents_in_a_lane_that_leads_the_other_way_conflict_with_the_road(
    state: tuple[float, float, float, float], expected: bool
):
    away = (90.0, 60.0, 0.0, 0.0)
    scenario = scenario_with(straight_drivers([state, away]))
    ids = scenario.agents.ids
    found = offenders(scenario, "wrong way").diagonal()
    assert found.tolist() == [expected, False]
    chosen = SEARCH.conflicting(
        scenario, ids, np.random.default_rng(0), nothing_kept(scenario)
    )
    assert chosen == (ids[:1] if expected else ())


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        pytest.param((20, -5, 0.8, 0), True, id="stands askew beside the road"),
        pytest.param((20, -5, 0.8 + np.pi, 0), True, id="the same, turned around"),
        pytest.param((20, -5, 0.1, 0), False, id="parks beside the road"),
        pytest.param((20, -5, 1.5, 0), False, id="stands in a driveway"),
        pytest.param((20, -5, 0.8, 4), False, id="comes out of a driveway"),
        pytest.param((20, -12, 0.8, 0), False, id="stands on a lot"),
        pytest.param((20, -1, 0.8, 0), False, id="stands askew on the road"),
    ],
)
def test_vehicles_askew_beside_a_road_conflict_with_it(
    state: tuple[float, float, float, float], expected: bool
):
    scenario = scenario_with(straight_drivers([state, (90.0, 60.0, 0.0, 0.0)]))
    found = offenders(scenario, "askew off road").diagonal()
    assert found.tolist() == [expected, False]
    conflicts = SEARCH.conflicts(scenario.agents, scenario, nothing_kept(scenario))
    assert conflicts.diagonal().tolist() == [expected, False]


@pytest.mark.parametrize(
    ("left_m", "expected"),
    [pytest.param(-5, True, id="beside"), pytest.param(-1, False, id="on the road")],
)
def test_the_road_beside_which_vehicles_stand_may_be_warped(
    left_m: float, expected: bool
):
    scenario = scenario_with(straight_drivers([(40.0, left_m, 0.8, 0.0)]))
    anchor = RigidMotion(x_m=-20.0, y_m=0.0, rotation_rad=0.0)
    term = WarpTerm(kind="smooth-turn", power=3.0, length_m=40.0)
    bent = warp_scenario(scenario, RoadWarp(anchor=anchor, terms=(term,)))
    moved_m = np.linalg.norm(bent.agents.position_m - scenario.agents.position_m)
    assert moved_m > SETTINGS.beside_road_m
    assert offenders(bent, "askew off road").diagonal().tolist() == [expected]


def test_an_agent_gets_its_state_of_the_version_along_the_lane():
    ahead, back = (20.0, 0.0, 0.0, 8.0), (20.0, 0.0, np.pi, 8.0)
    versions = [scenario_with(straight_drivers([one])) for one in (back, ahead)]
    best = SEARCH.best_of(versions, versions[0].agents.ids, nothing_kept(versions[0]))
    assert best.agents.heading_rad[0, best.current_step] == 0.0


@settings(max_examples=30, deadline=None)
@given(crowd=crowds(), data=st.data())
def test_rules_are_independent_of_each_other(crowd: Crowd, data: st.DataObject):
    """What several rules find is what each of them finds alone, in any order."""
    states, kinds = crowd
    scenario = scenario_with(straight_drivers(states, kinds=kinds))
    traffic = SEARCH.traffic(scenario.agents, scenario, nothing_kept(scenario))
    some = data.draw(st.lists(st.sampled_from(PLACEMENT_RULES), unique=True))
    alone = np.zeros((len(scenario.agents),) * 2, bool)
    for rule in reversed(some):
        alone |= rule.offenders(traffic)
    together = replace(SEARCH, rules=some)
    found = together.conflicts(scenario.agents, scenario, nothing_kept(scenario))
    assert np.array_equal(found, alone | alone.T)


@settings(max_examples=60, deadline=None)
@given(crowd=crowds())
def test_without_the_chosen_agents_no_placed_one_conflicts(crowd: Crowd):
    states, kinds = crowd
    scenario = scenario_with(straight_drivers(states, kinds=kinds))
    placed = scenario.agents.ids[1::2]
    random = np.random.default_rng(0)
    chosen = SEARCH.conflicting(scenario, placed, random, nothing_kept(scenario))
    assert set(chosen) <= set(placed)
    assert len(set(chosen)) == len(chosen)
    rest = scenario.without_agents(chosen)
    assert not SEARCH.conflicting(
        rest,
        [name for name in placed if name not in chosen],
        random,
        nothing_kept(rest),
    )
    kind_of = dict(zip(scenario.agents.ids, scenario.agents.kinds, strict=True))
    assert all(kind_of[name] in LANE_FOLLOWER_KINDS for name in chosen)


@settings(max_examples=60, deadline=None)
@given(crowd=crowds(), turn=st.integers(1, 5), number=st.integers(2, 4))
def test_the_best_of_some_versions_has_no_more_conflicts_than_each(
    crowd: Crowd, turn: int, number: int
):
    states, kinds = crowd
    base = scenario_with(straight_drivers(states, kinds=kinds))
    ids, step = base.agents.ids[::2], base.current_step
    rows = base.agents.rows(ids)
    versions = []
    for version in range(number):
        place = base.agents.position_m[rows] + (0.0, 3.0 * version * turn)
        versions.append(base.with_agents(base.agents.with_rows(rows, position_m=place)))
    best = SEARCH.best_of(versions, ids, nothing_kept(versions[0]))

    def conflicts(scenario: Scenario) -> int:
        agents = scenario.agents
        counts = agents.is_valid[:, step] & agents.kind_mask(LANE_FOLLOWER_KINDS)
        found = SEARCH.conflicts(agents, scenario, nothing_kept(scenario))
        return int((found & counts & counts[:, None])[rows].sum())

    assert conflicts(best) <= min(map(conflicts, versions))
    assert best.agents.ids == base.agents.ids
    position = best.agents.position_m
    for row in range(len(base.agents)):
        same = [
            np.array_equal(position[row], v.agents.position_m[row]) for v in versions
        ]
        assert any(same) if row in rows else all(same)


def test_an_agent_gets_its_state_of_the_version_without_a_conflict():
    """The first agent is free in the first version only, the second in the second."""
    stands = [(0.0, 0.0, 0.0, 0.0), (60.0, 0.0, 0.0, 0.0)]
    free = [(20.0, 0.0, 0.0, 0.0), (80.0, 0.0, 0.0, 0.0)]
    one = scenario_with(straight_drivers([*stands, free[0], stands[1]]))
    two = scenario_with(straight_drivers([*stands, stands[0], free[1]]))
    best = SEARCH.best_of([one, two], one.agents.ids[2:], nothing_kept(one))
    found = best.agents.position_m[:, best.current_step, 0]
    assert found.tolist() == [0.0, 60.0, 20.0, 80.0]


@pytest.fixture
def placer(diffuser: PathDiffuser) -> InitialStateDenoiser:
    model = diffuser.model().stage(INITIAL_STATES.name).model
    assert isinstance(model, InitialStateDenoiser)
    return model


def placed(
    model: InitialStateDenoiser, scenario: Scenario, count: int
) -> tuple[Scenario, Scenario]:
    """The same sample without and with agents in conflict sampled again."""
    placing = SquarePlacement(
        resampled_ids=(),
        new_kinds=(AgentKind.VEHICLE,) * count,
        new_ids=tuple(f"new-{index}" for index in range(count)),
        region=Region(center_m=(0.0, 0.0), half_side_m=62.0),
    )
    (once,), (again,) = (
        placed_states(
            model,
            scenario,
            {0: [placing]},
            seed=0,
            options=InitialStateOptions(conflicts=conflicts),
        )
        for conflicts in (None, SEARCH)
    )
    return once, again


def test_only_agents_in_conflict_are_sampled_again(
    placer: InitialStateDenoiser, scenario: Scenario
):
    once, again = placed(placer, scenario, 12)
    step = scenario.current_step
    ids = [name for name in once.agents.ids if name.startswith("new")]
    random = np.random.default_rng(0)
    first, last = (
        SEARCH.conflicting(one, ids, random, nothing_kept(one)) for one in (once, again)
    )
    assert first, "a network with random weights places agents in conflict"
    assert len(last) < len(first)
    at = {
        name: scene.agents.position_m[scene.agents.rows(ids), step]
        for name, scene in (("once", once), ("again", again))
    }
    stayed = (at["once"] == at["again"]).all(axis=1)
    assert stayed.any()
    assert not stayed.all()
    assert set(again.agents.ids) == set(once.agents.ids)


def test_without_conflicts_nothing_is_sampled_again(
    placer: InitialStateDenoiser, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
):
    batches: list[int] = []
    place = pipeline.place_agents

    def counted(*given: object, **more: object) -> object:
        batches.append(1)
        return place(*given, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(pipeline, "place_agents", counted)
    bare = scenario.without_agents(scenario.agents.ids)
    once, again = placed(placer, bare, 1)
    assert len(batches) == 2
    assert (once.agents.position_m == again.agents.position_m).all()


def test_agents_that_are_sampled_again_keep_requested_attributes():
    scene = scene_batch(6)
    is_given = torch.zeros_like(scene.has_agent)
    is_given[:, :4] = True
    task = sampling_conditioning(scene, is_given)
    agents = straight_drivers([(0, 0, 0, 5), (0, 40, 0, 0)])
    now = scenario_with(agents)
    found = with_attributes_of(task, scene, [(now, agents)] * len(scene.has_agent))
    assert (found.moves[:, :4] == UNCONDITIONED).all()
    assert (found.moves[:, 4] == CONDITIONED_YES).all()
    assert (found.moves[:, 5] == CONDITIONED_NO).all()


def test_agents_are_placed_again_in_their_squares():
    placing = SquarePlacement(
        resampled_ids=("1", "2"),
        new_kinds=(AgentKind.VEHICLE,),
        new_ids=("new-1",),
        region=Region(center_m=(0.0, 0.0), half_side_m=62.0),
        square=3,
    )
    (again,) = placed_again(
        [placing, replace(placing, resampled_ids=("7",), new_ids=())], ["2", "new-1"]
    )
    assert again.resampled_ids == ("2", "new-1")
    assert (again.new_ids, again.new_kinds, again.square) == ((), (), 3)
    assert again.is_again
