import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
import torch

from pd_editor.generation.core.noise_schedule import centered_levels
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.features.map_pieces import PIECE_SHAPE
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    UNCONDITIONED,
    Conditioning,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.generation.initial_state.network.lane_distance import offset_from_lane_m
from pd_editor.generation.initial_state.network.state_encoding import (
    decode_states,
    encode_states,
)
from pd_editor.generation.initial_state.sampler import (
    InitialStateSamplerConfig,
    finished_states,
    sample_initial_states,
)
from pd_editor.generation.initial_state.state_overlap import overlap_depth_m
from pd_editor.generation.inputs import SceneTensors
from pd_editor.scene.agent_kind import Activity
from tests.generation.initial_state.scenes import scene_batch, small_model

SCHEDULE = InitialStateConfig().schedule()


def drawn(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    samples: Sequence[int] = (0, 1, 2),
    task: Conditioning | None = None,
    config: InitialStateSamplerConfig | None = None,
) -> torch.Tensor:
    config = InitialStateSamplerConfig(num_steps=4) if config is None else config
    task = sampling_conditioning(scene) if task is None else task
    steps = sample_initial_states(
        model, scene, RandomStreams(5, "states", samples), task, config=config
    )
    *_, last = steps
    return finished_states(scene, task, last.clean)


def test_states_are_proper_and_inside_the_square():
    scene = scene_batch(5, 9)
    side = torch.tensor([62.0, 30.0])
    states = drawn(
        small_model(), scene, task=sampling_conditioning(scene, half_side_m=side)
    )
    assert states.shape == (3, 2, *scene.has_agent.shape[1:], 5)
    assert states.isfinite().all()
    torch.testing.assert_close(
        states[..., 2:4].norm(dim=-1), torch.ones(states.shape[:-1])
    )
    assert (states[..., 4] >= 0).all()
    reach = states[..., :2].abs().amax(dim=(0, 2, 3))
    assert (reach <= side + 1e-3).all()


@pytest.mark.parametrize("eta", [0.0, 0.7])
def test_a_sample_alone_is_the_sample_among_others(eta: float):
    scene, model = scene_batch(6), small_model()
    config = InitialStateSamplerConfig(num_steps=4, eta=eta)
    together = drawn(model, scene, (0, 1, 2), config=config)
    alone = drawn(model, scene, (2,), config=config)
    torch.testing.assert_close(together[2], alone[0], rtol=1e-4, atol=1e-3)
    assert not torch.allclose(together[0], together[1])


def test_given_agents_come_out_bit_identical():
    scene = scene_batch(6)
    speed = scene.agent_speed.clone()
    speed[0, 0] = 0.3
    scene = replace(scene, agent_speed=speed)
    is_given = torch.tensor([[True, False, True, False, False, False]])
    states = drawn(small_model(), scene, task=sampling_conditioning(scene, is_given))
    for row in (0, 2):
        heading = scene.agent_pose[0, row, 2]
        assert (states[:, 0, row, :2] == scene.agent_pose[0, row, :2]).all()
        assert (states[:, 0, row, 2] == heading.cos()).all()
        assert (states[:, 0, row, 3] == heading.sin()).all()
        assert (states[:, 0, row, 4] == scene.agent_speed[0, row]).all()


def test_sampling_stops_when_no_further_step_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
):
    scene, model = scene_batch(4), small_model()
    calls = []
    denoise = InitialStateDenoiser.denoise

    def counted(*args: Any) -> torch.Tensor:
        calls.append(1)
        return denoise(*args)

    monkeypatch.setattr(InitialStateDenoiser, "denoise", counted)
    steps = sample_initial_states(model, scene, RandomStreams(0, "states", [0]))
    first, second = next(steps), next(steps)
    assert (first.index, second.index) == (0, 1)
    assert len(calls) == 2


MEAN = torch.tensor([0.03, -0.02, 1.0, 0.0, 0.8, -0.5, -0.5, 0.5])
SPREAD = torch.tensor([0.2, 0.05, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])


def drawn_from_a_gaussian(
    config: InitialStateSamplerConfig, monkeypatch: pytest.MonkeyPatch
) -> tuple[torch.Tensor, torch.Tensor]:
    """Positions over the square, and speeds, with its exact denoiser."""
    scene, model = scene_batch(30), small_model()
    levels = iter(centered_levels(config.num_steps, config.level_emphasis))

    def exact(_: object, noisy: torch.Tensor, *_others: object) -> torch.Tensor:
        noise = model.schedule.sigma(torch.tensor([next(levels)])).square()
        share = SPREAD.square() / (SPREAD.square() + noise)
        return MEAN + share * (noisy - MEAN)

    monkeypatch.setattr(InitialStateDenoiser, "denoise", exact)
    states = drawn(model, scene, range(200), config=config)
    return states[:, 0, :, :2].flatten(0, 1) / 62.0, states[..., 4]


@pytest.mark.parametrize(
    "config",
    [
        InitialStateSamplerConfig(num_steps=60, is_second_order=False, eta=0.0),
        InitialStateSamplerConfig(num_steps=60, is_second_order=False, eta=1.0),
        InitialStateSamplerConfig(num_steps=60),
    ],
    ids=["plain", "fresh", "second order"],
)
def test_the_exact_denoiser_of_a_gaussian_ends_in_that_gaussian(
    config: InitialStateSamplerConfig, monkeypatch: pytest.MonkeyPatch
):
    """Positions only: headings and speeds are no Gaussians when decoded."""
    position, _ = drawn_from_a_gaussian(config, monkeypatch)
    torch.testing.assert_close(position.mean(dim=0), MEAN[:2], rtol=0, atol=0.01)
    torch.testing.assert_close(position.std(dim=0), SPREAD[:2], rtol=0.08, atol=0)


def test_guidance_lowers_overlap_and_leaves_given_agents():
    before, after = 0.0, 0.0
    for seed in range(6):
        scene = scene_batch(16, seed=seed)
        is_given = torch.zeros_like(scene.has_agent)
        is_given[:, 0] = True
        codes = encode_states(scene.agent_pose, scene.agent_speed)[None]
        guide = InitialStateGuidance(pull=0.0).of(
            scene, SCHEDULE, sampling_conditioning(scene, is_given)
        )
        now = codes
        for _ in range(20):
            now = guide(now, 0.0)
        before += overlap_depth_m(codes, scene).sum().item()
        after += overlap_depth_m(now, scene).sum().item()
        assert torch.equal(now[:, is_given], codes[:, is_given])
    assert before > 20.0
    assert after < 0.1 * before


def test_guidance_pulls_movers_towards_lanes():
    scene = scene_batch(12)
    away = scene.agent_pose.clone()
    away[..., 1] = 20.0
    scene = replace(
        scene, agent_pose=away, agent_kind=torch.zeros_like(scene.agent_kind)
    )
    codes = encode_states(scene.agent_pose, scene.agent_speed)[None]
    guide = InitialStateGuidance().of(scene, SCHEDULE)
    reached = decode_states(guide(codes, 0.0))[..., 1]
    assert (reached < 16).all()
    assert (reached > 1.75).all()
    assert torch.equal(guide(codes, 1.0), codes)


def test_guidance_keeps_those_on_the_road_who_are_told_to_be_there():
    scene = scene_batch(12)
    away = scene.agent_pose.clone()
    away[..., 1] = 9.0
    scene = replace(
        scene,
        agent_pose=away,
        agent_speed=torch.zeros_like(scene.agent_speed),
        agent_kind=torch.zeros_like(scene.agent_kind),
    )
    codes = encode_states(scene.agent_pose, scene.agent_speed)[None]
    task = sampling_conditioning(scene)
    reached = {}
    for code in (UNCONDITIONED, CONDITIONED_NO, CONDITIONED_YES):
        told = replace(task, on_road=torch.full_like(task.on_road, code))
        guide, now = InitialStateGuidance().of(scene, SCHEDULE, told), codes
        for _ in range(20):
            now = guide(now, 0.0)
        reached[code] = offset_from_lane_m(decode_states(now)[..., :2], scene)[1]
    assert (reached[CONDITIONED_YES] <= 3.6).all()
    assert torch.equal(reached[UNCONDITIONED], reached[CONDITIONED_NO])
    assert (reached[UNCONDITIONED] > 5).all()


def test_guidance_pulls_waiting_agents_towards_lanes_and_leaves_parked_ones():
    scene = scene_batch(12)
    away = scene.agent_pose.clone()
    away[..., 1] = 9.0
    still = torch.zeros_like(scene.agent_speed)
    cars = torch.zeros_like(scene.agent_kind)
    scene = replace(scene, agent_pose=away, agent_speed=still, agent_kind=cars)
    points = replace(scene, agent_size=torch.zeros_like(scene.agent_size))
    guide = InitialStateGuidance(gap_m=0.0).of(points, SCHEDULE)
    moved = {}
    for activity in (Activity.UNKNOWN, Activity.PARKED, Activity.WAITING):
        now = torch.full_like(scene.agent_kind, activity)
        codes = encode_states(scene.agent_pose, still, now)[None]
        moved[activity] = (guide(codes, 0.0) - codes)[..., 1].abs() * 62.0
    assert (moved[Activity.WAITING] > 2.0).all()
    assert (moved[Activity.PARKED] == 0).all()
    assert (moved[Activity.UNKNOWN] == 0).all()


def test_guidance_keeps_all_within_lanes_where_nobody_is_wished_off_the_road():
    scene = scene_batch(12)
    away = scene.agent_pose.clone()
    away[..., 1] = 6.0
    vehicles = torch.zeros_like(scene.agent_kind)
    points = torch.zeros_like(scene.agent_size)
    scene = replace(scene, agent_pose=away, agent_kind=vehicles, agent_size=points)
    assert 0 < (scene.agent_speed > 0).sum() < scene.agent_speed.numel()
    task = sampling_conditioning(scene)
    task = replace(task, on_road=torch.full_like(task.on_road, CONDITIONED_YES))
    now = encode_states(scene.agent_pose, scene.agent_speed)[None]
    guide = InitialStateGuidance(gap_m=0.0).within_lanes().of(scene, SCHEDULE, task)
    for _ in range(20):
        now = guide(now, 0.0)
    offset = offset_from_lane_m(decode_states(now)[..., :2], scene)[1]
    assert (offset <= 1.5).all()
    assert (offset >= 1.3).all()


def junction_scene(num_agents: int) -> SceneTensors:
    """A road along x of ten pieces, the middle four in a junction."""
    scene = scene_batch(num_agents)
    pieces = scene.piece_pose.shape[1]
    assert pieces >= 10
    pose = torch.zeros_like(scene.piece_pose)
    pose[0, :10, 0] = torch.arange(-45.0, 50.0, 10.0)
    shape = torch.zeros_like(scene.piece_shape)
    shape[0, :, PIECE_SHAPE.index("length")] = 1.0
    shape[0, 3:7, PIECE_SHAPE.index("is_intersection")] = 1.0
    return replace(
        scene,
        piece_pose=pose,
        piece_shape=shape,
        piece_kind=torch.zeros_like(scene.piece_kind),
        has_piece=torch.arange(pieces)[None] < 10,
        agent_kind=torch.zeros_like(scene.agent_kind),
        has_agent=torch.ones_like(scene.has_agent),
    )


def test_vehicles_that_stand_in_a_junction_are_moved_out_of_it():
    scene = junction_scene(4)
    pose = torch.tensor([[12.0, 0, 0], [-13.0, 0, 0], [2.0, 0, 0], [33.0, 0, 0]])
    speed = torch.tensor([0.0, 0.0, 5.0, 0.0])
    clean = encode_states(pose, speed, torch.full((4,), 2))[None, None]
    may_stop = torch.tensor([[False, True, False, False]])
    guide = InitialStateGuidance().of(scene, SCHEDULE, may_stop=may_stop)
    x = decode_states(guide(clean, 0.0))[0, 0, :, 0]
    # The border is at 20 m. One that may stop, one that moves, one outside stay.
    assert x[0] == pytest.approx(23.0, abs=0.1)
    assert x[1:].tolist() == pytest.approx([-13.0, 2.0, 33.0], abs=0.1)
    unguided = InitialStateGuidance().of(scene, SCHEDULE)
    same = decode_states(unguided(clean, 0.0))[0, 0, :, 0]
    assert same.tolist() == pytest.approx(pose[:, 0].tolist(), abs=0.1)


def test_agents_that_stand_askew_on_a_lane_are_aligned_in_the_last_step():
    kinds = torch.tensor([[0, 0, 0, 0, PEDESTRIAN, 0]])
    scene = replace(junction_scene(6), agent_kind=kinds)
    turns = [0.5, math.pi - 0.5, 0.5, 0.5, 0.5, 0.1]
    x = [40.0, 44.0, 2.0, 50.0, 36.0, 30.0]
    y = [0.5, 0.0, 0.0, 4.0, 0.0, 0.0]
    pose = torch.tensor([x, y, turns]).T
    clean = encode_states(pose, torch.zeros(6), torch.full((6,), 2))[None, None]
    guide = InitialStateGuidance().of(scene, SCHEDULE)
    found = decode_states(guide(clean, 0.0))[0, 0]
    heading = torch.atan2(found[:, 3], found[:, 2])
    # One keeps facing against its lane. In the junction, beside the lane, on foot and
    # with a small angle, agents keep their headings.
    expected = [0.0, math.pi, *turns[2:]]
    assert heading.abs().tolist() == pytest.approx(expected, abs=1e-3)
    earlier = decode_states(guide(clean, 0.05))[0, 0]
    same = torch.atan2(earlier[:, 3], earlier[:, 2])
    assert same.tolist() == pytest.approx(turns, abs=1e-3)
    drives = encode_states(pose, torch.full((6,), 5.0), torch.full((6,), 3))
    moving = decode_states(guide(drives[None, None], 0.0))[0, 0]
    same = torch.atan2(moving[:, 3], moving[:, 2])
    assert same.tolist() == pytest.approx(turns, abs=1e-3)
