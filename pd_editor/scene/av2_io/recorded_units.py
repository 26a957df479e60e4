"""Checks of recorded headings and velocities against the motion of positions."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import heading_of, wrap_angle

_WINDOW_S: Final = 0.5
_MOVING_MPS: Final = 2.0
"""Positions that move faster than this for a while show where an agent drives."""
_AGREES_RAD: Final = 0.3
_MANY: Final = 0.5
_FEW: Final = 10
"""Fewer moving states prove nothing."""
_MAX_RATIO: Final = 2.0
"""Velocities that differ from the motion by more than this factor get a note."""


def headings_in_radians(
    heading: Float[np.ndarray, "A T"],
    position_m: Float[np.ndarray, "A T 2"],
    is_valid: Bool[np.ndarray, "A T"],
    step_s: float,
) -> tuple[Float[np.ndarray, "A T"], tuple[str, ...]]:
    """Headings in radians, counter-clockwise from +x, with a note if they were not.

    Degrees, and degrees clockwise from north, are known by the motion of the agents.
    Without moving agents, values beyond two turns count as degrees.
    """
    moves, motion = _motion(position_m, is_valid, step_s)
    most = float(np.abs(heading[is_valid]).max(initial=0.0))
    readings = {
        "radians": heading,
        "degrees": np.radians(heading),
        "degrees clockwise from north": np.radians(90.0 - heading),
    }
    if moves.sum() < _FEW:
        unit = "degrees" if most > 4 * np.pi else "radians"
    else:
        course = heading_of(motion[moves])
        fits = {
            one: float((np.abs(wrap_angle(rows[moves] - course)) < _AGREES_RAD).mean())
            for one, values in readings.items()
            for rows in (values[:, : moves.shape[1]],)
        }
        # Each reading is likelier than the next: they agree along a diagonal road.
        unit = max(fits, key=lambda one: fits[one] - 0.02 * list(fits).index(one))
        is_odd = fits["radians"] < _MANY
        # Within half a turn are radians, as exports write them, however agents slide.
        if fits[unit] < _MANY or most <= np.pi or not (is_odd or most > 2.1 * np.pi):
            unit = "radians"
        if is_odd and unit == "radians":
            return heading, ("Headings disagree with the motion of most agents.",)
    told = f"Headings were read as {unit}; expected radians."
    return readings[unit], () if unit == "radians" else (told,)


def notes_on_velocities(agents: AgentTracks, step_s: float) -> tuple[str, ...]:
    """Note velocities that do not fit the motion of positions; they are kept."""
    moves, motion = _motion(agents.position_m, agents.is_valid, step_s)
    driven_mps = float(np.hypot(*motion[moves].T).sum())
    said_mps = float(agents.speed_mps()[:, : moves.shape[1]][moves].sum())
    if moves.sum() < _FEW or 1 / _MAX_RATIO < said_mps / driven_mps < _MAX_RATIO:
        return ()
    return (
        f"Velocities do not fit the positions: together they are"
        f" {said_mps / driven_mps:.2g} times as large as the motion.",
    )


def _motion(
    position_m: Float[np.ndarray, "A T 2"],
    is_valid: Bool[np.ndarray, "A T"],
    step_s: float,
) -> tuple[Bool[np.ndarray, "A S"], Float[np.ndarray, "A S 2"]]:
    """Which states move on, and their velocity to a later place."""
    count = max(1, round(_WINDOW_S / step_s))
    motion = (position_m[:, count:] - position_m[:, :-count]) / (count * step_s)
    is_fast = np.hypot(motion[..., 0], motion[..., 1]) > _MOVING_MPS
    there = is_valid[:, count:] & is_valid[:, :-count]
    # Others jitter: boxes of standing agents jump now and then.
    drives = (there & is_fast).sum(axis=1) > _MANY * there.sum(axis=1)
    return there & is_fast & drives[:, None], motion
