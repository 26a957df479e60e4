import numpy as np
import pytest

from pd_editor.analysis.threats.encounter import exertion, limits_of
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import unit_vector

STEP_S = 0.1
TIME_S = STEP_S * np.arange(60)
VEHICLE = limits_of(AgentKind.VEHICLE)


def along_x(way_m: np.ndarray) -> np.ndarray:
    return np.stack([way_m, np.zeros_like(way_m)], axis=-1)[None]


def share(position_m: np.ndarray, speed: float, **options: np.ndarray) -> float:
    velocity = np.array([speed, 0.0])
    return float(
        exertion(position_m, velocity, 0.0, VEHICLE, STEP_S, **options).share[0]
    )


def test_constant_velocity_takes_no_acceleration() -> None:
    used = exertion(along_x(10 * TIME_S), np.array([10.0, 0]), 0.0, VEHICLE, STEP_S)
    assert used.largest_mps2[0] == pytest.approx(0.0, abs=1e-9)
    assert used.is_possible[0]


@pytest.mark.parametrize(("rate", "limit"), [(2.0, 4.0), (3.9, 4.0), (-4.0, 8.0)])
def test_share_is_that_of_the_limit(rate: float, limit: float) -> None:
    way = 30 * TIME_S + rate / 2 * TIME_S**2
    # At 30 m/s the limit of the speed is nearer than that of weak accelerations.
    assert share(along_x(way), 30.0) == pytest.approx(
        max(abs(rate) / limit, (30 + max(rate, 0) * TIME_S[-4]) / 35), rel=0.01
    )


def test_jump_of_the_velocity_is_not_possible() -> None:
    assert share(along_x(15 * TIME_S), 10.0) > 1


def test_reversing_is_not_possible() -> None:
    assert share(along_x(5 * TIME_S - 1.5 * TIME_S**2), 5.0) == np.inf


def test_circle_uses_lateral_limit() -> None:
    speed, radius = 10.0, 25.0
    angle = speed / radius * TIME_S
    circle = radius * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)
    used = share(circle[None], speed)
    # The first steps straddle the straight line before and the circle.
    assert used == pytest.approx(speed**2 / radius / VEHICLE.lateral_mps2, rel=0.05)


def test_tight_circle_exceeds_the_curvature() -> None:
    speed, radius = 3.0, 2.5
    angle = speed / radius * TIME_S
    circle = radius * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)
    assert share(circle[None], speed) > 1


def test_steps_after_the_end_do_not_count() -> None:
    way = 10 * TIME_S
    way[40:] += 3 * (TIME_S[40:] - TIME_S[40]) ** 2
    assert share(along_x(way), 10.0) > 1
    assert share(along_x(way), 10.0, until=np.array([30])) < 1


def test_limits_turn_with_the_scene() -> None:
    way = along_x(10 * TIME_S + TIME_S**2)[0]
    turned = way[:, :1] * unit_vector(np.array(2.0))
    used = exertion(turned[None], 10 * unit_vector(np.array(2.0)), 2.0, VEHICLE, STEP_S)
    assert used.share[0] == pytest.approx(share(way[None], 10.0))
