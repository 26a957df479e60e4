from dataclasses import replace

import numpy as np
import pytest

from pd_editor.base.errors import EditError, GenerationError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import GenerationRequest
from pd_editor.scene.locks import STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.roles.traffic_choice import (
    agent_ids_of_kinds,
    drivable_agent_ids,
    replaceable_agent_ids,
    resamplable_agent_ids,
)
from tests.editor.command_strategies import busy_scenario

BUSY = busy_scenario()
IDS = BUSY.agents.ids


@pytest.mark.parametrize("kept_s", [-0.1, 60.1, float("nan"), float("inf")])
def test_impossible_locks_are_refused(kept_s):
    with pytest.raises(EditError, match="expected 0"):
        Lock(kept_s=kept_s)


def test_a_lock_says_what_it_keeps():
    assert TRAJECTORY_LOCK.in_words == "trajectory"
    assert STATE_LOCK.in_words == "state"
    assert Lock(kept_s=2.5).in_words == "first 2.5 s"


def test_kept_steps_of_state_beginning_and_trajectory():
    now = BUSY.current_step
    locks = {IDS[0]: STATE_LOCK, IDS[1]: Lock(kept_s=2.0), IDS[2]: TRAJECTORY_LOCK}
    kept = replace(BUSY, locks=locks).kept_steps()
    assert np.flatnonzero(kept[0]).tolist() == [now]
    assert np.flatnonzero(kept[1]).tolist() == list(range(now, now + 21))
    assert kept[2].all()
    assert not kept[3:].any()


def test_a_kept_beginning_ends_where_the_agent_leaves():
    # Agent 4 leaves at step 80, 2.9 s after the current step.
    kept = replace(BUSY, locks={IDS[4]: Lock(kept_s=5.0)}).kept_steps()
    assert np.flatnonzero(kept[4])[-1] == 79


def test_removed_agents_lose_their_locks():
    scenario = replace(BUSY, locks={IDS[0]: STATE_LOCK, IDS[1]: TRAJECTORY_LOCK})
    assert scenario.without_agents((IDS[0],)).locks == {IDS[1]: TRAJECTORY_LOCK}


def test_choices_of_agents_leave_out_what_is_locked():
    locks = {IDS[0]: STATE_LOCK, IDS[1]: Lock(kept_s=2.0), IDS[2]: TRAJECTORY_LOCK}
    scenario = replace(BUSY, locks=locks)
    drivable = drivable_agent_ids(scenario)
    assert drivable == (IDS[0], IDS[1], IDS[3], IDS[4])
    assert resamplable_agent_ids(scenario, drivable) == (IDS[3], IDS[4])
    replaced = replaceable_agent_ids(scenario, keeps_ego=False, keeps_focal=False)
    assert replaced == IDS[3:]
    kinds = {AgentKind.PEDESTRIAN}
    assert agent_ids_of_kinds(scenario, drivable, kinds) == (IDS[3],)
    assert agent_ids_of_kinds(scenario, drivable, ()) == drivable


def test_nothing_left_to_generate_is_said():
    scenario = replace(BUSY, locks=dict.fromkeys(IDS, TRAJECTORY_LOCK))
    with pytest.raises(GenerationError, match=r"trajectories of all these .* locked"):
        drivable_agent_ids(scenario)
    scenario = replace(BUSY, locks=dict.fromkeys(IDS, STATE_LOCK))
    with pytest.raises(GenerationError, match=r"states of all these .* locked"):
        resamplable_agent_ids(scenario, IDS)


@pytest.mark.parametrize(
    ("lock", "redrawn", "said"),
    [
        (TRAJECTORY_LOCK, False, "trajectory of agent 100 is locked"),
        (STATE_LOCK, True, "state of agent 100 is locked"),
        (Lock(kept_s=1.0), True, "state of agent 100 is locked"),
    ],
)
def test_requests_against_a_lock_are_refused(lock, redrawn, said):
    scenario = replace(BUSY, locks={IDS[0]: lock})
    ids = (IDS[0],)
    with pytest.raises(GenerationError, match=said):
        GenerationRequest(
            scenario=scenario, agent_ids=ids, resampled_state_ids=ids if redrawn else ()
        )
