"""Methods by name, with options."""

import pytest

from pd_editor.base.errors import GenerationError
from pd_editor.experiments.evaluation.method import (
    GROUND_TRUTH,
    REFERENCE_METHODS,
    Method,
)
from pd_editor.scene.generation import AVOIDANCE, LANE_GUIDANCE, GenerationRequest
from tests.builders import two_agents_that_pass
from tests.editor.fake_generators import PlacingGenerator


def test_options_reach_the_generator():
    placing = PlacingGenerator()
    asked: list[str] = []

    def make(name: str) -> PlacingGenerator:
        asked.append(name)
        return placing

    scenario = two_agents_that_pass()
    method = Method(name="placing:lanes=0.6,tries=3,steps=9", make_generator=make)
    request = GenerationRequest(scenario=scenario, agent_ids=scenario.agents.ids)
    assert len(method.traffic(request).samples) == 1
    (seen,) = placing.requests
    assert asked == ["placing"]
    assert seen.num_denoising_steps == 9
    lanes, avoidance = seen.settings
    assert (lanes.name, lanes.weight) == (LANE_GUIDANCE, 0.6)
    assert (avoidance.name, avoidance.parameters) == (AVOIDANCE, {"tries": 3.0})
    assert "lanes 0.6, tries 3, steps 9" in method.description


def test_without_options_the_generators_own_settings_count():
    placing = PlacingGenerator()
    scenario = two_agents_that_pass()
    method = Method(name="plain", make_generator=lambda _name: placing)
    method.traffic(GenerationRequest(scenario=scenario, agent_ids=()))
    (seen,) = placing.requests
    assert seen.num_denoising_steps is None
    assert not seen.guidance


def test_raw_is_what_the_networks_sample():
    method = Method(name="x:raw=1", make_generator=make_nothing)
    usual = GenerationRequest(scenario=two_agents_that_pass(), agent_ids=())
    request = method.with_options(usual)
    assert usual.refines_states
    assert not request.refines_states
    lanes, avoidance = request.settings
    assert lanes.weight == 0.0
    assert avoidance.parameters == {"tries": 0.0}


def test_references_but_the_log_draw_no_states():
    scenario = two_agents_that_pass()
    ids = scenario.agents.ids
    request = GenerationRequest(
        scenario=scenario, agent_ids=ids, resampled_state_ids=ids[:1]
    )
    for name in REFERENCE_METHODS:
        method = Method(name=name, make_generator=make_nothing)
        if name == GROUND_TRUTH:
            assert method.traffic(request).samples[0].agents.ids == ids
        else:
            with pytest.raises(
                GenerationError, match=f"{name} samples no initial states"
            ):
                method.traffic(request)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("speed=3", "expected one of steps, lanes, tries, raw"),
        ("step=3", "the nearest is steps"),
        ("lanes", "expected a number from 0 to 1"),
        ("lanes=-1", "expected a number from 0 to 1"),
        ("tries=-1", "expected a number from 0 to 64"),
        ("steps=0", "expected a number from 1 to 1000"),
        ("steps=x", "expected a number from 1 to 1000"),
    ],
)
def test_unknown_options_are_refused(options: str, told: str):
    with pytest.raises(GenerationError, match=told):
        _ = Method(name=f"x:{options}", make_generator=make_nothing).options


def make_nothing(name: str):
    raise AssertionError(name)
