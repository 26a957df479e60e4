"""Traffic signals: lanes, stop lines and states."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.base_reference import MapWindow, SceneCut
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_cut import cut_scenario, within_window
from pd_editor.scene.signals import Signal, SignalState, states_at
from tests.builders import straight_lane, two_agents_that_pass


def signalled(share: float = 1.0) -> Scenario:
    scene = two_agents_that_pass()
    lanes = (straight_lane(1, (0, 0), (50, 0)), straight_lane(2, (0, 4), (50, 4)))
    steps = np.arange(scene.time_axis.num_steps)
    states = np.where(steps < 60, SignalState.STOP, SignalState.GO).astype(np.int8)
    signal = Signal(
        signal_id="s", lane_ids=(1, 2), stop_share=np.full(2, share), states=states
    )
    return replace(scene, road_map=RoadMap(lanes=lanes), signals=(signal,))


def test_stop_lines_reach_across_their_lanes():
    left, middle, right = signalled(0.5).stop_lines_m()[1]
    np.testing.assert_allclose(middle, [25.0, 4.0])
    np.testing.assert_allclose((left + right) / 2, middle)
    assert left[1] > middle[1] > right[1]


@given(power=st.floats(-10, 10), share=st.floats(0, 1))
def test_stop_lines_bend_with_the_road_and_come_back(power: float, share: float):
    scene = signalled(share)
    term = WarpTerm(kind="smooth-turn", power=power, length_m=20.0)
    warp = RoadWarp(
        anchor=RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0), terms=(term,)
    )
    bent = warp_scenario(scene, warp)
    flat = scene.stop_lines_m()
    np.testing.assert_allclose(bent.stop_lines_m(), warp.apply(flat))
    back = warp_scenario(bent, None)
    assert back.signals is scene.signals
    np.testing.assert_array_equal(back.stop_lines_m(), flat)


def test_stop_lines_and_states_survive_another_current_step():
    scene = signalled()
    later = scene.at_step(70)
    assert later.origin_city_m.tolist() != scene.origin_city_m.tolist()
    place = later.stop_lines_m() + later.origin_city_m
    np.testing.assert_allclose(place, scene.stop_lines_m() + scene.origin_city_m)


def test_lanes_have_the_state_of_their_signal():
    scene = signalled()
    assert states_at(scene.signals, 59) == {1: SignalState.STOP, 2: SignalState.STOP}
    assert states_at(scene.signals, 60)[2] is SignalState.GO


def test_a_cut_in_time_cuts_the_states():
    scene = signalled()
    cut = cut_scenario(scene, SceneCut(current_s=3.0, until_s=4.0))
    (signal,) = cut.signals
    assert len(signal.states) == cut.time_axis.num_steps == 70
    np.testing.assert_array_equal(signal.states, scene.signals[0].states[:70])


def test_a_part_of_the_map_keeps_the_signals_of_its_lanes():
    scene = signalled()
    x, y = scene.origin_city_m.tolist()
    part = within_window(scene, MapWindow(x_m=x + 25, y_m=y + 4, radius_m=1.5))
    assert [one.lane_ids for one in part.signals] == [(2,)]
    assert part.stop_lines_m().shape == (1, 3, 2)
