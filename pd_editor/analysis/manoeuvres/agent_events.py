"""Manoeuvres of single agents."""

from collections.abc import Iterator
from typing import SupportsFloat, SupportsIndex

import numpy as np
import shapely

from pd_editor.analysis.manoeuvres.lane_tracks import LaneTracks
from pd_editor.analysis.manoeuvres.limits import LIMITS
from pd_editor.analysis.manoeuvres.motion import Motion
from pd_editor.analysis.manoeuvres.scene_event import SceneEvent
from pd_editor.analysis.metrics.motion.kinematics import COMFORT, MAX_ACCELERATION_MPS2
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS, STANDING_MPS


def event(
    motion: Motion,
    kind: str,
    row: SupportsIndex,
    steps: tuple[SupportsIndex, SupportsIndex],
    value: SupportsFloat | None = None,
    other: SupportsIndex | None = None,
) -> SceneEvent:
    """An event of an agent's row from one step to another."""
    first, last = steps
    return SceneEvent(
        kind=kind,
        agent_id=motion.agents.ids[row],
        other_id="" if other is None else motion.agents.ids[other],
        begin_s=round(float(motion.time_s[first]), 2),
        end_s=round(float(motion.time_s[last]), 2),
        value=None if value is None else round(float(value), 2),
    )


def lane_changes(motion: Motion, lanes: LaneTracks) -> Iterator[SceneEvent]:
    """Changes to a lane beside, seen as the shift that the lanes' offsets tell."""
    one, two = lanes.lane[:, :-1], lanes.lane[:, 1:]
    linked = lanes.leads_to[one, two] | lanes.leads_to[two, one]
    aside = lanes.offset_m[:, :-1] - lanes.offset_m[:, 1:]
    crosses = (one >= 0) & (two >= 0) & ~linked & (np.abs(aside) > LIMITS.apart_m)
    drift = np.diff(lanes.offset_m, axis=1)
    # At a change from lane to lane the offset jumps; the agent does not.
    drift = np.where(one == two, drift, 0.0)
    most = round(LIMITS.lane_change_s / motion.step_s)
    for row, at in np.argwhere(crosses).tolist():
        sign = np.sign(aside[row, at])
        moves = sign * drift[row] > LIMITS.lane_drift_mps * motion.step_s
        still = (~moves & ((one == two)[row] | crosses[row])) | (one[row] < 0)
        still[at] = False
        before = np.flatnonzero(still[max(at - most, 0) : at])
        after = np.flatnonzero(still[at + 1 : at + 1 + most])
        first = max(at - most, 0) + before[-1] + 1 if len(before) else max(at - most, 0)
        last = at + 1 + after[0] if len(after) else min(at + 1 + most, len(still))
        parts = drift[row, first:at].sum(), drift[row, at + 1 : last].sum()
        shift = sign * sum(parts)
        # Where a lane tapers off beside the agent, only one of its offsets changes.
        goes = min(sign * parts[0], sign * parts[1]) > LIMITS.lane_drift_m
        goes &= shift < (motion.way_m[row, last] - motion.way_m[row, first]) / 2
        yaw = motion.yaw_rad[row, first : last + 1]
        is_turn = abs(yaw.sum()) > LIMITS.lane_change_yaw_rad
        if goes and shift >= LIMITS.lane_shift_m and not is_turn:
            side = "left" if sign > 0 else "right"
            yield event(motion, f"lane-change-{side}", row, (first, last))


def turns_and_crossings(motion: Motion, lanes: LaneTracks) -> Iterator[SceneEvent]:
    """Turns at junctions or beside the lanes, and straight ways across junctions."""
    moves = motion.is_follower & motion.has_moved
    rate = motion.yaw_rad / motion.step_s
    turning = np.zeros(rate.shape, bool)
    for sign in (1, -1):
        swings = (sign * rate > LIMITS.turn_rate_rad_s) & moves[:, None]
        for row, first, last in motion.runs(swings, 0.0, LIMITS.turn_pause_s).tolist():
            angle = abs(motion.yaw_rad[row, first : last + 1].sum())
            if angle < LIMITS.turn_rad or not _is_turn(motion, lanes, row, first, last):
                continue
            turning[row, first : last + 1] = True
            side = "left-turn" if sign > 0 else "right-turn"
            kind = "u-turn" if angle > LIMITS.u_turn_rad else side
            yield event(motion, kind, row, (first, last), np.degrees(angle))
    inside = lanes.is_junction & moves[:, None] & motion.agents.is_valid
    for row, first, last in motion.runs(inside, 0.0, 1.0).tolist():
        there = np.flatnonzero(motion.agents.is_valid[row])
        goes_on = first > there[0] or last < there[-1]
        way = motion.way_m[row, last] - motion.way_m[row, first]
        angle = abs(motion.yaw_rad[row, first : last + 1].sum())
        turns = angle >= LIMITS.turn_rad or turning[row, first : last + 1].any()
        if goes_on and way >= LIMITS.crossed_m and not turns:
            yield event(motion, "straight", row, (first, last))


def _is_turn(
    motion: Motion, lanes: LaneTracks, row: int, first: int, last: int
) -> bool:
    """Whether it is no bend of the road."""
    # Of a turn the way goes half of it aside; else only the tracker has turned the box.
    before = max(first - 1, 0)
    chord = motion.agents.position_m[row, last] - motion.agents.position_m[row, before]
    middle = motion.agents.heading_rad[row, before]
    middle += motion.yaw_rad[row, first : last + 1].sum() / 2
    ahead = chord @ unit_vector(middle)
    if ahead < max(LIMITS.turn_way_m, np.cos(LIMITS.crossing_rad) * np.hypot(*chord)):
        return False
    steps = slice(before, last + 2)
    if lanes.is_junction[row, steps].any():
        return True
    angle = abs(motion.yaw_rad[row, first : last + 1].sum())
    way = motion.way_m[row, last] - motion.way_m[row, before]
    lane, aslant = lanes.lane[row, steps], np.abs(lanes.turn_rad[row, steps])
    is_off = lane[0] < 0 or lane[-1] < 0
    if (is_off or not lanes.knows_junctions) and way < LIMITS.corner_m * angle:
        return True
    # From a drive into a lane: the agent turns against it.
    return bool((lane >= 0).all() and abs(aslant[0] - aslant[-1]) > angle / 2)


def stops(motion: Motion, lanes: LaneTracks) -> Iterator[SceneEvent]:
    """Standing, stop and go, and parked vehicles."""
    there = motion.agents.is_valid
    stands = (motion.speed_mps < STANDING_MPS) & there & motion.is_follower[:, None]
    at = np.arange(len(motion)), there.argmax(axis=1)
    is_off = (lanes.lane[at] < 0) | (np.abs(lanes.offset_m[at]) > LIMITS.off_lane_m)
    is_off |= np.abs(lanes.turn_rad[at]) > LIMITS.off_lane_rad
    is_parked = is_off & motion.is_follower & ~motion.has_moved
    for row, first, last in motion.runs(stands, LIMITS.stand_s, 0.4).tolist():
        if not is_parked[row]:
            yield event(motion, "stands", row, (first, last))
        way = motion.way_m[row]
        if min(way[first], way[-1] - way[last]) > LIMITS.moved_m:
            yield event(motion, "stop-and-go", row, (first, last))
    for row in np.flatnonzero(is_parked).tolist():
        steps = np.flatnonzero(there[row])
        yield event(motion, "parked", row, (steps[0], steps[-1]))


def hard_brakings(motion: Motion) -> Iterator[SceneEvent]:
    """Decelerations beyond comfort."""
    rate = np.gradient(motion.speed_mps, motion.step_s, axis=1)
    # The tracks' velocities are wrong at their ends and where boxes jump.
    way = motion.way_m.take(
        np.arange(2, motion.way_m.shape[1] + 2), axis=1, mode="clip"
    )
    way = (way - motion.way_m) / (2 * motion.step_s)
    slower = np.roll(way, 3, axis=1) - way
    hard = (rate < COMFORT.braking_mps2) & (rate > -MAX_ACCELERATION_MPS2)
    hard &= (slower > LIMITS.braked_mps) & motion.agents.is_valid
    hard &= (motion.is_follower & motion.has_moved)[:, None]
    for row, first, last in motion.runs(hard, LIMITS.braking_s).tolist():
        most = -rate[row, first : last + 1].min()
        yield event(motion, "hard-braking", row, (first, last), most)


def on_crosswalks(motion: Motion, scenario: Scenario) -> Iterator[SceneEvent]:
    """People on crosswalks, from the kerb to the kerb."""
    walks = [one for one in scenario.road_map.crosswalks if len(one.outline_m()) > 2]
    rows = np.flatnonzero(motion.agents.kind_mask({AgentKind.PEDESTRIAN}))
    rows = rows[motion.has_moved[rows]]
    if not walks or not len(rows):
        return
    area = shapely.unary_union(
        shapely.make_valid([shapely.Polygon(one.outline_m()) for one in walks])
    )
    shapely.prepare(area)
    place = motion.agents.position_m[rows]
    inside = shapely.contains_xy(area, place[..., 0], place[..., 1])
    inside &= motion.agents.is_valid[rows]
    for row, first, last in motion.runs(inside, LIMITS.beside_s, 0.4).tolist():
        if motion.speed_mps[rows[row], first : last + 1].max() > MOVING_MPS:
            yield event(motion, "on-crosswalk", rows[row], (first, last))


def steps_of(motion: Motion, one: SceneEvent) -> tuple[int, int, int]:
    """Row, first and last steps of an event."""
    first, last = np.searchsorted(motion.time_s, [one.begin_s - 0.01, one.end_s - 0.01])
    return motion.agents.row_of[one.agent_id], int(first), int(last)
