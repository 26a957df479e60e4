"""The goal point of an agent, and what terms on its course share: stop lines, points."""

import itertools
import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.guidance.guidance_kind import (
    OBEYED,
    AgentNow,
    Driven,
    Found,
    GuidanceKind,
    Measured,
    Plan,
    Tool,
)
from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.analysis.metrics.road import is_off_road, outside_m
from pd_editor.base.errors import EditError
from pd_editor.base.plain_text import listed
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.geometry.polyline import point_at
from pd_editor.scene.guidance_terms import (
    LEAST_AT_S,
    MOST_AT_S,
    NO_TRACK_M,
    AgentGuidance,
    Form,
    GuidanceTerm,
    Motion,
    Point,
    time_left_s,
)
from pd_editor.scene.paths.driving_paths import SPACING_M
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES, nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import lane_kinds_of
from pd_editor.scene.road_map import LaneKind, RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_limits import MAX_POSITION_M
from pd_editor.scene.thresholds import STANDING_MPS

REACH_M: Final = 8.0
"""Largest distance to a boundary; beyond it a lane has its usual width."""
USUAL_HALF_WIDTH_M: Final = 1.75

LINE_MARGIN_M: Final = 2.0
"""A stop line also counts this far beside its ends."""


def cross_line(
    road_map: RoadMap,
    point_m: Float[np.ndarray, "2"],
    *,
    kinds: tuple[LaneKind, ...] = DRIVING_LANES,
    max_distance_m: float = np.inf,
) -> tuple[Float[np.ndarray, "2 2"], int] | None:
    """Line from the left to the right boundary of the lane nearest to a point.

    It crosses the centre line at a right angle, at the foot of the point. Returns the
    line and the lane's id; None without a lane within ``max_distance_m`` of the point.
    """
    match = nearest_lanes(road_map, point_m[None], kinds=kinds)
    if not match.is_valid[0] or match.distance_m[0] > max_distance_m:
        return None
    lane = road_map.lane_of[int(match.lane_id[0])]
    (left,) = left_of(unit_vector(match.heading_rad[:1]))
    (foot,) = point_at(lane.centerline_m, match.along_m[:1])
    ends = [
        foot + side * _reach(boundary, foot, side * left) * left
        for boundary, side in ((lane.left_m, 1.0), (lane.right_m, -1.0))
    ]
    return np.array(ends), lane.lane_id


def _reach(
    boundary_m: Float[np.ndarray, "N 2"],
    foot_m: Float[np.ndarray, "2"],
    across: Float[np.ndarray, "2"],
) -> float:
    """Distance from a foot to where a boundary is crossed in a direction."""
    rel = boundary_m - foot_m
    aside = rel @ across
    ahead = rel @ np.array([across[1], -across[0]])
    crosses = (ahead[:-1] <= 0) != (ahead[1:] <= 0)
    if not crosses.any():
        return USUAL_HALF_WIDTH_M
    share = ahead[:-1][crosses] / (ahead[:-1][crosses] - ahead[1:][crosses])
    reach = aside[:-1][crosses] + share * (aside[1:] - aside[:-1])[crosses]
    within = reach[(reach > 0) & (reach <= REACH_M)]
    return float(within.min()) if len(within) else USUAL_HALF_WIDTH_M


def crossing(
    path_m: Float[np.ndarray, "N 2"], line_m: Float[np.ndarray, "2 2"]
) -> tuple[int, float] | None:
    """First crossing: index of the point before it, and the share of the way to the next."""
    side, place, length = _line_frame(path_m, line_m)
    near = (place > -LINE_MARGIN_M) & (place < length + LINE_MARGIN_M)
    crosses = (side[:-1] * side[1:] <= 0) & (near[:-1] | near[1:])
    crosses &= side[:-1] != side[1:]
    if not crosses.any():
        return None
    index = int(crosses.argmax())
    share = side[index] / (side[index] - side[index + 1])
    return index, float(share)


def overrun_m(
    position_m: Float[np.ndarray, "N 2"],
    heading_rad: Float[np.ndarray, "N"],
    size_m: Float[np.ndarray, "2"],
    line_m: Float[np.ndarray, "2 2"],
) -> float:
    """How far an agent's front gets beyond a line, seen from where it starts.

    Negative: the least distance before the line. Beside the line: minus infinity.
    """
    forward = unit_vector(heading_rad)
    left = left_of(forward)
    start, _, _ = _line_frame(position_m[:1], line_m)
    worst = -np.inf
    for sign in (-1.0, 0.0, 1.0):
        corner = position_m + size_m[0] / 2 * forward + sign * size_m[1] / 2 * left
        side, place, length = _line_frame(corner, line_m)
        near = (place > -LINE_MARGIN_M) & (place < length + LINE_MARGIN_M)
        beyond = -side * np.sign(start[0])
        worst = max(worst, float(beyond[near].max(initial=-np.inf)))
    return worst


def _line_frame(
    points_m: Float[np.ndarray, "N 2"], line_m: Float[np.ndarray, "2 2"]
) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N"], float]:
    """Signed distance to a line, place along it, and its length."""
    across = line_m[1] - line_m[0]
    length = float(np.hypot(*across))
    across = across / length
    gap = points_m - line_m[0]
    return gap @ left_of(across), gap @ across, length


LANE_REACH_M: Final = 6.0
"""Largest distance of a click to the centre line of the lane it means."""


def check_points(term: GuidanceTerm, points_m: tuple[Point, ...]) -> None:
    """Raise for points that are far from the scene, or not finite."""
    for point in points_m:
        if not all(
            math.isfinite(value) and abs(value) <= MAX_POSITION_M for value in point
        ):
            raise EditError(
                f"A point of a {term.name} is ({point[0]:g}, {point[1]:g}) m; "
                f"expected at most {MAX_POSITION_M:g} m from the scene's origin."
            )


def moved_points(points_m: tuple[Point, ...], motion: Motion) -> tuple[Point, ...]:
    """Points after a motion of the plane."""
    moved = motion(np.array(points_m, float).reshape(-1, 2))
    return tuple((float(x), float(y)) for x, y in moved)


def length_m(points_m: tuple[Point, ...]) -> float:
    """Length of a line."""
    return sum(itertools.starmap(math.dist, itertools.pairwise(points_m)))


def lane_kinds(scenario: Scenario, agent_id: str) -> tuple:
    """Kinds of the lanes that an agent uses."""
    (row,) = scenario.agents.rows([agent_id])
    return lane_kinds_of(scenario.agents.kinds[row]) or DRIVING_LANES


def rounded(point_m: Float[np.ndarray, "2"]) -> Point:
    """A point that is drawn by hand, to centimetres."""
    return round(float(point_m[0]), 2), round(float(point_m[1]), 2)


@dataclass(frozen=True, kw_only=True)
class GoalPoint(AgentGuidance):
    """Be at a point at a time."""

    kind: ClassVar[str] = "goal-point"

    point_m: Point
    at_s: Annotated[
        float | None,
        Form(
            "Time",
            "time",
            unit="s",
            least=LEAST_AT_S,
            most=MOST_AT_S,
            first=0.5,
            empty="end",
        ),
    ] = None
    """None: at the last generated step."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_points(self, (self.point_m,))

    def moved(self, motion: Motion) -> "GoalPoint":
        """The term with a moved point."""
        return replace(self, point_m=moved_points((self.point_m,), motion)[0])

    def later(
        self,
        seconds: float,
        track_m: Float[np.ndarray, "S 2"] = NO_TRACK_M,  # noqa: ARG002
    ) -> "GoalPoint | None":
        """The goal with the time that is left; one of the end stays."""
        left_s = time_left_s(self.at_s, seconds)
        is_over = left_s is None and self.at_s is not None
        return None if is_over else replace(self, at_s=left_s)

    @classmethod
    def drawn(
        cls, scenario: Scenario, agent_id: str, points_m: Float[np.ndarray, "1 2"]
    ) -> "GoalPoint":
        """Goal of an agent at a point of the road.

        Raises:
            EditError: the point is off the map.
        """
        away = float(outside_m(scenario, points_m)[0])
        if away > map_reach_m(scenario, agent_id):
            raise EditError(
                f"The goal is {away:.0f} m off the road; drop it on the road or close to "
                "it."
            )
        return cls(agent_id=agent_id, point_m=rounded(points_m[0]))


def map_reach_m(scenario: Scenario, agent_id: str) -> float:
    """Distance to the drivable area up to which points of an agent count as on the map."""
    (row,) = scenario.agents.rows([agent_id])
    walks = scenario.agents.kinds[row] is AgentKind.PEDESTRIAN
    # Points so near to the drivable area are on the map; pavements are no part of it.
    return 20.0 if walks else 4.0


def _goal_problems(term: GoalPoint, plan: Plan) -> Found:
    found = list(_reach_problems(term, plan))
    if not found and not plan.keeps(term.agent_id):
        found = list(_blocked_goal_problems(term, plan))
    yield from found


def _reach_problems(term: GoalPoint, plan: Plan) -> Found:
    (agent,) = plan.agents((term.agent_id,))
    goal, whose = np.array(term.point_m), f"The goal of {agent.name} is"
    time_s = agent.duration_s if term.at_s is None else term.at_s
    if time_s > agent.duration_s + 1e-6:
        yield (
            f"{whose} asked for at {time_s:g} s, and trajectories last "
            f"{agent.duration_s:.1f} s; it is aimed at then."
        )
        time_s = agent.duration_s
    if agent.is_driver and bool(is_off_road(plan.scenario, goal[None])[0]):
        yield f"{whose} off the road; move it onto the road."
    along, beside = nearest_on(agent.paths_m, goal)
    best = int(beside.argmin())
    # Distance of a goal from all planned paths at which it counts as unreachable.
    if beside[best] > 4.0:
        yield (
            f"{whose} {beside[best]:.0f} m beside all paths that it could take; move it "
            "onto one of them, or draw a path to it."
        )
        return
    least, most = agent.reach_m(time_s)
    distance = float(along[best])
    if distance > most + 0.5:
        yield (
            f"{whose} {distance:.0f} m ahead, and it gets at most {most:.0f} m far in "
            f"{time_s:.1f} s; move it nearer."
        )
    elif distance < least - 0.5:
        yield (
            f"{whose} {distance:.0f} m ahead, and it needs {least:.0f} m to stop from "
            f"{agent.speed_mps:.1f} m/s; move it further."
        )


def _blocked_goal_problems(term: GoalPoint, plan: Plan) -> Found:
    """Whether agents stand on each path to a goal; others with terms may drive away."""
    (agent,) = plan.agents((term.agent_id,))
    goal = np.array(term.point_m)
    along, beside = nearest_on(agent.paths_m, goal)
    # Paths that come as near to a goal as the nearest one, up to this, lead there.
    leads = beside <= beside.min() + 1.0
    leaving = {name for one in plan.terms for name in one.guided_ids}
    rows = _blocking_rows(agent, agent.paths_m[leads], goal, along[leads], leaving)
    if not rows:
        return
    names, one = [plan.scenario.agents.ids[row] for row in rows], len(rows) == 1
    who = f"Agent {names[0]} stands" if one else f"Agents {listed(names)} stand"
    yield (
        f"{who} on the way of {agent.name} to its goal; put the goal before "
        f"{'it' if one else 'them'}, or move {'it' if one else 'them'} away."
    )


def _blocking_rows(
    agent: AgentNow,
    paths_m: Float[np.ndarray, "P M 2"],
    goal_m: Float[np.ndarray, "2"],
    along_m: Float[np.ndarray, "P"],
    leaving: Collection[str] = (),
) -> list[int]:
    """The first agent that stands on each path to a goal; none if a path is free.

    Args:
        agent: the agent that drives.
        paths_m: the paths that lead to the goal, one point every ``SPACING_M``.
        goal_m: the goal.
        along_m: its arc length on each path.
        leaving: agents that are asked to drive elsewhere, which block nothing.
    """
    agents, now = agent.scenario.agents, agent.scenario.current_step
    stands = agents.speed_mps()[:, now] < STANDING_MPS
    stands &= agents.is_valid[:, now] & agents.kind_mask(LANE_FOLLOWER_KINDS)
    stands &= ~np.isin(agents.ids, list(leaving))
    stands[agent.row] = False
    others = np.flatnonzero(stands)
    boxes = Boxes(
        position_m=agents.position_m[others, now],
        heading_rad=agents.heading_rad[others, now],
        size_m=agents.size_m[others],
    )
    length, width = agents.size_m[agent.row]
    # Agents can swerve by 1 m around one that stands at the side of their way.
    size = np.array([length, max(width - 2.0, 0.2)])
    found: list[int] = []
    for path, along in zip(paths_m, along_m, strict=True):
        count = max(min(int(along / SPACING_M) + 1, len(path)), 2)
        step = np.gradient(path, axis=0)[:count]
        heading = np.arctan2(step[:, 1], step[:, 0])
        heading[0] = agent.heading_rad
        share = np.arange(count) / (count - 1)
        left = left_of(unit_vector(heading))
        aside = ((goal_m - path[count - 1]) * left[-1]).sum() * share**2
        driven = Boxes(
            position_m=(path[:count] + aside[:, None] * left)[:, None],
            heading_rad=heading[:, None],
            size_m=size,
        )
        touches = boxes_touch(driven, boxes)
        # Agents that overlap now may part.
        touches &= ~touches[0]
        if not touches.any():
            return []
        found.append(int(others[touches[touches.any(axis=1).argmax()].argmax()]))
    return list(dict.fromkeys(found))


def nearest_on(
    paths_m: Float[np.ndarray, "P M 2"], point_m: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "P"], Float[np.ndarray, "P"]]:
    """Arc length and distance of the nearest point of each path."""
    gap = np.linalg.norm(paths_m - point_m, axis=-1)
    node = gap.argmin(axis=1)
    every = np.arange(len(paths_m))
    after = np.minimum(node + 1, paths_m.shape[1] - 1)
    before = np.maximum(node - 1, 0)
    course = paths_m[every, after] - paths_m[every, before]
    course /= np.maximum(np.linalg.norm(course, axis=-1, keepdims=True), 1e-9)
    rest = point_m - paths_m[every, node]
    ahead = (rest * course).sum(-1)
    beside = np.abs(course[:, 0] * rest[:, 1] - course[:, 1] * rest[:, 0])
    # Before its first and beyond its last point a path has no side.
    inside = (node > 0) & (node < paths_m.shape[1] - 1) | (np.abs(ahead) < SPACING_M)
    return node * SPACING_M + ahead, np.where(inside, beside, gap[every, node])


def _goal_clash(
    term: GoalPoint, other: GuidanceTerm, shared: str | None, _plan: Plan
) -> Found:
    if (
        shared
        and isinstance(other, GoalPoint)
        and term.at_s == other.at_s
        and term.point_m != other.point_m
    ):
        yield (
            f"{shared} has two goal points at the same time; give one of them another "
            "time."
        )


def _goal_outcome(term: GoalPoint, driven: Driven) -> Measured | None:
    (row,) = driven.rows
    step = driven.num_steps - 1
    if term.at_s is not None:
        step = min(max(round(term.at_s / driven.step_s), 0), step)
    gap = driven.sample.position_m[row, step] - np.array(term.point_m)
    error = float(np.hypot(*gap))
    x, y = term.point_m
    return Measured(
        asked=f"at ({x:.1f}, {y:.1f}) m after {step * driven.step_s:.1f} s",
        achieved=f"{error:.1f} m away",
        error=error,
        unit="m",
        is_obeyed=error <= OBEYED.goal_m,
    )


GOAL: Final = GuidanceKind(
    value=GoalPoint,
    title="Goal",
    hint="Click where the agent should drive to (T)",
    icon="M5.5 17.5V3M5.5 3.5H15l-2.6 3.2L15 10H5.5",
    asks=lambda term: (
        f"be here {'at the end' if term.at_s is None else f'at {term.at_s:g} s'}"
    ),
    outcome=_goal_outcome,
    check=_goal_problems,
    clash=_goal_clash,
    leads=True,
    tool=Tool(
        "click",
        "click where it should drive to.",
        "Set a goal on the road",
        "T",
        draw=GoalPoint.drawn,
    ),
    shape="flag",
    points_m=lambda term, _: (term.point_m,),
)
