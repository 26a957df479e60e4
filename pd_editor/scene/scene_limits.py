"""Limits on the size of a scene, which bound the time and memory to open it.

Each limit is at least ten times what the largest recorded scenes have.
"""

from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.road_map import RoadMap

MAX_AGENTS: Final = 500
MAX_STEPS: Final = 1_000
MAX_STATES: Final = 200_000
"""Number of agents times steps."""
MAX_POSITION_M: Final = 5_000.0
"""Distance from the scene's origin along each axis."""
MAX_COORDINATE_M: Final = 1e8
"""Largest coordinate of a file, whose frame may be that of a map projection."""
MAX_SPEED_MPS: Final = 200.0
"""Faster states are refused along each axis: no road user reaches this."""
MAX_LENGTH_M: Final = 100.0
"""Length or width of an agent."""
MAX_GAP_M: Final = 500.0
"""Largest distance between a map and its tracks."""

MAX_LANES: Final = 2_000
MAX_LINKS: Final = 20_000
"""Number of successors and predecessors of all lanes."""
MAX_CROSSWALKS: Final = 200
MAX_AREAS: Final = 200
MAX_POINTS: Final = 100_000
MAX_LINES_M: Final = 200e3
"""Total length of all lines of a map."""
MAX_CROSSWALKS_M: Final = 10e3
"""Total length of all crosswalks."""
MAX_AREA_M2: Final = 16e6
"""Total area of the axis-aligned bounding boxes of the drivable areas."""
MAX_CROSSINGS: Final = 100_000
"""Expected number of crossings between boundaries."""
MAX_TANGLES: Final = 500
"""The same between areas whose boundary crosses itself; recorded maps have none."""


def is_apart(position_m: Float[np.ndarray, "R 2"]) -> Bool[np.ndarray, "R 2"]:
    """Whether coordinates lie too far from those of the other states of a scene."""
    far = np.zeros(position_m.shape, bool)
    # By column, which is faster by far.
    for axis, values in enumerate(position_m.T):
        if not np.ptp(values) < MAX_POSITION_M:
            distance = np.abs(values - np.median(values))
            # Rounded, so that the frame does not matter.
            far[:, axis] = ~(np.round(distance, 3) <= MAX_POSITION_M)
    return far


def road_gap_m(road_map: RoadMap, position_m: Float[np.ndarray, "R 2"]) -> float:
    """Distance along an axis between the bounding boxes of a map and of states."""
    least, most = road_map.bounds_m
    return max(
        max(least[axis] - values.max(), values.min() - most[axis])
        for axis, values in enumerate(position_m.T)
    )


def agents_excess(agents: AgentTracks, road_map: RoadMap) -> str | None:
    """Reason, with the limit, why tracks cannot be opened; None if they can."""
    if agents.is_valid.size > MAX_STATES:
        return (
            f"There would be {len(agents)} agents over {agents.num_steps} steps; at most"
            f" {MAX_STATES} states are possible."
        )
    return odd_agent(agents) or _misplaced(agents, road_map)


def odd_agent(agents: AgentTracks) -> str | None:
    """Reason, with the limit, why some agent is none; None if each is one."""
    is_odd = ~((agents.size_m > 0) & (agents.size_m <= MAX_LENGTH_M)).all(axis=1)
    if is_odd.any():
        return (
            f"Agent {agents.ids[np.argmax(is_odd)]} would have a size outside"
            f" 0..{MAX_LENGTH_M:g} m."
        )
    row, step = np.nonzero(agents.is_valid)
    if not len(row):
        return None
    speed = np.abs(agents.velocity_mps[row, step])
    # A comparison with NaN is false.
    if not speed.max() <= MAX_SPEED_MPS:
        fast = row[np.argmax(~(speed <= MAX_SPEED_MPS).all(axis=1))]
        return (
            f"Agent {agents.ids[fast]} would move at {speed.max():.0f} m/s; at most"
            f" {MAX_SPEED_MPS:g} m/s are possible."
        )
    return None


def _misplaced(agents: AgentTracks, road_map: RoadMap) -> str | None:
    row, step = np.nonzero(agents.is_valid)
    if not len(row):
        return None
    position = agents.position_m[row, step]
    apart = is_apart(position).any(axis=1)
    if apart.any():
        return (
            f"Agent {agents.ids[row[np.argmax(apart)]]} would come to lie more than"
            f" {MAX_POSITION_M / 1000:g} km from the other ones."
        )
    gap = road_gap_m(road_map, position)
    if gap > MAX_GAP_M:
        return (
            f"All agents would lie at least {gap:.0f} m from the road; at most"
            f" {MAX_GAP_M:g} m are possible."
        )
    return None


def road_excess(road_map: RoadMap) -> str | None:
    """Reason, with the limit, why a map is too large to be opened; None if it is not."""
    num_links = sum(
        len(lane.successors) + len(lane.predecessors) for lane in road_map.lanes
    )
    num_points = sum(map(len, road_map.polylines))
    counts = (
        (len(road_map.lanes), MAX_LANES, "lanes"),
        (num_links, MAX_LINKS, "links between lanes"),
        (len(road_map.crosswalks), MAX_CROSSWALKS, "crosswalks"),
        (len(road_map.drivable_areas), MAX_AREAS, "drivable areas"),
        (num_points, MAX_POINTS, "points"),
    )
    for count, limit, name in counts:
        if count > limit:
            return f"it has {count} {name}; at most {limit} are opened."
    points = np.concatenate(road_map.polylines)[:, :2]
    span = float(np.ptp(points, axis=0).max())
    if span > 2 * MAX_POSITION_M:
        return (
            f"it spans {span / 1000:.1f} km; at most {2 * MAX_POSITION_M / 1000:g} km "
            "are opened."
        )
    return _too_long(road_map) or _too_wide(road_map)


def _too_long(road_map: RoadMap) -> str | None:
    lines = sum(map(_length_m, road_map.polylines))
    if lines > MAX_LINES_M:
        return (
            f"its lines are {lines / 1000:.0f} km long together; at most "
            f"{MAX_LINES_M / 1000:g} km are opened."
        )
    walks = sum(
        max(_length_m(one.edge1), _length_m(one.edge2)) for one in road_map.crosswalks
    )
    if walks > MAX_CROSSWALKS_M:
        return (
            f"its crosswalks are {walks / 1000:.0f} km long together; at most "
            f"{MAX_CROSSWALKS_M / 1000:g} km are opened."
        )
    return None


def _too_wide(road_map: RoadMap) -> str | None:
    """Reason why the drivable areas are too large to be joined; None if they are not."""
    rings = [area.boundary[:, :2] for area in road_map.drivable_areas]
    spans = np.array([np.ptp(ring, axis=0) for ring in rings]).reshape(-1, 2)
    area = float(spans.prod(axis=1).sum())
    if area > MAX_AREA_M2:
        return (
            f"its drivable areas span {area / 1e6:.0f} km2; at most "
            f"{MAX_AREA_M2 / 1e6:g} km2 are opened."
        )
    outlines = rings or [lane.outline_m() for lane in road_map.lanes]
    # Random straight lines cross L^2 / (pi A) times (Buffon). A valid ring does not
    # cross itself.
    tangled = [ring for ring in outlines if not _is_simple(ring)]
    for some, limit in ((tangled, MAX_TANGLES), (outlines, MAX_CROSSINGS)):
        if some and _crossings(some) > limit:
            return (
                "the boundaries of its areas cross one another too often "
                f"(about {_crossings(some):.0f} times); at most {limit} crossings "
                "are opened."
            )
    return None


def _crossings(rings: list[Float[np.ndarray, "_ 2"]]) -> float:
    """Expected number of crossings between rings whose segments are placed at random."""
    span = np.ptp(np.concatenate(rings), axis=0)
    length = sum(_length_m(np.concatenate([ring, ring[:1]])) for ring in rings)
    return length**2 / (np.pi * float(np.maximum(span, 1.0).prod()))


def _is_simple(ring: Float[np.ndarray, "N 2"]) -> bool:
    return len(ring) >= 3 and bool(shapely.is_valid(shapely.Polygon(ring)))


def _length_m(line: Float[np.ndarray, "N _"]) -> float:
    return float(arc_length(line[:, :2])[-1])
