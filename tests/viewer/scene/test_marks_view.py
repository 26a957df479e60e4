import numpy as np
import pytest

from pd_editor.viewer.scene.marks_view import MIN_MARK_PX
from tests.viewer.fake_browser import CAMERA, connected_tab, running_app
from tests.viewer.scene.test_view_scale import view_of


@pytest.mark.parametrize("half_height_m", [20.0, 1500.0])
def test_rings_and_pins_are_large_enough_at_any_zoom(tmp_path, half_height_m):
    """Marks of warned, focal and ego agents can be found from far above (D18)."""
    view = view_of(half_height_m)
    with (
        running_app(tmp_path, "signalised-junction") as app,
        connected_tab(app) as tab,
    ):
        scenario, watch = tab.session.scenario, tab.model.findings
        tab.run(tab.elements.timeline.go_to_current)
        tab.run(lambda: tab.session.select((scenario.focal_id,)))
        warned = frozenset(scenario.agents.ids[:3])
        watch.agents_at = lambda _step: warned
        fov = float(np.radians(8.0))
        height = half_height_m / np.tan(fov / 2)
        above = {"position": [0.0, 0.0, height], "fov": fov, "image_height": 900}
        tab.send({**CAMERA, **above})
        tab.run(lambda: None)
        nodes = ("focal", "ego", "selection", "warnings")
        shown = [np.array(tab.node(f"/marks/{name}").batched_scales) for name in nodes]
        per_m = view.pixels_per_m(np.zeros((1, 3)))[0]
        for scales in shown:
            pixels = scales[:, 0] * per_m
            assert ((pixels >= 0.99 * MIN_MARK_PX) | (scales[:, 0] == 0)).all()
            assert scales.any()
