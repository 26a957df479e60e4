import numpy as np
import pytest

from pd_editor.analysis.metrics.motion import ade
from pd_editor.analysis.metrics.traffic_view import generated_traffic
from pd_editor.experiments.evaluation.method import REFERENCE_METHODS
from pd_editor.scene.generation import GenerationRequest
from pd_editor.scene.paths.motion_primitives import candidates
from tests.analysis.metrics.traffic_builders import sample_of
from tests.builders import scenario_with, straight_drivers
from tests.experiments.evaluation.small_dataset import PASSING


def request(agent_ids=None, num_samples=3, seed=0, states=PASSING):
    scenario = scenario_with(straight_drivers(states))
    return GenerationRequest(
        scenario=scenario,
        agent_ids=agent_ids or scenario.agents.ids,
        num_samples=num_samples,
        seed=seed,
    )


def test_the_log_and_constant_velocity_agree_on_straight_drivers():
    (log,) = REFERENCE_METHODS["ground-truth"].traffic(request())
    (constant,) = REFERENCE_METHODS["constant-velocity"].traffic(request())
    np.testing.assert_allclose(constant.agents.position_m, log.agents.position_m)
    assert ade(constant).value.max() < 1e-9
    assert constant.agents.is_valid.all()


def test_constant_velocity_moves_by_velocity_times_time():
    wanted = request(states=[(5.0, 1.0, 0.3, 7.0)])
    (view,) = REFERENCE_METHODS["constant-velocity"].traffic(wanted)
    way = view.agents.position_m[0, -1] - view.agents.position_m[0, 0]
    np.testing.assert_allclose(way, 6.0 * 7 * np.array([np.cos(0.3), np.sin(0.3)]))


def test_no_candidate_is_nearer_than_the_best_one():
    wanted = request()
    (best,) = REFERENCE_METHODS["best-candidate"].traffic(wanted)
    found = candidates(wanted.scenario, np.arange(3))
    least = ade(best).value
    for index in range(found.is_valid.shape[1]):
        sample = sample_of(wanted.agent_ids, found.position_m[:, index])
        other = ade(generated_traffic(wanted.scenario, sample)).value
        assert (least <= other + 1e-9)[found.is_valid[:, index]].all()


def test_random_candidates_are_candidates():
    wanted = request(num_samples=20)
    found = candidates(wanted.scenario, np.arange(3))
    for view in REFERENCE_METHODS["random-candidate"].traffic(wanted):
        apart = np.abs(found.position_m - view.agents.position_m[:, None]).max((2, 3))
        assert (np.where(found.is_valid, apart, np.inf).min(axis=1) == 0).all()


def test_a_draw_depends_on_neither_company_nor_number_of_samples():
    draw = REFERENCE_METHODS["random-candidate"].traffic
    whole, alone = draw(request(num_samples=4)), draw(request(("101",), num_samples=2))
    assert (len(whole), len(alone)) == (4, 2)
    for all_of_them, one in zip(whole, alone, strict=False):
        np.testing.assert_allclose(
            all_of_them.agents.position_m[1], one.agents.position_m[0], atol=1e-9
        )
    other = draw(request(num_samples=4, seed=1))
    assert any(
        not np.array_equal(a.agents.position_m, b.agents.position_m)
        for a, b in zip(whole, other, strict=True)
    )


@pytest.mark.parametrize("name", REFERENCE_METHODS)
def test_states_are_kept(name):
    wanted = request()
    step = wanted.scenario.current_step
    for view in REFERENCE_METHODS[name].traffic(wanted):
        assert view.agents.ids == wanted.agent_ids
        np.testing.assert_allclose(
            view.agents.position_m[:, 0], wanted.scenario.agents.position_m[:, step]
        )
