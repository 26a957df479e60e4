"""Kinds of terms on speeds: a target, a limit, a stop line, comfortable accelerations."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.analysis.guidance.guidance_kind import (
    LIMIT_BRAKING_MPS2,
    MAX_BRAKING_MPS2,
    OBEYED,
    Driven,
    Found,
    GuidanceKind,
    Measured,
    Plan,
    Tool,
    of_several,
)
from pd_editor.analysis.guidance.kinds.course import (
    LANE_REACH_M,
    GoalPoint,
    check_points,
    cross_line,
    crossing,
    lane_kinds,
    length_m,
    moved_points,
    overrun_m,
    rounded,
)
from pd_editor.analysis.metrics.motion import kinematics
from pd_editor.analysis.metrics.traffic_view import generated_traffic
from pd_editor.base.errors import EditError
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, MOTOR_VEHICLE_KINDS
from pd_editor.scene.guidance_terms import (
    AgentGuidance,
    AgentsGuidance,
    Form,
    GuidanceTerm,
    Motion,
    Point,
    agents_in_words,
)
from pd_editor.scene.paths.driving_paths import SPACING_M
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import FASTEST_MPS, FIRM_ACCELERATION_MPS2, STANDING_MPS


def usual_speed_mps(scenario: Scenario, agent_ids: tuple[str, ...]) -> float:
    """Mean speed of the agents now, to half a metre per second."""
    agents, step = scenario.agents, scenario.current_step
    rows = agents.rows(agent_ids)
    rows = rows[agents.is_valid[rows, step]]
    if not len(rows):
        return 8.0
    speed = float(np.hypot(*agents.velocity_mps[rows, step].T).mean())
    return round(2 * speed) / 2


@dataclass(frozen=True, kw_only=True)
class StopAtLine(AgentGuidance):
    """Stop in front of a line that is given by its two ends."""

    kind: ClassVar[str] = "stop-at-line"
    noun: ClassVar[str] = "stop line"

    line_m: tuple[Point, Point]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_points(self, self.line_m)
        if not 0.5 <= length_m(self.line_m) <= 100.0:
            raise EditError(
                f"A stop line is {length_m(self.line_m):g} m long; expected 0.5 to "
                "100 m."
            )

    def moved(self, motion: Motion) -> "StopAtLine":
        """The term with moved ends."""
        first, last = moved_points(self.line_m, motion)
        return replace(self, line_m=(first, last))

    @classmethod
    def drawn(
        cls, scenario: Scenario, agent_id: str, points_m: Float[np.ndarray, "1 2"]
    ) -> "StopAtLine":
        """Stop line of an agent across the lane nearest to a point.

        Raises:
            EditError: no lane is near.
        """
        found = cross_line(
            scenario.road_map,
            points_m[0],
            kinds=lane_kinds(scenario, agent_id),
            max_distance_m=LANE_REACH_M,
        )
        if found is None:
            raise EditError("There is no lane here to stop on; click a lane.")
        first, last = (rounded(point) for point in found[0])
        return cls(agent_id=agent_id, line_m=(first, last))


def _stop_problems(term: StopAtLine, plan: Plan) -> Found:
    (agent,) = plan.agents((term.agent_id,))
    line = np.array(term.line_m)
    found = [crossing(path, line) for path in agent.paths_m]
    places = [(one[0] + one[1]) * SPACING_M for one in found if one is not None]
    if not places:
        yield (
            f"The stop line of {agent.name} crosses none of the paths that it could "
            "take; put it across its lane."
        )
        return
    ahead = max(places) - float(plan.scenario.agents.size_m[agent.row, 0]) / 2
    needed = agent.speed_mps**2 / (2 * max(ahead, 0.01))
    if ahead <= 0:
        yield (
            f"The front of {agent.name} is on its stop line already; put the line "
            "further ahead."
        )
    elif needed > MAX_BRAKING_MPS2:
        yield (
            f"To stop at its line in {ahead:.0f} m, {agent.name} would have to brake with "
            f"{needed:.1f} m/s² from {agent.speed_mps:.1f} m/s; put the line further "
            "ahead."
        )


def _stop_clash(
    term: StopAtLine, other: GuidanceTerm, shared: str | None, plan: Plan
) -> Found:
    """Whether the straight way to a goal crosses the line where the agent stops."""
    goal = _there(other, plan)
    if shared and goal is not None:
        (agent,) = plan.agents((goal.agent_id,))
        way = shapely.LineString([agent.position_m, goal.point_m])
        if way.intersects(shapely.LineString(term.line_m)):
            yield (
                f"The goal of {agent.name} lies beyond the line where it stops; remove "
                "one of the two."
            )


def _there(term: GuidanceTerm, plan: Plan) -> GoalPoint | None:
    """A goal of an agent that is in the scenario."""
    if isinstance(term, GoalPoint) and term.agent_id in plan.scenario.agents.row_of:
        return term
    return None


def _stop_outcome(term: StopAtLine, driven: Driven) -> Measured | None:
    (row,) = driven.rows
    sample = driven.sample
    beyond = overrun_m(
        sample.position_m[row],
        sample.heading_rad[row],
        sample.size_m[row],
        np.array(term.line_m),
    )
    speed = float(driven.speed_mps()[row, -1])
    stands = speed < 2 * STANDING_MPS
    # An agent that has not come to the line yet can still stop before it, or cannot.
    overrun = beyond if stands else beyond + speed**2 / (2 * MAX_BRAKING_MPS2)
    stops = overrun <= (OBEYED.overrun_m if stands else 0.0)
    if not np.isfinite(beyond):
        achieved = "passes beside the line"
    elif beyond > OBEYED.overrun_m:
        achieved = f"crosses it by {beyond:.1f} m"
        overrun = beyond
    else:
        state = "stands" if stands else f"rolls with {speed:.1f} m/s"
        achieved = f"{state} {max(-beyond, 0.0):.1f} m before it"
        if not stops:
            achieved += ", too fast to stop there"
    return Measured(
        asked="stops before the line",
        achieved=achieved,
        error=max(overrun, 0.0) if np.isfinite(beyond) else 0.0,
        unit="m",
        is_obeyed=bool(stops),
        has_no_case=not np.isfinite(beyond),
    )


STOP: Final = GuidanceKind(
    value=StopAtLine,
    title="Stop at a line",
    short_title="Stop line",
    hint="Click the lane where the agent should stop (B)",
    icon="M7 2.5h6L17.5 7v6L13 17.5H7L2.5 13V7zM6 10h8",
    asks=lambda _: "stop at this line",
    outcome=_stop_outcome,
    check=_stop_problems,
    clash=_stop_clash,
    tool=Tool(
        "click",
        "click the lane where it should stop.",
        "Set a stop line",
        "B",
        draw=StopAtLine.drawn,
    ),
    shape="line",
    points_m=lambda term, _: term.line_m,
)


@dataclass(frozen=True, kw_only=True)
class TargetSpeed(AgentsGuidance):
    """Reach and keep a speed, within comfortable accelerations."""

    kind: ClassVar[str] = "target-speed"

    speed_mps: Annotated[
        float, Form("Speed", "speed", unit="m/s", least=0.0, most=FASTEST_MPS)
    ]


def _speed_problems(term: TargetSpeed, plan: Plan) -> Found:
    for agent in plan.agents(term.agent_ids):
        change = term.speed_mps - agent.speed_mps
        rate = FIRM_ACCELERATION_MPS2 if change > 0 else MAX_BRAKING_MPS2
        if abs(change) > rate * agent.duration_s:
            reached = agent.speed_mps + np.sign(change) * rate * agent.duration_s
            yield (
                f"{agent.subject} drives {agent.speed_mps:.1f} m/s and reaches at most "
                f"{max(reached, 0.0):.1f} m/s in {agent.duration_s:.1f} s, not "
                f"{term.speed_mps:g}; ask for less."
            )


def _speed_clash(
    term: TargetSpeed, other: GuidanceTerm, shared: str | None, _plan: Plan
) -> Found:
    if not shared:
        return
    speed = term.speed_mps
    if isinstance(other, TargetSpeed) and abs(speed - other.speed_mps) > 0.1:
        yield (
            f"{shared} is asked for {other.speed_mps:g} and for {speed:g} m/s; keep one "
            "of the target speeds."
        )
    elif isinstance(other, SpeedLimit) and speed > other.speed_mps:
        yield (
            f"{shared} is asked for {speed:g} m/s above its speed limit of "
            f"{other.speed_mps:g} m/s; lower one or raise the other."
        )
    elif isinstance(other, StopAtLine) and speed > 0:
        yield (
            f"{shared} is asked to keep {speed:g} m/s and to stop at a line; keep one of "
            "both."
        )


def _speed_outcome(term: TargetSpeed, driven: Driven) -> Measured | None:
    speed = driven.speed_mps()[driven.rows]
    if not term.agent_ids:
        # Stationary agents are not moved unless they are named.
        speed = speed[speed.max(axis=1, initial=0.0) > STANDING_MPS]
    if not len(speed):
        return None
    # Time at the end over which a target speed is measured.
    last = speed[:, -max(round(1.0 / driven.step_s), 1) :].mean(axis=1)
    worst = last[int(np.abs(last - term.speed_mps).argmax())]
    error = float(abs(worst - term.speed_mps))
    return Measured(
        asked=f"{term.speed_mps:.1f} m/s over the last second",
        achieved=of_several(len(last), f"{worst:.1f} m/s"),
        error=error,
        unit="m/s",
        is_obeyed=error <= OBEYED.speed_mps,
    )


TARGET: Final = GuidanceKind(
    value=TargetSpeed,
    title="Target speed",
    short_title="Speed",
    hint="Reach and keep a speed",
    icon="M3.7 15a7.3 7.3 0 1 1 12.6 0M10 12l3.4-4.4",
    asks=lambda term: f"drive at {term.speed_mps:g} m/s",
    outcome=_speed_outcome,
    agents=MOTOR_VEHICLE_KINDS,
    check=_speed_problems,
    clash=_speed_clash,
    usual=lambda scenario, ids: TargetSpeed(
        agent_ids=ids, speed_mps=usual_speed_mps(scenario, ids)
    ),
)


@dataclass(frozen=True, kw_only=True)
class SpeedLimit(AgentsGuidance):
    """Do not exceed a speed."""

    kind: ClassVar[str] = "speed-limit"

    speed_mps: Annotated[
        float, Form("Speed", "speed", unit="m/s", least=0.5, most=FASTEST_MPS)
    ]


def _limit_problems(term: SpeedLimit, plan: Plan) -> Found:
    for agent in plan.agents(term.agent_ids):
        if agent.speed_mps - term.speed_mps > MAX_BRAKING_MPS2 * agent.duration_s:
            yield (
                f"{agent.subject} drives {agent.speed_mps:.1f} m/s and cannot brake to "
                f"{term.speed_mps:g} m/s in {agent.duration_s:.1f} s."
            )


def _limit_clash(
    term: SpeedLimit, other: GuidanceTerm, shared: str | None, plan: Plan
) -> Found:
    """Whether a goal is farther than an agent gets at its speed limit."""
    goal = _there(other, plan)
    if not shared or goal is None:
        return
    (agent,) = plan.agents((goal.agent_id,))
    time_s = agent.duration_s if goal.at_s is None else goal.at_s
    time_s = min(time_s, agent.duration_s)
    # An agent that is faster now brakes to the limit first.
    excess = max(agent.speed_mps - term.speed_mps, 0.0)
    braking_s = min(excess / MAX_BRAKING_MPS2, time_s)
    most = term.speed_mps * time_s + excess * braking_s / 2
    distance = float(np.hypot(*(np.array(goal.point_m) - agent.position_m)))
    # Goals may be so much farther than an agent gets.
    if distance > most + 0.5:
        yield (
            f"The goal of {agent.name} is {distance:.0f} m away, and at its speed limit "
            f"of {term.speed_mps:g} m/s it gets at most {most:.0f} m far in "
            f"{time_s:.1f} s; move the goal nearer or raise the limit."
        )


def _limit_outcome(term: SpeedLimit, driven: Driven) -> Measured | None:
    speed = driven.speed_mps()[driven.rows]
    allowed = allowed_mps(term.speed_mps, speed, driven.step_s)
    excess = speed - allowed
    worst = float(excess.max())
    is_obeyed = worst <= OBEYED.speed_mps
    row, step = np.unravel_index(excess.argmax(), excess.shape)
    achieved, start = f"at most {speed[row, step]:.1f} m/s", speed[row, 0]
    if is_obeyed:
        achieved = _slowed_to(term.speed_mps, speed, allowed)
    elif start > term.speed_mps:
        achieved += f", {worst:.1f} more than braking from {start:.1f} m/s allows"
    return Measured(
        asked=f"at most {term.speed_mps:.1f} m/s",
        achieved=of_several(len(driven.rows), achieved),
        error=max(worst, 0.0),
        unit="m/s",
        is_obeyed=is_obeyed,
    )


def _slowed_to(
    limit_mps: float,
    speed_mps: Float[np.ndarray, "G S"],
    allowed_mps: Float[np.ndarray, "G S"],
) -> str:
    """The highest speed where no time to brake is allowed, and what was braked from."""
    bound = speed_mps[allowed_mps <= limit_mps]
    fastest = float(speed_mps[:, 0].max())
    if not bound.size:
        return f"still braking from {fastest:.1f} m/s at the end"
    top = f"at most {bound.max():.1f} m/s"
    return top if fastest <= limit_mps else f"{top} once braked from {fastest:.1f} m/s"


def allowed_mps(
    limit_mps: float, speed_mps: Float[np.ndarray, "G S"], step_s: float
) -> Float[np.ndarray, "G S"]:
    """Speeds that keep a limit; the time to brake from the current speed is allowed."""
    time_s = step_s * np.arange(speed_mps.shape[1])
    return np.maximum(limit_mps, speed_mps[:, :1] - LIMIT_BRAKING_MPS2 * time_s)


LIMIT: Final = GuidanceKind(
    value=SpeedLimit,
    title="Speed limit",
    hint="Do not exceed a speed",
    icon="M10 2.5a7.5 7.5 0 1 1 0 15a7.5 7.5 0 1 1 0-15"
    "M10 6.3a3.7 3.7 0 1 1 0 7.4a3.7 3.7 0 1 1 0-7.4",
    asks=lambda term: f"at most {term.speed_mps:g} m/s",
    outcome=_limit_outcome,
    check=_limit_problems,
    clash=_limit_clash,
    usual=lambda scenario, ids: SpeedLimit(
        agent_ids=ids, speed_mps=max(usual_speed_mps(scenario, ids), 1.0)
    ),
)


def _acceleration(label: str, noun: str) -> Form:
    return Form(label, noun, unit="m/s\u00b2", least=0.2, most=12.0, step=0.1)


@dataclass(frozen=True, kw_only=True)
class ComfortLimits(AgentsGuidance):
    """Do not exceed accelerations forwards, backwards and to the sides."""

    kind: ClassVar[str] = "comfort-limits"
    noun: ClassVar[str] = "comfort limit"

    max_acceleration_mps2: Annotated[
        float, _acceleration("Speed up", "acceleration")
    ] = 2.5
    max_braking_mps2: Annotated[float, _acceleration("Brake", "braking")] = 3.5
    max_lateral_mps2: Annotated[
        float, _acceleration("Sideways", "lateral acceleration")
    ] = 3.0

    @property
    def in_words(self) -> str:
        """Name of the term with its agents."""
        return f"comfort limits of {agents_in_words(self.agent_ids)}"


def _comfort_outcome(term: ComfortLimits, driven: Driven) -> Measured | None:
    motion = kinematics(generated_traffic(driven.scenario, driven.sample))
    rows = driven.rows
    along, across = motion.longitudinal_mps2[rows], np.abs(motion.lateral_mps2[rows])
    excess = {
        "acceleration": along.max(axis=1) - term.max_acceleration_mps2,
        "braking": -along.min(axis=1) - term.max_braking_mps2,
        "lateral acceleration": across.max(axis=1) - term.max_lateral_mps2,
    }
    what = max(excess, key=lambda name: excess[name].max())
    error = max(float(excess[what].max()), 0.0)
    worst = driven.sample.ids[rows[excess[what].argmax()]]
    return Measured(
        asked=(
            f"at most {term.max_acceleration_mps2:.1f} forwards, "
            f"{term.max_braking_mps2:.1f} braking, {term.max_lateral_mps2:.1f} m/s² "
            "sideways"
        ),
        achieved="within all" if error == 0 else f"{error:.1f} m/s² more {what}",
        error=error,
        unit="m/s²",
        is_obeyed=error <= OBEYED.acceleration_mps2,
        worst_id=worst if error > 0 else None,
    )


COMFORT: Final = GuidanceKind(
    value=ComfortLimits,
    title="Comfort limits",
    short_title="Comfort",
    hint="Limit the accelerations",
    icon="M2.8 11.5c2.4-5 4.8-5 7.2 0s4.8 5 7.2 0",
    asks=lambda _: "drive comfortably",
    outcome=_comfort_outcome,
    agents=LANE_FOLLOWER_KINDS,
)
