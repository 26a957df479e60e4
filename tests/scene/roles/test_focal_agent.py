"""Which agent becomes the focal one (D2)."""

from dataclasses import replace

import numpy as np

from pd_editor.scene.agent_kind import AgentCategory, AgentKind
from pd_editor.scene.roles.focal_agent import (
    focal_place_m,
    with_focal_agent,
    with_focal_category,
)
from tests.builders import scenario_with, straight_drivers

VEHICLE, PEDESTRIAN = AgentKind.VEHICLE, AgentKind.PEDESTRIAN


def scene(kinds=(VEHICLE,) * 5):
    """The focal agent, a parked car beside it, and three that drive."""
    return scenario_with(
        straight_drivers(
            [(10, 0, 0, 9), (11, 0, 0, 0), (40, 0, 0, 8), (25, 0, 0, 7), (14, 0, 0, 6)],
            kinds=kinds,
        )
    )


def without_focal(base):
    return with_focal_agent(base.without_agents(("100",)), focal_place_m(base))


def test_the_nearest_moving_vehicle_with_a_complete_track_follows():
    base = scene()
    is_valid = base.agents.is_valid.copy()
    is_valid[4, 90:] = False
    base = base.with_agents(replace(base.agents, is_valid=is_valid))
    found = without_focal(base)
    assert found.focal_id == "103"
    assert found.provenance.notes == ("Vehicle 103 is the focal agent now.",)
    focal = [c is AgentCategory.FOCAL for c in found.agents.categories]
    assert focal == [False, False, True, False]


def test_vehicles_that_stand_come_before_people_and_people_before_things():
    thing = AgentKind.STATIC
    found = without_focal(scene((VEHICLE, VEHICLE, PEDESTRIAN, PEDESTRIAN, thing)))
    assert found.focal_id == "101"
    found = without_focal(scene((VEHICLE, thing, PEDESTRIAN, PEDESTRIAN, thing)))
    assert found.focal_id == "103"


def test_a_focal_agent_that_is_there_stays_and_a_bare_road_has_none():
    base = scene()
    assert with_focal_agent(base) is base
    bare = base.without_agents(base.agents.ids)
    assert with_focal_agent(bare) is bare
    assert np.array_equal(focal_place_m(bare), [0.0, 0.0])


def test_one_agent_alone_has_the_focal_category():
    agents = replace(scene().agents, categories=(AgentCategory.FOCAL,) * 5)
    assert with_focal_category(agents, "102").categories == (
        AgentCategory.SCORED,
        AgentCategory.SCORED,
        AgentCategory.FOCAL,
        AgentCategory.SCORED,
        AgentCategory.SCORED,
    )
