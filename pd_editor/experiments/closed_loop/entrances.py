"""Where new vehicles and people come into the mapped area."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.analysis.metrics.road import is_off_road, map_ends, offsets_from
from pd_editor.experiments.closed_loop.world import World
from pd_editor.scene.agent_kind import (
    LANE_FOLLOWER_KINDS,
    MOTOR_VEHICLE_KINDS,
    AgentKind,
)
from pd_editor.scene.generation import Region
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_sample import TrafficSample

_HALF_SIDE_M: Final = 12.0
"""Half the side of the square in which states of those who enter are sampled."""
_FREE_M: Final = 25.0
_LANE_M: Final = 2.5
"""An entrance is taken while another vehicle is nearer along and across its lane."""
_ASIDE_M: Final = 2.0
"""Who enters is at most so far beside one of the lanes that begin there."""
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
            fits = (np.abs(aside) < _ASIDE_M) & (along > _COSINE)
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
