"""Features of the scene test, and standing vehicles that are askew, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.metrics.road import askew, surroundings
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.scene.agent_kind import AgentKind
from scene_test import FEATURES
from tests.builders import scenario_with, straight_drivers


def view_of(states, kinds=None):
    agents = straight_drivers(states)
    if kinds is not None:
        agents = replace(agents, kinds=tuple(kinds))
    return recorded_traffic(scenario_with(agents))


def feature(values, name: str) -> np.ndarray:
    return values.value[:, FEATURES.index(name)]


def test_features_by_hand():
    """Two vehicles in line, one beside them; noise is below a metre."""
    view = view_of([(0.0, 0.0, 0.0, 10.0), (15.0, 0.0, 0.0, 0.0), (0.0, 3.5, 0.0, 5.0)])
    values = surroundings(view)
    assert values.is_valid.all()
    assert np.allclose(feature(values, "nearest distance"), [3.5, 15.0, 3.5], atol=1.5)
    assert np.allclose(feature(values, "distance ahead"), [15.0, 99.0, 99.0], atol=1.5)
    assert feature(values, "standing").tolist() == [0.0, 1.0, 0.0]
    assert feature(values, "vehicles within 20 m").tolist() == [2.0, 2.0, 2.0]
    assert feature(values, "standing within 20 m").tolist() == [1.0, 0.0, 1.0]
    assert np.all(feature(values, "lane distance") < 1.6)
    assert not feature(values, "off the drivable area").any()
    again = surroundings(view)
    assert np.array_equal(values.value, again.value)


def test_only_vehicles_are_judged_and_a_lone_one_has_no_neighbour():
    view = view_of(
        [(0.0, 0.0, 0.0, 10.0), (15.0, 0.0, 0.0, 0.0)],
        [AgentKind.VEHICLE, AgentKind.PEDESTRIAN],
    )
    values = surroundings(view)
    assert values.is_valid.any(axis=1).tolist() == [True, False]
    assert feature(values, "nearest distance")[0] == 99.0
    assert feature(values, "vehicles within 20 m")[0] == 0.0
    lane, neighbour = askew(view)
    assert not lane.is_valid.any()  # The only vehicle moves.
    assert not neighbour.is_valid.any()


@pytest.mark.parametrize(
    ("degrees", "to_lane", "to_neighbour"),
    [(0.0, 0, 0), (10.0, 0, 0), (30.0, 1, 1), (90.0, 0, 1), (178.0, 0, 0)],
)
def test_askew_standing_vehicles(degrees, to_lane, to_neighbour):
    turn = np.radians(degrees)
    view = view_of([(0.0, 0.0, turn, 0.0), (8.0, 0.0, 0.0, 0.0)])
    lane, neighbour = askew(view)
    assert lane.is_valid.all()
    assert lane.value.tolist() == [to_lane, 0]
    assert neighbour.value.tolist() == [to_neighbour, to_neighbour]
