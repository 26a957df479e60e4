"""What the camera shows beside elements over the picture."""

import numpy as np

from pd_editor.viewer.scene.camera import projected
from pd_editor.viewer.scene.framing import agents_extent
from tests.viewer.fake_browser import CAMERA, FakeTab


def test_an_agent_under_the_strip_of_samples_is_brought_into_sight(tab: FakeTab):
    """(W19) In low windows the samples of a run covered the very agent they are of."""
    view, session = tab.elements.viewpoint, tab.session
    scenario = session.scenario
    row = scenario.agents.row_of[scenario.focal_id]
    place = scenario.agents.position_m[row, scenario.current_step]

    def height() -> float:
        """Of the focal agent in the picture, 0 at the top."""
        screen, _ = projected(tab.ui.client.camera, np.append(place, 0.0)[None])
        return float(screen[0, 1])

    tab.run(view.frame_opened)
    assert 0.5 < height() < 1.0
    tab.run(view.uncover)
    opened = height()
    tab.model.covered["samples"] = CAMERA["image_height"] // 2
    tab.run(view.uncover)
    assert 0.0 < height() < 0.5
    assert opened > 0.5, "nothing was in the way before"
    shown = height()
    tab.run(view.uncover)
    assert height() == shown


def test_framed_agents_are_above_the_curve_of_speed(tab: FakeTab):
    """In low windows the status chip and the curve covered the end of a trajectory."""
    view, session = tab.elements.viewpoint, tab.session
    name = session.scenario.focal_id
    tab.run(lambda: session.select((name,)))
    tab.run(view.show_top)
    corners = agents_extent(session.scenario, (name,))
    screen, _ = projected(tab.ui.client.camera, corners)
    assert (
        screen[:, 1].max()
        < 1.0 - tab.model.covered["speeds"] / CAMERA["image_height"] + 1e-3
    )
    tab.run(lambda: session.select(()))
    tab.run(view.frame_selection)
    screen, _ = projected(tab.ui.client.camera, corners)
    lowest = 1.0 - tab.model.covered["timeline"] / CAMERA["image_height"]
    assert screen[:, 1].max() < lowest + 1e-3


def test_the_selection_stays_in_sight_when_the_view_is_switched(tab: FakeTab):
    """In 3-D, a car that F had framed from above was under the curve of speed."""
    view, session = tab.elements.viewpoint, tab.session
    scenario = session.scenario
    now = scenario.current_step
    name = next(
        name
        for name, there in zip(
            scenario.agents.ids, scenario.agents.is_valid[:, now], strict=True
        )
        if there and name != scenario.focal_id
    )
    place = scenario.agents.position_m[scenario.agents.row_of[name], now]
    tab.run(lambda: session.select((name,)))
    tab.run(view.show_top)
    for _ in range(2):
        tab.run(view.switch)
        screen, _ = projected(tab.ui.client.camera, np.append(place, 0.0)[None])
        lowest = 1.0 - tab.model.covered_px / CAMERA["image_height"]
        assert 0.0 < screen[0, 1] < lowest
