"""Warping the road as an edit."""

import numpy as np
import pytest

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import SetRoadWarp, TransformAgents
from pd_editor.editor.session import EditorSession
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.editor.command_strategies import busy_scenario

BASE = busy_scenario()


def turn(power: float, *, x_m: float = 0.0, length_m: float = 10.0) -> RoadWarp:
    anchor = RigidMotion(x_m=x_m, y_m=0.0, rotation_rad=0.0)
    term = WarpTerm(kind="smooth-turn", power=power, length_m=length_m)
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
    gap = reset.agents.position_m[1, 49] - BASE.agents.position_m[1, 49]
    assert np.allclose(gap, [-5, 0])
    assert (reset.agents.position_m[0] == BASE.agents.position_m[0]).all()


@pytest.mark.parametrize("mu", [0.0, -1.0, 2.5, float("nan")])
def test_impossible_friction_is_refused(mu):
    with pytest.raises(EditError, match="riction"):
        SetRoadWarp(warp=turn(1), friction_coefficient=mu)


def test_labels_say_what_was_done():
    assert SetRoadWarp(warp=turn(4)).label == "Bend the road: bend +4"
    mu = SetRoadWarp(warp=turn(-2.5), friction_coefficient=0.6)
    assert mu.label == "Bend the road: bend -2.5, friction 0.6"
    assert SetRoadWarp(warp=None).label == "Reset the road"


def test_history_says_what_differs_from_the_warp_in_force():
    """(D28)"""
    session = EditorSession(BASE)
    both = RoadWarp(
        anchor=turn(6, x_m=38).anchor,
        terms=(
            *turn(6, x_m=38, length_m=20).terms,
            WarpTerm(kind="ripple-road", power=2, length_m=60),
        ),
    )
    for command in (
        SetRoadWarp(warp=turn(4)),
        SetRoadWarp(warp=turn(6)),
        SetRoadWarp(warp=turn(6, x_m=38)),
        SetRoadWarp(warp=turn(6, x_m=38, length_m=20)),
        SetRoadWarp(warp=both),
        SetRoadWarp(warp=both, friction_coefficient=0.7),
        SetRoadWarp(warp=both, friction_coefficient=0.5),
        SetRoadWarp(warp=None),
    ):
        session.apply(command)
    assert [entry.label for entry in session.entries] == [
        "Bend the road: bend +4",
        "Road: bend +4 to +6",
        "Road: anchor moved 38 m",
        "Road: length of the bend 10 to 20 m",
        "Road: waves +2 added",
        "Road: friction limit 0.7",
        "Road: friction 0.7 to 0.5",
        "Reset the road",
    ]
