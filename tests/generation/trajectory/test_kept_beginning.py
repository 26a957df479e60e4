"""Locked beginnings: exact, conditioned on, and without a jump at their end."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import GenerationError
from pd_editor.editor.commands import traffic_command
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.generation.trajectory.network.decoding import motion_of
from pd_editor.generation.trajectory.task import KeptBeginning, projected
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.locks import STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.roles.traffic_choice import (
    drivable_agent_ids,
    resamplable_agent_ids,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import scenario_with, straight_drivers
from tests.generation.generated_traffic import generated
from tests.generation.trajectory.scenes import small_model

BASIS = small_model().decoder.basis
NOW = TimeAxis().current_step


def locked(scenario: Scenario, kept_s: float) -> Scenario:
    names = scenario.agents.ids
    return replace(scenario, locks=dict.fromkeys(names, Lock(kept_s=kept_s)))


def kept_beginning(scenario: Scenario) -> KeptBeginning:
    rows = np.arange(len(scenario.agents))
    return KeptBeginning.of(scenario, rows, np.ones(len(rows), bool))


def curved() -> Scenario:
    """Two drivers, one of which brakes in a bend."""
    agents = straight_drivers([(0, 0, 0.4, 8.0), (3, 20, -2.0, 0.0)])
    time = np.maximum(np.arange(agents.num_steps) - NOW, 0) * 0.1
    way, course = 8.0 * time - 0.4 * time**2, 0.4 + 0.05 * time
    place = way[:, None] * np.stack([np.cos(course), np.sin(course)], axis=-1)
    velocity = np.gradient(place, 0.1, axis=0)
    velocity[NOW] = 8.0 * np.array([np.cos(0.4), np.sin(0.4)])
    changed = {"position_m": place, "velocity_mps": velocity, "heading_rad": course}
    return scenario_with(
        agents.with_rows(np.array([0]), **{k: v[None] for k, v in changed.items()})
    )


@settings(max_examples=40, deadline=None)
@given(kept_s=st.floats(0.1, 5.8), seed=st.integers(0, 1000))
def test_kept_states_are_exact_and_the_rest_goes_on_smoothly(kept_s, seed):
    scenario = locked(curved(), kept_s)
    kept = kept_beginning(scenario)
    latent = np.random.default_rng(seed).normal(size=(3, 2, 10))
    matrix, offset = kept.projection(BASIS, 2)
    moved = projected(
        torch.from_numpy(latent)[:, None],
        torch.from_numpy(matrix)[None],
        torch.from_numpy(offset)[None],
    )[:, 0].numpy()
    agents = scenario.agents
    raw = motion_of(
        BASIS,
        moved,
        agents.position_m[:, NOW],
        agents.heading_rad[:, NOW],
        agents.velocity_mps[:, NOW],
        scenario.time_axis,
    )
    motion = kept.joined(raw)
    last = NOW + round(kept_s / 0.1)
    for name in ("position_m", "heading_rad", "velocity_mps"):
        wanted = getattr(agents, name)[:, NOW : last + 1]
        found = getattr(motion, name)[:, :, : last + 1 - NOW]
        assert np.array_equal(found, np.broadcast_to(wanted, found.shape))
    end = last - NOW
    pace = np.diff(motion.position_m, axis=2) / 0.1
    before, after = pace[:, :, end - 1], pace[:, :, end]
    # No jump of velocity: less than one step at 6 m/s2, whatever the rest does later.
    assert np.hypot(*(after - before).T).max() < 1.2


@settings(max_examples=30, deadline=None)
@given(kept_s=st.floats(0.1, 5.8), seed=st.integers(0, 1000))
def test_projecting_twice_changes_little_and_others_not_at_all(kept_s, seed):
    scenario = curved()
    name = scenario.agents.ids[0]
    scenario = replace(scenario, locks={name: Lock(kept_s=kept_s)})
    matrix, offset = kept_beginning(scenario).projection(BASIS, 2)
    latent = np.random.default_rng(seed).normal(size=(2, 10))
    once = np.einsum("aij,aj->ai", matrix, latent) + offset
    assert np.array_equal(once[1], latent[1])
    twice = np.einsum("aij,aj->ai", matrix, once) + offset
    assert np.linalg.norm(twice - once) <= np.linalg.norm(once - latent) + 1e-9


def test_the_rest_does_not_follow_the_jitter_of_a_recorded_beginning() -> None:
    agents = straight_drivers([(0, 0, 0, 8.0)])
    place = agents.position_m.copy()
    place[0, NOW:, 0] += 0.25 * np.sin(0.3 * np.arange(place.shape[1] - NOW))
    scenario = locked(
        scenario_with(agents.with_rows(np.array([0]), position_m=place)), 2.0
    )
    _, offset = kept_beginning(scenario).projection(BASIS, 1)
    raw = motion_of(
        BASIS,
        offset[None],
        place[:, NOW],
        agents.heading_rad[:, NOW],
        agents.velocity_mps[:, NOW],
        scenario.time_axis,
    )
    speed = np.hypot(*np.moveaxis(raw.velocity_mps[0, 0, 20:], -1, 0))
    assert np.abs(speed - 8.0).max() < 1.0


def test_a_locked_beginning_comes_out_bit_identical(diffuser: PathDiffuser):
    scenario = locked(curved(), 2.0)
    ids = scenario.agents.ids
    traffic = generated(diffuser, scenario, ids, num_samples=2)
    for sample in traffic.samples:
        for name in ("position_m", "heading_rad", "velocity_mps"):
            wanted = getattr(scenario.agents, name)[:, NOW : NOW + 21]
            assert np.array_equal(getattr(sample, name)[:, :21], wanted)
    one, two = traffic.samples
    assert not np.array_equal(one.position_m, two.position_m)


def test_a_beginning_of_an_agent_that_leaves_goes_on_from_its_last_state(
    diffuser: PathDiffuser,
):
    scenario = curved()
    is_valid = scenario.agents.is_valid.copy()
    is_valid[0, NOW + 12 :] = False
    gone = scenario.agents.with_rows(np.arange(2), is_valid=is_valid)
    scenario = locked(scenario.with_agents(gone), 3.0)
    request = GenerationRequest(scenario=scenario, agent_ids=scenario.agents.ids)
    command = traffic_command(request, run_to_end(diffuser.generate(request)))
    after = apply_within_locks(command, scenario).agents
    assert after.is_valid[0, NOW:].all()
    kept = slice(NOW, NOW + 12)
    assert np.array_equal(
        after.position_m[0, kept], scenario.agents.position_m[0, kept]
    )
    assert np.abs(np.diff(after.position_m[0, NOW:], axis=0)).max() < 1.2


def test_locked_trajectories_and_states_cannot_be_asked_for(diffuser: PathDiffuser):
    scenario = curved()
    ids = scenario.agents.ids
    held = replace(scenario, locks={ids[0]: TRAJECTORY_LOCK})
    with pytest.raises(GenerationError, match="trajectory of agent 100 is locked"):
        generated(diffuser, held, ids)
    held = replace(scenario, locks={ids[0]: STATE_LOCK})
    with pytest.raises(GenerationError, match="state of agent 100 is locked"):
        generated(diffuser, held, ids, resampled_state_ids=ids)


@pytest.mark.real_data
@pytest.mark.parametrize("kept_s", [0.0, 1.5, 4.0, None])
def test_real_locked_agents_are_bit_identical(
    kept_s: float | None, av2_scenario_folders: list[Path]
):
    scenario = read_scenario(av2_scenario_folders[-1])
    ids = drivable_agent_ids(scenario)
    held = replace(scenario, locks=dict.fromkeys(ids[::2], Lock(kept_s=kept_s)))
    free = drivable_agent_ids(held)
    states = resamplable_agent_ids(held, free)
    request = GenerationRequest(
        scenario=held, agent_ids=free, resampled_state_ids=states, only_on_road=True
    )
    traffic = run_to_end(make_generator(DEFAULT_GENERATOR).generate(request))
    command = traffic_command(request, traffic)
    after = apply_within_locks(command, held)
    is_kept = held.kept_steps()
    for name in held.locks:
        row, other = held.agents.row_of[name], after.agents.row_of[name]
        for field in ("position_m", "heading_rad", "velocity_mps", "is_valid"):
            one = getattr(held.agents, field)[row][is_kept[row]]
            two = getattr(after.agents, field)[other][is_kept[row]]
            assert one.tobytes() == two.tobytes()
    assert not held.locks.keys() & set(command.left_out_ids)
    assert len(after.agents) + len(command.left_out_ids) == len(held.agents)
