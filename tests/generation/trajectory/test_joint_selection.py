import numpy as np

from pd_editor.generation.trajectory.sample_yielding import (
    TrajectoryChoices,
    select_jointly,
)

STEPS = np.arange(21)[:, None] * 0.5


def straight(start: tuple[float, float], heading: float, speed: float) -> np.ndarray:
    direction = np.array([np.cos(heading), np.sin(heading)])
    return np.array(start) + speed * STEPS * direction


def choices_of(
    *agents: list[np.ndarray], heading: tuple[float, ...]
) -> TrajectoryChoices:
    position = np.stack([np.stack(ways) for ways in agents], axis=1)
    angles = np.broadcast_to(np.array(heading)[None, :, None], position.shape[:3])
    return TrajectoryChoices(
        position_m=position,
        heading_rad=angles,
        exists=np.ones(position.shape[1:3], bool),
        size_m=np.tile([4.6, 1.9], (len(agents), 1)),
    )


def test_each_takes_a_future_that_avoids_the_others() -> None:
    """Three pairs meet in every joint sample, yet a mixture is free."""
    cross = [straight((-40.0, 0.0), 0.0, speed) for speed in (4.0, 4.0, 0.0)]
    other = [straight((0.0, -40.0), np.pi / 2, speed) for speed in (4.0, 0.0, 0.0)]
    ahead = [straight((-20.0, 0.0), 0.0, speed) for speed in (0.0, 0.0, 8.0)]
    choices = choices_of(cross, other, ahead, heading=(0.0, np.pi / 2, 0.0))
    choice = select_jointly(choices, np.ones(3, bool))
    assert choice[0] == 2 or choice[2] == 2
    assert not overlaps(choices, choice)


def test_kept_agents_are_avoided_and_do_not_yield() -> None:
    kept = [straight((0.0, -40.0), np.pi / 2, 4.0)] * 2
    drawn = [straight((-40.0, 0.0), 0.0, speed) for speed in (4.0, 8.0)]
    choices = choices_of(kept, drawn, heading=(np.pi / 2, 0.0))
    choice = select_jointly(choices, np.array([False, True]))
    assert choice[1] == 1


def test_without_conflicts_the_first_joint_sample_is_taken() -> None:
    ways = [straight((0.0, 0.0), 0.0, speed) for speed in (1.0, 2.0, 3.0)]
    far = [straight((0.0, 50.0), 0.0, speed) for speed in (1.0, 2.0, 3.0)]
    choice = select_jointly(choices_of(ways, far, heading=(0.0, 0.0)), np.ones(2, bool))
    assert choice.tolist() == [0, 0]


def test_who_overlaps_from_the_start_is_not_blamed() -> None:
    one = [straight((0.0, 0.0), 0.0, 0.0), straight((0.0, 0.0), 0.0, 5.0)]
    two = [straight((2.0, 0.0), 0.0, 0.0)] * 2
    choice = select_jointly(choices_of(one, two, heading=(0.0, 0.0)), np.ones(2, bool))
    assert choice.tolist() == [0, 0]


def overlaps(choices: TrajectoryChoices, choice: np.ndarray) -> bool:
    """Whether any two centres come closer than the boxes allow, by brute force."""
    taken = choices.position_m[choice, np.arange(len(choice))]
    return any(
        np.hypot(*(taken[i] - taken[j]).T).min() < 1.9
        for i in range(len(choice))
        for j in range(i)
    )
