from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pd_editor.av2_io.read import read_scenario
from pd_editor.diffusion import path_diffuser, placing
from pd_editor.diffusion.agent_counts import AgentCounts
from pd_editor.diffusion.defaults import DeviceName
from pd_editor.diffusion.devices import drawing_device
from pd_editor.diffusion.model_folder import TrainedStage, save_model
from pd_editor.diffusion.path_diffuser import DenoisingProgress, PathDiffuser
from pd_editor.diffusion.pose_context import TOLD_NO, TOLD_YES, UNTOLD, PoseTask
from pd_editor.diffusion.pose_denoiser import PoseDenoiser, PoseDenoiserConfig
from pd_editor.diffusion.pose_sampling import sample_states
from pd_editor.diffusion.stages import INITIAL_STATES, TRAJECTORIES
from pd_editor.errors import EditError, GenerationError, ModelError
from pd_editor.generation import (
    AVOIDANCE,
    LANE_GUIDANCE,
    GeneratedTraffic,
    GenerationRequest,
    GuidanceTerm,
    Region,
    ScenarioGenerator,
    TrafficSample,
    guidance_terms,
    run_to_end,
)
from pd_editor.metrics.map_points import map_points
from pd_editor.repair import slow_for_gaps
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import scenario_with, straight_drivers, two_agents_that_pass
from tests.diffusion.trajectory_scenes import small_model

SINGLE = GuidanceTerm(name=AVOIDANCE, weight=0.0)


@pytest.fixture(scope="module")
def model_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("model")
    driver = small_model()
    counts = AgentCounts(
        half_side_m=np.full(3, 62.0),
        lane_m=np.full(3, 200.0),
        counts=np.einsum("i,jk->ijk", [4, 0, 0, 1, 2], [[0, 0], [0, 1]])[None].repeat(
            3, axis=0
        ),
    )
    config = PoseDenoiserConfig(
        width=32, num_heads=2, num_layers=1, num_near_pieces=4, relation_width=16
    )
    placer = PoseDenoiser(config)
    placer.set_agent_counts(counts)
    save_model(
        folder,
        {
            "traj": TrainedStage(kind=TRAJECTORIES, config=driver.config, model=driver),
            "init": TrainedStage(kind=INITIAL_STATES, config=config, model=placer),
        },
    )
    return folder


@pytest.fixture
def diffuser(model_folder: Path) -> PathDiffuser:
    return PathDiffuser(model_folder)


@pytest.fixture
def scenario() -> Scenario:
    return two_agents_that_pass()


def generated(
    diffuser: PathDiffuser, scenario: Scenario, ids: tuple[str, ...], **asked: object
) -> GeneratedTraffic:
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=ids,
        **asked,  # type: ignore[arg-type]
    )
    return run_to_end(diffuser.generate(request))


def same(one: TrafficSample, two: TrafficSample) -> bool:
    return one.ids == two.ids and all(
        np.array_equal(getattr(one, name), getattr(two, name))
        for name in ("position_m", "heading_rad", "velocity_mps")
    )


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


def test_agents_are_added_and_placed_anew(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    ids = scenario.agents.ids
    traffic = generated(
        diffuser,
        scenario,
        ids[:1],
        redrawn_state_ids=ids[:1],
        num_new_agents={AgentKind.PEDESTRIAN: 1, AgentKind.VEHICLE: 2},
        num_samples=2,
        region=Region(center_m=(20.0, 0.0), half_side_m=30.0),
    )
    one, two = traffic.samples
    assert one.ids == (ids[0], "new-1", "new-2", "new-3")
    assert one.kinds[1:] == (AgentKind.VEHICLE,) * 2 + (AgentKind.PEDESTRIAN,)
    assert not same(one, two)
    alone = generated(
        diffuser,
        scenario,
        ids[:1],
        redrawn_state_ids=ids[:1],
        num_new_agents={AgentKind.PEDESTRIAN: 1, AgentKind.VEHICLE: 2},
        region=Region(center_m=(20.0, 0.0), half_side_m=30.0),
    )
    assert same(alone.samples[0], one)


def test_whoever_is_placed_can_brake_behind_those_ahead(diffuser: PathDiffuser) -> None:
    """The weights are random: without the last repair some could not."""
    crowd = [(8.0 * k, 3.5 * lane, 0.0, 9.0) for k in range(9) for lane in range(2)]
    scenario = scenario_with(straight_drivers(crowd))
    ids = scenario.agents.ids
    traffic = generated(
        diffuser, scenario, ids, redrawn_state_ids=ids, moving_share=1.0, num_samples=3
    )
    now = scenario.current_step
    for sample in traffic.samples:
        agents = scenario.agents
        rows = agents.rows(sample.ids)
        arrays = {
            name: getattr(agents, name).copy()
            for name in ("position_m", "heading_rad", "velocity_mps")
        }
        for name, values in arrays.items():
            values[rows, now] = getattr(sample, name)[:, 0]
        placed = scenario.with_agents(agents.with_rows(rows, **arrays))
        assert slow_for_gaps(placed, keep_ids=())[1].changes == ()


def test_the_model_chooses_how_many_so_that_there_are_as_many_as_in_training(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    traffic = generated(
        diffuser,
        scenario,
        scenario.agents.ids,
        draws_num_agents=True,
        region=Region(center_m=(0.0, 0.0), half_side_m=62.0),
    )
    kinds = traffic.samples[0].kinds
    assert kinds.count(AgentKind.PEDESTRIAN) == 2
    assert kinds.count(AgentKind.CYCLIST) == 1
    assert kinds.count(AgentKind.VEHICLE) == 4


def test_wishes_about_those_placed_are_answered(
    diffuser: PathDiffuser, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks: list[PoseTask] = []

    def spied(*given: Any, task: PoseTask, **more: Any) -> Any:
        tasks.append(task)
        return sample_states(*given, task=task, **more)

    monkeypatch.setattr(placing, "sample_states", spied)
    asked = {
        "num_new_agents": {AgentKind.VEHICLE: 6, AgentKind.PEDESTRIAN: 1},
        "num_samples": 2,
        "guidance": (SINGLE,),
    }
    wishes = {"moving_share": 0.75, "only_on_road": True}
    traffic = generated(diffuser, scenario, (), **asked, **wishes)
    for task in tasks:
        kept, drives, walks = task.moves[0].split([2, 6, 1])
        assert (kept == UNTOLD).all()
        assert 4 <= (drives == TOLD_YES).sum() <= 5
        assert (drives == TOLD_NO).sum() + (drives == TOLD_YES).sum() == 6
        assert walks != UNTOLD
        assert task.on_road[0].tolist() == [UNTOLD] * 2 + [TOLD_YES] * 6 + [UNTOLD]
    numbers = []
    points = map_points(scenario.road_map).center_m
    for sample in traffic.samples:
        walker = sample.kinds.index(AgentKind.PEDESTRIAN)
        speed = np.hypot(*sample.velocity_mps[:, 0].T)
        gap = sample.position_m[:, 0, None] - points
        far = np.hypot(gap[..., 0], gap[..., 1]).min(axis=1) > 4
        far[walker] = False
        numbers.append(((speed >= 0.5).sum(), far.sum()))
    moving, off = np.sum(numbers, axis=0)
    assert traffic.notes[0].startswith(f"{moving} of 14 placed agents move")
    assert "75% were asked for" in traffic.notes[0]
    assert traffic.notes[1].startswith(f"{off or 'None'} of 14 placed agents came")
    assert not generated(diffuser, scenario, (), **asked).notes


def test_nobody_waits_only_where_there_are_no_tries(
    diffuser: PathDiffuser, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[TrafficSample] = []

    def recorded(_scenario: Scenario, _rows: object, sample: TrafficSample) -> Any:
        asked.append(sample)
        return sample, ("somebody",)

    monkeypatch.setattr(path_diffuser, "giving_way", recorded)
    ids, calls = scenario.agents.ids, {}
    for tries in (0, 1, 3):
        asked.clear()
        guidance = guidance_terms(0.0, tries)
        traffic = generated(diffuser, scenario, ids, guidance=guidance, num_samples=2)
        calls[tries] = len(asked)
        assert any("were slowed" in note for note in traffic.notes) == (tries > 0)
    assert calls == {0: 0, 1: 2, 3: 2}


def bad_requests(scenario: Scenario) -> Iterator[tuple[dict[str, object], str]]:
    ids = scenario.agents.ids
    yield {"agent_ids": ()}, "nobody"
    yield {"agent_ids": (ids[0], ids[0])}, "twice"
    yield {"num_samples": 0}, "samples"
    yield {"num_denoising_steps": 0}, "denoising steps"
    yield {"seed": -1}, "seed"
    yield {"moving_share": 1.5}, "must be between 0 and 1"
    yield {"only_on_road": True}, "whose states are drawn"
    yield {"agent_ids": ids[:1], "redrawn_state_ids": ids[1:]}, "another state"
    yield {"num_new_agents": {AgentKind.VEHICLE: 500}}, "500"
    yield {"num_new_agents": {AgentKind.STATIC: 1}}, "road users"
    yield {"num_new_agents": {AgentKind.VEHICLE: -1}}, "negative"
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
    with pytest.raises(EditError, match="nobody"):
        generated(diffuser, scenario, ("nobody",))
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
            guidance=(GuidanceTerm(name=LANE_GUIDANCE, weight=weight), SINGLE),
        )
        for weight in (0.0, 1.0)
    )
    assert not same(free.samples[0], firm.samples[0])
    assert not any("Guidance" in note for note in free.notes)
    assert any("to 0.0 m" in note for note in firm.notes)
    odd = generated(diffuser, scenario, ids, guidance=(GuidanceTerm(name="magic"),))
    assert any("magic" in note for note in odd.notes)


def test_every_tensor_is_made_on_the_device_of_the_model(
    diffuser: PathDiffuser, model_folder: Path, scenario: Scenario
) -> None:
    ids = scenario.agents.ids
    requests: list[dict[str, Any]] = [
        {"redrawn_state_ids": ids[:1], "num_new_agents": {AgentKind.VEHICLE: 2}},
        {"draws_num_agents": True, "moving_share": 0.5, "only_on_road": True},
        {"guidance": guidance_terms(0.9, 3), "num_samples": 2},
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
        assert drawing_device(name).type == device
    with pytest.raises(GenerationError, match="GPU"):
        PathDiffuser(model_folder, device="cuda")


def test_nobody_is_placed_outside_the_square_even_to_be_on_a_lane(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    beside = Region(center_m=(0.0, 40.0), half_side_m=10.0)
    traffic = generated(
        diffuser,
        scenario.without_agents(scenario.agents.ids),
        (),
        num_new_agents={AgentKind.VEHICLE: 4},
        region=beside,
    )
    place = traffic.samples[0].position_m[:, 0]
    # Who overlaps somebody at the border is slid out of it by a car's length at most.
    outside = np.abs(place - beside.center_m) - beside.half_side_m
    assert (outside <= 5.0).all()
    assert (outside.max(axis=1) <= 0).sum() >= 3


def test_a_road_that_is_full_gets_nobody_more(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    nowhere = Region(center_m=(500.0, 500.0), half_side_m=5.0)
    traffic = generated(
        diffuser,
        scenario.without_agents(scenario.agents.ids),
        (),
        draws_num_agents=True,
        region=nowhere,
        num_samples=2,
    )
    assert [sample.ids for sample in traffic.samples] == [(), ()]
    assert any("Nobody was placed in 2 of 2 samples" in note for note in traffic.notes)


def test_things_alone_keep_their_velocity(diffuser: PathDiffuser) -> None:
    thing = straight_drivers([(0.0, 0.0, 0.0, 2.0)], kinds=(AgentKind.STATIC,))
    scenario = scenario_with(thing)
    traffic = generated(diffuser, scenario, thing.ids)
    now = scenario.current_step
    velocity = traffic.samples[0].velocity_mps
    assert (velocity == thing.velocity_mps[:, None, now]).all()
    assert any("no road users" in note for note in traffic.notes)


def test_agents_that_are_not_there_take_no_room(diffuser: PathDiffuser) -> None:
    agents = straight_drivers(
        [(4.0 * number, 0.0, 0.0, 1.0) for number in range(path_diffuser.MOST_AGENTS)]
    )
    scenario = scenario_with(agents)
    valid = agents.is_valid.copy()
    valid[3:, scenario.current_step] = False
    scenario = scenario.with_agents(replace(agents, is_valid=valid))
    traffic = generated(diffuser, scenario, (), draws_num_agents=True)
    assert traffic.samples


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
    asked = {"redrawn_state_ids": ids[:1], "num_new_agents": {AgentKind.VEHICLE: 2}}
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
