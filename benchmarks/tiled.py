"""A real scene repeated side by side: large maps with many agents, up to the limits."""

from dataclasses import replace

import numpy as np

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.road_map import Crosswalk, DrivableArea, Lane, RoadMap
from pd_editor.scene.scenario import Scenario

SPACING_M = 450.0
_IDS_PER_TILE = 10**9


def tiled(scenario: Scenario, num_tiles: int, num_agents: int) -> Scenario:
    """``num_tiles`` copies of a map in rows of four, with so many agents that exist now."""
    moves = [np.array([n % 4, n // 4, 0]) * SPACING_M for n in range(num_tiles)]
    road_map = RoadMap(
        lanes=tuple(
            _moved_lane(one, move, tile * _IDS_PER_TILE)
            for tile, move in enumerate(moves)
            for one in scenario.road_map.lanes
        ),
        crosswalks=tuple(
            _moved_crosswalk(one, move, tile * _IDS_PER_TILE)
            for tile, move in enumerate(moves)
            for one in scenario.road_map.crosswalks
        ),
        drivable_areas=tuple(
            DrivableArea(
                area_id=one.area_id + tile * _IDS_PER_TILE, boundary=one.boundary + move
            )
            for tile, move in enumerate(moves)
            for one in scenario.road_map.drivable_areas
        ),
    )
    tracks: AgentTracks | None = None
    agents = scenario.agents
    present = np.flatnonzero(agents.is_valid[:, scenario.current_step])
    random = np.random.default_rng(0)
    for tile, move in enumerate(moves):
        wanted = len(range(tile, num_agents, num_tiles))
        for first in range(0, wanted, len(present)):
            part = agents.taken(present[: wanted - first])
            shift = random.normal(0, 0.3 * (first > 0), (len(part), 1, 2))
            part = replace(
                part,
                ids=tuple(f"{tile}-{first + k}" for k in range(len(part))),
                position_m=part.position_m + move[:2] + shift,
            )
            tracks = part if tracks is None else tracks.joined(part)
    assert tracks is not None
    return replace(scenario, road_map=road_map, agents=tracks, focal_id=tracks.ids[0])


def _moved_lane(lane: Lane, move: np.ndarray, first: int) -> Lane:
    sides = lane.left_neighbor, lane.right_neighbor
    left, right = (None if one is None else one + first for one in sides)
    return replace(
        lane,
        lane_id=lane.lane_id + first,
        centerline=lane.centerline + move,
        left=lane.left + move,
        right=lane.right + move,
        successors=tuple(name + first for name in lane.successors),
        predecessors=tuple(name + first for name in lane.predecessors),
        left_neighbor=left,
        right_neighbor=right,
    )


def _moved_crosswalk(walk: Crosswalk, move: np.ndarray, first: int) -> Crosswalk:
    return replace(
        walk,
        crosswalk_id=walk.crosswalk_id + first,
        edge1=walk.edge1 + move,
        edge2=walk.edge2 + move,
    )
