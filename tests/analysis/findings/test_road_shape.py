from pd_editor.analysis.findings.check import scene_problems
from pd_editor.analysis.findings.road import MIN_RADIUS_M, weakened_to_radius
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.friction import summarise
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.builders import scenario_with, straight_drivers

ANCHOR = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)


def bent(kind, power, length_m):
    term = WarpTerm(kind=kind, power=power, length_m=length_m)
    scenario = scenario_with(straight_drivers([(0, 0, 0, 1)]))
    return warp_scenario(scenario, RoadWarp(anchor=ANCHOR, terms=(term,)))


def road_problem(scenario):
    found = [p for p in scene_problems(scenario, with_future=False) if not p.agent_ids]
    return found[0] if found else None


def test_a_road_folded_into_spikes_is_a_problem():
    """(D10) Ripple 10 with a wave length of 5 m has a radius of 0.06 m."""
    problem = road_problem(bent("ripple-road", 10.0, 5.0))
    assert problem.kind == "folded-road"
    assert "folded into spikes" in problem.message
    assert problem.holds_at(0)
    assert problem.holds_at(109)


def test_a_radius_that_no_vehicle_drives_is_a_problem():
    """(D10)"""
    problem = road_problem(bent("double-turn", 10.0, 5.0))
    assert problem is None or problem.kind == "sharp-road"
    sharp = road_problem(bent("smooth-turn", 10.0, 6.0))
    assert sharp.kind == "sharp-road"
    assert "vehicle needs about 5 m" in sharp.message


def test_gentle_bends_and_straight_roads_are_fine():
    assert road_problem(bent("ripple-road", 3.0, 60.0)) is None
    assert road_problem(scenario_with(straight_drivers([(0, 0, 0, 1)]))) is None


def test_bends_are_weakened_until_they_can_be_driven():
    for kind, power, length in (
        ("ripple-road", 10.0, 20.0),
        ("smooth-turn", -10.0, 6.0),
    ):
        warp = bent(kind, power, length).applied_warp.warp
        weaker = weakened_to_radius(warp)
        assert weaker is not None
        assert summarise(weaker).min_radius_m >= MIN_RADIUS_M
        (term,) = weaker.terms
        assert 0 < abs(term.power) < 10
        assert term.power * power > 0
    spikes = RoadWarp(
        anchor=ANCHOR,
        terms=(WarpTerm(kind="ripple-road", power=0.5, length_m=1.0),),
    )
    assert weakened_to_radius(spikes) is None
