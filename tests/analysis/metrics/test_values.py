import numpy as np
import pytest

from pd_editor.analysis.metrics.scene_metrics import agent_values, sample_values
from pd_editor.analysis.metrics.values import (
    METRICS,
    MetricValues,
    any_step,
    mean_over_steps,
    measured,
)
from tests.analysis.metrics.traffic_builders import recorded


def test_what_is_not_valid_is_zero_and_never_counted():
    values = measured("speed", np.array([3.0, np.nan, 5.0]), np.array([1, 0, 1]) > 0)
    assert values.value.tolist() == [3, 0, 5]
    assert values.valid().tolist() == [3, 5]
    assert values.unit == "m/s"


def test_nan_is_never_a_value():
    with pytest.raises(AssertionError):
        MetricValues(name="speed", value=np.array([np.nan]), is_valid=np.array([True]))


def test_steps_are_averaged_where_they_are_valid():
    value = np.array([[1.0, 3.0, 100.0], [7.0, 7.0, 7.0]])
    is_valid = np.array([[True, True, False], [False, False, False]])
    mean = mean_over_steps("jerk", value, is_valid)
    assert mean.value.tolist() == [2, 0]
    assert mean.is_valid.tolist() == [True, False]
    ever = any_step("off_drivable", value > 50, is_valid)
    assert ever.value.tolist() == [0, 0]
    assert ever.is_valid.tolist() == [True, False]


def test_every_metric_of_the_table_is_reported_and_no_other():
    view = recorded([(0, 0, 0, 10), (20, 0, 0, 0)])
    reported = {**agent_values(view), **sample_values([view, view])}
    assert set(reported) == set(METRICS)
    for name, values in reported.items():
        assert values.name == name
        assert len(values) == len(view)
