"""What the camera shows beside elements over the picture."""

import numpy as np

from pd_editor.viewer.scene.camera import projected
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
