"""Who comes into the map, where, and how many."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.closed_loop.world import Entrances, World
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.road_map import Crosswalk, RoadMap
from pd_editor.scene.traffic_sample import TrafficSample
from tests.builders import scenario_with, straight_drivers, two_lane_road
from tests.experiments.closed_loop.test_roll_out import rolled

CAR, BIKE, WALKER = AgentKind.VEHICLE, AgentKind.CYCLIST, AgentKind.PEDESTRIAN
KINDS = (CAR, BIKE, WALKER)
STATES = [(0.0, 0.0, 0.0, 5.0), (40.0, 0.0, 0.0, 5.0), (80.0, 7.0, 0.0, 1.0)]


def world_with(states=STATES, kinds=KINDS, road_map: RoadMap | None = None) -> World:
    scene = scenario_with(straight_drivers(states, kinds=kinds), road_map)
    return World.beginning(scene, 100, seed=0)


def test_each_is_replaced_by_its_kind():
    world = world_with()
    entrances = Entrances.of(world)
    random = np.random.default_rng(0)
    assert entrances.wanted(world, random) is None
    names = dict(zip(KINDS, world.scenario.agents.ids, strict=True))
    for kind, name in names.items():
        _, numbers = entrances.wanted(world.without([name]), random) or (None, {})
        assert numbers == {kind: 2}
    _, numbers = entrances.wanted(world.without(names.values()), random) or (None, {})
    assert numbers == dict.fromkeys(KINDS, 2)


@pytest.mark.parametrize(
    ("kind", "place", "enters"),
    [
        (CAR, (-95, 0, 0.0), True),
        (CAR, (-95, -3.0, 0.0), False),
        (CAR, (-95, 0, 3.1), False),
        (BIKE, (-95, 3.5, 0.0), True),
        (BIKE, (-95, 12, 0.0), False),
        (WALKER, (-95, -3.0, 0.0), True),
        (WALKER, (-95, -3.0, 3.1), False),
        (WALKER, (-95, 1.0, 0.5), False),
        (WALKER, (-85, 1.0, 0.5), True),
        (WALKER, (-20, -3.0, 0.0), False),
    ],
)
def test_where_one_comes_in(kind, place, enters):
    """Pedestrians beside the road, or on a crosswalk; others on lanes that begin."""
    across = [np.array([[x, -2, 0], [x, 6, 0]], float) for x in (-87, -83)]
    crosswalk = Crosswalk(crosswalk_id=1, edge1=across[0], edge2=across[1])
    world = world_with(road_map=replace(two_lane_road(), crosswalks=(crosswalk,)))
    entrances = Entrances.of(world)
    (gone,) = (
        name
        for name, one in zip(world.scenario.agents.ids, KINDS, strict=True)
        if one is kind
    )
    world = world.without([gone])
    x, y, heading = place
    sample = TrafficSample(
        ids=("new-1", "new-2"),
        kinds=(kind, kind),
        size_m=np.ones((2, 2)),
        position_m=np.tile(np.array([x, y], float), (2, 61, 1)),
        heading_rad=np.full((2, 61), heading),
        velocity_mps=np.zeros((2, 61, 2)),
    )
    assert entrances.entering(sample, world).ids == ("new-1",) * enters
    assert not entrances.entering(sample, world_with()).ids


def test_who_walks_away_from_the_road_has_left():
    far = [(0.0, 11.0, 1.5, 1.0), (10.0, 20.0, 0.0, 0.0), (0.0, 12.0, 1.5, 5.0)]
    world = world_with(far, (WALKER, WALKER, CAR))
    sample = TrafficSample(
        ids=world.scenario.agents.ids,
        kinds=world.scenario.agents.kinds,
        size_m=world.scenario.agents.size_m,
        position_m=np.repeat(np.array(far)[:, None, :2], 61, axis=1)
        + np.arange(61)[:, None] * np.array([0.0, 0.3]) * [[[1]], [[0]], [[1]]],
        heading_rad=np.full((3, 61), 1.5),
        velocity_mps=np.tile([[[0.0, 3.0]], [[0.0, 0.0]], [[0.0, 3.0]]], (1, 61, 1)),
    )
    there = world.planned(sample).after(10).is_present()
    assert there.tolist() == [False, True, True]


@pytest.mark.slow
def test_people_stay_as_many(av2_root):
    folder = sorted((av2_root / "val").iterdir())[7]
    scenario = open_scenario(folder)
    found = rolled(scenario, model="path-diffuser", duration_s=60.0).scenario
    agents, now = found.agents, scenario.current_step
    walks = agents.kind_mask([WALKER])
    count = agents.is_valid[walks, now::10].sum(axis=0)
    assert (count >= count[0] - 1).all()
    entered = walks & ~agents.is_valid[:, : now + 1].any(axis=1)
    assert (agents.is_valid[entered].sum(axis=1) > 20).any()
