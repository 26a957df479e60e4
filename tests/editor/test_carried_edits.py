"""Edits of one scene in another: roles, poses, and what is left out."""

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.space import KeepGap
from pd_editor.analysis.guidance.kinds.speed import TargetSpeed
from pd_editor.base.errors import EditError
from pd_editor.editor.commands import (
    AddGuidance,
    ChangeGuidance,
    Command,
    DeleteAgents,
    RemoveGuidance,
    ReplaceTraffic,
    SetAgentSpeed,
    SetRoadWarp,
    traffic_command,
)
from pd_editor.editor.family import Member, member
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.generation import GenerationRequest, Region, run_to_end
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.roles.traffic_choice import (
    drivable_agent_ids,
    resamplable_agent_ids,
)
from pd_editor.scene.scenario import Scenario

HERE, THERE = "merge", "roundabout"
MODEL = "lane-follower"


def carried(session: EditorSession, there: Scenario) -> Member:
    """The session's edits in another scene."""
    recipe = session.recipe()
    return member(recipe, session.base, {}, "carried", make_generator, on=there)


def edited(*commands: Command) -> EditorSession:
    session = EditorSession(open_scenario(HERE))
    for command in commands:
        session.apply(command)
    return session


def generated(session: EditorSession, model: str = MODEL, **asked: object) -> None:
    """Apply traffic of everybody, or what is asked for."""
    scenario = session.scenario
    about = {"agent_ids": drivable_agent_ids(scenario), **asked}
    request = GenerationRequest(scenario=scenario, **about)  # type: ignore[arg-type]
    traffic = run_to_end(make_generator(model).generate(request))
    session.apply(traffic_command(request, traffic))


@pytest.mark.parametrize("ahead_m", [0.0, 12.0])
def test_a_warp_lies_to_the_focal_agent_as_it_did(ahead_m: float):
    here, there = open_scenario(HERE), open_scenario(THERE)
    aside = RigidMotion(x_m=ahead_m, y_m=ahead_m / 3, rotation_rad=ahead_m / 30)
    term = WarpTerm(kind="smooth-turn", power=4.0, length_m=20.0)
    anchor = pose_of_anchor(here, "focal").after(aside)
    session = edited(SetRoadWarp(warp=RoadWarp(anchor=anchor, terms=(term,))))
    made = carried(session, there)
    (command,) = made.recipe.commands
    assert isinstance(command, SetRoadWarp)
    assert command.warp is not None
    assert command.warp.terms == (term,)
    seen = pose_of_anchor(there, "focal").inverse().after(command.warp.anchor)
    assert (seen.x_m, seen.y_m) == pytest.approx((aside.x_m, aside.y_m), abs=1e-9)
    assert seen.rotation_rad == pytest.approx(aside.rotation_rad, abs=1e-9)
    assert made.left_out == ()


def test_everybody_is_everybody_and_what_is_made_can_be_read_again():
    session, there = edited(), open_scenario(THERE)
    x, y = session.scenario.agents.position_m[0, session.scenario.current_step]
    free = resamplable_agent_ids(session.scenario, drivable_agent_ids(session.scenario))
    where = Region(center_m=(float(x), float(y)), half_side_m=30.0)
    generated(session, DEFAULT_GENERATOR, num_samples=2, seed=5)
    generated(
        session, DEFAULT_GENERATOR, resampled_state_ids=free, seed=6, region=where
    )
    made = carried(session, there)
    first, second = made.recipe.commands
    assert isinstance(first, ReplaceTraffic)
    assert isinstance(second, ReplaceTraffic)
    everybody = set(drivable_agent_ids(there))
    assert set(first.sample.ids) == set(first.request.agent_ids) == everybody
    assert (first.seed, second.seed) == (5, 6)
    assert set(second.request.resampled_state_ids) <= everybody
    again = replay(Recipe.from_text(made.recipe.to_text()), there)
    np.testing.assert_array_equal(
        again.agents.position_m, made.scenario.agents.position_m
    )


def test_ego_and_focal_agent_have_their_like_and_others_are_left_out():
    here, there = open_scenario(HERE), open_scenario(THERE)
    others = [one for one in drivable_agent_ids(here) if one != here.focal_id]
    session = edited(
        SetAgentSpeed(agent_ids=(here.focal_id,), speed_mps=3.0),
        DeleteAgents(agent_ids=(others[0],)),
    )
    generated(session, agent_ids=(others[1], others[2]))
    made = carried(session, there)
    (command,) = made.recipe.commands
    assert command == SetAgentSpeed(agent_ids=(there.focal_id,), speed_mps=3.0)
    labels = [one.label for one in session.commands_in_force]
    assert list(made.left_out) == labels[1:]


def test_terms_of_all_agents_are_carried_with_their_places_in_the_list():
    here, there = open_scenario(HERE), open_scenario(THERE)
    x, y = here.agents.position_m[0, here.current_step].tolist()
    goal = GoalPoint(agent_id=here.agents.ids[0], point_m=(x + 5.0, y))
    session = edited(
        AddGuidance(term=goal),
        AddGuidance(term=TargetSpeed(speed_mps=5.0)),
        AddGuidance(term=KeepGap(gap_m=8.0)),
        ChangeGuidance(index=1, term=TargetSpeed(speed_mps=7.0)),
        RemoveGuidance(index=0),
        ChangeGuidance(index=1, term=KeepGap(gap_m=9.0)),
        RemoveGuidance(index=0),
    )
    made = carried(session, there)
    assert made.scenario.guidance == session.scenario.guidance == (KeepGap(gap_m=9.0),)
    assert len(made.left_out) == 2


def test_a_warp_needs_a_focal_agent_there():
    here = open_scenario(HERE)
    term = WarpTerm(kind="smooth-turn", power=4.0, length_m=20.0)
    anchor = pose_of_anchor(here, "focal")
    session = edited(SetRoadWarp(warp=RoadWarp(anchor=anchor, terms=(term,))))
    there = open_scenario(THERE)
    with pytest.raises(EditError, match="no focal agent"):
        carried(session, there.without_agents(there.agents.ids))
