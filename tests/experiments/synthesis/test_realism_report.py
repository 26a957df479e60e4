"""The realism report: against closed forms, and on real scenes."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import jensenshannon

from pd_editor.base.errors import InputError
from pd_editor.experiments.synthesis.realism_report import (
    QUANTITIES,
    MeasuredScene,
    RealismReport,
    RealismRow,
    realism_report,
)
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers


def scene(speed_mps: float, num_agents: int = 4) -> Scenario:
    """Cars 20 m apart on a lane to the east, all as fast."""
    states = [(20.0 * row - 60.0, 0.4, 0.0, speed_mps) for row in range(num_agents)]
    return scenario_with(straight_drivers(states))


def values(scenario: Scenario, name: str) -> np.ndarray:
    (quantity,) = (one for one in QUANTITIES if one.name == name)
    return quantity.measure(MeasuredScene(scenario=scenario)).valid()


def test_quantities_of_a_known_scene() -> None:
    moving = scene(6.0)
    assert values(moving, "speed") == pytest.approx([6.0] * 4)
    assert values(moving, "path in 6 s") == pytest.approx([6.0 * 6.0] * 4)
    assert values(moving, "nearest agent") == pytest.approx([20.0] * 4)
    assert values(moving, "offset from lane, moving") == pytest.approx([0.4] * 4)
    assert values(moving, "offset from lane, standing").size == 0
    assert values(moving, "angle to lane, moving") == pytest.approx([0.0] * 4)
    assert values(moving, "heading change in 6 s") == pytest.approx([0.0] * 4)
    assert values(moving, "turning").tolist() == [0.0] * 4
    assert values(moving, "standing").tolist() == [0.0] * 4
    assert values(moving, "agents in a scene") == 4
    assert values(moving, "movers in a scene") == 4
    assert values(moving, "lanes in a scene") == 4
    assert values(moving, "lanes in junctions").tolist() == [0.0] * 4
    assert values(moving, "curvature of lanes") == pytest.approx([0.0] * 4)
    standing = scene(0.0)
    assert values(standing, "standing").tolist() == [1.0] * 4
    assert values(standing, "standing that start").tolist() == [0.0] * 4
    assert values(standing, "offset from lane, standing") == pytest.approx([0.4] * 4)
    assert values(standing, "longitudinal acceleration").size == 0


@given(
    one=st.lists(st.floats(-50, 50), min_size=1, max_size=30),
    other=st.lists(st.floats(-50, 50), min_size=1, max_size=30),
)
def test_distance_is_that_of_scipy(one: list[float], other: list[float]) -> None:
    quantity = QUANTITIES[0]
    first, second = np.array(one), np.array(other)
    counts = quantity.bins.counts(first), quantity.bins.counts(second)
    assert counts[0].sum() == len(one), "nothing falls out of the bins"
    assert quantity.distance(first, second) == pytest.approx(
        jensenshannon(*counts), abs=1e-6
    )


def row(report: RealismReport, name: str) -> RealismRow:
    return next(one for one in report.rows if one.name == name)


def test_like_scenes_pass_and_others_do_not() -> None:
    speeds = np.random.default_rng(0).uniform(0, 20, 12)
    real = [scene(speed) for speed in speeds]
    report = realism_report(real, real)
    assert row(report, "speed").distance == pytest.approx(0.0, abs=1e-6)
    assert all(one.passes for one in report.rows)
    fast = realism_report([scene(speed + 9) for speed in speeds], real, real[:5])
    assert not row(fast, "speed").passes
    assert row(fast, "nearest agent").passes
    assert row(fast, "speed").other_real is not None
    assert f"{len(speeds)} synthetic scenes" in fast.report().markdown()
    stored = json.loads(json.dumps(fast.json()))
    assert stored["num_other"] == 5
    assert len(stored["rows"]) == len(fast.rows)


def test_nothing_to_compare() -> None:
    with pytest.raises(InputError, match="no synthetic"):
        realism_report([], [scene(1.0)])
    with pytest.raises(InputError, match="no real"):
        realism_report([scene(1.0)], [])


def test_real_halves_are_alike(av2_scenario_folders: list[Path]) -> None:
    train = [path for path in av2_scenario_folders if path.parent.name == "train"]
    real = [read_scenario(folder) for folder in train[:12]]
    report = realism_report(real[::2], real[1::2])
    # Of two halves, chance alone makes the ratio about the root of 2.
    assert np.median([one.ratio for one in report.rows]) < 2.5
    assert {one.name for one in report.rows} == {one.name for one in QUANTITIES}
