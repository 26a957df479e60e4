"""Lanes that lead from one lane to another."""

from collections import deque

from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.road_map import LaneKind, RoadMap


def lane_chain(
    road_map: RoadMap,
    first_id: int,
    last_id: int,
    *,
    kinds: tuple[LaneKind, ...],
) -> tuple[int, ...] | None:
    """Ids of the fewest lanes that follow one another from a lane to another one.

    Both ends are included. None if the last lane is not reached without a lane change.
    """
    graph = lane_graph(road_map)
    if first_id not in graph.row_of or last_id not in graph.row_of:
        return None
    allowed = graph.allowed(kinds)
    first, last = graph.row_of[first_id], graph.row_of[last_id]
    came_from: dict[int, int | None] = {first: None}
    waiting = deque([first])
    while waiting and last not in came_from:
        row = waiting.popleft()
        for after in graph.successors[row]:
            if allowed[after] and after not in came_from:
                came_from[after] = row
                waiting.append(after)
    if last not in came_from:
        return None
    chain: list[int] = []
    at: int | None = last
    while at is not None:
        chain.append(graph.lane_ids[at])
        at = came_from[at]
    return tuple(reversed(chain))
