"""Reconstructs the history of a placed agent: backwards along its lane at its speed."""

from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.geometry.angles import heading_of, unit_vector, wrap_angle
from pd_editor.geometry.polyline import arc_length, offset_line, without_repeats
from pd_editor.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.paths.lanes.route_choice import ON_LANE_M, lane_kinds_of
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.road_map import RoadMap

MAX_TURN_RAD: Final = np.radians(30)
"""An agent at a larger angle to its lane gets a straight history."""
_TANGENT_M: Final = 0.5
_MARGIN_M: Final = 5.0


def reconstructed_positions(
    road_map: RoadMap,
    kind: AgentKind,
    position_m: Float[np.ndarray, "2"],
    heading_rad: float,
    distance_m: Float[np.ndarray, "P"],
) -> tuple[Float[np.ndarray, "P 2"], Float[np.ndarray, "P"]]:
    """Earlier positions of an agent, ``distance_m`` before the current one, with headings.

    The history follows the agent's lane and the straightest chain of predecessors; it is
    straight without a lane.
    """
    line = _line_to(road_map, kind, position_m, heading_rad, distance_m.max(initial=0))
    if line is None:
        direction = unit_vector(np.array(heading_rad))
        straight = position_m - distance_m[:, None] * direction
        return straight, np.full(len(distance_m), float(heading_rad))
    centre, shifted = line
    along = arc_length(centre)
    reached = along[-1] - distance_m

    def at(where: Float[np.ndarray, "P"]) -> Float[np.ndarray, "P 2"]:
        x, y = shifted.T
        return np.stack(
            [np.interp(where, along, x), np.interp(where, along, y)], axis=-1
        )

    chord = at(reached + _TANGENT_M) - at(reached - _TANGENT_M)
    return at(reached), heading_of(chord)


def _line_to(
    road_map: RoadMap,
    kind: AgentKind,
    position_m: Float[np.ndarray, "2"],
    heading_rad: float,
    length_m: float,
) -> tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N 2"]] | None:
    """Centre line up to an agent, and its parallel that ends at the agent."""
    match = nearest_lanes(
        road_map,
        position_m[None],
        heading_rad=np.array([heading_rad]),
        kinds=lane_kinds_of(kind),
    )
    turn = wrap_angle(heading_rad - match.heading_rad)
    if not (
        match.is_valid[0]
        and match.distance_m[0] <= ON_LANE_M
        and np.abs(turn[0]) <= MAX_TURN_RAD
    ):
        return None
    graph = lane_graph(road_map)
    row = graph.row_of[int(match.lane_id[0])]
    own = graph.centerlines_m[row]
    before = own[arc_length(own) < match.along_m[0]]
    offset = float(match.offset_m[0])
    normal = unit_vector(match.heading_rad + np.pi / 2)[0]
    pieces = [before, (position_m - offset * normal)[None]]
    missing = length_m + _MARGIN_M - match.along_m[0]
    while missing > 0 and (earlier := _straightest_before(graph, row)) is not None:
        row = earlier
        pieces.insert(0, graph.centerlines_m[row])
        missing -= graph.lengths_m[row]
    line = without_repeats(np.concatenate(pieces), 1e-3)
    ahead = unit_vector(match.heading_rad)[0]
    if len(line) > 1:
        first = line[1] - line[0]
        start = first / np.linalg.norm(first)
    else:
        start = ahead
    # Beyond the first lane and beyond the agent the line continues straight.
    if missing > 0:
        line = np.concatenate([line[:1] - (missing + _MARGIN_M) * start, line])
    shifted = offset_line(line, offset)
    return line, shifted + (position_m - shifted[-1])


def _straightest_before(graph: LaneGraph, row: int) -> int | None:
    """Straightest predecessor of a lane; None without one."""
    before = [
        other
        for other, following in enumerate(graph.successors)
        if row in following and other != row
    ]
    if not before:
        return None
    lines = graph.centerlines_m
    ends = np.stack([lines[other][-1] - lines[other][-2] for other in before])
    start = (lines[row][1] - lines[row][0])[None]
    bend = np.abs(wrap_angle(heading_of(start) - heading_of(ends)))
    return before[int(bend.argmin())]
