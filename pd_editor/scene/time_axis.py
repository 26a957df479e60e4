"""The time steps of a scenario."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True, kw_only=True)
class TimeAxis:
    """Equally spaced time steps, one of which is the current step."""

    num_steps: int = 110
    """Number of steps T."""
    current_step: int = 49
    """Step that edits act on (t = 0): the last observed one, as Argoverse 2 has it.

    Later steps are the future: 60 of them, 6.0 s.
    """
    step_s: float = 0.1
    start_timestamp_ns: int | float = 0.0
    """Time of the first step, as the source file has it."""
    end_timestamp_ns: int | float = 10.9e9
    """Time of the last step, as the source file has it."""

    def __post_init__(self) -> None:
        assert 0 <= self.current_step < self.num_steps
        assert self.step_s > 0

    @property
    def num_future_steps(self) -> int:
        """Steps after the current one."""
        return self.num_steps - self.current_step - 1

    @property
    def future_s(self) -> float:
        """Time from the current step to the last one."""
        return self.num_future_steps * self.step_s

    @property
    def duration_s(self) -> float:
        """Time from the first to the last step."""
        return (self.num_steps - 1) * self.step_s

    @property
    def is_past(self) -> Bool[np.ndarray, "T"]:
        """Whether each step is observed: the current one and those before it."""
        return np.arange(self.num_steps) <= self.current_step

    def times_s(self) -> Float[np.ndarray, "T"]:
        """Time of each step, zero at the current one."""
        return (np.arange(self.num_steps) - self.current_step) * self.step_s

    def lasting(self, num_steps: int) -> "TimeAxis":
        """The same axis with another number of steps."""
        span = (num_steps - 1) * self.step_s * 1e9
        start = self.start_timestamp_ns
        return replace(
            self, num_steps=num_steps, end_timestamp_ns=start + type(start)(span)
        )
