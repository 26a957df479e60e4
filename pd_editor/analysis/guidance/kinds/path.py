"""Kinds of terms on the path of an agent: drawn, with way-points, or along lanes."""

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np
import shapely
import shapely.ops
from jaxtyping import Float

from pd_editor.analysis.guidance.guidance_kind import (
    OBEYED,
    AgentNow,
    Driven,
    Found,
    GuidanceKind,
    Measured,
    Plan,
    Refusal,
    Tool,
)
from pd_editor.analysis.guidance.kinds.course import (
    LANE_REACH_M,
    GoalPoint,
    check_points,
    lane_kinds,
    length_m,
    map_reach_m,
    moved_points,
    rounded,
)
from pd_editor.analysis.guidance.way_points import (
    WayPlan,
    WayPoint,
    way_point_problems,
    way_points_measured,
)
from pd_editor.analysis.metrics.road import outside_m
from pd_editor.analysis.threats.encounter import Track
from pd_editor.analysis.threats.threat_feasibility import recorded_track
from pd_editor.base.errors import EditError
from pd_editor.base.plain_text import one_line
from pd_editor.scene.geometry.frenet import FrenetFrames
from pd_editor.scene.geometry.polyline import arc_length, point_at
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
from pd_editor.scene.paths.drawn_path import FollowedPath, lane_line, path_to_follow
from pd_editor.scene.paths.driving_paths import SPACING_M
from pd_editor.scene.paths.lanes.lane_graph import lane_chain
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import FASTEST_MPS

MAX_PATH_POINTS: Final = 1_000
MAX_DRAWN_POINTS: Final = 60
"""A line that is drawn by hand is simplified to so many points."""
_LEAST_PATH_M: Final = 3.0
_LANE_TOLERANCE_M: Final = 0.2
_GRID_M: Final = 0.5

POINT_FORMS: Final[Mapping[str, Form]] = {
    "speeds_mps": Form("Speed", "speed", unit="m/s", most=FASTEST_MPS, empty="any"),
    "times_s": Form(
        "Time",
        "time",
        unit="s",
        least=LEAST_AT_S,
        most=MOST_AT_S,
        first=0.5,
        empty="any",
    ),
    "waits_for": Form("Wait for", "agents to wait for", empty="nobody"),
}
"""Forms of what is asked at the points of a path, by the fields that hold it."""


@dataclass(frozen=True, kw_only=True)
class FollowPath(AgentGuidance):
    """Drive along a path, at a speed that the model chooses where none is asked for.

    What is asked at the points is empty, or there is one value per point.
    """

    kind: ClassVar[str] = "follow-path"
    noun: ClassVar[str] = "path"

    points_m: tuple[Point, ...]
    speeds_mps: tuple[float | None, ...] = ()
    times_s: tuple[float | None, ...] = ()
    waits_for: tuple[str | None, ...] = ()
    """Agents that have to pass before the agent drives on from the point."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 2 <= len(self.points_m) <= MAX_PATH_POINTS:
            raise EditError(
                f"A path to follow has {len(self.points_m)} points; expected 2 to "
                f"{MAX_PATH_POINTS}."
            )
        check_points(self, self.points_m)
        if length_m(self.points_m) < 1.0:
            raise EditError("A path to follow is shorter than 1 m; draw a longer one.")
        for name, form in POINT_FORMS.items():
            self._check_each(getattr(self, name), form)
        self._check_ids(self.awaited_ids)
        if self.agent_id in self.awaited_ids:
            raise EditError(
                f"Agent {one_line(self.agent_id)} cannot wait for itself; name another "
                "agent."
            )
        times = [one for one in self.times_s if one is not None]
        if any(after <= before for before, after in itertools.pairwise(times)):
            raise EditError("The times of the way-points of a path must increase.")

    def _check_each(self, values: tuple[Any, ...], form: Form) -> None:
        count = len(self.points_m)
        if len(values) not in (0, count):
            raise EditError(
                f"A path with {count} points has {len(values)} values of {form.noun}; "
                "expected one per point, or none."
            )
        for value in values:
            if value is not None and form.most:
                what = f"{form.noun} at a way-point"
                self._check(what, value, form.least, form.most)

    @property
    def awaited_ids(self) -> tuple[str, ...]:
        """Agents that have to pass first, each once."""
        return tuple(dict.fromkeys(one for one in self.waits_for if one is not None))

    @property
    def named_ids(self) -> tuple[str, ...]:
        """Ids of the agent and of those that it waits for."""
        return (self.agent_id, *self.awaited_ids)

    @property
    def guided_ids(self) -> tuple[str, ...]:
        """Id of the agent that is guided."""
        return (self.agent_id,)

    def way_points(self) -> list[WayPoint]:
        """All points with what is asked there."""
        count = len(self.points_m)
        each = (getattr(self, name) or (None,) * count for name in POINT_FORMS)
        return [
            WayPoint(
                number=number,
                point_m=point,
                speed_mps=speed,
                at_s=at_s,
                waits_for=other,
            )
            for number, (point, speed, at_s, other) in enumerate(
                zip(self.points_m, *each, strict=True), start=1
            )
        ]

    @property
    def has_asks(self) -> bool:
        """Whether something is asked at a way-point."""
        return any(one.asks for one in self.way_points())

    def with_way_points(self, points: Sequence[WayPoint]) -> "FollowPath":
        """The path with other way-points; their numbers do not matter.

        Raises:
            EditError: they make no path.
        """
        asked = [(one.speed_mps, one.at_s, one.waits_for) for one in points]
        values = (
            each if any(one is not None for one in each) else ()
            for each in zip(*asked, strict=True)
        )
        asks = dict(zip(POINT_FORMS, values, strict=True)) if points else {}
        return replace(self, points_m=tuple(one.point_m for one in points), **asks)

    def moved(self, motion: Motion) -> "FollowPath":
        """The term with moved points."""
        return replace(self, points_m=moved_points(self.points_m, motion))

    def later(
        self, seconds: float, track_m: Float[np.ndarray, "S 2"] = NO_TRACK_M
    ) -> "FollowPath | None":
        """What is left of the path, without the times that are over.

        It goes from shortly behind its agent on; None if that has come to the end.
        """
        points = self._way_points_left(track_m[::-5][::-1])
        if not points:
            return None
        left = (replace(one, at_s=time_left_s(one.at_s, seconds)) for one in points)
        return self.with_way_points(list(left))

    def _way_points_left(self, track_m: Float[np.ndarray, "S 2"]) -> list[WayPoint]:
        """Way-points after a drive along the path, from a point behind the agent on.

        How far it has come follows from its track, as paths may cross themselves.
        """
        points = list(self.way_points())
        if not len(track_m):
            return points
        line = np.array(self.points_m)
        arc = arc_length(line)
        grid = np.arange(0.0, arc[-1] + _GRID_M, _GRID_M).clip(max=arc[-1])
        curve = point_at(line, grid)
        at = int(np.linalg.norm(curve - track_m[0], axis=-1).argmin())
        for before, place in itertools.pairwise(track_m):
            # How much further than it drove an agent may have come along its path.
            reach_m = float(np.linalg.norm(place - before)) + 2.0
            ahead = curve[at : at + int(reach_m / _GRID_M) + 1]
            at += int(np.linalg.norm(ahead - place, axis=-1).argmin())
        if arc[-1] - grid[at] < 1.0:
            return []
        # So much of a path behind the agent is kept: it is joined in its direction.
        begin = float(grid[at]) - 5.0
        if begin <= 0:
            return points
        x_m, y_m = point_at(line, np.array([begin]))[0].tolist()
        first = WayPoint(
            number=0, point_m=(x_m, y_m), speed_mps=None, at_s=None, waits_for=None
        )
        rest = (one for one, along in zip(points, arc, strict=True) if along > begin)
        return [first, *rest]

    def without_agents(self, agent_ids: Collection[str]) -> "FollowPath | None":
        """The path without waits for removed agents; None without its own agent."""
        if self.agent_id in agent_ids:
            return None
        if not set(self.awaited_ids) & set(agent_ids):
            return self
        left = [
            replace(one, waits_for=None) if one.waits_for in agent_ids else one
            for one in self.way_points()
        ]
        return self.with_way_points(left)

    @classmethod
    def drawn(
        cls, scenario: Scenario, agent_id: str, points_m: Float[np.ndarray, "N 2"]
    ) -> "FollowPath":
        """Path of an agent along a line drawn by hand, simplified to few points.

        Raises:
            EditError: the line is too short, or leaves the map.
        """
        line = shapely.LineString(points_m) if len(points_m) > 1 else None
        if line is None or line.length < _LEAST_PATH_M:
            raise EditError(
                f"The path is too short; it takes at least {_LEAST_PATH_M:g} m of road."
            )
        # Largest distance between a drawn line and its simplified path.
        tolerance = 0.25
        simple = shapely.get_coordinates(line.simplify(tolerance))
        while len(simple) > MAX_DRAWN_POINTS:
            tolerance *= 2
            simple = shapely.get_coordinates(line.simplify(tolerance))
        return cls(
            agent_id=agent_id, points_m=tuple(map(rounded, simple))
        ).checked_on_map(scenario)

    @classmethod
    def clicked(
        cls, scenario: Scenario, agent_id: str, points_m: Float[np.ndarray, "N 2"]
    ) -> "FollowPath":
        """Path through points, which snap to lanes and are joined along these.

        The first point is the agent's own place, which stays as it is.

        Raises:
            EditError: they make no path, or leave the map.
        """
        points = [snapped(scenario, agent_id, one) for one in points_m]
        points[0] = points_m[0]
        line = [points[0]]
        for before, after in itertools.pairwise(points):
            line += [*_along_lanes(scenario, agent_id, before, after), after]
        return cls(
            agent_id=agent_id, points_m=tuple(dict.fromkeys(map(rounded, line)))
        ).checked_on_map(scenario)

    def checked_on_map(self, scenario: Scenario) -> "FollowPath":
        """The path itself.

        Raises:
            EditError: it leaves the map.
        """
        away = float(outside_m(scenario, np.array(self.points_m)).max())
        if away > map_reach_m(scenario, self.agent_id):
            raise EditError(
                f"The path leads {away:.0f} m off the road; draw it on the road or close "
                "to it."
            )
        return self


def snapped(
    scenario: Scenario, agent_id: str, point_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "2"]:
    """The point of a lane's centre line near a point; the point itself without one."""
    found = nearest_lanes(
        scenario.road_map, point_m[None], kinds=lane_kinds(scenario, agent_id)
    )
    # A point that is clicked this near to a lane's centre line is meant to be on it.
    if not found.is_valid[0] or found.distance_m[0] > 1.5:
        return point_m
    lane = scenario.road_map.lane_of[int(found.lane_id[0])]
    return point_at(lane.centerline_m, found.along_m)[0]


def _along_lanes(
    scenario: Scenario,
    agent_id: str,
    before_m: Float[np.ndarray, "2"],
    after_m: Float[np.ndarray, "2"],
) -> list[Float[np.ndarray, "2"]]:
    """Points between two ones, of the lanes that lead from one to the other if any do."""
    kinds = lane_kinds(scenario, agent_id)
    ends = np.array([before_m, after_m])
    found = nearest_lanes(scenario.road_map, ends, kinds=kinds)
    first, last = found.lane_id.tolist()
    if not found.is_valid.all() or found.distance_m.max() > 0.05:
        return []
    chain = lane_chain(scenario.road_map, first, last, kinds=kinds)
    line = None if chain is None else lane_line(scenario.road_map, chain)
    if line is None or len(line) < 2:
        return []
    whole = shapely.LineString(line)
    begin, end = (whole.project(shapely.Point(one)) for one in ends)
    # Lanes that are longer than the way between two points, by this, do not join them.
    if not 0 < end - begin < 1.6 * np.linalg.norm(after_m - before_m):
        return []
    part = shapely.ops.substring(whole, begin, end).simplify(_LANE_TOLERANCE_M)
    return list(shapely.get_coordinates(part)[1:-1])


def _line_problems(
    agent: AgentNow, line_m: Float[np.ndarray, "N 2"], what: str
) -> Found:
    whose = f"The {what} of {agent.name}"
    gap = float(np.linalg.norm(line_m - agent.position_m, axis=-1).min())
    if gap > 15.0:
        yield f"{whose} begins {gap:.0f} m away; begin it at the agent."
    followed = path_to_follow(
        line_m, agent.position_m, agent.heading_rad, agent.speed_mps
    )
    path, length = followed.path, followed.length_m
    if length < 1.0:
        yield f"{whose} ends behind it; draw it ahead of the agent."
        return
    if not followed.is_drivable:
        yield (
            f"{whose} leads sideways or backwards, so it is not followed; begin it in "
            "the agent's direction."
        )
        return
    turn = np.abs(np.diff(path.heading_rad[0])) / SPACING_M
    driven = agent.reach_m(agent.duration_s)[1] / SPACING_M
    within = np.arange(len(turn)) < min(driven, length / SPACING_M)
    braked = np.maximum(
        agent.speed_mps**2 - 2 * 3.0 * SPACING_M * np.arange(len(turn)), 1.0
    )
    # Lateral acceleration above which a path cannot be followed at the current speed.
    if (braked * turn)[within].max(initial=0.0) > 6.0:
        yield (
            f"{whose} bends too sharply for {agent.speed_mps:.1f} m/s; draw a wider "
            "curve or lower the speed."
        )


def _path_clash(
    term: "FollowPath | FollowLane",
    other: GuidanceTerm,
    shared: str | None,
    _plan: Plan,
) -> Found:
    """Lanes leave it to paths to tell of both."""
    if shared and isinstance(other, (FollowLane, type(term))):
        yield f"{shared} has two paths to follow; keep one of them."
    elif shared and isinstance(term, FollowPath) and isinstance(other, GoalPoint):
        yield from _goal_clash(term, other, shared)
    elif isinstance(term, FollowPath) and isinstance(other, FollowPath):
        yield from _wait_clash(term, other)


def _wait_clash(term: FollowPath, other: FollowPath) -> Found:
    """Two waits, each at a place before the one that the other agent waits to be left."""

    def waits(one: FollowPath, awaited: str) -> list[tuple[shapely.Point, int]]:
        at = [way for way in one.way_points() if way.waits_for == awaited]
        return [(shapely.Point(way.point_m), way.number) for way in at]

    for (here, number), (there, other_number) in itertools.product(
        waits(term, other.agent_id), waits(other, term.agent_id)
    ):
        lines = map(shapely.LineString, (term.points_m, other.points_m))
        if all(
            line.project(own) <= line.project(awaited)
            for line, own, awaited in zip(
                lines, (here, there), (there, here), strict=True
            )
        ):
            yield (
                f"Agents {term.agent_id} (way-point {number}) and {other.agent_id} "
                f"(way-point {other_number}) wait for each other, so neither would drive "
                "on; let one of them not wait."
            )
            return


def _goal_clash(term: FollowPath, goal: GoalPoint, shared: str) -> Found:
    """A goal beside the path, or at a time that its way-points do not leave for it."""
    line, point = shapely.LineString(term.points_m), shapely.Point(goal.point_m)
    place, beside = line.project(point), line.distance(point)
    when = math.inf if goal.at_s is None else goal.at_s
    if beside > LANE_REACH_M:
        if 0 < place < line.length:
            yield (
                f"{shared} has a goal point {beside:.0f} m beside the path to follow; move "
                "one of them."
            )
        return
    arcs = arc_length(np.array(term.points_m)).tolist()
    for number, (arc, at_s) in enumerate(
        zip(arcs, term.times_s, strict=False), start=1
    ):
        if at_s is None or abs(place - arc) < OBEYED.goal_m:
            continue
        if (place > arc) != (when > at_s):
            told = "at the end" if goal.at_s is None else f"at {when:g} s"
            where = "beyond" if place > arc else "before"
            yield (
                f"{shared} has a goal point {told} that lies {where} way-point "
                f"{number}, asked for at {at_s:g} s; change one of the times."
            )
            return


def _followed(line_m: Float[np.ndarray, "N 2"], driven: Driven) -> FollowedPath:
    (row,) = driven.rows
    sample = driven.sample
    return path_to_follow(
        line_m,
        sample.position_m[row, 0],
        float(sample.heading_rad[row, 0]),
        float(driven.speed_mps()[row, 0]),
    )


def _line_outcome(
    line_m: Float[np.ndarray, "N 2"], words: str, driven: Driven
) -> Measured:
    """Mean distance to the side of the path that joins a line, after the first seconds."""
    (row,) = driven.rows
    sample, followed = driven.sample, _followed(line_m, driven)
    path, length = followed.path, followed.length_m
    along, beside = FrenetFrames(points_m=path.points_m).to_frenet(
        sample.position_m[row, None]
    )
    counted = along[0] <= length
    # Time after which an agent should be on the path that it follows.
    counted[: round(2.0 / driven.step_s)] = False
    error = float(np.abs(beside[0][counted]).mean()) if counted.any() else 0.0
    return Measured(
        asked=f"along {words}",
        achieved=f"{error:.1f} m beside it",
        error=error,
        unit="m",
        is_obeyed=error <= OBEYED.path_m,
    )


def way_plan(
    term: "FollowPath | FollowLane", followed: FollowedPath, width_m: float
) -> WayPlan | None:
    """Plan of the way-points of a path on the path that is followed; None without any."""
    if not (isinstance(term, FollowPath) and term.has_asks and followed.is_drivable):
        return None
    return WayPlan.of(term.way_points(), followed, width_m)


def _path_problems(term: FollowPath, plan: Plan) -> Found:
    (agent,) = plan.agents((term.agent_id,))
    found = list(_line_problems(agent, np.array(term.points_m), "path"))
    followed = path_to_follow(
        np.array(term.points_m), agent.position_m, agent.heading_rad, agent.speed_mps
    )
    ways = way_plan(term, followed, float(plan.scenario.agents.size_m[agent.row, 1]))
    if ways is not None and not found and not plan.keeps(term.agent_id):
        found += way_point_problems(ways, agent, lambda other: _kept(other, plan))
    yield from found


def _kept(agent_id: str, plan: Plan) -> Track | None:
    """Track of an agent that is not known to be generated."""
    if plan.generates(agent_id):
        return None
    return recorded_track(plan.scenario, plan.scenario.agents.row_of[agent_id])


def _path_outcome(term: FollowPath, driven: Driven) -> Measured:
    (row,) = driven.rows
    line = np.array(term.points_m)
    kept = _line_outcome(line, "the path", driven)
    ways = way_plan(term, _followed(line, driven), float(driven.sample.size_m[row, 1]))
    return kept if ways is None else way_points_measured(ways, driven, kept)


def _path_asks(term: FollowPath) -> str:
    asked = [f"{one.asks} at {one.number}" for one in term.way_points() if one.asks]
    return "; ".join(["follow this path", *asked])


PATH: Final = GuidanceKind(
    value=FollowPath,
    title="Path",
    hint="Draw or click the path that the agent should follow (D)",
    icon="M3.5 16.5c6.5 0 3-6 6.5-7s3-6 6.5-6M13.5 2.5h3.5V6",
    asks=_path_asks,
    outcome=_path_outcome,
    check=_path_problems,
    clash=_path_clash,
    leads=True,
    tool=Tool(
        "draw",
        "click its points and double click the last, or drag along the path.",
        "Draw a path",
        "D",
        draw=FollowPath.drawn,
        click=FollowPath.clicked,
    ),
    shape="path",
    points_m=lambda term, _: term.points_m,
)


@dataclass(frozen=True, kw_only=True)
class FollowLane(AgentGuidance):
    """Drive along the centre lines of lanes, one after another."""

    kind: ClassVar[str] = "follow-lane"
    noun: ClassVar[str] = "lane route"

    lane_ids: tuple[int, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.lane_ids) <= MAX_PATH_POINTS:
            raise EditError(
                f"A lane to follow is made of {len(self.lane_ids)} lanes; expected 1 "
                f"to {MAX_PATH_POINTS}."
            )

    @classmethod
    def drawn(
        cls, scenario: Scenario, agent_id: str, points_m: Float[np.ndarray, "1 2"]
    ) -> "FollowLane":
        """Lanes from an agent's lane to the lane nearest to a point.

        Raises:
            EditError: no lane is near, or it is not reached from the agent's lane.
        """
        agents, step = scenario.agents, scenario.current_step
        kinds = lane_kinds(scenario, agent_id)
        (row,) = agents.rows([agent_id])
        to = nearest_lanes(scenario.road_map, points_m, kinds=kinds)
        start = nearest_lanes(
            scenario.road_map,
            agents.position_m[row, step][None],
            heading_rad=agents.heading_rad[row, step][None],
            kinds=kinds,
        )
        if not to.is_valid[0] or to.distance_m[0] > LANE_REACH_M:
            raise EditError("There is no lane here to follow; click a lane.")
        first, last = int(start.lane_id[0]), int(to.lane_id[0])
        chain = lane_chain(scenario.road_map, first, last, kinds=kinds)
        if chain is None:
            raise EditError(
                f"Lane {last} is not reached from the agent's lane without a lane "
                "change; draw a path instead."
            )
        return cls(agent_id=agent_id, lane_ids=chain)

    def points_m(self, scenario: Scenario) -> Float[np.ndarray, "N 2"]:
        """The centre lines of the lanes as one line, simplified."""
        lanes = scenario.road_map.lane_of
        lines = [lanes[one].centerline_m for one in self.lane_ids if one in lanes]
        if not lines:
            return np.zeros((0, 2))
        line = shapely.LineString(np.concatenate(lines))
        return shapely.get_coordinates(line.simplify(_LANE_TOLERANCE_M))


def _lane_problems(term: FollowLane, plan: Plan) -> Found:
    (agent,) = plan.agents((term.agent_id,))
    lanes = plan.scenario.road_map.lane_of
    line = lane_line(plan.scenario.road_map, term.lane_ids)
    if line is None or len(line) < 2:
        missing = next((one for one in term.lane_ids if one not in lanes), 0)
        yield Refusal(
            f"Lane {missing}, which {agent.name} should follow, is not on this map; "
            "choose another one."
        )
        return
    for one, other in itertools.pairwise(term.lane_ids):
        lane = lanes[one]
        if other not in (*lane.successors, lane.left_neighbor, lane.right_neighbor):
            yield (
                f"Lane {other} does not follow lane {one}; choose lanes of {agent.name} "
                "that are connected."
            )
    yield from _line_problems(agent, line, "lane")


def _lane_outcome(term: FollowLane, driven: Driven) -> Measured | None:
    line = lane_line(driven.scenario.road_map, term.lane_ids)
    if line is None or len(line) < 2:
        return None
    lanes = "lane" if len(term.lane_ids) == 1 else "lanes"
    words = f"{lanes} {', '.join(map(str, term.lane_ids[:3]))}"
    return _line_outcome(line, words, driven)


LANES: Final = GuidanceKind(
    value=FollowLane,
    title="Lanes",
    hint="Click the lane that the agent should reach",
    icon="M4.5 17V3M15.5 17V3M10 16.5V5M7.5 7.5 10 5l2.5 2.5",
    asks=lambda _: "follow these lanes",
    outcome=_lane_outcome,
    check=_lane_problems,
    clash=_path_clash,
    leads=True,
    tool=Tool("click", "click the lane that it should reach.", draw=FollowLane.drawn),
    shape="path",
    points_m=FollowLane.points_m,
)
