"""Findings on the road: bands along the parts concerned, frames at the worst poses."""

import numpy as np

from pd_editor.scene.palette import LIGHT
from pd_editor.viewer.findings.scorecard_drawer import MARGIN_M, finding_primitives
from pd_editor.viewer.scene.ribbons_view import HEIGHT_M as RIBBON_HEIGHT_M
from tests.analysis.findings.builders import finding
from tests.builders import scenario_with, straight_drivers


def test_bands_cover_the_part_concerned_and_no_more():
    scenario = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 10.0)]))
    agent = scenario.agents.ids[0]
    now = scenario.current_step
    x = scenario.agents.position_m[0, :, 0]
    length, width = scenario.agents.size_m[0]
    for kind, index in (("harsh-motion", 0), ("off-road", 1)):
        one = finding(kind, agent, now + 10, now + 20)
        parts = finding_primitives(scenario, [one], LIGHT)
        band = parts[index].points_m[np.unique(parts[index].faces)]
        other = parts[1 - index]
        assert not len(other.faces)
        assert np.isclose(band[:, 0].min(), x[now + 9], atol=0.6)
        assert np.isclose(band[:, 0].max(), x[now + 21], atol=1.0)
        assert np.isclose(np.ptp(band[:, 1]), width + MARGIN_M)
        frame = parts[2].points_m
        assert np.isclose(frame[:, 0].mean(), x[now + 15])
        assert np.ptp(frame[:, 0]) > length
        assert all(np.max(part.height_m, initial=0) < RIBBON_HEIGHT_M for part in parts)
        assert all(part.vertex_opacity is None for part in parts)


def test_an_agent_that_is_gone_is_left_out():
    scenario = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 10.0)]))
    assert (
        finding_primitives(scenario, [finding("against-traffic", "gone")], LIGHT) == []
    )
