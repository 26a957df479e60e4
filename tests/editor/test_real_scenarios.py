"""Edits, recipes and journals on real Argoverse 2 scenarios."""

from pathlib import Path

import numpy as np
import pytest

from pd_editor.editor.commands import (
    PlaceAgent,
    SetAgentSpeed,
    SetRoadWarp,
    TransformAgents,
    new_agent_id,
    traffic_command,
)
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import Journal, find_unfinished, restore
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from tests.editor.command_strategies import present_ids
from tests.editor.fake_generators import DriftGenerator
from tests.editor.same_scenario import same_scenario

pytestmark = pytest.mark.real_data


@pytest.fixture(params=range(0, 70, 14))
def scenario(request, av2_scenario_folders: list[Path]) -> Scenario:
    return read_scenario(av2_scenario_folders[request.param])


def edited(scenario: Scenario, session: EditorSession) -> None:
    """Warp, move, place, drive and speed up."""
    agents, now = scenario.agents, scenario.current_step
    focal = agents.row_of[scenario.focal_id]
    x, y = (float(value) for value in agents.position_m[focal, now])
    heading = float(agents.heading_rad[focal, now])
    term = WarpTerm(kind="double-turn", power=5.0, length_m=10.0)
    anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=heading)
    warp = RoadWarp(anchor=anchor, terms=(term,))
    session.apply(SetRoadWarp(warp=warp, friction_coefficient=0.7))
    ids = tuple(present_ids(session.scenario))[:12]
    session.select(ids)
    session.apply(TransformAgents(agent_ids=ids, dx_m=1.0, rotation_rad=0.05))
    place = PlaceAgent(
        agent_id=new_agent_id(session.scenario),
        kind=AgentKind.VEHICLE,
        x_m=x - 15 * float(np.cos(heading)),
        y_m=y - 15 * float(np.sin(heading)),
        heading_rad=heading,
        speed_mps=8.0,
        back_cast=True,
    )
    session.apply(place)
    request = GenerationRequest(scenario=session.scenario, agent_ids=ids, seed=1)
    traffic = run_to_end(DriftGenerator().generate(request))
    session.apply(traffic_command(request, traffic))
    session.apply(SetAgentSpeed(agent_ids=ids[:5], speed_mps=6.0))


def test_recipe_and_journal_lead_to_the_same_scenario(scenario: Scenario, tmp_path):
    session = EditorSession(scenario, journal=Journal(tmp_path))
    edited(scenario, session)
    session.undo()
    session.redo()
    recipe = Recipe.from_text(session.recipe().to_text())
    assert same_scenario(replay(recipe, scenario), session.scenario)
    session.close()
    (work,) = find_unfinished(tmp_path)
    again = restore(work, scenario)
    assert same_scenario(again.scenario, session.scenario)
    again.jump_to(0)
    assert again.scenario is scenario
    again.close()


@pytest.mark.parametrize("speed", [0.0, 7.5, -1.5])
def test_a_new_speed_keeps_every_present_agent_where_it_is(
    scenario: Scenario, speed: float
):
    ids = tuple(present_ids(scenario))
    changed = SetAgentSpeed(agent_ids=ids, speed_mps=speed).apply(scenario).agents
    before, now = scenario.agents, scenario.current_step
    rows = before.rows(ids)
    for name in ("position_m", "heading_rad"):
        assert (getattr(changed, name)[:, now] == getattr(before, name)[:, now]).all()
    assert np.allclose(changed.speed_mps()[rows, now], abs(speed), atol=1e-6)
    both = changed.is_valid[rows, now:-1] & changed.is_valid[rows, now + 1 :]
    step = np.diff(changed.position_m[rows, now:], axis=1)
    pace = np.linalg.norm(step, axis=-1)[both] / scenario.time_axis.step_s
    logged = before.speed_mps()[rows, now:].max(initial=0)
    assert pace.max(initial=0) <= max(abs(speed), logged) + 1.0
