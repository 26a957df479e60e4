import numpy as np
import pytest

from pd_editor.analysis.findings.check import checked, scene_problems
from pd_editor.analysis.findings.friction import friction_problems, sideways_motion
from pd_editor.base.errors import EditError
from pd_editor.editor.commands import (
    SetRoadWarp,
    SlowToFrictionLimit,
    command_from_json,
    command_to_json,
)
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.builders import scenario_with, straight_drivers

ANCHOR = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)


def bent(kind="double-turn", power=8.0, speed=14.0, length_m=10.0, mu=None):
    term = WarpTerm(kind=kind, power=power, length_m=length_m)
    warp = RoadWarp(anchor=ANCHOR, terms=(term,))
    scenario = scenario_with(straight_drivers([(0, 0, 0, speed)]))
    return SetRoadWarp(warp=warp, friction_coefficient=mu).apply(scenario)


def test_an_agent_too_fast_for_a_bend_is_told_with_both_speeds():
    """(D10) Friction is judged, and the sentence says whom and by how much."""
    (problem,) = [p for p in scene_problems(bent()) if p.kind == "friction"]
    assert problem.agent_ids == ("100",)
    assert problem.message.startswith("Vehicle 100 is too fast for its curve ")
    assert "where friction holds " in problem.message
    assert problem.ratio > 2.0
    assert problem.first_step >= 50
    # Times and speeds are those that the list and the picture tell.
    scenario = bent()
    later = (problem.first_step - scenario.current_step) * scenario.time_axis.step_s
    assert f"{later:.1f} s" in problem.message
    speed = np.hypot(*scenario.agents.velocity_mps[0, problem.worst_step])
    assert f": {speed:.1f} m/s, where" in problem.message


def test_the_acceleration_is_that_of_the_true_curvature():
    scenario = bent(power=4.0, speed=10.0)
    motion = sideways_motion(scenario)
    warp = scenario.applied_warp.warp
    x = np.linspace(0, 40, 4001)
    # Along x the speed stays 10 m/s, so the true value is f'' 10^2 / sqrt(1 + f'^2).
    exact = np.abs(warp.derivative(x, 2)) * 100 / np.hypot(1, warp.derivative(x, 1))
    assert motion.lateral_mps2.max() == pytest.approx(exact.max(), rel=0.1)


def test_slow_or_straight_agents_are_not_reported():
    assert not friction_problems(bent(speed=3.0))
    assert not friction_problems(scenario_with(straight_drivers([(0, 0, 0, 30)])))
    standing = scenario_with(straight_drivers([(0, 0, 0, 0)]))
    assert not friction_problems(standing)


def test_slowing_to_the_limit_cures_and_is_recorded():
    """(D10) The cure is a command of its own: undone, replayed, named in the history."""
    scenario = bent()
    command = SlowToFrictionLimit(agent_ids=("100",), friction_coefficient=0.7)
    after = command.apply(scenario)
    assert not friction_problems(after)
    assert command.label == "Slow agent 100 to the friction limit (mu 0.7)"
    now = scenario.current_step
    assert (after.agents.position_m[:, now] == scenario.agents.position_m[:, now]).all()
    again = command_from_json(command_to_json(command), "it")
    assert again == command
    assert command.apply(after) is after
    with pytest.raises(EditError, match="Friction coefficient 3"):
        SlowToFrictionLimit(agent_ids=("100",), friction_coefficient=3.0)


@pytest.mark.real_data
def test_real_scenes_bent_and_slowed_keep_to_the_limit(av2_scenario_folders):
    """(D10) The road panel's checkbox and the list agree about the same limit."""
    num_fast = num_left = 0
    for folder in av2_scenario_folders[::12]:
        scenario = read_scenario(folder)
        recorded = scene_problems(scenario)
        assert len([p for p in recorded if p.kind == "friction"]) <= 2
        term = WarpTerm(kind="double-turn", power=10.0, length_m=10.0)
        warp = RoadWarp(anchor=pose_of_anchor(scenario, "focal"), terms=(term,))
        for mu in (None, 0.7):
            after = SetRoadWarp(warp=warp, friction_coefficient=mu).apply(scenario)
            new = checked(after, scenario, recorded).new
            fast = tuple(p.agent_ids[0] for p in new if p.kind == "friction")
            if mu is not None:
                num_left += len(fast)
                continue
            num_fast += len(fast)
            if fast:
                cured = SlowToFrictionLimit(agent_ids=fast).apply(after)
                found = {p.agent_ids[0] for p in friction_problems(cured)}
                assert not found & set(fast)
    assert num_fast > 3
    assert num_left == 0


def test_a_track_whose_own_speeds_are_slow_is_not_too_fast():
    """A track that jumps was told with 0.3 m/s where friction holds 0.2."""
    scenario = bent()
    agents = scenario.agents
    slow = agents.with_rows(np.array([0]), velocity_mps=agents.velocity_mps / 50)
    assert friction_problems(scenario)
    assert not friction_problems(scenario.with_agents(slow))
