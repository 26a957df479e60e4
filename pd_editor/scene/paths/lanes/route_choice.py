"""Possible routes of each agent from its current pose."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph
from pd_editor.scene.paths.lanes.lane_routes import LaneRoutes, Route, lane_routes
from pd_editor.scene.paths.lanes.lane_search import NearbyLanes
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES
from pd_editor.scene.road_map import LaneKind, RoadMap

ON_LANE_M: Final = 3.0
"""An agent within this distance of a centre line can follow the lane."""
CHANGE_REACH_M: Final = 6.0
"""An agent within this distance of a neighbouring lane can change to it."""
MAX_TURN_RAD: Final = np.pi / 3
"""Lanes at a larger angle to the agent are followed only without an alternative."""
METRES_PER_RADIAN: Final = 3.0
"""Weight of an angle to a lane against a distance when lanes are ranked."""
MAX_ROUTES: Final = 6
MAX_CHANGES: Final = 2
CYCLIST_LANES: Final = (*DRIVING_LANES, LaneKind.BIKE)


def lane_kinds_of(kind: AgentKind) -> tuple[LaneKind, ...]:
    """Lane kinds that agents of a kind may follow; none for pedestrians and objects."""
    if kind not in LANE_FOLLOWER_KINDS:
        return ()
    return CYCLIST_LANES if kind is AgentKind.CYCLIST else DRIVING_LANES


@dataclass(frozen=True, kw_only=True, eq=False)
class RouteChoice:
    """Q pairs of an agent and a route, sorted by agent, most natural route first."""

    agent: Int[np.ndarray, "Q"]
    routes: tuple[Route, ...]
    along_m: Float[np.ndarray, "Q"]
    """Arc length of the agent on its route."""
    offset_m: Float[np.ndarray, "Q"]
    """Offset of the agent to the left of its route."""
    turn_rad: Float[np.ndarray, "Q"]
    """Heading of the agent minus that of the route."""
    is_lane_change: Bool[np.ndarray, "Q"]


def choose_routes(
    road_map: RoadMap,
    position_m: Float[np.ndarray, "A 2"],
    heading_rad: Float[np.ndarray, "A"],
    kinds: tuple[AgentKind, ...],
    needed_m: Float[np.ndarray, "A"],
) -> RouteChoice:
    """Find routes from the lanes that agents are on, and from their neighbours.

    Routes of an agent differ within the ``needed_m`` ahead of it.
    """
    routes = lane_routes(road_map)
    graph = routes.graph
    lane_kinds = [lane_kinds_of(kind) for kind in kinds]
    allowed = {kind: graph.allowed(kind) for kind in set(lane_kinds)}
    usable = np.array([allowed[kind] for kind in lane_kinds], bool)
    usable = usable.reshape(len(kinds), len(graph.lane_ids))
    near = graph.search.in_reach(position_m, heading_rad, usable, CHANGE_REACH_M)
    first = np.searchsorted(near.point, np.arange(len(kinds) + 1)).tolist()
    rank = near.distance_m + METRES_PER_RADIAN * np.abs(near.turn_rad)
    order = np.lexsort((near.lane, rank.round(6), near.point)).tolist()
    table = _PairTable.of(near)
    pairs: list[int] = []
    chosen: list[Route] = []
    changes: list[bool] = []
    for agent, lanes_allowed in enumerate(lane_kinds):
        starts, beside = _starts(table, order[first[agent] : first[agent + 1]], graph)
        for pool, limit in ((starts, MAX_ROUTES), (beside, MAX_CHANGES)):
            found = _routes_from(
                pool, table, routes, float(needed_m[agent]), lanes_allowed
            )
            for pair, route in found[:limit]:
                pairs.append(pair)
                chosen.append(route)
                changes.append(pool is beside)
    return _as_choice(pairs, chosen, changes, near)


@dataclass(frozen=True, kw_only=True)
class _PairTable:
    """``NearbyLanes`` as lists, which are faster to iterate over."""

    lane: list[int]
    distance_m: list[float]
    along_m: list[float]
    turn_rad: list[float]
    is_beside: list[bool]

    @classmethod
    def of(cls, near: NearbyLanes) -> "_PairTable":
        return cls(
            lane=near.lane.tolist(),
            distance_m=near.distance_m.tolist(),
            along_m=near.along_m.tolist(),
            turn_rad=np.abs(near.turn_rad).tolist(),
            is_beside=near.is_beside.tolist(),
        )


def _starts(
    table: _PairTable, pairs: list[int], graph: LaneGraph
) -> tuple[list[int], list[int]]:
    """Pairs with lanes to follow, and pairs with lanes to change to, best first."""
    on_lane = [pair for pair in pairs if table.distance_m[pair] <= ON_LANE_M]
    good = [
        pair
        for pair in on_lane
        if table.is_beside[pair] and table.turn_rad[pair] <= MAX_TURN_RAD
    ]
    if not good:
        good = [pair for pair in on_lane if table.is_beside[pair]] or on_lane
        return good[:1], []
    beside_first = graph.neighbors[table.lane[good[0]]]
    starts = [pair for pair in good if table.lane[pair] not in beside_first]
    followed = {table.lane[pair] for pair in starts}
    neighbors = {row for pair in starts for row in graph.neighbors[table.lane[pair]]}
    beside = [
        pair
        for pair in pairs
        if table.lane[pair] in neighbors - followed
        and table.is_beside[pair]
        and table.turn_rad[pair] <= MAX_TURN_RAD
    ]
    return starts, beside


def _routes_from(
    pairs: list[int],
    table: _PairTable,
    routes: LaneRoutes,
    needed_m: float,
    kinds: tuple[LaneKind, ...],
) -> list[tuple[int, Route]]:
    """Distinct routes within ``needed_m``, one of each start lane in turn."""
    turns: list[list[tuple[int, Route]]] = []
    seen: set[tuple[int, ...]] = set()
    for pair in pairs:
        length = table.along_m[pair] + needed_m
        new: list[tuple[int, Route]] = []
        lane_id = routes.graph.lane_ids[table.lane[pair]]
        for route in routes.from_lane(lane_id, length, kinds):
            lanes = route.lane_ids[: route.num_lanes_within(length)]
            if lanes not in seen:
                seen.add(lanes)
                new.append((pair, route))
        turns.append(new)
    longest = max(map(len, turns), default=0)
    return [new[index] for index in range(longest) for new in turns if index < len(new)]


def _as_choice(
    pairs: list[int],
    chosen: list[Route],
    changes: list[bool],
    near: NearbyLanes,
) -> RouteChoice:
    index = np.array(pairs, int)
    return RouteChoice(
        agent=near.point[index],
        routes=tuple(chosen),
        along_m=near.along_m[index],
        offset_m=near.offset_m[index],
        turn_rad=near.turn_rad[index],
        is_lane_change=np.array(changes, bool),
    )
