import numpy as np
import pytest

from pd_editor.viewer.scene.marks_view import MIN_MARK_PX
from tests.viewer.fake_browser import connected_tab, running_app
from tests.viewer.scene.test_view_scale import view_of


@pytest.mark.parametrize("half_height_m", [20.0, 1500.0])
def test_rings_and_pins_are_large_enough_at_any_zoom(tmp_path, half_height_m):
    """Marks of warned, focal and ego agents can be found from far above (D18)."""
    view = view_of(half_height_m)
    with (
        running_app(tmp_path, "signalised-junction") as app,
        connected_tab(app) as tab,
    ):
        picture, scenario = tab.elements.picture, tab.session.scenario
        marks = picture._marks
        warned = scenario.agents.ids[:3]

        def shown():
            tab.tab.workspace.playback.pause()
            marks.set_view(view)
            picture.agents.show(scenario, float(scenario.current_step))
            marks.show(
                scenario, picture.agents.poses, (scenario.focal_id,), warned, None
            )
            batches = (marks._focal, marks._ego, marks._selection, marks._warnings)
            return [np.array(batch.batched_scales) for batch in batches]

        per_m = view.pixels_per_m(np.zeros((1, 3)))[0]
        for scales in tab.run(shown):
            pixels = scales[:, 0] * per_m
            assert ((pixels >= 0.99 * MIN_MARK_PX) | (scales[:, 0] == 0)).all()
            assert scales.any()
