"""Phases of junctions: which movements may go at a moment, as signals would tell."""

from dataclasses import dataclass, replace
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.road_map import LaneKind, RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal, SignalState, signals_of_lanes

_NEAR_M: Final = 2.0
"""Lanes through one junction come this near to each other."""
_LEAST_CONFLICTS: Final = 2
_SIDE_RAD: Final = np.radians(45)
"""Ways into a junction that differ by more, modulo a half turn, have green in turn."""
_TURN_RAD: Final = np.radians(40)
_LEFT_TURN_SHARE: Final = 0.15
"""Share of the phases that are of left turns alone."""
_GREEN_S: Final = (12.0, 35.0)
_CAUTION_S: Final = 3.0
_CHANGE_S: Final = 4.0
"""Time from the end of green to the next phase, caution included."""
_KEY: Final = 0x50484153


@dataclass(frozen=True, kw_only=True, eq=False)
class Junction:
    """Lanes by which M movements enter a junction whose movements conflict."""

    lane_ids: Int[np.ndarray, "M"]
    heading_rad: Float[np.ndarray, "M"]
    """Direction in which each movement enters."""
    turn_rad: Float[np.ndarray, "M"]
    """Turn to the left until its end."""
    conflicts: Bool[np.ndarray, "M M"]
    """Whether two movements from different ways in cross or merge."""

    def sampled_phase(self, random: np.random.Generator) -> Bool[np.ndarray, "M"]:
        """Movements that go in a plausible phase, the more likely the more lanes it has."""
        return self.phase_of(
            int(random.integers(len(self.lane_ids))),
            turns_left=random.random() < _LEFT_TURN_SHARE,
        )

    def phase_of(self, movement: int, *, turns_left: bool) -> Bool[np.ndarray, "M"]:
        """Movements that go together with one of them.

        These are of one street, from both its ends; either those that turn left, or all
        others and the left turns without oncoming traffic.
        """
        gap = wrap_angle(2 * (self.heading_rad - self.heading_rad[movement])) / 2
        goes = np.abs(gap) < _SIDE_RAD
        left = goes & (self.turn_rad > _TURN_RAD)
        first, later = (left, goes & ~left) if turns_left else (goes & ~left, left)
        if not first.any():
            return goes
        return first | (later & ~(self.conflicts & first).any(axis=1))

    def phases_after(self, first: Bool[np.ndarray, "M"]) -> Bool[np.ndarray, "N M"]:
        """Phases in turn, the first one given, by which each movement goes once at least."""
        phases = [first]
        while not (gone := np.any(phases, axis=0)).all():
            waits = int(np.argmin(gone))
            turns_left = bool(self.turn_rad[waits] > _TURN_RAD)
            phases.append(self.phase_of(waits, turns_left=turns_left))
        return np.array(phases)

    def programme(
        self,
        first: Bool[np.ndarray, "M"],
        num_steps: int,
        step_s: float,
        random: np.random.Generator,
    ) -> Int[np.ndarray, "M S"]:
        """States over some steps, from a moment on in a phase that lasts beyond the first.

        Each phase ends with caution of those that wait in the next one, and a clear
        junction.
        """
        phases = self.phases_after(first)
        states = np.full((len(first), num_steps), SignalState.STOP, np.int8)
        green_s = random.uniform(*_GREEN_S, len(phases))
        at_s, number = (2 * step_s - green_s[0]) * random.random(), 0
        while at_s < num_steps * step_s:
            now, later = phases[number], phases[(number + 1) % len(phases)]
            ends_s = at_s + green_s[number]
            times_s = (at_s, ends_s, ends_s + _CAUTION_S, ends_s + _CHANGE_S)
            begin, end, clear, after = (max(int(one / step_s), 0) for one in times_s)
            states[now, begin:end] = SignalState.GO
            states[now & ~later, end:clear] = SignalState.CAUTION
            states[now & later, end:after] = SignalState.GO
            at_s, number = ends_s + _CHANGE_S, (number + 1) % len(phases)
        return states

    def signals(self, states: Int[np.ndarray, "M T"], name: str) -> list[Signal]:
        """Signals of the movements; those with equal states have one."""
        kinds = np.unique(states, axis=0)
        return [
            Signal(
                signal_id=f"{name}:{row}",
                lane_ids=tuple(self.lane_ids[chosen].tolist()),
                stop_share=np.zeros(chosen.sum()),
                states=own.copy(),
            )
            for row, own in enumerate(kinds)
            for chosen in [(states == own).all(axis=1)]
        ]


_junctions: WeakKeyDictionary[RoadMap, tuple[Junction, ...]] = WeakKeyDictionary()


def junctions(road_map: RoadMap) -> tuple[Junction, ...]:
    """Junctions with movements that cross, of lanes for vehicles; once per map value."""
    if road_map not in _junctions:
        _junctions[road_map] = _found_junctions(road_map)
    return _junctions[road_map]


def _found_junctions(road_map: RoadMap) -> tuple[Junction, ...]:
    lanes = [
        lane
        for lane in road_map.lanes
        if lane.is_intersection
        and lane.kind is not LaneKind.BIKE
        and len(lane.centerline_m) > 1
    ]
    if not lanes:
        return ()
    inside = {lane.lane_id for lane in lanes}
    lines = np.array([shapely.LineString(lane.centerline_m) for lane in lanes])
    group = _connected(lines)
    found = []
    for number in range(group.max() + 1):
        rows = [
            row
            for row in np.flatnonzero(group == number).tolist()
            if not inside & set(lanes[row].predecessors)
        ]
        ways = [_way(lanes[row].lane_id, road_map, inside) for row in rows]
        if len(ways) < 2:
            continue
        start = np.array([way[0] for way in ways])
        heading = heading_of(np.array([way[1] - way[0] for way in ways]))
        end = heading_of(np.array([way[-1] - way[-2] for way in ways]))
        line = np.array([shapely.LineString(way) for way in ways])
        conflicts = shapely.intersects(line[:, None], line)
        conflicts &= np.linalg.norm(start[:, None] - start, axis=-1) > _NEAR_M
        junction = Junction(
            lane_ids=np.array([lanes[row].lane_id for row in rows]),
            heading_rad=heading,
            turn_rad=wrap_angle(end - heading),
            conflicts=conflicts,
        )
        gap = np.abs(wrap_angle(2 * (heading[:, None] - heading))) / 2
        if (conflicts & (gap > _SIDE_RAD)).sum() / 2 >= _LEAST_CONFLICTS:
            found.append(junction)
    return tuple(found)


def sampled_signals(scenario: Scenario, seed: int) -> tuple[Signal, ...]:
    """Signals of all junctions, each in a plausible phase that lasts."""
    random = np.random.default_rng([seed, _KEY])
    return tuple(
        signal
        for number, one in enumerate(junctions(scenario.original_road_map))
        for signal in one.signals(
            _lasting(one.sampled_phase(random), scenario), f"junction {number}"
        )
    )


def continued_signals(
    scenario: Scenario, num_steps: int, seed: int
) -> tuple[Signal, ...]:
    """Signals over another number of steps.

    A junction whose phase lasts for the whole scene goes on with other phases in turn, from
    the current step; other signals keep their last state.
    """
    random = np.random.default_rng([seed, _KEY, 1])
    now, step_s = scenario.current_step, scenario.time_axis.step_s
    known = {lane: one.states for one in scenario.signals for lane in one.lane_ids}
    found: list[Signal] = []
    for number, one in enumerate(junctions(scenario.original_road_map)):
        own = [known[lane] for lane in one.lane_ids.tolist() if lane in known]
        if len(own) < len(one.lane_ids) or any(map(np.ptp, own)):
            continue
        goes = np.array([states[0] == SignalState.GO for states in own])
        later = one.programme(goes, max(num_steps - now, 1), step_s, random)
        states = np.concatenate([np.repeat(later[:, :1], now, axis=1), later], axis=1)
        found += one.signals(states[:, :num_steps], f"junction {number}")
    taken = {lane for one in found for lane in one.lane_ids}
    kept = signals_of_lanes(scenario.signals, known.keys() - taken)
    return (
        *(
            replace(one, states=np.pad(one.states, (0, num_steps), "edge")[:num_steps])
            for one in kept
        ),
        *found,
    )


def _lasting(goes: Bool[np.ndarray, "M"], scenario: Scenario) -> Int[np.ndarray, "M T"]:
    states = np.where(goes, SignalState.GO, SignalState.STOP).astype(np.int8)
    return np.repeat(states[:, None], scenario.time_axis.num_steps, axis=1)


def signals_with_green(scenario: Scenario, lane_id: int) -> tuple[Signal, ...] | None:
    """Signals after a lane was given green, all others of its junction by its phase.

    None if the lane does not lead into a junction with crossing traffic, or through one.
    """
    road_map = scenario.original_road_map
    lane = road_map.lane_of.get(lane_id)
    asked = {lane_id, *(lane.successors if lane is not None else ())}
    for number, one in enumerate(junctions(road_map)):
        rows = np.flatnonzero(np.isin(one.lane_ids, list(asked)))
        if len(rows):
            straight = rows[np.abs(one.turn_rad[rows]).argmin()]
            turns_left = one.turn_rad[straight] > _TURN_RAD
            goes = one.phase_of(int(straight), turns_left=bool(turns_left))
            kept = signals_of_lanes(
                scenario.signals, set(road_map.lane_of) - set(one.lane_ids.tolist())
            )
            states = _lasting(goes, scenario)
            return (*kept, *one.signals(states, f"junction {number}"))
    return None


def _connected(lines: np.ndarray) -> Int[np.ndarray, "L"]:
    """Number of the group of each line; lines of a group come near to each other."""
    tree = shapely.STRtree(lines)
    one, other = tree.query(lines, predicate="dwithin", distance=_NEAR_M)
    group = np.arange(len(lines))
    while True:
        least = group.copy()
        np.minimum.at(least, one, group[other])
        if np.array_equal(least, group):
            return np.unique(group, return_inverse=True)[1]
        group = least


def _way(lane_id: int, road_map: RoadMap, inside: set[int]) -> Float[np.ndarray, "N 2"]:
    """Centre line of a movement, over all its lanes through the junction."""
    parts, seen = [], set()
    while lane_id in inside and lane_id not in seen:
        seen.add(lane_id)
        lane = road_map.lane_of[lane_id]
        parts.append(lane.centerline_m)
        lane_id = next(iter(lane.successors), -1)
    return np.concatenate(parts)
