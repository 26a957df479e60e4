from pathlib import Path

import numpy as np
import pytest

from examples import constant_velocity
from pd_editor import generate, open_scenario
from pd_editor.base.errors import EditError, GenerationError
from pd_editor.scene.prediction import prediction_request
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


def test_a_predictor_with_the_usual_filter_sees_every_sampled_agent(tmp_path):
    from av2.datasets.motion_forecasting.scenario_serialization import (
        load_argoverse_scenario_parquet,
    )

    outcome = generate("roundabout", num_agents=("6",), seed=2, out=tmp_path)
    folder = Path(outcome.folders[0])
    loaded = load_argoverse_scenario_parquet(next(folder.glob("*.parquet")))
    last = max(
        state.timestep
        for track in loaded.tracks
        for state in track.object_states
        if state.observed
    )
    kept = {
        track.track_id
        for track in loaded.tracks
        if any(one.timestep == last for one in track.object_states)
    }
    scenario = open_scenario(folder)
    sampled = tuple(one for one in scenario.agents.ids if one.startswith("new-"))
    assert len(sampled) == 6
    assert kept.issuperset(sampled)
    asked = prediction_request(scenario, sampled, num_modes=6, seed=0)
    answer = constant_velocity.Predictor().predict(asked)
    assert answer.position_m.shape == (6, 2, scenario.time_axis.num_future_steps, 2)
    # A past of its own for each: longer than the current state alone.
    assert (asked.agents.is_valid.sum(axis=1) > 1).mean() > 0.8


def test_without_a_past_the_current_state_is_still_observed(tmp_path):
    asked = {"num_agents": ("3",), "seed": 2, "out": tmp_path}
    scenario = generate("roundabout", no_past=True, **asked).scenarios[0]
    agents, now = scenario.agents, scenario.current_step
    rows = [row for row, name in enumerate(agents.ids) if name.startswith("new-")]
    assert agents.observed[rows].sum(axis=1).tolist() == [1, 1, 1]
    assert agents.observed[rows, now].all()
    assert not agents.has_made_up_past.any()
