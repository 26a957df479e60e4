import inspect
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pd_editor.base.errors import EditError, GenerationError, ModelError
from pd_editor.editor.commands import traffic_command
from pd_editor.generation import path_diffuser
from pd_editor.generation.checkpoints.model_folder import made_model
from pd_editor.generation.core.devices import sampling_device
from pd_editor.generation.core.sampler import SamplerStep, sample_steps
from pd_editor.generation.defaults import DeviceName
from pd_editor.generation.features.scene_fields import LATENT_SIZE
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.path_diffuser import DenoisingProgress, PathDiffuser
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser
from pd_editor.generation.trajectory.task import TrajectoryTask
from pd_editor.scene.agent_kind import Activity, AgentKind, activity_at
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import (
    LANE_GUIDANCE,
    GenerationRequest,
    GuidanceSetting,
    ScenarioGenerator,
    TrafficSample,
    guidance_settings,
    run_to_end,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import scenario_with, straight_drivers
from tests.generation.generated_traffic import SINGLE, generated, same
from tests.generation.trajectory.scenes import small_model


def test_it_is_a_generator_and_begins_at_the_exact_state(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    assert isinstance(diffuser, ScenarioGenerator)
    ids = scenario.agents.ids
    traffic = generated(diffuser, scenario, ids, num_samples=3, seed=4)
    assert len(traffic.samples) == 3
    assert len(traffic.model_sha256) == 64
    now, steps = scenario.current_step, scenario.time_axis.num_future_steps + 1
    for sample in traffic.samples:
        assert sample.ids == ids
        assert sample.position_m.shape == (len(ids), steps, 2)
        agents = scenario.agents
        assert np.array_equal(sample.position_m[:, 0], agents.position_m[:, now])
        assert np.array_equal(sample.heading_rad[:, 0], agents.heading_rad[:, now])
        assert np.array_equal(sample.velocity_mps[:, 0], agents.velocity_mps[:, now])
    assert not same(traffic.samples[0], traffic.samples[1])


def test_the_same_request_gives_the_same_traffic(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    ids = scenario.agents.ids
    first, again = (generated(diffuser, scenario, ids, seed=3) for _ in range(2))
    other = generated(diffuser, scenario, ids, seed=5)
    assert same(first.samples[0], again.samples[0])
    assert not same(first.samples[0], other.samples[0])


def test_what_is_not_of_the_folder_stands_in_provenance(
    model_folder: Path, diffuser: PathDiffuser, scenario: Scenario
) -> None:
    """The hash was that of the folder, whichever network sampled."""
    ids, calls = scenario.agents.ids, []

    def counted(*args: Any) -> Iterator[SamplerStep]:
        calls.append(args[1].shape[-1])
        return sample_steps(*args)

    networks = {
        name: made_model(stage.kind, stage.config, seed=5)
        for name, stage in diffuser.model().stages.items()
    }
    placer, driver = networks["init"], networks["traj"]
    assert isinstance(placer, InitialStateDenoiser)
    assert isinstance(driver, TrajectoryDenoiser)
    driver.load_state_dict(
        driver.state_dict()
        | {
            f"decoder.{name}": values
            for name, values in small_model().decoder.state_dict().items()
        }
    )
    usual = generated(diffuser, scenario, ids, resampled_state_ids=ids)
    found = {
        given: generated(
            PathDiffuser(model_folder, **{given: part}),  # type: ignore[arg-type]
            scenario,
            ids,
            resampled_state_ids=ids,
        )
        for given, part in (
            ("sampler", counted),
            ("initial_state_model", placer),
            ("trajectory_model", driver),
        )
    }
    assert same(found["sampler"].samples[0], usual.samples[0])
    assert {LATENT_SIZE} < set(calls), "both stages"
    assert not same(found["initial_state_model"].samples[0], usual.samples[0])
    assert not same(found["trajectory_model"].samples[0], usual.samples[0])
    assert [one.generator for one in found.values()] == [
        "path-diffuser+counted",
        "path-diffuser+InitialStateDenoiser",
        "path-diffuser+TrajectoryDenoiser",
    ]
    assert found["sampler"].model_sha256 == usual.model_sha256
    assert len({one.model_sha256 for one in found.values()}) == 3


def test_models_that_are_none_are_told(tmp_path: Path):
    layer: Any = torch.nn.Linear(2, 2)

    def unchecked(folder: Path, **models: Any) -> None:
        """Make one as programs do that check no types at run time."""
        make = inspect.unwrap(PathDiffuser.__init__)
        make(object.__new__(PathDiffuser), folder, **models)

    with pytest.raises(GenerationError, match="initial_state_model is of type Linear"):
        unchecked(tmp_path, initial_state_model=layer)
    with pytest.raises(GenerationError, match="all members of TrajectoryModel"):
        unchecked(tmp_path, trajectory_model=layer)


def test_scenarios_of_one_seed_get_different_random_numbers(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    """Else one seed would make many agents of all scenes of a data set stand."""
    other = replace(scenario, scenario_id="another")
    edited = scenario.with_agents(scenario.agents)
    ids = scenario.agents.ids

    def found(scene: Scenario, **more: Any) -> TrafficSample:
        return generated(diffuser, scene, ids, seed=3, **more).samples[0]

    for more in ({}, {"resampled_state_ids": ids}):
        assert same(found(scenario, **more), found(edited, **more))
        assert not same(found(scenario, **more), found(other, **more))


def test_progress_is_told_after_each_step_with_what_is_believed_in(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=scenario.agents.ids,
        num_denoising_steps=4,
        num_samples=2,
    )
    reports = list(diffuser.generate(request))
    assert [one.fraction for one in reports] == [0.25, 0.5, 0.75, 1.0]
    for one in reports:
        assert isinstance(one, DenoisingProgress)
        assert len(one.preview()) == 2


def test_agents_yield_unless_there_are_no_tries_or_they_shall_not(
    diffuser: PathDiffuser, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[TrafficSample] = []

    def recorded(
        _scenario: Scenario,
        _rows: object,
        sample: TrafficSample,
        _terms: object,
    ) -> Any:
        asked.append(sample)
        return sample, ("somebody",)

    monkeypatch.setattr(path_diffuser, "with_yielding", recorded)
    ids, calls = scenario.agents.ids, {}
    for tries, yields in ((0, True), (1, True), (3, True), (1, False)):
        asked.clear()
        guidance = guidance_settings(0.0, tries, yields=yields)
        traffic = generated(diffuser, scenario, ids, guidance=guidance, num_samples=2)
        calls[tries, yields] = len(asked)
        slows = bool(yields and tries)
        # It named fewer agents than it counted, since samples share their ids.
        told = "2 agents in 2 samples slowed down to avoid a collision."
        assert (told in traffic.notes) == slows
        assert traffic.slowed_ids == ((("somebody",),) * 2 if slows else ())
    assert calls == {(0, True): 0, (1, True): 2, (3, True): 2, (1, False): 0}


def test_slowed_agents_are_named_where_states_are_sampled_too(
    diffuser: PathDiffuser, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slowed(
        _scenario: Scenario,
        _rows: object,
        sample: TrafficSample,
        _terms: object,
    ) -> Any:
        return sample, sample.ids[:1]

    monkeypatch.setattr(path_diffuser, "with_yielding", slowed)
    traffic = generated(
        diffuser,
        scenario,
        scenario.agents.ids,
        resampled_state_ids=scenario.agents.ids,
        num_samples=2,
    )
    first = scenario.agents.ids[0]
    assert traffic.slowed_ids == ((first,), (first,))
    assert "2 agents in 2 samples slowed down to avoid a collision." in traffic.notes
    one = generated(
        diffuser, scenario, (first,), resampled_state_ids=(first,), num_samples=1
    )
    assert f"1 agent slowed down to avoid a collision: {first}." in one.notes


def bad_requests(scenario: Scenario) -> Iterator[tuple[dict[str, object], str]]:
    ids = scenario.agents.ids
    yield {"agent_ids": ()}, "no agent to generate"
    yield {"agent_ids": (ids[0], ids[0])}, "twice"
    yield {"num_samples": 0}, "samples"
    yield {"num_denoising_steps": 0}, "denoising steps"
    yield {"seed": -1}, "seed"
    yield {"moving_share": 1.5}, "must be between 0 and 1"
    yield {"only_on_road": True}, "whose states are sampled"
    yield {"agent_ids": ids[:1], "resampled_state_ids": ids[1:]}, "another state"
    yield {"num_new_agents": {AgentKind.VEHICLE: 501}}, "expected 0 to 500"
    yield {"num_new_agents": {AgentKind.STATIC: 1}}, "road users"
    yield {"num_new_agents": {AgentKind.VEHICLE: -1}}, "expected 0 to 500"
    bare = replace(scenario.road_map, lanes=())
    yield {"scenario": replace(scenario, road_map=bare)}, "no lanes"
    agents, now = scenario.agents, scenario.current_step
    gone = agents.is_valid.copy()
    gone[0, now] = False
    yield (
        {"scenario": scenario.with_agents(replace(agents, is_valid=gone))},
        "not there",
    )
    broken = agents.position_m.copy()
    broken[0, now] = np.nan
    yield (
        {"scenario": scenario.with_agents(replace(agents, position_m=broken))},
        "finite",
    )


def test_bad_requests_are_refused_in_words(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    for changes, words in bad_requests(scenario):
        asked: dict[str, Any] = {
            "scenario": scenario,
            "agent_ids": scenario.agents.ids,
        } | changes
        with pytest.raises(GenerationError, match=words):
            generated(diffuser, asked.pop("scenario"), asked.pop("agent_ids"), **asked)


def test_strangers_long_futures_and_missing_weights_are_refused(
    diffuser: PathDiffuser, scenario: Scenario, tmp_path: Path
) -> None:
    with pytest.raises(EditError, match="missing"):
        generated(diffuser, scenario, ("missing",))
    axis = replace(scenario.time_axis, step_s=0.5)
    assert isinstance(axis, TimeAxis)
    with pytest.raises(GenerationError, match="lasts"):
        generated(diffuser, replace(scenario, time_axis=axis), scenario.agents.ids)
    with pytest.raises(ModelError):
        generated(PathDiffuser(tmp_path / "none"), scenario, scenario.agents.ids)


def test_guidance_is_taken_by_name(diffuser: PathDiffuser, scenario: Scenario) -> None:
    ids = scenario.agents.ids
    free, firm = (
        generated(
            diffuser,
            scenario,
            ids,
            guidance=(GuidanceSetting(name=LANE_GUIDANCE, weight=weight), SINGLE),
        )
        for weight in (0.0, 1.0)
    )
    assert not same(free.samples[0], firm.samples[0])
    assert not free.measures
    assert ["path along lanes" in told for told in firm.measures] == [True]
    odd = generated(diffuser, scenario, ids, guidance=(GuidanceSetting(name="magic"),))
    assert any("magic" in note for note in odd.notes)


def test_every_tensor_is_made_on_the_device_of_the_model(
    diffuser: PathDiffuser, model_folder: Path, scenario: Scenario
) -> None:
    ids = scenario.agents.ids
    requests: list[dict[str, Any]] = [
        {"resampled_state_ids": ids[:1], "num_new_agents": {AgentKind.VEHICLE: 2}},
        {"samples_num_agents": True, "moving_share": 0.5, "only_on_road": True},
        {"guidance": guidance_settings(0.9, 3), "num_samples": 2},
    ]
    expected = [generated(diffuser, scenario, ids[:1], **asked) for asked in requests]
    anew = PathDiffuser(model_folder)
    anew.model()
    # What is made on the default device by mistake has no numbers there.
    with torch.device("meta"):
        found = [generated(anew, scenario, ids[:1], **asked) for asked in requests]
    for one, two in zip(found, expected, strict=True):
        assert all(map(same, one.samples, two.samples))


def test_the_device_is_chosen(
    model_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    choices: tuple[tuple[bool, DeviceName, str], ...] = (
        (True, "auto", "cuda"),
        (True, "cuda", "cuda"),
        (True, "cpu", "cpu"),
        (False, "auto", "cpu"),
        (False, "cpu", "cpu"),
    )
    for there, name, device in choices:
        monkeypatch.setattr(torch.cuda, "is_available", lambda there=there: there)
        assert sampling_device(name).type == device
    with pytest.raises(GenerationError, match="GPU"):
        PathDiffuser(model_folder, device="cuda")


def test_things_alone_keep_their_velocity(diffuser: PathDiffuser) -> None:
    thing = straight_drivers([(0.0, 0.0, 0.0, 2.0)], kinds=(AgentKind.STATIC,))
    scenario = scenario_with(thing)
    traffic = generated(diffuser, scenario, thing.ids)
    now = scenario.current_step
    velocity = traffic.samples[0].velocity_mps
    assert (velocity == thing.velocity_mps[:, None, now]).all()
    assert any("no road users" in note for note in traffic.notes)


def test_a_kept_future_with_a_hole_of_nan_leaves_the_others_alone(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    first, second = scenario.agents.ids
    position = scenario.agents.position_m.copy()
    position[scenario.agents.row_of[second], -3] = np.nan
    holed = scenario.with_agents(replace(scenario.agents, position_m=position))
    sample = generated(diffuser, holed, (first,)).samples[0]
    assert np.isfinite(sample.position_m).all()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU")
def test_a_gpu_draws_the_same(model_folder: Path, scenario: Scenario) -> None:
    ids = scenario.agents.ids
    asked = {"resampled_state_ids": ids[:1], "num_new_agents": {AgentKind.VEHICLE: 2}}
    one, two = (
        generated(PathDiffuser(model_folder, device=name), scenario, ids, **asked)
        for name in ("cpu", "cuda")
    )
    first, second = one.samples[0], two.samples[0]
    assert np.allclose(first.position_m, second.position_m, atol=0.2)


@pytest.mark.real_data
def test_real_scenarios_are_driven_around_their_kept_agents(
    diffuser: PathDiffuser, av2_scenario_folders: list[Path]
) -> None:
    for folder in (av2_scenario_folders[0], av2_scenario_folders[-1]):
        scenario = read_scenario(folder)
        there = scenario.agents.is_valid[:, scenario.current_step]
        ids = tuple(np.array(scenario.agents.ids)[there])
        traffic = generated(diffuser, scenario, ids[:5], num_samples=2)
        assert traffic.samples[0].ids == ids[:5]
        everybody = generated(diffuser, scenario, ids)
        assert everybody.samples[0].position_m.shape[0] == len(ids)


def test_activities_are_sampled_with_states_and_known_when_driven_again(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    request = GenerationRequest(
        scenario=scenario, agent_ids=(), num_new_agents={AgentKind.VEHICLE: 6}, seed=2
    )
    traffic = run_to_end(diffuser.generate(request))
    (sample,) = traffic.samples
    assert len(sample.activity) == 6
    filled = traffic_command(request, traffic).apply(scenario)
    rows = filled.agents.rows(sample.ids)
    assert filled.agents.activity[rows].tolist() == list(sample.activity)
    assert Activity.UNKNOWN not in sample.activity
    again = generated(diffuser, filled, sample.ids, seed=5).samples[0]
    assert again.activity == sample.activity
    model = diffuser._trajectories().model
    assert isinstance(model, TrajectoryDenoiser)
    known = TrajectoryTask.of(filled, rows, model.decoder.basis)
    speed = filled.agents.speed_mps()[rows, filled.current_step]
    of_rows = np.isin(known.features.agent_row, rows)
    expected = activity_at(np.array(sample.activity), speed)
    assert np.array_equal(known.features.agent_activity[of_rows], expected)
