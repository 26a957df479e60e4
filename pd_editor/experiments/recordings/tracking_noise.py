"""Model of a tracker's errors: noisy states, and tracks that break off.

Noise is stationary and smooth: white noise under a Gaussian kernel, so that its
correlation over a time d is exp(-d^2 / (4 c^2)), with the kernel's width c. Its strength
differs between agents (log-normal factor), which gives the heavy tails of real tracks.
Noise of velocities is independent of that of positions, as after a tracker's filter.

The defaults follow 35 scenarios of Argoverse 2's train split: heading against motion
0.7 deg at the median and 3.6 deg at the 90th percentile; given speed against motion
0.3 and 1.1 m/s; positions of standing vehicles scatter by 0.07 m (90 %: 0.24 m); over
1 s tracks leave a parabola by 1.5 cm along and 0.3 cm across only, so drift is slow;
half of the tracks lie within 40 m of the ego, nine of ten within 86 m. Occlusions are
set so that a scene has as many tracks as there (55, of which 28 at the current step and
8 throughout, medians) and as short ones (27 steps).
"""

import dataclasses
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import wrap_angle

_KERNEL_WIDTHS: Final = 3.0
"""Where the kernel is cut off, in units of its width."""


@dataclass(frozen=True, kw_only=True)
class TrackingNoise:
    """Parameters of a tracker's errors; zero or infinity disables each."""

    along_m: float = 0.25
    """Standard deviation of a driving agent's position along its heading."""
    across_m: float = 0.12
    standing_m: float = 0.06
    """Standard deviation of a stationary agent's position, in both directions."""
    heading_rad: float = 0.018
    velocity_along_mps: float = 0.35
    velocity_across_mps: float = 0.2
    agent_spread: float = 0.7
    """Standard deviation of the logarithm of each agent's factor."""
    heading_spread: float = 1.0
    """The same for headings, whose errors have heavier tails."""
    position_width_s: float = 1.0
    """Kernel width of positions and headings."""
    velocity_width_s: float = 0.4
    range_m: float = 65.0
    """Median distance from the ego up to which an agent is observed."""
    range_spread: float = 0.5
    """Standard deviation of the logarithm of that distance."""
    occlusions_per_s: float = 0.12
    """Median rate of occlusions over agents."""
    occlusion_spread: float = 0.8
    """Standard deviation of the logarithm of each agent's rate."""
    occlusion_s: float = 1.2
    """Mean duration, exponentially distributed."""


def smooth_noise(
    random: np.random.Generator, count: int, num_steps: int, width_steps: float
) -> Float[np.ndarray, "N T"]:
    """``count`` series with mean 0, variance 1 and a Gaussian correlation."""
    if width_steps <= 0:
        return random.standard_normal((count, num_steps))
    reach = int(np.ceil(_KERNEL_WIDTHS * width_steps))
    gap = np.arange(num_steps + 2 * reach)[:, None] - np.arange(num_steps) - reach
    kernel = np.exp(-0.5 * (gap / width_steps) ** 2) * (np.abs(gap) <= reach)
    kernel /= np.sqrt((kernel**2).sum(axis=0))
    return random.standard_normal((count, num_steps + 2 * reach)) @ kernel


def noisy(
    tracks: AgentTracks,
    noise: TrackingNoise,
    random: np.random.Generator,
    step_s: float,
) -> AgentTracks:
    """Add noise to positions, headings and velocities of tracks."""
    count, num_steps = tracks.is_valid.shape

    def blur(width_s: float) -> Float[np.ndarray, "A T"]:
        return smooth_noise(random, count, num_steps, width_s / step_s)

    spread = np.array([noise.agent_spread] * 3 + [noise.heading_spread])
    factor = np.exp(spread[:, None, None] * random.standard_normal((4, count, 1)))
    # A filter suppresses the noise of stationary agents; it returns as they start.
    drives = np.clip(tracks.speed_mps() / 3.0, 0.0, 1.0)
    along = noise.standing_m + (noise.along_m - noise.standing_m) * drives
    across = noise.standing_m + (noise.across_m - noise.standing_m) * drives
    position = _turned(
        along * factor[0] * blur(noise.position_width_s),
        across * factor[1] * blur(noise.position_width_s),
        tracks.heading_rad,
    )
    turn = noise.heading_rad * (0.3 + 0.7 * drives)
    turn = turn * factor[3] * blur(noise.position_width_s)
    change = 0.005 + 0.995 * drives
    velocity = _turned(
        noise.velocity_along_mps * change * factor[2] * blur(noise.velocity_width_s),
        noise.velocity_across_mps * change * factor[2] * blur(noise.velocity_width_s),
        tracks.heading_rad,
    )
    is_valid = tracks.is_valid
    return dataclasses.replace(
        tracks,
        position_m=tracks.position_m + np.where(is_valid[..., None], position, 0.0),
        heading_rad=wrap_angle(tracks.heading_rad + np.where(is_valid, turn, 0.0)),
        velocity_mps=tracks.velocity_mps + np.where(is_valid[..., None], velocity, 0.0),
    )


def _turned(
    along: Float[np.ndarray, "A T"],
    across: Float[np.ndarray, "A T"],
    heading: Float[np.ndarray, "A T"],
) -> Float[np.ndarray, "A T 2"]:
    cos, sin = np.cos(heading), np.sin(heading)
    return np.stack([along * cos - across * sin, along * sin + across * cos], axis=-1)


def seen(
    tracks: AgentTracks,
    ego: int,
    always: Int[np.ndarray, "M"],
    noise: TrackingNoise,
    random: np.random.Generator,
    step_s: float,
) -> Bool[np.ndarray, "A T"]:
    """Steps at which each agent is within range of the ego and not occluded.

    ``always`` are rows whose tracks do not break off; the ego exists at all steps.
    """
    count, num_steps = tracks.is_valid.shape
    reach = noise.range_m * np.exp(noise.range_spread * random.standard_normal(count))
    gap = np.linalg.norm(tracks.position_m - tracks.position_m[ego], axis=-1)
    hidden = _hidden(count, num_steps, noise, random, step_s)
    is_seen = tracks.is_valid & (gap <= reach[:, None]) & ~hidden
    is_seen[always] = tracks.is_valid[always]
    return is_seen


def _hidden(
    count: int,
    num_steps: int,
    noise: TrackingNoise,
    random: np.random.Generator,
    step_s: float,
) -> Bool[np.ndarray, "A T"]:
    """Steps at which agents are occluded: random starts, exponential durations."""
    rate = noise.occlusions_per_s * np.exp(
        noise.occlusion_spread * random.standard_normal((count, 1))
    )
    begins = random.random((count, num_steps)) < rate * step_s
    lasts = random.exponential(noise.occlusion_s / step_s, (count, num_steps))
    ends = np.where(begins, np.arange(num_steps) + 1 + lasts, 0.0)
    return np.arange(num_steps) < np.maximum.accumulate(ends, axis=1)
