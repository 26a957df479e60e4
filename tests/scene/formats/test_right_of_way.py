"""Who waits where ways through a junction meet."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.formats.sumo_writer import Way, meetings

ANGLES = st.floats(-3.1, 3.1).map(lambda angle: round(angle, 1))


def way(
    lane: int, heading: float, turn: float = 0.0, num_lanes: int = 1, end: int = 0
) -> Way:
    """From one side of the origin over it."""
    one, two = (np.array([np.cos(n), np.sin(n)]) for n in (heading, heading + turn))
    return Way(
        lanes=(lane, lane + 100, end or lane + 200),
        line_m=np.stack([-10 * one, 0 * one, 10 * two]),
        num_lanes=num_lanes,
    )


def test_turns_wait_for_straight_on_and_left_for_right():
    straight, left, right = way(1, 0.0), way(2, 3.1, 1.5), way(3, 1.5, -1.5)
    order = [straight, right, left]
    for row, one in enumerate(order):
        assert [one.waits_for(other) for other in order[:row]] == [True] * row
        assert not any(one.waits_for(other) for other in order[row + 1 :])
    assert [one.direction for one in order] == ["s", "r", "l"]


def test_of_equal_ways_the_one_from_the_right_goes_first():
    east, north = way(1, 0.0), way(2, np.pi / 2)
    assert east.waits_for(north)
    assert east.is_equal_to(north)
    wide = way(3, 0.0, num_lanes=2)
    assert north.waits_for(wide)
    assert not north.is_equal_to(wide)


@given(ANGLES, ANGLES, ANGLES, ANGLES, st.integers(1, 2), st.sampled_from([0, 9]))
def test_one_of_two_waits(
    one: float, turn: float, two: float, other_turn: float, lanes: int, end: int
):
    ways = way(1, one, turn, 1, end), way(2, two, other_turn, lanes, end)
    assert ways[0].waits_for(ways[1]) != ways[1].waits_for(ways[0])


def test_ways_from_one_lane_do_not_meet():
    ways = [way(1, 0.0), way(2, 1.5), way(1, 0.0, 1.5), way(4, 1.5, end=201)]
    found = meetings(ways)
    np.testing.assert_array_equal(found, found.T)
    assert [found[0].tolist(), found[2].tolist()] == [
        [False, True, False, True],
        [False, True, False, True],
    ]
    assert meetings([]).shape == (0, 0)
