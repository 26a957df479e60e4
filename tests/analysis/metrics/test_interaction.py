import numpy as np

from pd_editor.analysis.metrics.box_overlaps import local_density, nearest_distance
from pd_editor.analysis.metrics.motion import diversity_values
from pd_editor.scene.agent_kind import AgentKind
from tests.analysis.metrics.traffic_builders import generated, recorded
from tests.builders import scenario_with, straight_drivers


def test_distances_to_others_of_the_same_group():
    kinds = (AgentKind.VEHICLE,) * 3 + (AgentKind.PEDESTRIAN,)
    view = recorded([(0, 0, 0, 1), (3, 4, 0, 1), (0, 12, 0, 1), (0, 1, 0, 1)], kinds)
    np.testing.assert_allclose(nearest_distance(view).value, [5, 5, np.hypot(3, 8), 0])
    assert nearest_distance(view).is_valid.all()
    density = local_density(view)
    np.testing.assert_allclose(density.value[0], [5, 12, 0, 0, 0])
    assert density.is_valid.sum(axis=1).tolist() == [2, 2, 2, 0]


def test_density_holds_the_five_nearest():
    view = recorded([(10.0 * index, 0, 0, 0) for index in range(8)])
    np.testing.assert_allclose(local_density(view).value[0], [10, 20, 30, 40, 50])
    assert local_density(view).is_valid.all()


def test_spread_of_samples_in_closed_form():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10)]))
    time = np.arange(61) * 0.1
    views = [
        generated(scenario, ("100",), np.stack([v * time, np.zeros(61)], axis=-1)[None])
        for v in (10.0, 11.0, 13.0)
    ]
    values = diversity_values(views)
    # Pairs differ by 1, 2 and 3 m/s.
    np.testing.assert_allclose(values["pairwise_ade"].value, 2 * time[1:].mean())
    np.testing.assert_allclose(values["end_spread"].value, 2 * 6.0)
    assert not diversity_values(views[:1])["end_spread"].is_valid.any()


def test_coverage_counts_lanes_that_samples_visit():
    # From lane 1 (and 3 beside it), 60 m lead on to lanes 2 and 4.
    scenario = scenario_with(straight_drivers([(20, 0, 0, 10)]))
    time = np.arange(61) * 0.1
    straight = np.stack([20 + 10 * time, np.zeros(61)], axis=-1)[None]
    aside = straight + np.stack([np.zeros(61), 3.5 * time / 6.0], axis=-1)
    short = np.stack([20 + time, np.zeros(61)], axis=-1)[None]

    def coverage(*paths):
        views = [generated(scenario, ("100",), path) for path in paths]
        return diversity_values(views)["lane_coverage"].value.tolist()

    assert coverage(straight) == [0.5]
    assert coverage(straight, aside) == [0.75]
    assert coverage(short) == [0.5]
    assert coverage(short, straight) == [0.5]
