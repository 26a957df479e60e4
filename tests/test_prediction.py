import numpy as np
import pytest

from pd_editor.errors import EditError, GenerationError
from pd_editor.prediction import prediction_request
from tests.builders import scenario_with, straight_drivers

DRIVERS = [(0, 0, 0, 10), (30, 0, 0, 5), (0, 3.5, 0, 0.5), (60, 3.5, 0, 8)]


def test_nothing_after_the_current_step_is_seen():
    scenario = scenario_with(straight_drivers(DRIVERS))
    asked = prediction_request(scenario, scenario.agents.ids[:3], num_modes=6, seed=1)
    now = scenario.current_step
    assert asked.agents.position_m.shape == (3, now + 1, 2)
    assert asked.others.ids == scenario.agents.ids[3:]
    np.testing.assert_array_equal(
        asked.agents.velocity_mps, scenario.agents.velocity_mps[:3, : now + 1]
    )
    assert not asked.agents.position_m.flags.writeable
    # A view would let a predictor read on into the future.
    base = asked.agents.position_m.base
    assert base is None or base.shape[1] == now + 1


def test_agents_that_are_absent_or_unknown_are_refused():
    scenario = scenario_with(straight_drivers(DRIVERS[:2]))
    with pytest.raises(EditError):
        prediction_request(scenario, ("missing",), num_modes=1, seed=0)
    is_valid = scenario.agents.is_valid.copy()
    is_valid[1, scenario.current_step] = False
    agents = scenario.agents.with_rows(np.array([0, 1]), is_valid=is_valid)
    absent = scenario.with_agents(agents)
    with pytest.raises(GenerationError, match="is not present at the current step"):
        prediction_request(absent, scenario.agents.ids, num_modes=1, seed=0)
