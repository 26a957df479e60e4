"""An edit with the traffic that was regenerated for it."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from pd_editor.base.errors import LockedAgentError, RecipeError
from pd_editor.editor.commands import (
    RegeneratedEdit,
    SetLocks,
    SetRoadWarp,
    TransformAgents,
    command_from_json,
    command_to_json,
    traffic_command,
)
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.commands.traffic import carried_to
from pd_editor.editor.edit_findings import carried_agent_ids, generated_agent_ids
from pd_editor.editor.recipe import Recipe, regenerate, replay
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.locks import STATE_LOCK, Lock
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.editor.command_strategies import busy_scenario
from tests.editor.fake_generators import DriftGenerator
from tests.editor.same_scenario import same_scenario

BASE = busy_scenario()
MOVE = TransformAgents(agent_ids=("100",), dx_m=2.0, rotation_rad=0.3)
GENERATOR = DriftGenerator()


def bend(power: float) -> SetRoadWarp:
    term = WarpTerm(kind="smooth-turn", power=power, length_m=20.0, border_m=0.0)
    anchor = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)
    return SetRoadWarp(warp=RoadWarp(anchor=anchor, terms=(term,)))


def regenerated(ids: tuple[str, ...] = ("100", "101")) -> RegeneratedEdit:
    request = GenerationRequest(scenario=MOVE.apply(BASE), agent_ids=ids, seed=7)
    traffic = run_to_end(GENERATOR.generate(request))
    return RegeneratedEdit(edit=MOVE, traffic=traffic_command(request, traffic))


def test_it_is_the_edit_and_then_the_traffic():
    command = regenerated()
    step_by_step = command.traffic.apply(MOVE.apply(BASE))
    assert same_scenario(command.apply(BASE), step_by_step)
    assert command.edits_current_state
    assert (
        command.label
        == "Move agent 100 by 2.0 m, turn by +17\N{DEGREE SIGN}, 2 agents regenerated"
    )


def test_the_moved_agent_does_not_count_as_carried_once_it_is_regenerated():
    assert carried_agent_ids([MOVE]) == {"100"}
    assert carried_agent_ids([regenerated()]) == set()
    assert carried_agent_ids([regenerated(("101",))]) == {"100"}
    assert generated_agent_ids([MOVE, regenerated(("101",))]) == {"101"}


def test_a_recipe_with_it_replays_and_regenerates():
    recipe = Recipe(base=BASE.reference, commands=(regenerated(),))
    again = Recipe.from_text(recipe.to_text())
    assert again.commands == recipe.commands
    assert again.edited_ids == {"100", "101"}
    assert same_scenario(replay(again, BASE), recipe.commands[0].apply(BASE))
    result, (entry,) = regenerate(again, BASE, GENERATOR)
    assert entry.is_equal
    assert same_scenario(result, replay(again, BASE))


def test_damaged_entries_are_told():
    good = command_to_json(regenerated())
    for change, message in (
        ({"traffic": None}, "Entry 1 .RegeneratedEdit..traffic must be an object"),
        ({"traffic": good["edit"]}, "traffic must be a ReplaceTraffic"),
        ({"edit": good}, "must not contain another RegeneratedEdit"),
        ({"more": 1}, "must have exactly the fields"),
    ):
        with pytest.raises(RecipeError, match=message):
            command_from_json(json.loads(json.dumps(good | change)), "Entry 1")


def test_carried_trajectories_begin_at_the_present_poses_and_keep_their_shape():
    sample = regenerated().traffic.sample
    edited = TransformAgents(agent_ids=("100",), dy_m=5.0, rotation_rad=1.0).apply(
        MOVE.apply(BASE)
    )
    carried = carried_to(sample, edited)
    now, row = edited.current_step, edited.agents.row_of["100"]
    assert np.allclose(carried.position_m[0, 0], edited.agents.position_m[row, now])
    assert np.allclose(carried.position_m[1], sample.position_m[1], atol=1e-4)
    way = carried.position_m[0, -1] - carried.position_m[0, 0]
    before = sample.position_m[0, -1] - sample.position_m[0, 0]
    assert math.isclose(np.hypot(*way), np.hypot(*before), rel_tol=1e-5)
    turn = math.atan2(way[1], way[0]) - math.atan2(before[1], before[0])
    assert math.isclose(turn, 1.0, abs_tol=1e-4)
    assert carried_to(sample, MOVE.apply(BASE)) is sample


def test_traffic_with_a_bent_road_keeps_locked_states():
    """(W9) The road carries locked agents along; its traffic must not move them."""
    locked = SetLocks(agent_ids=("100",), lock=STATE_LOCK).apply(BASE)
    warp = bend(6.0)
    request = GenerationRequest(scenario=warp.apply(locked), agent_ids=("100",), seed=7)
    traffic = run_to_end(GENERATOR.generate(request))
    command = traffic_command(request, traffic)
    kept = RegeneratedEdit(edit=warp, traffic=command)
    assert same_scenario(apply_within_locks(kept, locked), kept.apply(locked))
    sample = replace(command.sample, position_m=command.sample.position_m + 3.0)
    with pytest.raises(LockedAgentError, match="state of agent 100 is locked"):
        apply_within_locks(
            RegeneratedEdit(edit=warp, traffic=replace(command, sample=sample)), locked
        )


def test_carried_trajectories_continue_the_locked_seconds():
    """(W9) No jump where the locked seconds end, while a road is bent further."""
    locked = SetLocks(agent_ids=("100",), lock=Lock(kept_s=2.0)).apply(BASE)
    first, further = bend(-8.0).apply(BASE), bend(8.0)
    request = GenerationRequest(scenario=first, agent_ids=("100",), seed=7)
    command = traffic_command(request, run_to_end(GENERATOR.generate(request)))
    now, row = BASE.current_step, BASE.agents.row_of["100"]
    sample = replace(
        command.sample,
        position_m=first.agents.position_m[[row], now:],
        heading_rad=first.agents.heading_rad[[row], now:],
        velocity_mps=first.agents.velocity_mps[[row], now:],
    )
    edited = further.apply(locked)
    carried = replace(command, sample=carried_to(sample, edited))
    after = apply_within_locks(RegeneratedEdit(edit=further, traffic=carried), locked)
    track, speed = after.agents.position_m[row], BASE.agents.velocity_mps[row, now, 0]
    assert (
        track[now : now + 21] == edited.agents.position_m[row, now : now + 21]
    ).all()
    steps_m = np.hypot(*np.diff(track[now:], axis=0).T)
    assert steps_m.max() < 1.5 * speed * BASE.time_axis.step_s
