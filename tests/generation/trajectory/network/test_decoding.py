from dataclasses import replace

import numpy as np
import pytest

from pd_editor.generation.trajectory.network.decoding import (
    Motion,
    motion_of,
    turned_as_vehicles,
)
from pd_editor.scene.time_axis import TimeAxis
from tests.generation.trajectory.scenes import arc_basis, futures

AXIS = TimeAxis()
POSITION = np.array([[3.0, -2.0], [100.0, 50.0], [0.0, 0.0]])
HEADING = np.array([0.4, -2.9, 1.0])


def test_futures_begin_at_the_state_and_go_where_the_latents_say() -> None:
    basis = arc_basis()
    points, speed = futures(60, seed=2)
    chosen = np.flatnonzero(speed > 3)[:3]
    points, speed = points[chosen], speed[chosen]
    latent = basis.encode(points, speed)[None]
    velocity = speed[:, None] * np.stack([np.cos(HEADING), np.sin(HEADING)], axis=-1)
    motion = motion_of(basis, latent, POSITION, HEADING, velocity, AXIS)
    assert np.array_equal(motion.position_m[0, :, 0], POSITION)
    assert np.array_equal(motion.heading_rad[0, :, 0], HEADING)
    assert np.array_equal(motion.velocity_mps[0, :, 0], velocity)
    for agent in range(3):
        cos, sin = np.cos(HEADING[agent]), np.sin(HEADING[agent])
        world = points[agent] @ np.array([[cos, sin], [-sin, cos]]) + POSITION[agent]
        gap = np.linalg.norm(motion.position_m[0, agent, 1:60] - world, axis=-1)
        assert gap.max() < 0.3
    inner = motion.velocity_mps[0, :, 1:-1]
    ahead = motion.position_m[0, :, 2:] - motion.position_m[0, :, :-2]
    assert np.allclose(inner, ahead / 0.2)


def test_who_stands_and_hardly_moves_stays_exactly() -> None:
    basis = arc_basis()
    still = basis.encode(np.zeros((3, 59, 2)), np.zeros(3))
    moving = still[None] + np.array([0.0, 1e-4, 2.0])[:, None, None]
    motion = motion_of(basis, moving, POSITION, HEADING, np.zeros((3, 2)), AXIS)
    for sample in (0, 1):
        assert np.ptp(motion.position_m[sample], axis=1).max() == 0.0
        assert np.array_equal(
            motion.heading_rad[sample], np.repeat(HEADING[:, None], 61, axis=1)
        )
    assert np.ptp(motion.position_m[2], axis=1).max() > 1.0


@pytest.mark.parametrize(("steps", "step_s"), [(60, 0.1), (11, 0.5), (0, 0.1)])
def test_other_time_axes_are_met_between_and_beyond_the_steps(
    steps: int, step_s: float
) -> None:
    basis = arc_basis()
    time = 0.1 * np.arange(1, 60)
    straight = np.stack([8.0 * time, np.zeros(59)], axis=-1)[None]
    latent = basis.encode(straight, np.array([8.0]))[None]
    axis = TimeAxis(num_steps=steps + 1, current_step=0, step_s=step_s)
    motion = motion_of(
        basis,
        latent,
        np.zeros((1, 2)),
        np.zeros(1),
        np.array([[8.0, 0.0]]),
        axis,
    )
    expected = 8.0 * step_s * np.arange(steps + 1)
    assert np.abs(motion.position_m[0, 0, :, 0] - expected).max() < 0.2
    assert motion.position_m.shape == (1, 1, steps + 1, 2)


def test_a_vehicle_slower_than_walking_does_not_turn_on_the_spot() -> None:
    """A drawn corner turned a vehicle by 90 degrees within a few centimetres."""
    way = np.concatenate([np.linspace(0, 1, 21), np.ones(20)])
    left = np.concatenate([np.zeros(21), np.linspace(0, 1, 21)[1:]])
    position = np.broadcast_to(np.stack([way, left], axis=-1), (1, 2, 41, 2))
    heading = np.repeat([0.0, np.pi / 2], [21, 20])
    sharp = Motion(
        position_m=position,
        heading_rad=np.broadcast_to(heading, (1, 2, 41)),
        velocity_mps=np.gradient(position, 0.1, axis=-2),
    )
    turned = turned_as_vehicles(sharp, np.array([True, False]), 0.1)
    vehicle, pedestrian = turned.heading_rad[0]
    step_m = np.linalg.norm(np.diff(position[0, 0], axis=0), axis=-1)
    assert (np.abs(np.diff(vehicle)) <= 0.3 * step_m + 1e-9).all()
    assert vehicle[-1] == pytest.approx(0.3, abs=1e-6)
    assert np.array_equal(pedestrian, heading)
    # At eight times the pace the same corner is driven as it was.
    fast = turned_as_vehicles(
        replace(sharp, position_m=8 * position), np.array([True, True]), 0.1
    )
    assert fast.heading_rad[0, 0, -1] == np.pi / 2
