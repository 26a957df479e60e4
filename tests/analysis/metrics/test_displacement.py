import numpy as np

from pd_editor.analysis.metrics.motion import (
    ade,
    ade_with_state,
    best_of_samples,
    fde,
    missed,
)
from tests.analysis.metrics.traffic_builders import generated
from tests.builders import scenario_with, straight_drivers

SCENARIO = scenario_with(straight_drivers([(0, 0, 0, 10), (0, 3.5, 0, 5)]))
TIME = np.arange(61) * 0.1


def slower_by(speed: float) -> np.ndarray:
    x = (10 - speed) * TIME
    return np.stack([x, np.zeros(61)], axis=-1)[None]


def test_closed_form_of_a_slower_agent():
    view = generated(SCENARIO, ("100",), slower_by(0.5))
    np.testing.assert_allclose(ade(view).value, 0.5 * TIME[1:].mean())
    np.testing.assert_allclose(ade_with_state(view).value, 0.5 * TIME.mean())
    np.testing.assert_allclose(fde(view).value, 0.5 * 6.0)
    assert missed(view).value.tolist() == [1]
    assert missed(generated(SCENARIO, ("100",), slower_by(0.3))).value.tolist() == [0]


def test_the_best_of_samples_is_the_least():
    views = [generated(SCENARIO, ("100",), slower_by(v)) for v in (0.5, 0.2, 3.0)]
    best = best_of_samples(views)
    np.testing.assert_allclose(best["min_fde"].value, 0.2 * 6.0)
    np.testing.assert_allclose(best["min_ade"].value, 0.2 * TIME[1:].mean())
    assert best["min_missed"].value.tolist() == [0]


def test_an_agent_that_was_never_recorded_has_no_error():
    view = generated(SCENARIO, ("new",), slower_by(0.5))
    assert not ade(view).is_valid.any()
    assert not fde(view).is_valid.any()


def test_the_final_error_is_at_the_last_recorded_step():
    agents = SCENARIO.agents
    is_valid = agents.is_valid.copy()
    is_valid[0, 80:] = False
    cut = scenario_with(agents.with_rows(np.arange(2), is_valid=is_valid))
    view = generated(cut, ("100",), slower_by(0.5))
    np.testing.assert_allclose(fde(view).value, 0.5 * 3.0)
    np.testing.assert_allclose(ade(view).value, 0.5 * TIME[1:31].mean())
