"""The drawn region: squares of drags, and what the rest of the tab does with it."""

import numpy as np
import pytest

from pd_editor.base.errors import GenerationError
from pd_editor.scene.generation import Region
from pd_editor.viewer.generation.generation_panel import AROUND_TRAFFIC, IN_REGION
from pd_editor.viewer.generation.region_drawing import square_between
from tests.viewer.fake_browser import FakeTab


@pytest.mark.parametrize(
    ("end", "center"),
    [
        ((30.0, 10.0), (15.0, 15.0)),
        ((-30.0, 10.0), (-15.0, 15.0)),
        ((-10.0, -30.0), (-15.0, -15.0)),
    ],
)
def test_the_square_grows_from_the_corner_where_the_drag_began(end, center):
    found = square_between(np.zeros(2), np.array(end))
    assert found == Region(center_m=center, half_side_m=15.0)


def test_a_square_without_room_is_refused():
    with pytest.raises(GenerationError, match="at least 10 m"):
        square_between(np.zeros(2), np.array([9.0, -9.9]))


def test_a_drawn_region_is_where_agents_are_replaced(tab: FakeTab):
    drawing = tab.elements.region
    scenario = tab.session.scenario
    tab.press("Draw a region")
    assert tab.field("Where").value == IN_REGION
    assert drawing.is_active
    one, other = scenario.agents.position_m[:, scenario.current_step]
    assert other[1] - one[1] > 3.0
    corners = one + np.array([[-6.0, -10.0], [6.0, 2.0]])
    event = {"kind": "drawn", "start": corners[0].tolist(), "end": corners[1].tolist()}
    tab.hear("region", **event)
    assert not drawing.is_active
    assert drawing.region is not None
    assert drawing.region.held(scenario, scenario.agents.ids) == scenario.agents.ids[:1]
    tab.type("Keep focal agent", False)
    assert tab.field("Vehicles").value == 1
    # A late event of a mode that is over changes nothing.
    before = drawing.region
    tab.hear("region", **{**event, "end": (one + 60.0).tolist()})
    assert drawing.region is before
    tab.hear("region", kind="clear")
    assert drawing.region is None
    assert tab.field("Where").value == AROUND_TRAFFIC


def test_modes_end_each_other_and_escape_ends_the_drawing(tab: FakeTab):
    drawing, placing, measure = (
        tab.elements.region,
        tab.elements.placing,
        tab.elements.measure,
    )
    tab.run(placing.toggle)
    tab.run(drawing.toggle)
    assert not placing.is_active
    tab.run(measure.toggle)
    assert not drawing.is_active
    tab.run(drawing.toggle)
    assert not measure.is_active
    tab.run(tab.elements.escape)
    assert not drawing.is_active
    assert tab.field("Where").value == AROUND_TRAFFIC


def test_without_a_region_the_panel_says_what_to_do(tab: FakeTab):
    tab.type("Where", IN_REGION)
    tab.hear("run", kind="resample")
    assert "Press 'Draw a region'" in tab.shown("run")["text"]


def test_another_scene_has_no_region_yet(tab: FakeTab):
    drawing = tab.elements.region
    drawing.region = Region(center_m=(0.0, 0.0), half_side_m=20.0)
    tab.run(lambda: tab.tab.workspace.open_reference("roundabout"))
    assert drawing.region is None
