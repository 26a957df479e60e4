"""Guidance terms as edits: recipes, journals, warps and deletions carry them."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.path import FollowLane, FollowPath
from pd_editor.analysis.guidance.kinds.space import AvoidCollisions, KeepGap, StayOnRoad
from pd_editor.analysis.guidance.kinds.speed import (
    ComfortLimits,
    SpeedLimit,
    StopAtLine,
    TargetSpeed,
)
from pd_editor.base.errors import EditError, RecipeError
from pd_editor.editor.commands import (
    AddGuidance,
    ChangeGuidance,
    DeleteAgents,
    RemoveGuidance,
    RequestSummary,
    SetRoadWarp,
    TransformAgents,
    command_from_json,
    command_to_json,
)
from pd_editor.editor.commands.json_values import from_json, to_json
from pd_editor.editor.journal import Journal
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import find_unfinished, restore
from pd_editor.scene.generation import GuidanceSetting
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.guidance_terms import MAX_TERMS, GuidanceTerm
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.editor.command_strategies import busy_scenario

BASE = replace(busy_scenario(), guidance=())
TERMS: tuple[GuidanceTerm, ...] = (
    FollowPath(agent_id="100", points_m=((0.0, 0.0), (30.0, 0.5)), weight=2.0),
    FollowLane(agent_id="100", lane_ids=(1, 2)),
    GoalPoint(agent_id="100", point_m=(40.0, 0.0), at_s=4.5),
    GoalPoint(agent_id="101", point_m=(20.0, 0.0), is_on=False),
    TargetSpeed(agent_ids=("100", "101"), speed_mps=7.0),
    SpeedLimit(speed_mps=12.0),
    ComfortLimits(max_braking_mps2=3.0),
    StopAtLine(agent_id="101", line_m=((20.0, -2.0), (20.0, 2.0))),
    StayOnRoad(),
    KeepGap(agent_ids=("101",), gap_m=8.0),
    AvoidCollisions(side="left"),
    YieldTo(agent_id="101", other_id="100"),
    Threaten(agent_id="101", other_id="100", severity=0.5, approach="cut-in"),
)


def session_with(*terms: GuidanceTerm) -> EditorSession:
    session = EditorSession(BASE)
    for term in terms:
        session.apply(AddGuidance(term=term))
    return session


def bend() -> SetRoadWarp:
    term = WarpTerm(kind="smooth-turn", power=5.0, length_m=10.0)
    anchor = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)
    return SetRoadWarp(warp=RoadWarp(anchor=anchor, terms=(term,)))


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.kind)
def test_each_term_survives_json(term: GuidanceTerm):
    stored = json.loads(json.dumps(to_json(term)))
    assert stored["kind"] == term.kind
    assert from_json(GuidanceTerm, stored, "The term") == term
    command = ChangeGuidance(index=0, term=term)
    text = json.dumps(command_to_json(command))
    assert command_from_json(json.loads(text), "Entry 1") == command


def test_a_recipe_replays_terms_their_changes_and_removals():
    session = session_with(*TERMS)
    session.apply(
        ChangeGuidance(index=2, term=GoalPoint(agent_id="100", point_m=(35.0, 0.0)))
    )
    session.apply(RemoveGuidance(index=0))
    recipe = Recipe.from_text(session.recipe().to_text())
    assert replay(recipe, BASE).guidance == session.scenario.guidance
    assert len(session.scenario.guidance) == len(TERMS) - 1
    assert session.scenario.guidance[1].point_m == (35.0, 0.0)


def test_a_journal_restores_terms(tmp_path: Path):
    session = EditorSession(BASE, journal=Journal(tmp_path))
    for term in TERMS:
        session.apply(AddGuidance(term=term))
    session.close()
    (work,) = find_unfinished(tmp_path)
    restored = restore(work, BASE)
    assert restored.scenario.guidance == TERMS
    restored.undo()
    assert restored.scenario.guidance == TERMS[:-1]
    restored.close()


def test_adding_and_removing_are_undone():
    session = session_with(TERMS[2])
    session.apply(RemoveGuidance(index=0))
    assert session.scenario.guidance == ()
    session.undo()
    assert session.scenario.guidance == (TERMS[2],)
    session.undo()
    assert session.scenario is BASE


def test_a_warp_carries_points_and_its_reset_gives_back_the_originals():
    session = session_with(TERMS[0], TERMS[2], TERMS[7])
    before = session.scenario
    session.apply(bend())
    warp = session.scenario.applied_warp
    assert warp is not None
    path, goal, line = session.scenario.guidance
    assert isinstance(goal, GoalPoint)
    assert isinstance(path, FollowPath)
    assert isinstance(line, StopAtLine)
    assert goal.point_m[1] > 10
    assert path.points_m[0] == (0.0, 0.0)
    assert line.line_m[0][1] > 0
    # A term that is set on the warped road goes back with the road.
    session.apply(AddGuidance(term=GoalPoint(agent_id="101", point_m=goal.point_m)))
    session.apply(SetRoadWarp(warp=None))
    assert session.scenario.guidance[:3] == before.guidance
    added = session.scenario.guidance[3]
    assert isinstance(added, GoalPoint)
    assert added.point_m == pytest.approx((40.0, 0.0), abs=1e-9)


def test_deleted_agents_leave_their_terms():
    session = session_with(*TERMS)
    session.apply(DeleteAgents(agent_ids=("101",)))
    left = session.scenario.guidance
    assert all("101" not in term.named_ids for term in left)
    assert TargetSpeed(agent_ids=("100",), speed_mps=7.0) in left
    assert SpeedLimit(speed_mps=12.0) in left
    session.undo()
    assert session.scenario.guidance == TERMS


def test_moving_an_agent_leaves_its_goal():
    session = session_with(TERMS[2])
    session.apply(TransformAgents(agent_ids=("100",), dx_m=-3.0))
    assert session.scenario.guidance == (TERMS[2],)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (
            AddGuidance(term=GoalPoint(agent_id="9", point_m=(0.0, 0.0))),
            "no agent '9' here for the goal point",
        ),
        (AddGuidance(term=FollowLane(agent_id="100", lane_ids=(99,))), "no lane 99"),
        (RemoveGuidance(index=0), "no guidance term 1; the scenario has 0"),
        (RemoveGuidance(index=-1), "no guidance term"),
        (ChangeGuidance(index=3, term=TERMS[2]), "no guidance term 4"),
    ],
)
def test_what_is_not_there_is_refused(command, said):
    with pytest.raises(EditError, match=said):
        command.apply(BASE)


def test_the_number_of_terms_is_limited():
    scenario = BASE
    for _ in range(MAX_TERMS):
        scenario = AddGuidance(term=TERMS[5]).apply(scenario)
    with pytest.raises(EditError, match="at most 200"):
        AddGuidance(term=TERMS[5]).apply(scenario)


def test_labels_tell_what_changed():
    session = session_with(TERMS[2])
    before = session.scenario
    goal = TERMS[2]
    off = ChangeGuidance(
        index=0,
        term=GoalPoint(agent_id="100", point_m=(40.0, 0.0), at_s=4.5, is_on=False),
    )
    strong = ChangeGuidance(
        index=0,
        term=GoalPoint(agent_id="100", point_m=(40.0, 0.0), at_s=4.5, weight=2.0),
    )
    assert AddGuidance(term=goal).label == "Add goal point of agent 100"
    assert off.label_after(before) == "Switch goal point of agent 100 off"
    assert strong.label_after(before) == "Strength of goal point of agent 100: 2"
    assert RemoveGuidance(index=0).label_after(before) == (
        "Remove goal point of agent 100"
    )


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"agent_id": "1", "point_m": [0, 0]}, "names its kind"),
        ({"kind": "goal", "agent_id": "1", "point_m": [0, 0]}, "one of goal-point"),
        ({"kind": "goal-point", "agent_id": "1"}, "lacks the field 'point_m'"),
        ({"kind": "goal-point", "agent_id": "1", "point_m": [0, 0], "x": 1}, "'x'"),
        ({"kind": "goal-point", "agent_id": "1", "point_m": [0]}, "list of 2"),
        ({"kind": 3, "agent_id": "1", "point_m": [0]}, "one of goal-point"),
    ],
)
def test_bad_stored_terms_are_refused(data, said):
    with pytest.raises(RecipeError, match=said):
        from_json(GuidanceTerm, data, "The term")


def test_stored_requests_hold_terms_and_the_settings_of_earlier_versions():
    setting = GuidanceSetting(name="nearest-candidate", weight=0.5)
    summary = RequestSummary(agent_ids=("100",), guidance=(setting, TERMS[5]))
    stored = json.loads(json.dumps(to_json(summary)))
    assert stored["guidance"][0] == {
        "name": "nearest-candidate",
        "weight": 0.5,
        "agent_ids": [],
        "parameters": {},
    }
    assert from_json(RequestSummary, stored, "The request") == summary
    request = summary.request(session_with(TERMS[2], TERMS[3]).scenario, seed=1)
    assert request.settings == (setting,)
    assert request.terms == (TERMS[2], TERMS[5])
