"""The mode in which the road is pulled: the place that is held follows the pointer."""

import numpy as np
import pytest

from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import WARP_KINDS
from tests.viewer.fake_browser import FakeTab

AHEAD_M = 40.0


def beside(tab: FakeTab, ahead_m: float, left_m: float) -> list[float]:
    """A place in the frame of the focal agent."""
    pose = pose_of_anchor(tab.session.base, "focal")
    return pose.apply(np.array([ahead_m, left_m])).tolist()


def pull(tab: FakeTab, start: list[float], *way: list[float], end: str = "end") -> None:
    def at_once() -> None:
        tab.hear("bending", kind="grab", point=start)
        for point in way:
            tab.hear("bending", kind="pull", point=point)
        tab.hear("bending", kind=end)

    tab.run(at_once)
    tab.run(lambda: None)


@pytest.fixture
def bending(tab: FakeTab):
    mode = tab.elements.bending
    tab.run(mode.toggle)
    return mode


@pytest.mark.parametrize("number", range(1, len(WARP_KINDS) + 1))
def test_the_place_that_is_held_follows_the_pointer(tab: FakeTab, bending, number):
    tab.hear("bending", kind="kind", number=number)
    start = beside(tab, AHEAD_M, 0.5)
    pull(tab, start, beside(tab, AHEAD_M, 1.0), beside(tab, AHEAD_M + 3.0, 2.5))
    (entry,) = tab.session.entries
    warp = tab.session.scenario.applied_warp.warp
    assert [term.kind for term in warp.terms] == [WARP_KINDS[number - 1]]
    # Across the road only, and to the power's last digit.
    moved = warp.apply(np.array([start]))[0]
    assert np.allclose(moved, beside(tab, AHEAD_M, 2.5), atol=0.05), entry
    # It is pulled on from where it is, and not from the road as recorded.
    pull(tab, moved.tolist(), beside(tab, AHEAD_M, -1.0))
    warp = tab.session.scenario.applied_warp.warp
    assert len(warp.terms) == 1
    assert np.allclose(
        warp.apply(np.array([start]))[0], beside(tab, AHEAD_M, -1.0), atol=0.1
    )
    assert len(tab.session.entries) == 2


def test_sliders_show_what_is_pulled_and_no_power_is_out_of_range(
    tab: FakeTab, bending
):
    pull(tab, beside(tab, AHEAD_M, 0.0), beside(tab, AHEAD_M, -500.0))
    assert tab.field("Bend").value == -10.0
    tab.run(tab.session.undo)
    assert tab.field("Bend").value == 0.0
    assert tab.session.scenario.applied_warp is None


def test_a_pull_that_is_given_up_changes_nothing(tab: FakeTab, bending):
    before = tab.session.scenario
    places = beside(tab, AHEAD_M, 0.0), beside(tab, AHEAD_M, 3.0)
    pull(tab, *places, end="cancel")
    assert tab.session.scenario is before
    assert not tab.session.entries
    # Nor does what arrives after the mode has ended.
    tab.run(tab.elements.escape)
    assert not bending.is_active
    pull(tab, *places)
    assert not tab.session.entries


def test_a_place_behind_the_anchor_bends_from_before_it(tab: FakeTab, bending):
    start = beside(tab, -30.0, 0.0)
    pull(tab, start, beside(tab, -30.0, 2.0))
    warp = tab.session.scenario.applied_warp.warp
    assert 15.0 < warp.distance_ahead(np.array(start)) < 30.0
    assert np.allclose(
        warp.apply(np.array([start]))[0], beside(tab, -30.0, 2.0), atol=0.05
    )
    # The road is bent by now: it is told where it can be pulled.
    pull(tab, beside(tab, -90.0, 0.0), beside(tab, -90.0, 2.0))
    assert "pull it farther ahead" in tab.refusal()
    assert len(tab.session.entries) == 1
