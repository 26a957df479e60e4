"""An export has the findings of the scene that was exported, with the same numbers."""

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pd_editor.analysis.findings.check import SceneCheck
from pd_editor.base.installed_files import demo_names
from pd_editor.editor.commands import SetFocalAgent, SetRoadWarp, TransformAgents
from pd_editor.editor.edit_findings import edit_findings
from pd_editor.editor.library.index_table import index_row
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import (
    exported_files,
    made_by,
    open_scenario,
    scenario_and_recipe,
)
from pd_editor.editor.session import EditorSession
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import WARP_KINDS, RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers

ROUNDED_M = 0.03
"""Map files are rounded to centimetres."""
BENDS = {
    "kind": st.sampled_from(WARP_KINDS),
    "power": st.floats(-10, 10).map(lambda power: round(power, 1)),
    "length_m": st.sampled_from((10.0, 30.0, 60.0)),
    "mu": st.sampled_from((None, 0.4, 0.7)),
}


def bend(session: EditorSession, kind, power, length_m, mu) -> None:
    term = WarpTerm(kind=kind, power=power, length_m=length_m)
    anchor = pose_of_anchor(session.scenario, "focal")
    warp = RoadWarp(anchor=anchor, terms=(term,))
    session.apply(SetRoadWarp(warp=warp, friction_coefficient=mu))


def reopened(session: EditorSession) -> tuple[Scenario, Recipe]:
    """The session's export, as it is."""
    recipe = session.recipe()
    files = exported_files(session.scenario, recipe, session.base)
    scenario, again = scenario_and_recipe(files)
    assert again is not None
    return made_by(scenario, again), again


def told(found: SceneCheck) -> dict:
    return {
        (where, one.kind, one.agent_ids): (one.message, one.value)
        for where, some in (("new", found.new), ("recorded", found.recorded))
        for one in some
    }


def assert_same(session: EditorSession) -> Scenario:
    """What the list tells continued and as it is, and what the table counts of both."""
    export, recipe = reopened(session)
    continued = edit_findings(session.scenario, session.base, session.commands_in_force)
    as_it_is = edit_findings(export, export, ())
    ours, theirs = told(continued), told(as_it_is)
    for key in ours.keys() | theirs.keys():
        one, other = ours.get(key, ("", 0.0)), theirs.get(key, ("", 0.0))
        # Who is a rounding from the edge may be on either side of it.
        at_edge = "off-road" in key[1] and max(one[1], other[1]) < ROUNDED_M
        assert one[1] == pytest.approx(other[1], abs=ROUNDED_M), key
        assert one[0] == other[0] or at_edge or "off the road" in one[0] + other[0], key
    if session.commands_in_force and ours.keys() == theirs.keys():
        row = index_row(session.scenario, session.base, recipe)
        opened = EditorSession(export)
        again = index_row(export, export, opened.recipe())
        assert row.problems == again.problems
    return export


@settings(max_examples=6, deadline=None)
@given(demo=st.sampled_from(demo_names()), **BENDS)
@example(demo="roundabout", kind="ripple-road", power=-9.0, length_m=30.0, mu=None)
@example(demo="downtown", kind="double-turn", power=9.7, length_m=10.0, mu=0.4)
def test_an_export_of_a_bent_demo_has_the_same_findings(
    demo, kind, power, length_m, mu
):
    session = EditorSession(open_scenario(demo))
    bend(session, kind, power, length_m, mu)
    assert_same(session)


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("scene", "kind", "power"),
    [
        ("02382383", "ripple-road", -3.0),
        ("0006ca28", "ripple-road", 10.0),
        ("000ace8b", "smooth-turn", 5.1),
    ],
)
def test_an_export_of_a_bent_recording_has_the_same_findings(
    av2_root, scene, kind, power
):
    """Its friction problems were lost or had other numbers, and metres differed."""
    (folder,) = av2_root.glob(f"*/{scene}*")
    session = EditorSession(open_scenario(folder))
    bend(session, kind, power, 60.0 if kind == "ripple-road" else 10.0, None)
    assert_same(session)


def test_exports_of_exports_have_the_findings_of_both_bends():
    """Another focal agent moves the frame of the scene, too."""
    agents = straight_drivers([(0, 0, 0, 14), (-35, 0, 0, 14), (-70, 3.5, 0, 9)])
    first = EditorSession(scenario_with(agents))
    bend(first, "double-turn", 8.0, 10.0, 0.5)
    first.apply(SetFocalAgent(agent_id="101"))
    first.apply(TransformAgents(agent_ids=("102",), dx_m=7.0, dy_m=3.0))
    export = assert_same(first)
    assert (export.origin_city_m != first.scenario.origin_city_m).any()
    second = EditorSession(export)
    bend(second, "ripple-road", 4.0, 30.0, None)
    again = assert_same(second)
    assert len(again.warps) == 2
    found = edit_findings(again, again, ()).new
    assert {one.kind for one in found} >= {"friction", "off-road"}
    assert {one.limit for one in found if one.kind == "friction"} == {0.5 * 9.81}


def test_metres_off_the_road_are_the_largest_of_all_steps_on_the_bent_road():
    """They were measured at five steps, before the bend, where metres are none."""
    states = [(0, 0, 0, 14), (-10, 9.0, 0.06, 11), (10, -6.0, -0.3, 3)]
    session = EditorSession(scenario_with(straight_drivers(states)))
    bend(session, "ripple-road", 10.0, 40.0, None)
    scenario = session.scenario
    area = shapely.Polygon(scenario.road_map.drivable_areas[0].boundary[:, :2])
    path = scenario.agents.position_m[:, scenario.current_step :]
    away = np.array([[area.distance(shapely.Point(at)) for at in one] for one in path])
    found = edit_findings(scenario, session.base, session.commands_in_force).all
    off = {one.agent_ids[0]: one for one in found if "off-road" in one.kind}
    assert {"101", "102"} <= off.keys()
    for name, one in off.items():
        row = scenario.agents.row_of[name]
        assert one.value == pytest.approx(away[row].max())
        assert one.worst_step == away[row].argmax() + scenario.current_step
