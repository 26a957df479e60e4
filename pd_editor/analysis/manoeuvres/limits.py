"""All thresholds by which events are told apart, each with its reason."""

from dataclasses import dataclass
from typing import Final

from pd_editor.scene.thresholds import PARKED_OFFSET_M, PARKED_TURN_RAD


@dataclass(frozen=True, kw_only=True)
class ManoeuvreLimits:
    """Thresholds; those without a source were chosen by eye on ``train``."""

    sampling_s: float = 0.2
    """Manoeuvres last seconds, so every second step of 10 Hz is enough."""
    jump_rad: float = 1.0
    """No vehicle yaws more in a step: the tracker has turned its box around."""
    lane_reach_m: float = 4.5
    """Lanes further away are not followed: more than a lane's width of 3.7 m."""
    lane_turn_rad: float = 1.05
    """Lanes at a larger angle, 60 degrees, are crossed, not followed."""
    num_candidates: int = 6
    """Lanes at a place, the nearest ones; more overlap only in the middle of junctions."""
    num_hops: int = 3
    """Lanes in turn that count as one way: maps cut lanes into short pieces."""
    apart_m: float = 1.2
    """Lanes that are nearer to one another, such as in a fork, are one place."""
    lane_shift_m: float = 1.8
    """Least shift of a lane change: half the lane's width, as highD counts them."""
    lane_drift_m: float = 0.3
    """Least part of a lane change in each of the lanes."""
    lane_drift_mps: float = 0.25
    """A lane change lasts while the agent goes aside faster than in its lane."""
    lane_change_s: float = 5.0
    """Longest half of a lane change; whole ones take 2 to 8 s (Toledo and Zohar 2007)."""
    lane_change_yaw_rad: float = 0.45
    """Agents that yaw more while they change lanes turn in a junction."""
    turn_rate_rad_s: float = 0.06
    """Yaw rate of turns; at 10 m/s it is a radius of 170 m."""
    turn_pause_s: float = 1.2
    """Turns go on after a pause, such as for pedestrians."""
    turn_way_m: float = 2.0
    """Least way of a turn: no vehicle turns on the spot."""
    turn_rad: float = 0.7
    """Least turn, 40 degrees: junctions are skewed, and tracks end within turns."""
    u_turn_rad: float = 2.6
    """Least turn back, 150 degrees."""
    corner_m: float = 20.0
    """Where no lane tells a turn from a bend, turns have a smaller radius."""
    crossed_m: float = 10.0
    """Way within a junction that crosses it."""
    roundabout_m: float = 60.0
    """Radius of the largest roundabouts; lanes of a larger one count as straight."""
    stand_s: float = 1.0
    """Shorter stops are the noise of tracks."""
    parked_m: float = 1.5
    """Who never leaves a place by more has not moved; tracks of parked cars jitter."""
    off_lane_m: float = PARKED_OFFSET_M
    off_lane_rad: float = PARKED_TURN_RAD
    moved_m: float = 2.0
    """Way before and after a stop that makes it stop and go."""
    braking_s: float = 0.4
    """Shorter decelerations are the noise of tracks."""
    braked_mps: float = 1.0
    """Least loss of speed within 0.6 s, by the places, of who brakes hard."""
    pairs_m: float = 60.0
    """Agents whose ways stay further apart have nothing to do with one another."""
    headway_s: float = 3.0
    """Followers keep less; at more, drivers are free (Vogel 2002: 6 s; HCM: 3 s)."""
    follow_s: float = 2.0
    """Who is behind for a shorter time does not follow."""
    cut_in_s: float = 2.5
    """Headway left to who is cut off; it is under the usual one."""
    crossing_pet_s: float = 5.0
    """Longer times after one another are no interaction (FHWA SSAM: 5 s)."""
    crossing_rad: float = 0.52
    """Paths at a smaller angle, 30 degrees, merge or follow."""
    joined_s: float = 1.5
    """Who goes in one direction so long after they met merge, others cross."""
    new_s: float = 0.6
    """Tracks that are younger may be another's that goes on."""
    near_m: float = 1.0
    """Least gap after a short time to collision: queues and cars beside keep more."""
    near_ttc_s: float = 1.5
    """Conflicts have a shorter time to collision (FHWA SSAM)."""
    near_pet_s: float = 1.0
    """So have those with a shorter time after one another (Allen and others 1978)."""
    slip_rad: float = 0.35
    """No vehicle goes at a larger angle, 20 degrees, to where its box points."""
    tracked_s: float = 1.0
    """Time for which an agent's track is sound before it meets another."""
    near_s: float = 0.6
    """Shorter conflicts are the noise of tracked velocities."""
    near_braking_mps2: float = 3.35
    """Conflicts need harder braking than this to be avoided (Archer 2005)."""
    yield_share: float = 0.5
    """Who yields slows to this share of the speed that it came with, or less."""
    yield_m: float = 25.0
    """Distance from the place of crossing at which who yields is slowest, at most."""
    beside_m: float = 2.0
    """Gap to a cyclist beside; laws ask for 1.5 m."""
    beside_s: float = 0.6
    """Least time of being beside, overtaking or on a crosswalk."""
    passing_m: float = 6.0
    """Overtaken agents are at most this far aside."""


LIMITS: Final = ManoeuvreLimits()
