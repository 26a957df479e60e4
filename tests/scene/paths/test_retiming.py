import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.paths.retiming import (
    fill_gaps,
    interpolate_rows,
    retime,
    travelled_m,
    with_new_speed,
    with_speed_at,
)

STEP_S = 0.1
SPEEDS = st.floats(0.6, 25)


def straight(speed, heading=0.3, steps=60):
    distance = speed * STEP_S * np.arange(steps)
    direction = np.array([np.cos(heading), np.sin(heading)])
    position = np.array([5.0, -2.0]) + distance[:, None] * direction
    return (
        position[None],
        np.full((1, steps), heading),
        np.broadcast_to(speed * direction, (1, steps, 2)).copy(),
        np.ones((1, steps), bool),
    )


def circle(speed, radius=15.0, steps=60):
    angle = speed * STEP_S * np.arange(steps) / radius
    position = radius * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)
    velocity = speed * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    heading = (angle + np.pi) % (2 * np.pi) - np.pi
    return position[None], heading[None], velocity[None], np.ones((1, steps), bool)


@given(st.lists(st.floats(-5, 5), min_size=2, max_size=6), st.integers(1, 4))
def test_rows_are_interpolated_as_numpy_does_one_by_one(values, rows):
    rng = np.random.default_rng(len(values))
    known_x = np.sort(rng.uniform(0, 10, (rows, len(values))), axis=1)
    known_y = np.stack([np.roll(values, row) for row in range(rows)])
    x = rng.uniform(-2, 12, (rows, 7))
    found = interpolate_rows(x, known_x, known_y[..., None])[..., 0]
    for row in range(rows):
        np.testing.assert_allclose(
            found[row], np.interp(x[row], known_x[row], known_y[row]), atol=1e-9
        )


@given(st.lists(st.booleans(), min_size=2, max_size=12).filter(any))
def test_gaps_are_interpolated_in_time(valid):
    steps = np.arange(len(valid))
    is_valid = np.array(valid)[None]
    values = np.where(is_valid, 3.0 * steps + 1, 0.0)[..., None]
    wanted = np.interp(steps, steps[valid], 3.0 * steps[valid] + 1)
    np.testing.assert_allclose(fill_gaps(values, is_valid)[0, :, 0], wanted)


@given(SPEEDS)
def test_own_distances_give_the_same_motion(speed):
    for position, heading, velocity, valid in (straight(speed), circle(speed)):
        again = retime(position, heading, valid, travelled_m(position), STEP_S)
        np.testing.assert_allclose(again[0], position, atol=1e-9)
        np.testing.assert_allclose(np.exp(1j * again[1]), np.exp(1j * heading))
        np.testing.assert_allclose(
            again[2][:, 1:-1], velocity[:, 1:-1], rtol=0.02, atol=0.4
        )


@given(SPEEDS, st.floats(0.1, 3))
def test_a_straight_line_goes_on_straight_at_any_speed(speed, factor):
    position, heading, _, valid = straight(speed)
    distance = factor * travelled_m(position)
    moved, turned, velocity = retime(position, heading, valid, distance, STEP_S)
    wanted = straight(speed * factor)
    np.testing.assert_allclose(moved, wanted[0], atol=1e-9)
    np.testing.assert_allclose(turned, wanted[1], atol=1e-9)
    np.testing.assert_allclose(velocity, wanted[2], atol=1e-6)


@given(st.floats(2, 12), st.floats(0.2, 1.0))
def test_slower_on_a_circle_stays_on_it(speed, factor):
    position, heading, velocity, valid = circle(speed)
    slow = with_new_speed(
        position, heading, velocity, valid, np.array([speed * factor]), STEP_S
    )
    radius = np.linalg.norm(slow[0][0] - [0, 15.0], axis=1)
    assert np.abs(radius - 15).max() < 0.02
    angle = factor * speed * STEP_S * np.arange(60) / 15
    np.testing.assert_allclose(np.unwrap(slow[1][0]), angle, atol=1e-2)
    speeds = np.hypot(slow[2][..., 0], slow[2][..., 1])
    np.testing.assert_allclose(speeds, speed * factor, rtol=1e-9)
    np.testing.assert_allclose(
        travelled_m(slow[0]), factor * travelled_m(position), rtol=2e-3, atol=1e-9
    )


def test_beyond_the_curve_it_goes_straight_on():
    position, heading, velocity, valid = circle(5.0, steps=20)
    moved, turned, _ = with_new_speed(
        position, heading, velocity, valid, np.array([10.0]), STEP_S
    )
    np.testing.assert_allclose(turned[0, -1], heading[0, -1])
    beyond = travelled_m(moved)[0] > travelled_m(position)[0, -1] + 1
    course = np.diff(moved[0][beyond], axis=0)
    angle = np.arctan2(course[:, 1], course[:, 0])
    np.testing.assert_allclose(angle, angle[0], atol=1e-9)
    np.testing.assert_allclose(angle[0], heading[0, -1], atol=0.06)


def test_the_same_speed_changes_nothing():
    position, heading, velocity, valid = circle(7.0)
    again = with_new_speed(position, heading, velocity, valid, np.array([7.0]), STEP_S)
    np.testing.assert_allclose(again[0], position, atol=1e-9)
    np.testing.assert_allclose(again[2], velocity, atol=0.2)


def test_one_who_stands_drives_straight_ahead_despite_jitter():
    rng = np.random.default_rng(3)
    position = 0.05 * rng.standard_normal((1, 60, 2))
    heading = np.full((1, 60), 0.5) + 0.1 * rng.standard_normal((1, 60))
    heading[0, 0] = 0.5
    moved, turned, velocity = with_new_speed(
        position, heading, 0 * position, np.ones((1, 60), bool), np.array([4.0]), STEP_S
    )
    ahead = np.array([np.cos(0.5), np.sin(0.5)])
    wanted = position[0, 0] + 0.4 * np.arange(60)[:, None] * ahead
    np.testing.assert_allclose(moved[0], wanted, atol=1e-9)
    np.testing.assert_allclose(turned, 0.5)
    np.testing.assert_allclose(velocity[0], np.tile(4 * ahead, (60, 1)))


def test_one_who_waits_and_then_drives_goes_along_its_curve():
    position, heading, velocity, _ = circle(6.0, steps=40)
    waits = [
        np.concatenate([a[:, :1].repeat(20, 1), a], 1) for a in (position, velocity)
    ]
    waits[1][:, :20] = 0
    turned = np.concatenate([heading[:, :1].repeat(20, 1), heading], 1)
    moved, _, new_velocity = with_new_speed(
        waits[0], turned, waits[1], np.ones((1, 60), bool), np.array([3.0]), STEP_S
    )
    radius = np.linalg.norm(moved[0] - [0, 15.0], axis=1)
    assert np.abs(radius - 15).max() < 0.02
    speeds = np.hypot(new_velocity[..., 0], new_velocity[..., 1])
    np.testing.assert_allclose(speeds, 3.0)


def test_stopping_keeps_the_pose():
    position, heading, velocity, valid = circle(8.0)
    moved, turned, stopped = with_new_speed(
        position, heading, velocity, valid, np.array([0.0]), STEP_S
    )
    np.testing.assert_allclose(moved, np.broadcast_to(position[:, :1], moved.shape))
    np.testing.assert_allclose(turned, heading[0, 0], atol=1e-12)
    assert not stopped.any()


def test_a_starting_agent_is_not_shot_off():
    steps = np.arange(60)
    speed = np.minimum(0.6 + 2.0 * STEP_S * steps, 10.0)
    x = np.concatenate([[0], np.cumsum(speed[:-1]) * STEP_S])
    position = np.stack([x, 0 * x], axis=-1)[None]
    velocity = np.stack([speed, 0 * speed], axis=-1)[None]
    moved, _, new_velocity = with_new_speed(
        position,
        np.zeros((1, 60)),
        velocity,
        np.ones((1, 60), bool),
        np.array([6.0]),
        STEP_S,
    )
    assert new_velocity[0, 0, 0] == 6.0
    assert new_velocity.max() <= 10.0
    assert (np.diff(moved[0, :, 0]) <= 1.0 + 1e-9).all()


def test_absent_steps_are_zero_and_do_not_disturb_the_rest():
    position, heading, velocity, valid = straight(10.0)
    valid = valid.copy()
    valid[0, 20:25] = False
    valid[0, 49:] = False
    mask = valid[..., None]
    moved, turned, new_velocity = with_new_speed(
        position * mask,
        heading * valid,
        velocity * mask,
        valid,
        np.array([5.0]),
        STEP_S,
    )
    for values in (moved, turned, new_velocity):
        assert not values[~valid].any()
    np.testing.assert_allclose(moved[valid], straight(5.0)[0][valid], atol=1e-9)


@given(
    SPEEDS, st.integers(1, 59), st.floats(0, 30), st.sampled_from([straight, circle])
)
def test_a_pulled_speed_is_reached_on_the_same_curve_and_fades(
    speed, step, pulled, curve
):
    position, heading, velocity, is_valid = curve(speed)
    moved, headed, driven = with_speed_at(
        position, heading, velocity, is_valid, step, pulled, STEP_S
    )
    speeds = np.linalg.norm(driven[0], axis=-1)
    np.testing.assert_allclose(speeds[step], pulled, atol=1e-6)
    np.testing.assert_allclose(moved[0, 0], position[0, 0], atol=1e-9)
    np.testing.assert_allclose(speeds[0], speed, atol=1e-6)
    # Never slower than both, never faster than both.
    assert (speeds >= min(speed, pulled) - 1e-6).all()
    assert (speeds <= max(speed, pulled) + 1e-6).all()
    # After so long a time nothing of the pull is left.
    fade = max(10, np.pi * abs(pulled - speed) / (2 * 2.5) / STEP_S)
    np.testing.assert_allclose(speeds[int(step + fade) + 1 :], speed, atol=1e-6)
    # Along the curve, as far as it goes; each step is as long as the speeds tell.
    travelled = travelled_m(moved)[0]
    known = travelled_m(position)[0]
    along = np.concatenate([[0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * STEP_S)])
    inside = along <= known[-1]
    # Chords of a circle are shorter than its arcs.
    np.testing.assert_allclose(travelled[inside], along[inside], rtol=0.01, atol=0.05)
    if curve is circle:
        radius = np.linalg.norm(moved[0] - [0, 15.0], axis=-1)
        np.testing.assert_allclose(radius[inside], 15.0, atol=0.06)
    del headed


def test_a_standing_agent_is_pulled_straight_ahead_and_its_noise_goes():
    rng = np.random.default_rng(3)
    position, heading, velocity, is_valid = straight(0.0)
    position = position + rng.normal(0, 0.02, position.shape)
    velocity = velocity + rng.normal(0, 0.05, velocity.shape)
    moved, _, driven = with_speed_at(
        position, heading, velocity, is_valid, 30, 4.0, STEP_S
    )
    ahead = (moved[0] - position[0, 0]) @ [np.cos(0.3), np.sin(0.3)]
    assert (np.diff(ahead) >= 0).all()
    assert np.isclose(np.linalg.norm(driven[0, 30]), 4.0)
    assert ahead[-1] > 5
    np.testing.assert_allclose(moved[0, 0], position[0, 0])


def test_pulled_to_a_stop_it_stands_and_goes_on_later():
    position, heading, velocity, is_valid = straight(3.0)
    moved, _, driven = with_speed_at(
        position, heading, velocity, is_valid, 25, 0.0, STEP_S
    )
    assert np.linalg.norm(driven[0, 25]) < 1e-9
    assert np.linalg.norm(driven[0, -1]) > 2.9
    assert travelled_m(moved)[0, -1] < travelled_m(position)[0, -1] - 1
