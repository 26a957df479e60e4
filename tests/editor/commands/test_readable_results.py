"""What commands make can be opened again after its export, or they refuse in a sentence."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import (
    Command,
    PlaceAgent,
    SetAgentHeading,
    SetAgentPosition,
    SetAgentSpeed,
    SetRoadWarp,
    TransformAgents,
)
from pd_editor.editor.scenario_store import export_into, open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.scene import scene_limits
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_warp import RoadWarp, WarpTerm

BASE = open_scenario("roundabout")
FOCAL = BASE.focal_id
ROW, NOW = BASE.agents.row_of[FOCAL], BASE.current_step
(X, Y), HEADING = (
    BASE.agents.position_m[ROW, NOW].tolist(),
    float(BASE.agents.heading_rad[ROW, NOW]),
)


def sharp_bend(length_m: float = 1.0) -> SetRoadWarp:
    anchor = RigidMotion(
        x_m=X - 5 * math.cos(HEADING),
        y_m=Y - 5 * math.sin(HEADING),
        rotation_rad=HEADING,
    )
    term = WarpTerm(
        kind="smooth-turn", power=10.0, length_m=length_m, border_m=0.0, exponent=2.0
    )
    return SetRoadWarp(warp=RoadWarp(anchor=anchor, terms=(term,)))


def placed(x_m: float, y_m: float) -> PlaceAgent:
    return PlaceAgent(
        agent_id="far",
        kind=AgentKind.VEHICLE,
        x_m=x_m,
        y_m=y_m,
        heading_rad=0.0,
        speed_mps=60.0,
    )


def spin() -> list[Command]:
    ids = BASE.agents.ids
    return [TransformAgents(agent_ids=ids, dx_m=900.0, dy_m=900.0)] * 2


@pytest.mark.parametrize(
    ("edits", "words"),
    [
        (
            [SetAgentSpeed(agent_ids=(FOCAL,), speed_mps=30.0), sharp_bend()],
            "would move at .* at most 200 m/s",
        ),
        (
            [
                SetAgentPosition(agent_id=FOCAL, x_m=-4990.0, y_m=0.0),
                SetAgentHeading(agent_ids=(FOCAL,), heading_rad=math.pi),
                SetAgentSpeed(agent_ids=(FOCAL,), speed_mps=60.0),
            ],
            "more than 5 km from the other ones",
        ),
        ([placed(-4990.0, 0.0), placed(4990.0, 0.0)], "more than 5 km"),
        (spin(), "from the road; at most 500 m"),
        ([SetAgentSpeed(agent_ids=(FOCAL,), speed_mps=5.0), sharp_bend(2.0)], ""),
        ([sharp_bend(20.0)], ""),
    ],
)
def test_what_is_accepted_opens_again(edits: list[Command], words: str, tmp_path: Path):
    session = EditorSession(BASE)
    told = ""
    for edit in edits:
        before = session.scenario
        try:
            session.apply(edit)
        except EditError as error:
            told = str(error)
            assert session.scenario is before
    again = open_scenario(export_into(tmp_path, session.scenario, session.recipe()))
    assert again.agents.ids == session.scenario.agents.ids
    assert bool(told) == bool(words)
    assert re.search(words, told)


def test_a_bend_that_makes_the_map_too_large_is_refused(
    monkeypatch: pytest.MonkeyPatch,
):
    """The limits of maps hold for warped ones."""
    session = EditorSession(BASE)
    points = sum(map(len, BASE.road_map.dense.polylines))
    monkeypatch.setattr(scene_limits, "MAX_POINTS", points - 1)
    with pytest.raises(EditError, match=rf"opened again: it has {points} points"):
        session.apply(sharp_bend(20.0))
    session.apply(TransformAgents(agent_ids=(FOCAL,), dx_m=1.0))


def test_agents_times_steps_are_limited_as_in_files(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(scene_limits, "MAX_STATES", BASE.agents.is_valid.size)
    with pytest.raises(EditError, match="states are possible"):
        EditorSession(BASE).apply(placed(X, Y + 30.0))


def test_the_limit_of_places_does_not_depend_on_the_frame():
    """The writer knows scene coordinates, the reader those of the city."""
    place = np.array([[0.0, 0.0], [0.0, 0.0], [5000.0, 0.0], [0.0, 5000.002]])
    for shift in (0.0, 3456.789, 4.692e6):
        found = scene_limits.is_apart(place + shift)
        assert found.tolist() == [[False] * 2] * 3 + [[False, True]]
