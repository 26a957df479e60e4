"""Scorecard: means, levels and occurrences, on known scenes and on recordings."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.analysis.findings.scorecard import (
    MEANS,
    ROWS,
    UsualRange,
    scorecard,
    usual_ranges,
)
from pd_editor.analysis.metrics.scene_metrics import agent_values
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.analysis.metrics.values import METRICS
from pd_editor.scene.av2_io.read import read_scenario
from tests.builders import empty_tracks, scenario_with, straight_drivers

HIT = [(0.0, 0.0, 0.0, 10.0), (20.0, 0.0, 0.0, 0.0)]


def rows_of(scenario):
    return {row.name: row for row in scorecard(scenario)}


def test_a_collision_is_found_where_it_happens():
    scenario = scenario_with(straight_drivers(HIT))
    row = rows_of(scenario)["new_overlap"]
    assert row.value == 1.0
    assert row.level == "extreme"
    worst = row.findings[0]
    assert worst.is_fault
    agents, step = scenario.agents, worst.worst_step
    assert worst.holds_at(step)
    step = worst.first_step
    assert not worst.holds_at(step - 1)
    before = agents.position_m[1, step - 1, 0] - agents.position_m[0, step - 1, 0]
    at = agents.position_m[1, step, 0] - agents.position_m[0, step, 0]
    length = agents.size_m[:, 0].mean()
    assert at < length <= before + 0.2


def test_parked_cars_collide_with_nothing():
    scenario = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 0.0)]))
    rows = rows_of(scenario)
    assert rows["new_overlap"].value == 0.0
    assert not rows["new_overlap"].findings
    assert rows["standing"].value == 1.0
    assert rows["speed"].value == 0.0


def test_without_agents_nothing_is_told():
    rows = rows_of(dataclasses.replace(scenario_with(empty_tracks(110)), focal_id=""))
    assert tuple(rows) == tuple(ROWS)
    assert all(math.isnan(row.value) and not row.findings for row in rows.values())
    assert {row.level for row in rows.values()} == {"usual"}


def test_means_are_those_of_the_metrics(av2_root):
    folder = next(iter(sorted((av2_root / "val").iterdir())))
    scenario = read_scenario(folder)
    view = recorded_traffic(scenario)
    movers, values = view.agents.is_in("movers"), agent_values(view)
    rows = rows_of(scenario)
    for name in MEANS:
        one, row = values[name], rows[name]
        assert row.value == pytest.approx(one.value[one.is_valid & movers].mean())


def test_recordings_are_usual(av2_root):
    levels = [
        row.level
        for path in sorted((av2_root / "val").glob("*/scenario*.parquet"))
        for row in scorecard(read_scenario(path.parent))
    ]
    assert levels.count("usual") > 0.8 * len(levels)
    assert levels.count("extreme") < 0.05 * len(levels)


def test_each_metric_has_a_usual_range():
    usual = usual_ranges()
    assert set(usual) == set(ROWS)
    assert set(MEANS) <= set(METRICS)
    for one in usual.values():
        quantiles = (one.low, one.quarter, one.median, one.three_quarters, one.high)
        assert list(quantiles) == sorted(quantiles)
        assert one.num_scenes >= 30


@given(
    st.lists(st.floats(0, 10), min_size=5, max_size=5).map(sorted), st.floats(-5, 20)
)
def test_levels_grow_with_the_distance(quantiles, value):
    low, quarter, median, three_quarters, high = quantiles
    usual = UsualRange(
        low=low,
        quarter=quarter,
        median=median,
        three_quarters=three_quarters,
        high=high,
        num_scenes=35,
    )
    order = ["usual", "unusual", "extreme"]
    assert usual.level_of("speed", float(np.clip(value, low, high))) == "usual"
    levels = [usual.level_of("speed", high + more) for more in (0.0, 1.0, 30.0)]
    assert [order.index(one) for one in levels] == sorted(map(order.index, levels))
    assert levels[-1] == "extreme"
    assert usual.level_of("new_overlap", low - 1) == "usual"
    assert usual.level_of("speed", low - 30) == "extreme"
