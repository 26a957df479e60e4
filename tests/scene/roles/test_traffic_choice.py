from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.speed import TargetSpeed
from pd_editor.base.errors import EditError, GenerationError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids, steered_agent_ids
from tests.builders import scenario_with, straight_drivers

KINDS = tuple(AgentKind)


def every_kind():
    """One agent per kind; the first is absent at the current step."""
    agents = straight_drivers(
        [(10 * row, 0, 0, 1) for row in range(len(KINDS))], kinds=KINDS
    )
    is_valid = np.array(agents.is_valid)
    is_valid[0, 49] = False
    return scenario_with(replace(agents, is_valid=is_valid))


def test_guidance_is_about_the_selected_or_the_guided_agents():
    goal = GoalPoint(agent_id="3", point_m=(0.0, 0.0))
    speed = TargetSpeed(agent_ids=("2", "3"), speed_mps=1.0)
    everybody = TargetSpeed(agent_ids=(), speed_mps=1.0)

    def steered(*terms, selection=()):
        return steered_agent_ids(replace(every_kind(), guidance=terms), selection)

    assert steered() is None
    assert steered(goal, speed) == ("3", "2")
    assert steered(goal, everybody) is None
    assert steered(goal, replace(everybody, is_on=False)) == ("3",)
    assert steered(goal, everybody, selection=("1",)) == ("1",)


def test_all_road_users_at_the_current_step_are_driven():
    scenario = every_kind()
    kinds = dict(zip(scenario.agents.ids, scenario.agents.kinds, strict=True))
    assert {kinds[name] for name in drivable_agent_ids(scenario)} == {
        AgentKind.PEDESTRIAN,
        AgentKind.MOTORCYCLIST,
        AgentKind.CYCLIST,
        AgentKind.BUS,
    }


def test_of_those_wanted_only_such_are_driven_in_their_order():
    scenario = every_kind()
    ids = scenario.agents.ids
    wanted = (ids[4], ids[0], ids[5], ids[1])
    assert drivable_agent_ids(scenario, wanted) == (ids[4], ids[1])


def test_nobody_to_drive_is_said():
    scenario = every_kind()
    with pytest.raises(GenerationError, match="None of these agents"):
        drivable_agent_ids(scenario, scenario.agents.ids[:1])
    with pytest.raises(GenerationError, match="None of these agents"):
        drivable_agent_ids(scenario, ())
    with pytest.raises(EditError, match="There is no agent 'ghost' here"):
        drivable_agent_ids(scenario, ("ghost",))
