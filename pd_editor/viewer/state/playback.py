"""The playhead: time of the picture, and playback."""

import math
import time
from collections.abc import Callable
from typing import Final

from pd_editor.scene.time_axis import TimeAxis

FRAME_S: Final = 1 / 30
SPEEDS: Final = (0.25, 0.5, 1.0, 2.0, 4.0)


class Playback:
    """A fractional step that runs with a clock; knows nothing of drawing."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start at step 0."""
        self._clock = clock
        self._last_time: float | None = None
        self._next_frame = 0.0
        self.axis = TimeAxis()
        self.first_step = 0
        """Step at which playback begins again; few agents exist earlier."""
        self.last_step = self.axis.num_steps - 1
        """Last step of playback; no agent exists later."""
        self.step = 0.0
        self.speed = 1.0
        self.direction = 1
        """1, or -1 if it plays backwards."""
        self.loops = True

    @property
    def is_playing(self) -> bool:
        """Whether the playhead moves."""
        return self._last_time is not None

    def open(self, axis: TimeAxis) -> None:
        """Take another time axis; the playhead stands at its current step."""
        self.pause()
        self.axis = axis
        self.first_step, self.last_step = 0, axis.num_steps - 1
        self.step = float(axis.current_step)

    def play(self, direction: int = 1) -> None:
        """Move, from the other end if the one ahead was reached."""
        self.direction = direction
        ahead, behind = self._ends()
        if direction * (self.step - ahead) >= 0:
            self.step = behind
        self._last_time = self._next_frame = self._clock()

    def shuttle(self, direction: int) -> None:
        """Play in a direction, or twice as fast if it plays in it already; 0 pauses."""
        if not direction:
            self.pause()
        elif self.is_playing and direction == self.direction:
            self.speed = min(2 * self.speed, SPEEDS[-1])
        else:
            self.speed = min(self.speed, 1.0)
            self.play(direction)

    def pause(self) -> None:
        """Pause playback."""
        self._last_time = None

    def limit(self, first_step: int, last_step: int) -> None:
        """Take other limits; a playhead that moves does not stay before the first step."""
        begins_later = first_step > self.first_step
        if begins_later and self.is_playing and self.step < first_step:
            self.step = float(first_step)
        self.first_step, self.last_step = first_step, last_step

    def seek(self, step: float) -> None:
        """Jump to a step."""
        self.step = min(max(step, 0.0), float(self.axis.num_steps - 1))

    def next_speed(self) -> float:
        """Switch to the next of ``SPEEDS``."""
        self.speed = SPEEDS[(SPEEDS.index(self.speed) + 1) % len(SPEEDS)]
        return self.speed

    def _ends(self) -> tuple[float, float]:
        """The step at which playback ends, and the one at which it begins again."""
        first, last = float(self.first_step), float(self.last_step)
        return (last, first) if self.direction > 0 else (first, last)

    def advance(self) -> tuple[bool, float | None]:
        """Move with the clock.

        Returns:
            Whether a new frame is due, and the seconds until the next one (None when
            standing still).
        """
        if self._last_time is None:
            return False, None
        now = self._clock()
        if now < self._next_frame:
            return False, self._next_frame - now
        steps = (now - self._last_time) / self.axis.step_s * self.speed
        self.step += self.direction * steps
        self._last_time = now
        (ahead, behind), length = self._ends(), self.last_step - self.first_step
        passed = self.direction * (self.step - ahead)
        if passed > 0 and self.loops:
            passed = math.fmod(passed, length) if length > 0 else 0.0
            self.step = behind + self.direction * passed
        elif passed > 0:
            self.step = ahead
            self.pause()
        self._next_frame = max(self._next_frame + FRAME_S, now)
        return True, max(self._next_frame - now, 0.0)
