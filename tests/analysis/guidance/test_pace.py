"""The pace along a course: it meets what is asked for wherever rates allow it."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pd_editor.analysis.guidance.way_points import Ask, Pace, Rates, pace_of

RATES = Rates(up=1.5, down=2.0, hardest_up=2.5, hardest_down=5.0, cruise_mps=9.0)
TIMES_S = np.linspace(0.0, 20.0, 2_001)


@st.composite
def asks(draw: st.DrawFn) -> list[Ask]:
    """Up to four places in order, with times in order as well."""
    found, along, time = [], 0.0, 0.0
    for _ in range(draw(st.integers(0, 4))):
        along += draw(st.floats(1.0, 60.0))
        time += draw(st.floats(0.2, 8.0))
        found.append(
            Ask(
                along_m=along,
                speed_mps=draw(st.none() | st.floats(0.0, 20.0)),
                at_s=draw(st.none() | st.just(time)),
                release_s=draw(st.none() | st.floats(0.0, 15.0) | st.just(np.inf)),
            )
        )
    return found


@given(asks=asks(), first=st.floats(0.0, 20.0))
def test_agents_never_go_back_and_keep_the_hardest_rates(asks: list[Ask], first: float):
    pace = pace_of(asks, first, RATES)
    along = pace.along_at(TIMES_S)
    assert np.isfinite(along).all()
    assert (np.diff(along) >= -1e-6).all()
    assert len(pace.arrivals) == len(asks)
    gain = np.diff(pace.speed_mps) / np.maximum(np.diff(pace.time_s), 1e-12)
    assert gain.max(initial=0.0) <= RATES.hardest_up + 1e-6
    assert gain.min(initial=0.0) >= -RATES.hardest_down - 1e-6


@given(gap=st.floats(5.0, 80.0), first=st.floats(1.0, 15.0), share=st.floats(0.8, 1.3))
@example(gap=5.0, first=13.0, share=1.125)  # Brakes reach further.
def test_a_place_is_reached_at_its_time(gap: float, first: float, share: float):
    at_s = share * gap / first
    pace = pace_of([Ask(along_m=gap, at_s=at_s)], first, RATES)
    most = first * at_s + RATES.hardest_up * at_s**2 / 2
    least = first * at_s - RATES.hardest_down * at_s**2 / 2
    if least < gap < 0.95 * most and share < 1.2:
        assert pace.along_at(np.array([at_s]))[0] == pytest.approx(gap, abs=0.1)


@given(gap=st.floats(20.0, 80.0), first=st.floats(0.0, 12.0), last=st.floats(0.0, 12.0))
def test_a_place_is_passed_at_its_speed(gap: float, first: float, last: float):
    needed = abs(last**2 - first**2) / (2 * gap)
    pace = pace_of([Ask(along_m=gap, speed_mps=last)], first, RATES)
    _, along, speed = pace.arrivals[0]
    if needed < (RATES.hardest_up if last > first else RATES.hardest_down) - 0.01:
        assert speed == pytest.approx(last, abs=0.05)
        assert along == pytest.approx(gap, abs=0.1)


def waits(release_s: float, *more: Ask) -> Pace:
    return pace_of([Ask(along_m=30.0, release_s=release_s), *more], 8.0, RATES)


def test_an_agent_stands_until_it_may_go_and_drives_off():
    along = waits(9.0).along_at(TIMES_S)
    stands = (TIMES_S > 7.0) & (TIMES_S < 9.0)
    assert along[stands] == pytest.approx(30.0, abs=0.05)
    assert along[-1] > 60.0
    assert waits(np.inf).along_at(TIMES_S)[-1] == pytest.approx(30.0, abs=0.05)


def test_who_cannot_stop_at_a_place_waits_behind_it():
    pace = pace_of([Ask(along_m=3.0, release_s=9.0)], 10.0, RATES)
    assert pace.arrivals[0][2] > 5.0
    along = pace.along_at(TIMES_S)
    stands = (TIMES_S > 4.0) & (TIMES_S < 9.0)
    assert along[stands] == pytest.approx(10.0**2 / (2 * RATES.hardest_down), abs=0.1)


def test_an_agent_that_arrives_later_does_not_stop():
    assert waits(3.0).speed_mps.min() == 8.0


def test_after_a_wait_the_speed_that_is_asked_for_next_counts():
    pace = waits(6.0, Ask(along_m=50.0, speed_mps=4.0))
    assert pace.speed_mps[-1] == pytest.approx(4.0)
    assert pace.arrivals[1][2] == pytest.approx(4.0)
