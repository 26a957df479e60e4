"""Where new vehicles come onto the mapped road."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.metrics.road.off_road import map_ends, offsets_from
from pd_editor.experiments.closed_loop.world import World
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.generation import Region
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Entrances:
    """Starts of lanes without a predecessor, and the vehicles that there are to be."""

    point_m: Float[np.ndarray, "N 2"]
    way: Float[np.ndarray, "N 2"]
    """Unit vectors into the map."""
    exit_m: Float[np.ndarray, "E 2"]
    """Ends of lanes without a successor."""
    num_vehicles: int

    @classmethod
    def of(cls, world: World) -> "Entrances":
        """Entrances of the road; as many vehicles as there are now."""
        road_map = world.scenario.road_map
        point, out = map_ends(road_map, -1)
        return cls(
            point_m=point,
            way=-out,
            exit_m=map_ends(road_map, 1)[0],
            num_vehicles=_num_vehicles(world),
        )

    def wanted(
        self, world: World, random: np.random.Generator
    ) -> tuple[Region, dict[AgentKind, int]] | None:
        """Where how many are to enter now; None if there are enough, or is no room."""
        missing = self.num_vehicles - _num_vehicles(world)
        if missing <= 0 or not len(self.point_m):
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
        return region, {AgentKind.VEHICLE: min(missing + 1, _MOST_AT_ONCE)}

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
        """The sample without new agents that do not come in on a lane that begins.

        Nor are there more than are missing.
        """
        known = world.scenario.agents.row_of
        new = {name: row for row, name in enumerate(sample.ids) if name not in known}
        fit = [
            name
            for name, row in new.items()
            if self._comes_in(
                sample.position_m[row, 0], float(sample.heading_rad[row, 0])
            )
        ]
        gone = set(new).difference(fit[: self.num_vehicles - _num_vehicles(world)])
        return sample.without(gone) if gone else sample

    def _comes_in(self, position_m: Float[np.ndarray, "2"], heading_rad: float) -> bool:
        (ahead,), (aside,) = offsets_from(self.point_m, self.way, position_m[None])
        along = self.way @ np.array([np.cos(heading_rad), np.sin(heading_rad)])
        fits = (np.abs(aside) < _ASIDE_M) & (along > _COSINE)
        return bool((fits & (ahead > -2.0) & (ahead < 2 * _HALF_SIDE_M)).any())


def _num_vehicles(world: World) -> int:
    agents = world.scenario.agents
    return int((world.is_present() & agents.kind_mask(LANE_FOLLOWER_KINDS)).sum())
