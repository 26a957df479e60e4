"""Warping the road as an edit."""

import numpy as np
import pytest

from pd_editor.editor.commands import SetRoadWarp, TransformAgents
from pd_editor.editor.session import EditorSession
from pd_editor.errors import EditError
from pd_editor.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.editor.command_strategies import busy_scenario

BASE = busy_scenario()


def turn(power: float, **changes: float) -> RoadWarp:
    anchor = RigidMotion(
        x_m=0.0, y_m=0.0, rotation_rad=changes.pop("rotation_rad", 0.0)
    )
    term = WarpTerm(kind="smooth-turn", power=power, length_m=10.0)
    return RoadWarp(anchor=anchor, terms=(term,))


def test_reset_gives_back_the_very_road_and_agents():
    session = EditorSession(BASE)
    session.apply(SetRoadWarp(warp=turn(4)))
    assert session.scenario.road_map is not BASE.road_map
    session.apply(SetRoadWarp(warp=None))
    assert session.scenario.road_map is BASE.road_map
    assert session.scenario.agents is BASE.agents


def test_a_new_warp_takes_the_place_of_the_old_one():
    twice = SetRoadWarp(warp=turn(2)).apply(SetRoadWarp(warp=turn(-7)).apply(BASE))
    once = SetRoadWarp(warp=turn(2)).apply(BASE)
    assert (twice.agents.position_m == once.agents.position_m).all()


def test_nothing_to_do_is_no_edit():
    assert SetRoadWarp(warp=None).apply(BASE) is BASE
    assert SetRoadWarp(warp=turn(0)).apply(BASE) is BASE
    warped = SetRoadWarp(warp=turn(3)).apply(BASE)
    assert SetRoadWarp(warp=turn(3)).apply(warped) is warped
    assert (
        SetRoadWarp(warp=turn(3), friction_coefficient=0.5).apply(warped) is not warped
    )


def test_edits_made_on_a_warped_road_survive_its_reset():
    warped = SetRoadWarp(warp=turn(3)).apply(BASE)
    moved = TransformAgents(agent_ids=("101",), dx_m=-5).apply(warped)
    reset = SetRoadWarp(warp=None).apply(moved)
    assert reset.road_map is BASE.road_map
    gap = reset.agents.position_m[1, 50] - BASE.agents.position_m[1, 50]
    assert np.allclose(gap, [-5, 0])
    assert (reset.agents.position_m[0] == BASE.agents.position_m[0]).all()


@pytest.mark.parametrize("mu", [0.0, -1.0, 2.5, float("nan")])
def test_impossible_friction_is_refused(mu):
    with pytest.raises(EditError, match="riction"):
        SetRoadWarp(warp=turn(1), friction_coefficient=mu)


def test_labels_say_what_was_done():
    assert SetRoadWarp(warp=turn(4)).label == "Warp: smooth turn +4"
    mu = SetRoadWarp(warp=turn(-2.5), friction_coefficient=0.6)
    assert mu.label == "Warp: smooth turn -2.5, mu 0.6"
    assert SetRoadWarp(warp=None).label == "Reset the road"
