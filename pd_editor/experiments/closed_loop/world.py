"""The scene of a roll-out: states up to the present, plans after it, and who enters."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.analysis.manoeuvres.scene_facts import scene_content
from pd_editor.analysis.metrics.road import (
    is_off_road,
    is_past_lanes,
    map_ends,
    offsets_from,
    outside_m,
)
from pd_editor.analysis.repair.yielding import LEAST_WAY_M
from pd_editor.editor.commands.agents import new_agent_ids
from pd_editor.editor.commands.roll_out import RolledMotion
from pd_editor.editor.commands.traffic import NEW_PREFIX, blank_tracks
from pd_editor.scene.agent_kind import (
    LANE_FOLLOWER_KINDS,
    MOTOR_VEHICLE_KINDS,
    ROAD_USER_KINDS,
    Activity,
    AgentKind,
)
from pd_editor.scene.generation import Region
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.junction_phases import continued_signals
from pd_editor.scene.roles.traffic_choice import trajectory_locked_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS
from pd_editor.scene.time_axis import TimeAxis
from pd_editor.scene.traffic_sample import TrafficSample

HORIZON: Final = TimeAxis().num_future_steps
"""Steps that are planned."""
_BEYOND_M: Final = 15.0
"""An agent leaves this far outside of the mapped road's bounding box."""

_TURNS_ON_S: Final = 1.0
"""Time in which headings become those of a new path, at the speed of now."""
_WALKING_MPS: Final = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """A scene whose time axis reaches ``HORIZON`` beyond the end of the roll-out."""

    scenario: Scenario
    step: int
    """The present."""
    replayed: frozenset[str] = frozenset()
    """Agents that keep the tracks that they had, or are parked."""

    @classmethod
    def beginning(cls, scenario: Scenario, num_steps: int, seed: int) -> "World":
        """The present of a scenario, whose agents have no future but locked ones.

        Static objects and parked agents stay where they are; phases of junctions change.
        """
        now = scenario.current_step
        agents = scenario.agents
        count = now + 1 + num_steps + HORIZON
        locked = trajectory_locked_ids(scenario)
        keeps = np.array([name in scenario.locks for name in agents.ids], bool)
        kept = scenario.kept_steps() | scenario.time_axis.is_past
        agents = replace(agents, is_valid=agents.is_valid & kept)
        agents = agents.without_future(now, count, keeps)
        parked = _is_parked(scenario)
        static = parked | ~agents.kind_mask(ROAD_USER_KINDS)
        static &= agents.is_valid[:, now] & ~np.isin(agents.ids, list(locked))
        # Who is not parked may start; the model keeps more of those of unknown activity.
        agents = replace(
            agents, activity=np.where(parked, Activity.PARKED, Activity.WAITING)
        )
        replayed = locked.union(agents.ids[row] for row in np.flatnonzero(parked))
        rows, steps = np.flatnonzero(static), np.zeros(count - now, int)
        # They stand where a locked beginning ends.
        begins = now + np.maximum(scenario.kept_steps()[rows, now:].sum(axis=1) - 1, 0)
        place = (rows[:, None], begins[:, None] + steps)
        standing = (agents.position_m[place], agents.heading_rad[place])
        standing = (standing[0], wrap_angle(standing[1]), np.zeros_like(standing[0]))
        begins += begins > now
        at = np.arange(now, count) >= begins[:, None]
        agents = agents.with_motion(rows, now, standing, at)
        axis = scenario.time_axis.lasting(count)
        signals = continued_signals(scenario, count, seed)
        scenario = replace(scenario, agents=agents, time_axis=axis, signals=signals)
        return cls(scenario=scenario, step=now, replayed=frozenset(replayed))

    @property
    def elapsed_s(self) -> float:
        """Time since the roll-out began."""
        axis = self.scenario.time_axis
        return (self.step - axis.current_step) * axis.step_s

    @property
    def last_step(self) -> int:
        """The step at which the roll-out ends."""
        return self.scenario.time_axis.num_steps - 1 - HORIZON

    def is_present(self) -> Bool[np.ndarray, "A"]:
        """Whether each agent is there now."""
        return np.array(self.scenario.agents.is_valid[:, self.step])

    def generated_ids(self, driven: Collection[str]) -> tuple[str, ...]:
        """Road users that are there now, but for those that are driven or replayed."""
        agents = self.scenario.agents
        asked = self.is_present() & agents.kind_mask(ROAD_USER_KINDS)
        kept = self.replayed.union(driven)
        return tuple(
            agents.ids[row]
            for row in np.flatnonzero(asked)
            if agents.ids[row] not in kept
        )

    def window(self) -> Scenario:
        """The scene from shortly before the present to the horizon; agents there now."""
        # Steps before the present that a window shows.
        first, last = max(self.step - 10, 0), self.step + HORIZON
        steps = slice(first, last + 1)
        rows = np.flatnonzero(self.is_present())
        agents, axis = self.scenario.agents, self.scenario.time_axis
        cut = agents.cut_to(steps).taken(rows)
        there = set(cut.ids)
        return replace(
            self.scenario,
            agents=cut,
            time_axis=replace(
                axis, num_steps=last + 1 - first, current_step=self.step - first
            ),
            retired_ids=self.scenario.retired_ids.union(agents.ids).difference(there),
            locks={
                name: lock.later(self.elapsed_s)
                for name, lock in self.scenario.locks.items()
                if name in there
            },
            guidance=(),
            signals=tuple(
                replace(one, states=one.states[steps]) for one in self.scenario.signals
            ),
        )

    def with_fresh_ids(self, sample: TrafficSample) -> TrafficSample:
        """The sample, in which nobody who enters has the id of one who has left.

        Its track would go on with a jump.
        """
        agents, there = self.scenario.agents, self.is_present()
        present = {agents.ids[row] for row in np.flatnonzero(there)}
        count = sum(name not in present for name in sample.ids)
        fresh = iter(new_agent_ids(self.scenario, count, NEW_PREFIX))
        ids = (name if name in present else next(fresh) for name in sample.ids)
        return replace(sample, ids=tuple(ids))

    def turning_on(self, sample: TrafficSample) -> TrafficSample:
        """The sample, whose agents turn on as they do now, then along their new paths.

        Its headings follow its paths alone, and leap where a path begins.
        """
        agents, now = self.scenario.agents, self.step
        known = np.isin(sample.ids, agents.ids)
        rows = agents.rows(np.array(sample.ids)[known])
        turn = np.zeros(len(sample.ids))
        last = agents.heading_rad[rows, now] - agents.heading_rad[rows, max(now - 1, 0)]
        turn[known] = np.where(agents.is_valid[rows, max(now - 1, 0)], last, 0.0)
        heading = sample.heading_rad
        leap = wrap_angle(heading[:, 1] - heading[:, 0] - turn)
        kept = self.scenario.kept_steps()[rows, now + 1]
        leap[np.flatnonzero(known)[kept]] = 0.0
        step_m = np.linalg.norm(np.diff(sample.position_m, axis=1), axis=-1)
        speed = np.maximum(step_m[:, :1] / self.scenario.time_axis.step_s, _WALKING_MPS)
        way = np.cumsum(step_m, axis=1) - step_m[:, :1]
        share = np.maximum(1 - way / (speed * _TURNS_ON_S), 0.0)
        later = wrap_angle(heading[:, 1:] - leap[:, None] * share)
        return replace(
            sample, heading_rad=np.concatenate([heading[:, :1], later], axis=1)
        )

    def planned(self, sample: TrafficSample) -> "World":
        """With a sample as the plan of its agents, of which some may be new."""
        agents = self.scenario.agents
        kept = np.flatnonzero(self.scenario.kept_steps()[:, self.step + 1])
        sample = _at_rest(sample, [agents.ids[row] for row in kept])
        new = [row for row, name in enumerate(sample.ids) if name not in agents.row_of]
        if new:
            blank = blank_tracks(sample, np.array(new), agents.num_steps)
            agents = agents.joined(blank)
        rows = agents.rows(sample.ids)
        is_new = np.isin(np.arange(len(rows)), new)
        motion = (
            sample.position_m,
            wrap_angle(sample.heading_rad),
            sample.velocity_mps,
        )
        at = np.arange(sample.heading_rad.shape[1]) >= 1 - is_new[:, None]
        agents = agents.with_motion(rows, self.step, motion, at)
        return replace(self, scenario=replace(self.scenario, agents=agents))

    def after(self, num_steps: int) -> "World":
        """Some steps later, without the agents that left the mapped road; locked ones stay."""
        step = self.step + num_steps
        world = replace(self, step=step)
        agents, road_map = self.scenario.agents, self.scenario.road_map
        steps = slice(self.step + 1, step + 1)
        position, is_valid = agents.position_m[:, steps], agents.is_valid[:, steps]
        least, most = road_map.bounds_m
        far = (position < least - _BEYOND_M) | (position > most + _BEYOND_M)
        gone = np.array((is_valid & far.any(-1)).any(axis=1))
        rows = np.flatnonzero(agents.kind_mask(LANE_FOLLOWER_KINDS) & is_valid[:, -1])
        way = unit_vector(agents.heading_rad[rows, step])
        gone[rows] |= is_past_lanes(road_map, agents.position_m[rows, step], way)
        walks = np.flatnonzero(
            agents.kind_mask([AgentKind.PEDESTRIAN]) & is_valid[:, -1]
        )
        away = outside_m(self.scenario, agents.position_m[walks, step])
        moves = agents.speed_mps()[walks, step] > STANDING_MPS
        # Pedestrians leave this far from the drivable area: 99 % of recorded ones are
        # nearer.
        gone[walks] |= (away > 8.0) & moves
        gone &= ~self.scenario.kept_steps()[:, step]
        return world.without([agents.ids[row] for row in np.flatnonzero(gone)])

    def without(self, names: Iterable[str]) -> "World":
        """Without some agents from the present on."""
        agents = self.scenario.agents
        rows = agents.rows(names)
        if not len(rows):
            return self
        later = np.arange(agents.num_steps) >= self.step
        agents = agents.with_rows(
            rows,
            is_valid=agents.is_valid[rows] & ~later,
        )
        return replace(self, scenario=replace(self.scenario, agents=agents))

    def motion_from(self, first: int) -> RolledMotion:
        """What has happened from a step on, up to the present."""
        agents = self.scenario.agents.cut_to(slice(first, self.step + 1))
        agents = agents.taken(agents.is_valid.any(axis=1))
        return RolledMotion.of(agents)


def _is_parked(scenario: Scenario) -> Bool[np.ndarray, "A"]:
    """Which agents are parked, by their activity or by their tracks."""
    events = scene_content(scenario).events
    never_left = {one.agent_id for one in events if one.kind == "parked"}
    of_tracks = np.array([name in never_left for name in scenario.agents.ids], bool)
    return of_tracks | (scenario.activity() == Activity.PARKED)


def _at_rest(sample: TrafficSample, kept_ids: Collection[str]) -> TrafficSample:
    """The sample, in which agents stand that stand now and would hardly move.

    Those do not yield, so that window after window they would creep into the next one.
    """
    begin = sample.position_m[:, :1]
    way = np.linalg.norm(sample.position_m - begin, axis=-1).max(axis=1)
    speed = np.linalg.norm(sample.velocity_mps[:, 0], axis=-1)
    rests = (way < LEAST_WAY_M) & (speed < STANDING_MPS)
    rests = (rests & ~np.isin(sample.ids, list(kept_ids)))[:, None]
    return replace(
        sample,
        position_m=np.where(rests[..., None], begin, sample.position_m),
        heading_rad=np.where(rests, sample.heading_rad[:, :1], sample.heading_rad),
        velocity_mps=np.where(rests[..., None], 0.0, sample.velocity_mps),
    )


_HALF_SIDE_M: Final = 12.0
"""Half the side of the square in which states of those who enter are sampled."""
_FREE_M: Final = 25.0
_LANE_M: Final = 2.5
"""An entrance is taken while another vehicle is nearer along and across its lane."""
_COSINE: Final = 0.8
_MOST_AT_ONCE: Final = 3
_COUNTED: Final = {
    AgentKind.VEHICLE: MOTOR_VEHICLE_KINDS,
    AgentKind.CYCLIST: {AgentKind.CYCLIST},
    AgentKind.PEDESTRIAN: {AgentKind.PEDESTRIAN},
}
"""Kinds of those who enter, and the kinds in whose place they do."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Entrances:
    """Starts of lanes without a predecessor, and how many of whom there are to be."""

    point_m: Float[np.ndarray, "N 2"]
    way: Float[np.ndarray, "N 2"]
    """Unit vectors into the map."""
    exit_m: Float[np.ndarray, "E 2"]
    """Ends of lanes without a successor."""
    number: Mapping[AgentKind, int]

    @classmethod
    def of(cls, world: World) -> "Entrances":
        """Entrances of the road; as many vehicles, cyclists and pedestrians as now."""
        road_map = world.scenario.road_map
        point, out = map_ends(road_map, -1)
        return cls(
            point_m=point,
            way=-out,
            exit_m=map_ends(road_map, 1)[0],
            number=_numbers(world),
        )

    def wanted(
        self, world: World, random: np.random.Generator
    ) -> tuple[Region, dict[AgentKind, int]] | None:
        """Where how many are to enter now; None if there are enough, or is no room."""
        missing = self._missing(world)
        if not missing or not len(self.point_m):
            return None
        agents, step = world.scenario.agents, world.step
        there = world.is_present() & agents.kind_mask(LANE_FOLLOWER_KINDS)
        places = agents.position_m[there, step]
        ahead, aside = offsets_from(self.point_m, self.way, places)
        is_near = (np.abs(aside) < _LANE_M) & (np.abs(ahead) < _FREE_M)
        free = np.flatnonzero(~is_near.any(axis=0))
        if not len(free):
            return None
        # One more than is missing, since some do not come in on a lane that begins.
        region = self._square_at(int(random.choice(free)))
        return region, {
            kind: min(count + 1, _MOST_AT_ONCE) for kind, count in missing.items()
        }

    def _missing(self, world: World) -> dict[AgentKind, int]:
        """How many of each kind there are too few, if any."""
        now = _numbers(world)
        gap = {kind: count - now[kind] for kind, count in self.number.items()}
        return {kind: count for kind, count in gap.items() if count > 0}

    def _square_at(self, entrance: int) -> Region:
        """Where a vehicle is to come in: a square with few lanes that lead out."""
        way = self.way[entrance]
        ahead = self.point_m[entrance] + way * (_HALF_SIDE_M - 3.0)
        asides = np.array([0.0, -1.0, 1.0]) * (_HALF_SIDE_M - 4.0)
        places = ahead + asides[:, None] * (-way[1], way[0])
        gap = np.abs(self.exit_m - places[:, None])
        exits = (gap < _HALF_SIDE_M).all(axis=-1).sum(axis=-1)
        x, y = places[int(exits.argmin())].tolist()
        return Region(center_m=(x, y), half_side_m=_HALF_SIDE_M)

    def entering(self, sample: TrafficSample, world: World) -> TrafficSample:
        """The sample without new agents that do not come in, or are too many."""
        known = world.scenario.agents.row_of
        left = self._missing(world)
        gone: list[str] = []
        for row, name in enumerate(sample.ids):
            if name in known:
                continue
            kind = sample.kinds[row]
            place = sample.position_m[row, 0], float(sample.heading_rad[row, 0])
            comes_in = self._comes_in(world.scenario, kind, *place)
            kind = AgentKind.VEHICLE if kind in MOTOR_VEHICLE_KINDS else kind
            if comes_in and left.get(kind, 0) > 0:
                left[kind] -= 1
            else:
                gone.append(name)
        return sample.without(gone) if gone else sample

    def coming_in(self, scenario: Scenario, new_ids: Sequence[str]) -> list[str]:
        """Those of some agents that come in, by their states at the current step."""
        agents, now = scenario.agents, scenario.current_step
        return [
            name
            for row, name in zip(agents.rows(new_ids), new_ids, strict=True)
            if self._comes_in(
                scenario,
                agents.kinds[row],
                agents.position_m[row, now],
                float(agents.heading_rad[row, now]),
            )
        ]

    def _comes_in(
        self,
        scenario: Scenario,
        kind: AgentKind,
        position_m: Float[np.ndarray, "2"],
        heading_rad: float,
    ) -> bool:
        """Whether one comes in on a lane that begins.

        A pedestrian comes in beside the road or on a crosswalk, and walks into the map.
        """
        (ahead,), (aside,) = offsets_from(self.point_m, self.way, position_m[None])
        along = self.way @ np.array([np.cos(heading_rad), np.sin(heading_rad)])
        is_near = (ahead > -2.0) & (ahead < 2 * _HALF_SIDE_M)
        if kind is AgentKind.PEDESTRIAN:
            fits = (np.abs(aside) < 2 * _HALF_SIDE_M) & (along > 0.0)
        else:
            # Who enters is at most so far beside one of the lanes that begin there.
            fits = (np.abs(aside) < 2.0) & (along > _COSINE)
        if not (fits & is_near).any():
            return False
        return kind is not AgentKind.PEDESTRIAN or _is_walkable(scenario, position_m)


def _is_walkable(scenario: Scenario, position_m: Float[np.ndarray, "2"]) -> bool:
    """Whether a place is beside the drivable area, or on a crosswalk."""
    outlines = [one.outline_m() for one in scenario.road_map.crosswalks]
    crosswalks = shapely.union_all([shapely.Polygon(one) for one in outlines])
    off_road = is_off_road(scenario, position_m[None])[0]
    return bool(off_road or shapely.contains_xy(crosswalks, *position_m))


def _numbers(world: World) -> dict[AgentKind, int]:
    there, agents = world.is_present(), world.scenario.agents
    return {
        kind: int((there & agents.kind_mask(kinds)).sum())
        for kind, kinds in _COUNTED.items()
    }
