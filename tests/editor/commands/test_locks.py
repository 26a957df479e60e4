"""Laws of locks: no edit changes what they keep."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pd_editor.analysis.repair.retimed_trajectories import (
    retime_for_comfort,
    yield_to_others,
)
from pd_editor.analysis.repair.state_repairs import (
    project_to_lanes,
    separate_overlaps,
    slow_for_gaps,
)
from pd_editor.base.errors import EditError, LockedAgentError, PdEditorError
from pd_editor.editor.commands import (
    DeleteAgents,
    SetAgentSize,
    SetAgentSpeed,
    SetLocks,
    SetRoadWarp,
    TransformAgents,
    command_from_json,
    command_to_json,
    traffic_command,
)
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.session import EditorSession
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationRequest,
    TrafficSample,
)
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.locks import STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from tests.editor.command_strategies import (
    ABSENT_ID,
    any_command,
    busy_scenario,
    ignore_random_checks,
    locks,
    present_ids,
    some_of,
)
from tests.editor.same_scenario import same_scenario

pytestmark = ignore_random_checks
BASE = busy_scenario()
IDS = BASE.agents.ids
WARP = RoadWarp(
    anchor=RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0),
    terms=(WarpTerm(kind="smooth-turn", power=5.0, length_m=40.0),),
)


def kept_parts(
    scenario: Scenario, locked: Scenario | None = None
) -> dict[str, tuple[bytes, ...]]:
    """The bytes that the locks of one scenario (or of another) keep of each agent."""
    locked = scenario if locked is None else locked
    agents, is_kept = scenario.agents, locked.kept_steps()
    parts: dict[str, tuple[bytes, ...]] = {}
    for name in locked.locks:
        row = agents.row_of[name]
        steps = is_kept[locked.agents.row_of[name]]
        parts[name] = (
            str(agents.kinds[row]).encode(),
            agents.size_m[row].tobytes(),
            agents.activity[row].tobytes(),
            *(
                # The sign of a zero is no change: - 0.0 becomes 0.0.
                (getattr(agents, field)[row][steps] + 0.0).tobytes()
                for field in ("position_m", "heading_rad", "velocity_mps", "is_valid")
            ),
        )
    return parts


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_no_edit_changes_what_is_locked(data: st.DataObject):
    wanted = data.draw(some_of(present_ids(BASE)))
    chosen = {name: data.draw(locks()) for name in wanted}
    before = replace(BASE, locks=chosen)
    command = data.draw(any_command(before))
    try:
        after = apply_within_locks(command, before)
    except LockedAgentError:
        return
    except PdEditorError:
        assume(False)
        raise
    if isinstance(command, SetLocks):
        assert after.agents is before.agents
        return
    assert set(after.locks) == set(chosen) & set(after.agents.ids)
    if any(part.is_beyond_locks for part in command.parts):
        return
    kept = {name: lock for name, lock in chosen.items() if name in after.locks}
    locked = replace(before, locks=kept)
    assert kept_parts(after, locked) == kept_parts(locked)


@pytest.mark.parametrize("lock", [STATE_LOCK, Lock(kept_s=1.5), TRAJECTORY_LOCK])
def test_edits_of_a_locked_agent_name_the_lock_and_change_nothing(lock):
    session = EditorSession(BASE)
    session.apply(SetLocks(agent_ids=(IDS[0],), lock=lock))
    before = session.scenario
    for command in (
        TransformAgents(agent_ids=(IDS[0], IDS[1]), dx_m=1.0),
        SetAgentSpeed(agent_ids=(IDS[0],), speed_mps=3.0),
        SetAgentSize(agent_ids=(IDS[0],), length_m=9.0, width_m=None),
    ):
        with pytest.raises(
            LockedAgentError, match=f"The {lock.in_words} of agent"
        ) as caught:
            session.apply(command)
        assert caught.value.agent_ids == (IDS[0],)
        with pytest.raises(LockedAgentError):
            session.preview(command)
    assert session.scenario is before
    session.apply(SetLocks(agent_ids=(IDS[0],), lock=None))
    session.apply(TransformAgents(agent_ids=(IDS[0],), dx_m=1.0))
    assert not session.scenario.locks


def test_locks_are_undone_and_stand_in_the_recipe():
    session = EditorSession(BASE)
    session.apply(SetLocks(agent_ids=IDS[:2], lock=Lock(kept_s=2.0)))
    session.apply(SetLocks(agent_ids=(IDS[1],), lock=TRAJECTORY_LOCK))
    assert session.scenario.locks == {IDS[0]: Lock(kept_s=2.0), IDS[1]: TRAJECTORY_LOCK}
    recipe = Recipe.from_text(session.recipe().to_text())
    again = EditorSession.from_recipe(recipe, BASE)
    assert same_scenario(again.scenario, session.scenario)
    session.undo()
    session.undo()
    assert session.scenario is BASE


def test_locked_agents_move_with_the_road_and_back():
    session = EditorSession(BASE)
    session.apply(SetLocks(agent_ids=IDS[:2], lock=TRAJECTORY_LOCK))
    before = session.scenario
    session.apply(SetRoadWarp(warp=WARP))
    assert session.scenario.locks == before.locks
    assert (session.scenario.agents.position_m != before.agents.position_m).any()
    session.apply(SetRoadWarp(warp=None))
    assert same_scenario(session.scenario, before)


def test_deleting_a_locked_agent_drops_its_lock():
    session = EditorSession(BASE)
    session.apply(SetLocks(agent_ids=(IDS[1],), lock=TRAJECTORY_LOCK))
    session.apply(DeleteAgents(agent_ids=(IDS[1],)))
    assert not session.scenario.locks
    session.undo()
    assert session.scenario.locks == {IDS[1]: TRAJECTORY_LOCK}


def test_locks_on_agents_that_are_not_there_are_refused():
    with pytest.raises(EditError, match="no agent 'ghost'"):
        SetLocks(agent_ids=("ghost",), lock=TRAJECTORY_LOCK).apply(BASE)
    with pytest.raises(EditError, match="no state at the current step"):
        SetLocks(agent_ids=(ABSENT_ID,), lock=STATE_LOCK).apply(BASE)
    with pytest.raises(EditError, match="No agent is selected"):
        SetLocks(agent_ids=(), lock=None).apply(BASE)


@pytest.mark.parametrize(
    "lock", [None, STATE_LOCK, Lock(kept_s=0.1 + 0.2), TRAJECTORY_LOCK]
)
def test_a_lock_in_json_is_the_same_lock(lock):
    command = SetLocks(agent_ids=("a",), lock=lock)
    again = command_from_json(command_to_json(command), "entry")
    assert isinstance(again, SetLocks)
    assert again.lock == lock


@settings(max_examples=25, deadline=None)
@given(chosen=st.dictionaries(st.sampled_from(present_ids(BASE)), locks(), min_size=1))
def test_repairs_keep_what_is_locked(chosen: dict[str, Lock]):
    before = replace(BASE, locks=chosen)
    after = slow_for_gaps(separate_overlaps(project_to_lanes(before)))
    after, _ = yield_to_others(retime_for_comfort(after))
    assert kept_parts(after) == kept_parts(before)


def moved_sample(
    scenario: Scenario, ids: tuple[str, ...], by_m: float
) -> TrafficSample:
    """The recorded trajectories, shifted from the second step on."""
    agents, now = scenario.agents, scenario.current_step
    rows = agents.rows(ids)
    position = agents.position_m[rows, now:].copy()
    position[:, 1:] += by_m
    return TrafficSample(
        ids=ids,
        kinds=tuple(agents.kinds[row] for row in rows),
        size_m=agents.size_m[rows],
        position_m=position,
        heading_rad=agents.heading_rad[rows, now:],
        velocity_mps=agents.velocity_mps[rows, now:],
    )


def traffic_of(sample: TrafficSample) -> GeneratedTraffic:
    return GeneratedTraffic(samples=(sample,), generator="test")


def test_a_generator_that_ignores_a_lock_is_refused():
    scenario = replace(BASE, locks={IDS[0]: Lock(kept_s=2.0)})
    request = GenerationRequest(scenario=scenario, agent_ids=IDS[:2])
    traffic = traffic_of(moved_sample(scenario, IDS[:2], 1.0))
    with pytest.raises(PdEditorError, match="first 2 s of agent"):
        traffic_command(request, traffic)


def test_generated_traffic_leaves_the_kept_beginning_bit_identical():
    turned = BASE.agents.with_rows(
        np.arange(2), position_m=BASE.agents.position_m[:2] + np.pi / 7
    )
    scenario = replace(BASE, agents=turned, locks={IDS[0]: Lock(kept_s=2.0)})
    request = GenerationRequest(scenario=scenario, agent_ids=IDS[:2])
    command = traffic_command(
        request, traffic_of(moved_sample(scenario, IDS[:2], 0.003))
    )
    after = apply_within_locks(command, scenario)
    assert kept_parts(after) == kept_parts(scenario)
    end = scenario.current_step + 21
    moved = after.agents.position_m[0, end:] - scenario.agents.position_m[0, end:]
    assert np.allclose(moved, 0.003, atol=1e-4)


def test_results_that_would_remove_a_locked_agent_are_refused():
    request = GenerationRequest(
        scenario=BASE.without_agents((IDS[1],)), agent_ids=(IDS[0],)
    )
    command = traffic_command(
        request, traffic_of(moved_sample(BASE, IDS[:1], 1.0)), removed_ids=(IDS[1],)
    )
    scenario = replace(BASE, locks={IDS[1]: STATE_LOCK})
    with pytest.raises(LockedAgentError, match=f"agent {IDS[1]} is locked"):
        command.apply(scenario)
