"""Events: their kinds, manoeuvres of single agents, and of pairs."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, SupportsFloat, SupportsIndex

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.manoeuvres.tracks import LIMITS, LaneTracks, Motion
from pd_editor.analysis.metrics.motion import COMFORT, MAX_ACCELERATION_MPS2
from pd_editor.analysis.metrics.safety import box_gap_m, encroachments, times_to_touch
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS, STANDING_MPS
from pd_editor.scene.time_axis import TimeAxis

EVENT_KINDS: Final[dict[str, str]] = {
    "lane-change-left": "",
    "lane-change-right": "",
    "left-turn": "turn",
    "right-turn": "turn",
    "u-turn": "turn",
    "straight": "",
    "stands": "",
    "stop-and-go": "",
    "parked": "",
    "hard-braking": "braking",
    "following": "headway",
    "cut-in": "headway",
    "merge": "lag",
    "crossing": "pet",
    "yielding": "pet",
    "overtaking": "",
    "on-crosswalk": "",
    "cyclist-beside": "gap",
    "near-miss": "ttc",
}
"""The quantity that each kind of event has as its value; empty: none.

turn: degrees; braking: m/s2; headway, lag, pet (post-encroachment time) and ttc (time to
collision): seconds; gap: metres between the boxes.
"""


@dataclass(frozen=True, kw_only=True)
class SceneEvent:
    """Something that an agent does, alone or towards another one."""

    kind: str
    agent_id: str
    """Who does it: who cuts in, yields, overtakes, follows, or comes second."""
    other_id: str = ""
    begin_s: float
    """Seconds after the current step."""
    end_s: float
    value: float | None = None
    """What ``EVENT_KINDS`` names."""

    @property
    def agent_ids(self) -> tuple[str, ...]:
        """Who does it, and towards whom, if anybody."""
        return (self.agent_id, self.other_id) if self.other_id else (self.agent_id,)

    def first_step(self, axis: TimeAxis) -> int:
        """Step of a time axis at which it begins, or the one next to that."""
        step = axis.current_step + round(self.begin_s / axis.step_s)
        return min(max(step, 0), axis.num_steps - 1)


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairs:
    """P ordered pairs of agents that come near, seen from the first of them."""

    motion: Motion
    lanes: LaneTracks
    a: Int[np.ndarray, "P"]
    b: Int[np.ndarray, "P"]

    @classmethod
    def of(cls, motion: Motion, lanes: LaneTracks) -> "Pairs":
        """Pairs of a moving follower of lanes and any agent that moves."""
        place = motion.agents.position_m
        rows = np.flatnonzero(motion.has_moved)
        low, high = place[rows].min(axis=1), place[rows].max(axis=1)
        apart = np.maximum(low[:, None] - high, low - high[:, None]).max(axis=-1)
        near = (apart < LIMITS.pairs_m) & motion.is_follower[rows][:, None]
        np.fill_diagonal(near, False)
        one, two = np.nonzero(near)
        return cls(motion=motion, lanes=lanes, a=rows[one], b=rows[two])

    @cached_property
    def exist(self) -> Bool[np.ndarray, "P S"]:
        """Whether both are there."""
        is_valid = self.motion.agents.is_valid
        return is_valid[self.a] & is_valid[self.b]

    @cached_property
    def ahead_m(self) -> Float[np.ndarray, "P S"]:
        """How far the second is ahead of the first's centre."""
        return np.einsum("psd,psd->ps", self._offset_m, self.motion.forward[self.a])

    @cached_property
    def aside_m(self) -> Float[np.ndarray, "P S"]:
        """How far it is to the left."""
        x, y = np.moveaxis(self.motion.forward[self.a], -1, 0)
        return x * self._offset_m[..., 1] - y * self._offset_m[..., 0]

    @cached_property
    def _offset_m(self) -> Float[np.ndarray, "P S 2"]:
        place = self.motion.agents.position_m
        return place[self.b] - place[self.a]

    @cached_property
    def is_along(self) -> Bool[np.ndarray, "P S"]:
        """Whether both go in one direction."""
        cosine = np.einsum(
            "psd,psd->ps", self.motion.forward[self.a], self.motion.forward[self.b]
        )
        return cosine > np.cos(LIMITS.crossing_rad)

    @cached_property
    def headway_s(self) -> Float[np.ndarray, "P S"]:
        """Time that the first, who moves, takes to the second's rear, its leader."""
        motion, lanes = self.motion, self.lanes
        length = motion.agents.size_m[:, 0]
        gap = self.ahead_m - (length[self.a] + length[self.b])[:, None] / 2
        mine, theirs = lanes.lane[self.a], lanes.lane[self.b]
        known = (mine >= 0) & (theirs >= 0)
        beside = np.abs(lanes.offset_m[self.a] - lanes.offset_m[self.b])
        in_lane = lanes.leads_to[mine, theirs] & (beside < LIMITS.lane_shift_m)
        in_front = np.abs(self.aside_m) < LIMITS.apart_m
        leads = np.where(known, in_lane, in_front) & self.is_along & (self.ahead_m > 0)
        leads &= self.exist & motion.is_follower[self.b][:, None]
        speed = motion.speed_mps[self.a]
        leads &= speed > 2 * MOVING_MPS
        headway = np.where(leads, np.maximum(gap, 0.0) / np.maximum(speed, 1.0), np.inf)
        nearest = np.full(motion.speed_mps.shape, np.inf)
        np.minimum.at(nearest, self.a, headway)
        return np.where(headway <= nearest[self.a], headway, np.inf)


def followings(pairs: Pairs) -> Iterator[SceneEvent]:
    """Who keeps behind whom."""
    motion = pairs.motion
    near = (pairs.headway_s < LIMITS.headway_s) & (
        motion.speed_mps[pairs.b] > MOVING_MPS
    )
    for pair, first, last in motion.runs(near, LIMITS.follow_s, 0.4).tolist():
        least = pairs.headway_s[pair, first : last + 1].min()
        a, b = pairs.a[pair], pairs.b[pair]
        yield event(motion, "following", a, (first, last), least, b)


def cut_ins(pairs: Pairs, changes: Iterable[SceneEvent]) -> Iterator[SceneEvent]:
    """Changes of lane, or into it, close in front of somebody who had the lane."""
    motion, after = pairs.motion, round(1.0 / pairs.motion.step_s)
    for change in changes:
        row, first, last = steps_of(motion, change)
        for pair in np.flatnonzero(pairs.b == row).tolist():
            led = pairs.headway_s[pair] < np.inf
            then = pairs.headway_s[pair, first : last + 1 + after]
            if led[max(first - 1, 0)] or not then.min() < LIMITS.cut_in_s:
                continue
            at = first + int(np.argmax(then < np.inf))
            begin, end = (first, max(at, first + 1))
            a = pairs.a[pair]
            yield event(motion, "cut-in", row, (begin, end), then.min(), a)


def meetings(motion: Motion, lanes: LaneTracks) -> Iterator[SceneEvent]:
    """Who crosses or joins another's path after it; who slows for that yields."""
    moves = np.flatnonzero(motion.has_moved)
    agents = motion.agents.taken(moves)
    a, at, b, other = encroachments(agents)
    yield from _merges(motion, lanes, np.stack([moves[a], moves[b]]), (at, other))
    turn = agents.heading_rad[a, at] - agents.heading_rad[b, other]
    late = np.abs(at - other)
    good = (np.abs(np.sin(turn)) > np.sin(LIMITS.crossing_rad)) & (late > 0)
    good &= late * motion.step_s <= LIMITS.crossing_pet_s
    # Trackers give a new id to an agent where it is, so tracks begin in others' boxes.
    first = agents.is_valid.argmax(axis=1) + round(LIMITS.new_s / motion.step_s)
    good &= (at >= first[a]) & (other >= first[b])
    a, at, b, other, late = (one[good] for one in (a, at, b, other, late))
    order = np.lexsort((late, b, a))
    pair = a[order] * len(agents) + b[order]
    after = round(LIMITS.joined_s / motion.step_s)
    last = agents.num_steps - 1
    for one in order[np.diff(pair, prepend=-1) != 0].tolist():
        ways = sorted(((at[one], a[one]), (other[one], b[one])))
        steps = int(ways[0][0]), int(ways[1][0])
        ends = [agents.heading_rad[row, min(n + after, last)] for n, row in ways]
        joins = np.cos(ends[0] - ends[1]) > np.cos(LIMITS.crossing_rad)
        rows = int(moves[ways[1][1]]), int(moves[ways[0][1]])
        pet = late[one] * motion.step_s
        if not (joins and motion.is_follower[list(rows)].all()):
            yield event(motion, "crossing", rows[0], steps, pet, rows[1])
        if (slow := _yields_at(motion, rows[0], *steps)) is not None:
            begin = min(slow, steps[0])
            yield event(motion, "yielding", rows[0], (begin, steps[1]), pet, rows[1])


def _merges(
    motion: Motion,
    lanes: LaneTracks,
    rows: Int[np.ndarray, "2 N"],
    steps: tuple[Int[np.ndarray, "N"], Int[np.ndarray, "N"]],
) -> Iterator[SceneEvent]:
    """Who comes right after another one into the lane that both their lanes lead to."""
    step = np.stack(steps)
    # Where their ways meet first, from the one that is there first.
    order = np.lexsort((np.abs(step[0] - step[1]), step.max(axis=0), *rows))
    keep = np.any(np.diff(rows[:, order], axis=1, prepend=-1) != 0, axis=0)
    row, step = rows[:, order[keep]], step[:, order[keep]]
    first = step.argsort(axis=0)
    row, step = (np.take_along_axis(one, first, axis=0) for one in (row, step))
    came = lanes.lane[
        row, np.maximum(step - round(LIMITS.tracked_s / motion.step_s), 0)
    ]
    after = step + round(LIMITS.joined_s / motion.step_s)
    goes = lanes.lane[row, np.minimum(after, lanes.lane.shape[1] - 1)]
    leads = lanes.leads_to
    joins = np.all(leads[came] & leads[goes], axis=0).any(axis=-1)
    joins &= ~leads[tuple(came)] & ~leads[tuple(came[::-1])]
    lag = (step[1] - step[0]) * motion.step_s
    joins &= lag <= LIMITS.headway_s
    joins &= motion.is_tracked(row, step).all(axis=0)
    for one in np.flatnonzero(joins).tolist():
        if _gaps_m(motion, *row[:, one].tolist()).min() > 0:
            yield event(
                motion, "merge", row[1, one], tuple(step[:, one]), lag[one], row[0, one]
            )


def _yields_at(motion: Motion, row: int, passed: int, crosses: int) -> int | None:
    """Step at which an agent slows for one that passes before it crosses, or None."""
    if not motion.is_follower[row]:
        return None
    since = max(passed - round(4.0 / motion.step_s), 0)
    speed = motion.speed_mps[row, since : crosses + 1]
    slowest = int(speed.argmin())
    way = motion.way_m[row]
    is_near = way[crosses] - way[since + slowest] <= LIMITS.yield_m
    came = motion.speed_mps[row, max(since - 5, 0) : since + slowest + 1].max()
    slowed = speed[slowest] <= max(LIMITS.yield_share * came, STANDING_MPS)
    return since + slowest if is_near and slowed and slowest < len(speed) - 1 else None


def passings(pairs: Pairs) -> Iterator[SceneEvent]:
    """Overtaking of who moves, and cyclists beside vehicles."""
    motion, agents = pairs.motion, pairs.motion.agents
    length, width = agents.size_m.T
    reach = (length[pairs.a] + length[pairs.b])[:, None] / 2
    moving = np.minimum(motion.speed_mps[pairs.a], motion.speed_mps[pairs.b])
    aside = np.abs(pairs.aside_m)
    beside = pairs.exist & pairs.is_along & (aside < LIMITS.passing_m)
    beside &= (moving > 2 * MOVING_MPS) & (np.abs(pairs.ahead_m) < reach)
    beside &= motion.is_follower[pairs.b][:, None]
    pedals = agents.kind_mask({AgentKind.CYCLIST})
    for pair, first, last in motion.runs(beside, LIMITS.beside_s, 0.4).tolist():
        a, b = pairs.a[pair], pairs.b[pair]
        before, after = max(first - 1, 0), min(last + 1, len(motion.time_s) - 1)
        was, gets = pairs.ahead_m[pair, before], pairs.ahead_m[pair, after]
        if was >= reach[pair, 0] and gets <= -reach[pair, 0]:
            yield event(motion, "overtaking", a, (first, last), None, b)
        gap = aside[pair, first : last + 1].min() - (width[a] + width[b]) / 2
        if pedals[b] and not pedals[a] and 0 < gap < LIMITS.beside_m:
            yield event(motion, "cyclist-beside", a, (first, last), gap, b)


def near_misses(motion: Motion, met: Iterable[SceneEvent]) -> Iterator[SceneEvent]:
    """Pairs that need hard braking not to collide, or pass right after one another."""
    agents = replace(motion.agents, velocity_mps=motion.velocity_mps)
    a, b, at, time = times_to_touch(agents, LIMITS.near_ttc_s)
    apart = agents.position_m[b, at] - agents.position_m[a, at]
    velocity = agents.velocity_mps[b, at] - agents.velocity_mps[a, at]
    closing = np.linalg.norm(velocity, axis=-1)
    good = closing > 2 * LIMITS.near_braking_mps2 * time
    good &= motion.is_tracked(a, at) & motion.is_tracked(b, at)
    # Of two in one direction only the one behind can hit the other, not the one beside.
    ahead = unit_vector(agents.heading_rad[a, at])
    turn = agents.heading_rad[a, at] - agents.heading_rad[b, at]
    aside = np.abs(ahead[:, 0] * apart[:, 1] - ahead[:, 1] * apart[:, 0])
    wide = (agents.size_m[a, 1] + agents.size_m[b, 1]) / 2
    good &= (np.cos(turn) < np.cos(LIMITS.crossing_rad)) | (aside < wide)
    a, b, at, time = (one[good] for one in (a, b, at, time))
    pairs, index = np.unique(a * len(agents) + b, return_inverse=True)
    after = round(LIMITS.near_ttc_s / motion.step_s)
    soon = np.full((len(pairs), len(motion.time_s)), np.inf)
    np.minimum.at(soon, (index, at), time)
    for pair, first, last in motion.runs(soon < np.inf, LIMITS.near_s).tolist():
        one, two = divmod(int(pairs[pair]), len(agents))
        least = soon[pair, first : last + 1].min()
        gap = _gaps_m(motion, one, two)
        # How it ended is not known of a track that ends meanwhile.
        ends = np.isinf(gap[min(last + after, len(gap) - 1)])
        if not ends and 0 < gap.min() < LIMITS.near_m > gap[first : last + after].min():
            yield event(motion, "near-miss", one, (first, last), least, two)
    for one in met:
        if one.kind == "crossing" and (one.value or 0.0) < LIMITS.near_pet_s:
            row, first, last = steps_of(motion, one)
            other = motion.agents.row_of[one.other_id]
            both = motion.is_tracked(np.array([other, row]), np.array([first, last]))
            if both.all() and _gaps_m(motion, row, other).min() > 0:
                yield event(motion, "near-miss", row, (first, last), None, other)


def _gaps_m(motion: Motion, row: int, other: int) -> Float[np.ndarray, "S"]:
    """Gaps between two agents; boxes that touch at any time are too large, or not true."""
    agents, steps = motion.agents, np.arange(len(motion.time_s))
    there = agents.is_valid[row] & agents.is_valid[other]
    gap = box_gap_m(agents.at(row, steps), agents.at(other, steps))
    return np.where(there, gap, np.inf)
