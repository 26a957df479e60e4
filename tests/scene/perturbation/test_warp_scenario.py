from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M, RoadWarp, WarpTerm
from tests.builders import scenario_with, straight_drivers, two_agents_that_pass

ANCHOR = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)
TERMS = st.tuples(
    st.sampled_from(list(DEFAULT_LENGTH_M)),
    st.floats(-9, 9).filter(lambda power: abs(power) > 0.1),
)
WARPS = st.lists(TERMS, min_size=1, max_size=3)


def warp_of(drawn):
    """Built inside the test: its run-time checks may not run while values are drawn."""
    terms = tuple(
        WarpTerm(kind=kind, power=power, length_m=DEFAULT_LENGTH_M[kind])
        for kind, power in drawn
    )
    return RoadWarp(anchor=ANCHOR, terms=terms)


def one(kind, power, anchor=ANCHOR):
    term = WarpTerm(kind=kind, power=power, length_m=DEFAULT_LENGTH_M[kind])
    return RoadWarp(anchor=anchor, terms=(term,))


def same_tracks(one, other):
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("position_m", "heading_rad", "velocity_mps", "is_valid")
    )


@settings(max_examples=20)
@given(WARPS, WARPS, st.sampled_from([None, 0.7]))
def test_reset_gives_back_the_very_same_objects(one_draw, other_draw, friction):
    first, second = warp_of(one_draw), warp_of(other_draw)
    base = two_agents_that_pass()
    warped = warp_scenario(base, first, friction_coefficient=friction)
    again = warp_scenario(warped, second)
    for scenario in (warped, again):
        reset = warp_scenario(scenario, None)
        assert reset.road_map is base.road_map
        assert reset.agents is base.agents
        assert reset.applied_warp is None


@settings(max_examples=20)
@given(WARPS, WARPS)
def test_a_new_warp_starts_from_the_original(one_draw, other_draw):
    first, second = warp_of(one_draw), warp_of(other_draw)
    base = two_agents_that_pass()
    directly = warp_scenario(base, second)
    by_way = warp_scenario(warp_scenario(base, first), second)
    assert same_tracks(directly.agents, by_way.agents)
    for mine, theirs in zip(
        directly.road_map.polylines, by_way.road_map.polylines, strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)


def test_a_warp_that_moves_nothing_is_no_warp():
    base = two_agents_that_pass()
    flat = warp_scenario(base, one("ripple-road", 0.0), friction_coefficient=0.7)
    assert flat.applied_warp is None
    assert flat.road_map is base.road_map
    assert flat.agents is base.agents


@settings(max_examples=20)
@given(WARPS)
def test_agents_stay_on_their_lane_and_move_as_their_positions_do(drawn):
    warp = warp_of(drawn)
    base = two_agents_that_pass()
    warped = warp_scenario(base, warp)
    agents = warped.agents
    np.testing.assert_allclose(
        warp.undo(agents.position_m), base.agents.position_m, atol=1e-9
    )
    slope = warp.derivative(base.agents.position_m[..., 0], 1)
    # d/dt (x, f(x)) = v (1, f'(x)) for a driver straight ahead at speed v.
    np.testing.assert_allclose(
        agents.velocity_mps[..., 1], base.agents.velocity_mps[..., 0] * slope, atol=1e-9
    )
    np.testing.assert_allclose(agents.heading_rad, np.arctan(slope), atol=1e-12)
    along = np.arctan2(agents.velocity_mps[..., 1], agents.velocity_mps[..., 0])
    np.testing.assert_allclose(along, agents.heading_rad, atol=1e-12)


@settings(max_examples=20)
@example([("double-turn", 8.0), ("double-turn", 8.625)])
@given(WARPS)
def test_tangents_of_warped_lanes_are_j_times_the_old_ones(drawn):
    warp = warp_of(drawn)
    base = two_agents_that_pass()
    warped = warp_scenario(base, warp).road_map
    for before, after in zip(base.road_map.dense.lanes, warped.lanes, strict=True):
        x = before.centerline[:, 0]
        chord = np.diff(after.centerline_m, axis=0)
        # A chord's slope is the mean of J along it, also where J has a kink.
        along = np.linspace(x[:-1], x[1:], 65, axis=-1)
        mean = np.trapezoid(warp.derivative(along, 1), along, axis=-1) / np.diff(x)
        np.testing.assert_allclose(chord[:, 1] / chord[:, 0], mean, atol=1e-3)


def test_what_lies_behind_the_border_is_untouched():
    base = scenario_with(straight_drivers([(-60, 0, 3.0, 8), (-40, 3.5, 0.3, 3)]))
    warped = warp_scenario(base, one("smooth-turn", 9.0))
    assert same_tracks(warped.agents, base.agents)
    for before, after in zip(
        base.road_map.dense.polylines, warped.road_map.polylines, strict=True
    ):
        behind = before[:, 0] < 5
        np.testing.assert_array_equal(after[behind], before[behind])


def test_an_edited_agent_is_taken_back_and_the_others_exactly():
    base = two_agents_that_pass()
    warp = one("ripple-road", 6.0)
    warped = warp_scenario(base, warp)
    row = np.array([0])
    pushed = warped.agents.with_rows(
        row, position_m=warped.agents.position_m[row] + [2.0, 1.0]
    )
    back = warp_scenario(warped.with_agents(pushed), None)
    np.testing.assert_array_equal(back.agents.position_m[1], base.agents.position_m[1])
    np.testing.assert_allclose(
        back.agents.position_m[0], warp.undo(pushed.position_m[0]), atol=1e-9
    )
    assert back.road_map is base.road_map


def test_taking_back_and_warping_again_is_the_edited_state():
    base = two_agents_that_pass()
    warp = one("double-turn", 7.0)
    warped = warp_scenario(base, warp)
    turned = warped.agents.with_rows(
        np.array([1]),
        heading_rad=wrap_angle(warped.agents.heading_rad[[1]] + 0.2),
        velocity_mps=warped.agents.velocity_mps[[1]] * 0.7,
    )
    again = warp_scenario(warped.with_agents(turned), warp)
    np.testing.assert_allclose(again.agents.position_m, turned.position_m, atol=1e-9)
    np.testing.assert_allclose(again.agents.heading_rad, turned.heading_rad, atol=1e-9)
    np.testing.assert_allclose(
        again.agents.velocity_mps, turned.velocity_mps, atol=1e-9
    )


def test_added_removed_and_renamed_agents_come_back():
    base = two_agents_that_pass()
    warped = warp_scenario(base, one("smooth-turn", 5.0))
    new = replace(warped.agents.taken([0]), ids=("new",), kinds=(AgentKind.BUS,))
    mixed = warped.agents.taken([1]).joined(new)
    back = warp_scenario(warped.with_agents(mixed), None).agents
    assert back.ids == ("101", "new")
    assert back.kinds == (AgentKind.VEHICLE, AgentKind.BUS)
    np.testing.assert_array_equal(back.position_m[0], base.agents.position_m[1])
    np.testing.assert_allclose(back.position_m[1], base.agents.position_m[0], atol=1e-9)


def test_absent_steps_stay_zero():
    agents = straight_drivers([(20, 0, 0.0, 10)])
    valid = np.tile(np.arange(110) < 70, (1, 1))
    agents = replace(
        agents,
        is_valid=valid,
        position_m=agents.position_m * valid[..., None],
        velocity_mps=agents.velocity_mps * valid[..., None],
    )
    warped = warp_scenario(
        scenario_with(agents), one("double-turn", 9.0), friction_coefficient=0.7
    ).agents
    for name in ("position_m", "heading_rad", "velocity_mps"):
        assert not getattr(warped, name)[~valid].any()


@pytest.mark.real_data
def test_every_real_scenario_comes_back(av2_scenario_folders):
    for folder in av2_scenario_folders[::8]:
        base = read_scenario(folder)
        row = int(base.agents.is_valid[:, base.current_step].argmax())
        x, y = base.agents.position_m[row, base.current_step].tolist()
        heading = float(base.agents.heading_rad[row, base.current_step])
        anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=heading)
        warped = warp_scenario(
            base, one("double-turn", 8.0, anchor), friction_coefficient=0.7
        )
        valid = base.agents.is_valid
        np.testing.assert_array_equal(warped.agents.is_valid, valid)
        reset = warp_scenario(warped, None)
        assert reset.road_map is base.road_map
        assert reset.agents is base.agents
        # As if every agent had been edited: nothing is left but the inverse.
        copied = warped.agents.with_rows(
            np.arange(len(base.agents)),
            velocity_mps=warped.agents.velocity_mps * 1.000001,
        )
        kept = warp_scenario(base, one("double-turn", 8.0, anchor))
        kept = replace(
            kept, agents=replace(kept.agents, velocity_mps=copied.velocity_mps)
        )
        inverse = warp_scenario(kept, None).agents
        np.testing.assert_allclose(
            inverse.position_m[valid], base.agents.position_m[valid], atol=1e-8
        )
