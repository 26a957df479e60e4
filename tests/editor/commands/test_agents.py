"""Which agents there are, and what they are."""

import numpy as np
import pytest

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import (
    DeleteAgents,
    DuplicateAgents,
    SetAgentActivity,
    SetAgentKind,
    SetAgentSize,
    SetAgentSpeed,
    SetFocalAgent,
    new_agent_id,
    new_agent_ids,
)
from pd_editor.scene.agent_kind import (
    DEFAULT_SIZE_M,
    Activity,
    AgentCategory,
    AgentKind,
)
from tests.editor.command_strategies import ABSENT_ID, busy_scenario
from tests.editor.same_scenario import same_tracks

BASE = busy_scenario()
FOCAL = BASE.focal_id


def test_kind_brings_its_size_unless_that_is_known():
    sized = SetAgentSize(agent_ids=("101",), length_m=5.5, width_m=2.1).apply(BASE)
    agents = SetAgentKind(agent_ids=("100", "101"), kind=AgentKind.BUS).apply(sized)
    assert agents.agents.kinds[:2] == (AgentKind.BUS, AgentKind.BUS)
    assert tuple(agents.agents.size_m[0]) == DEFAULT_SIZE_M[AgentKind.BUS]
    assert tuple(agents.agents.size_m[1]) == (5.5, 2.1)
    assert list(agents.agents.has_known_size[:3]) == [False, True, False]


@pytest.mark.parametrize("size", [(0.1, 1), (4, 31), (float("nan"), 2)])
def test_impossible_sizes_are_refused(size):
    with pytest.raises(EditError):
        SetAgentSize(agent_ids=("100",), length_m=size[0], width_m=size[1])


def test_copies_have_the_whole_track_but_no_score():
    command = DuplicateAgents(
        agent_ids=(FOCAL, "103"), new_ids=("a", "b"), dx_m=3, dy_m=-2
    )
    agents = command.apply(BASE).agents
    copies, originals = agents.taken([6, 7]), agents.taken([0, 3])
    assert copies.ids == ("a", "b")
    assert copies.categories == (AgentCategory.UNSCORED,) * 2
    gap = (copies.position_m - originals.position_m)[originals.is_valid]
    assert np.allclose(gap, [3, -2])
    for name in ("heading_rad", "velocity_mps", "is_valid", "observed", "size_m"):
        assert (getattr(copies, name) == getattr(originals, name)).all()
    assert command.selects == ("a", "b")


@pytest.mark.parametrize(
    ("ids", "new_ids", "message"),
    [
        (("100",), ("a", "b"), "1 agents to copy need as many new ids, not 2"),
        (("100", "101"), ("a", "a"), "under an id of its own"),
        (("100",), ("101",), "already an agent '101'"),
        (("100",), ("",), "not empty"),
        ((ABSENT_ID,), ("a",), "no state at the current step"),
    ],
)
def test_impossible_copies_are_refused(ids, new_ids, message):
    with pytest.raises(EditError, match=message):
        DuplicateAgents(agent_ids=ids, new_ids=new_ids).apply(BASE)


def test_absent_agents_can_be_deleted():
    left = DeleteAgents(agent_ids=(ABSENT_ID, "101")).apply(BASE)
    assert left.agents.ids == ("100", "102", "103", "104")
    kept = BASE.agents.taken([0, 2, 3, 4])
    assert same_tracks(left.agents, kept)


def test_the_focal_agent_cannot_be_deleted_until_another_is_focal():
    command = DeleteAgents(agent_ids=("101", FOCAL))
    with pytest.raises(EditError, match="choose another focal agent first"):
        command.apply(BASE)
    other = SetFocalAgent(agent_id="102").apply(BASE)
    assert command.apply(other).agents.ids == ("102", "103", "104", "105")


def test_there_is_one_focal_agent():
    other = SetFocalAgent(agent_id="102").apply(BASE)
    assert other.focal_id == "102"
    categories = other.agents.categories
    assert categories.count(AgentCategory.FOCAL) == 1
    assert categories[2] is AgentCategory.FOCAL
    assert categories[0] is AgentCategory.SCORED
    assert SetFocalAgent(agent_id="102").apply(other) is other


def test_an_absent_agent_cannot_be_focal():
    with pytest.raises(EditError, match="no state at the current step"):
        SetFocalAgent(agent_id=ABSENT_ID).apply(BASE)


def test_new_ids_are_free_and_always_the_same():
    assert new_agent_id(BASE) == "placed-1"
    taken = DuplicateAgents(agent_ids=("100",), new_ids=("copy-2",)).apply(BASE)
    assert new_agent_ids(taken, 3, "copy") == ("copy-1", "copy-3", "copy-4")


def test_agents_that_stand_are_parked_or_wait_and_what_moves_is_driving():
    ids = ("100", "101")
    moves = SetAgentSpeed(agent_ids=("100",), speed_mps=5.0).apply(BASE)
    moves = SetAgentSpeed(agent_ids=("101",), speed_mps=0.0).apply(moves)
    command = SetAgentActivity(agent_ids=ids, activity=Activity.PARKED)
    parked = command.apply(moves)
    assert list(parked.agents.activity[:2]) == [Activity.UNKNOWN, Activity.PARKED]
    assert list(parked.activity()[:2]) == [Activity.DRIVING, Activity.PARKED]
    assert command.apply(parked) is parked
    # An edit of the speed wins at once, and back at rest the agent is parked again.
    driven = SetAgentSpeed(agent_ids=("101",), speed_mps=3.0).apply(parked)
    assert driven.activity()[1] == Activity.DRIVING
    stopped = SetAgentSpeed(agent_ids=("101",), speed_mps=0.0).apply(driven)
    assert stopped.activity()[1] == Activity.PARKED


@pytest.mark.parametrize(
    ("speed", "activity"), [(5.0, Activity.PARKED), (0.0, Activity.DRIVING)]
)
def test_an_activity_that_contradicts_the_speed_is_refused(speed, activity):
    scene = SetAgentSpeed(agent_ids=("100",), speed_mps=speed).apply(BASE)
    with pytest.raises(EditError, match=f"cannot be {activity.in_words} at"):
        SetAgentActivity(agent_ids=("100",), activity=activity).apply(scene)
