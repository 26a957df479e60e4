from dataclasses import replace

import numpy as np
import pytest

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.palette import DARK, LIGHT
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.scene.ribbons_view import (
    DOT_WIDTH_M,
    _bottom_up,
    ribbon_primitives,
)
from tests.builders import scenario_with, straight_drivers


def four() -> Scenario:
    """A driver, one that comes later, a parked car that trembles, the ego."""
    agents = straight_drivers(
        [(0, 0, 0, 8), (0, 3.5, 0, 8), (30, 9, 0, 0), (40, 0, 0, 8)],
        kinds=(AgentKind.VEHICLE,) * 4,
    )
    is_valid = agents.is_valid.copy()
    is_valid[1, :70] = False
    noise = np.random.default_rng(1).normal(0, 0.15, agents.position_m[2].shape)
    position = agents.position_m.copy()
    position[2] += noise
    return scenario_with(
        replace(
            agents,
            ids=("100", "101", "102", "AV"),
            is_valid=is_valid,
            position_m=position,
        )
    )


def drawn_at(primitives, y_m: float) -> np.ndarray:
    """Points of triangles within a car's width of a line along x."""
    corners = [np.asarray(p.points_m)[p.faces].reshape(-1, 2) for p in primitives]
    points = np.concatenate(corners)
    return points[np.abs(points[:, 1] - y_m) < 1.2]


def test_a_parked_car_has_no_trail_and_a_driver_has_one():
    """Noise was drawn like a trajectory (D19)."""
    primitives = ribbon_primitives(four(), LIGHT)
    assert not len(drawn_at(primitives, 9.0))
    assert np.ptp(drawn_at(primitives, 0.0)[:, 0]) > 50


def test_an_agent_that_comes_later_is_thin_and_dotted():
    """It was drawn like one that is there (D19)."""
    points = drawn_at(ribbon_primitives(four(), DARK), 3.5)
    assert np.allclose(np.abs(points[:, 1] - 3.5), DOT_WIDTH_M / 2, atol=1e-6)
    ends = np.unique(points[:, 0].round(3))
    gaps = np.diff(ends)
    assert len(gaps) > 10
    assert gaps.max() < 1.0


def test_every_agent_has_a_height_of_its_own_and_the_focal_agent_lies_on_top():
    """Where ego and focal agent share a lane their ribbons flickered (D15)."""
    scenario = four()
    assert [scenario.agents.ids[row] for row in _bottom_up(scenario)][-2:] == [
        "AV",
        "100",
    ]
    primitives = ribbon_primitives(scenario, LIGHT)
    heights = {}
    for y in (0.0, 3.5):
        found = [
            np.asarray(p.height_m)[p.faces].reshape(-1)[
                np.abs(p.points_m[p.faces].reshape(-1, 2)[:, 1] - y) < 1.2
            ]
            for p in primitives
            if len(p.faces)
        ]
        heights[y] = set(np.concatenate(found).round(6))
    assert heights[0.0].isdisjoint(heights[3.5])
    assert len(heights[0.0]) == 2


@pytest.mark.parametrize("empty", [True, False])
def test_a_scenario_without_movers_has_no_ribbons(empty):
    scenario = scenario_with(straight_drivers([] if empty else [(0, 0, 0, 0)]))
    assert sum(len(p.faces) for p in ribbon_primitives(scenario, LIGHT)) == 0


def test_ribbons_of_real_scenes_are_finite(av2_scenario_folders):
    for folder in av2_scenario_folders[:3]:
        for primitive in ribbon_primitives(read_scenario(folder), LIGHT):
            assert np.isfinite(primitive.points_m).all()
