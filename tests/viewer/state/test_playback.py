import pytest

from pd_editor.scene.time_axis import TimeAxis
from pd_editor.viewer.state.playback import FRAME_S, Playback


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def make():
    clock = Clock()
    playback = Playback(clock)
    playback.open(TimeAxis())
    return playback, clock


def test_opens_at_the_current_step_and_stands():
    playback, _ = make()
    assert playback.step == 49
    assert playback.advance() == (False, None)


def test_another_scene_stands_at_its_current_step():
    """It went on playing, from wherever the scene before had been."""
    playback, _ = make()
    playback.seek(101.0)
    playback.play()
    playback.open(TimeAxis())
    assert playback.step == TimeAxis().current_step
    assert not playback.is_playing


def test_one_second_is_ten_steps_at_normal_speed():
    playback, clock = make()
    playback.play()
    for _ in range(40):
        clock.now += 0.025
        playback.advance()
    assert playback.step == pytest.approx(59, abs=0.5)


def test_frames_are_not_due_more_often_than_30_hz():
    playback, clock = make()
    playback.play()
    due = 0
    for _ in range(1000):
        clock.now += 0.001
        due += playback.advance()[0]
    assert due <= 1 / FRAME_S + 1


def test_loops_or_stops_at_the_end():
    playback, clock = make()
    playback.play()
    clock.now += 7.0
    playback.advance()
    assert playback.step == pytest.approx(119 - 109)
    playback.loops = False
    clock.now += 20.0
    playback.advance()
    assert playback.step == 109
    assert not playback.is_playing
    playback.play()
    assert playback.step == 0


def test_speed_cycles_and_seek_is_clamped():
    playback, _ = make()
    assert [playback.next_speed() for _ in range(5)] == [2.0, 4.0, 0.25, 0.5, 1.0]
    playback.seek(1e9)
    assert playback.step == 109
    playback.seek(-3)
    assert playback.step == 0


def test_ends_where_the_last_agent_does():
    playback, clock = make()
    playback.last_step = 60
    playback.play()
    clock.now += 1.5
    playback.advance()
    assert playback.step == pytest.approx(64 - 60)


def test_begins_again_where_most_agents_begin():
    playback, clock = make()
    playback.seek(20)
    playback.play()
    playback.limit(first_step=50, last_step=109)
    assert playback.step == 50
    clock.now += 6.0
    playback.advance()
    assert playback.step == pytest.approx(50 + 110 - 109)
    # A user may look at earlier steps, whatever is edited meanwhile.
    playback.seek(20)
    playback.limit(first_step=50, last_step=109)
    assert playback.step == 20


def test_a_recording_of_one_step_plays_on_the_spot():
    """Playing a single step divided by its length 0 (found by bad inputs)."""
    playback, clock = make()
    playback.open(TimeAxis(num_steps=1, current_step=0))
    playback.play()
    for _ in range(3):
        clock.now += 0.5
        playback.advance()
        assert playback.step == 0


def test_a_shuttle_plays_both_ways_and_twice_as_fast_each_time():
    playback, clock = make()
    playback.shuttle(-1)
    clock.now += 1.0
    playback.advance()
    assert playback.step == pytest.approx(39)
    playback.shuttle(-1)
    clock.now += 1.0
    playback.advance()
    assert playback.step == pytest.approx(19)
    clock.now += 1.0
    playback.advance()
    assert playback.step == pytest.approx(109 - 1), "it goes round at the beginning"
    playback.shuttle(1)
    assert (playback.direction, playback.speed) == (1, 1.0)
    speeds = [(playback.shuttle(1), playback.speed)[1] for _ in range(3)]
    assert speeds == [2.0, 4.0, 4.0]
    playback.shuttle(0)
    assert not playback.is_playing


def test_backwards_ends_at_the_first_step_and_begins_at_the_last():
    playback, clock = make()
    playback.loops = False
    playback.shuttle(-1)
    clock.now += 60.0
    playback.advance()
    assert (playback.step, playback.is_playing) == (0, False)
    playback.shuttle(-1)
    assert playback.step == 109
    playback.pause()
    playback.play()
    assert playback.step == 0, "Space plays forward"
