"""Roll-outs: from a scene and its present, the world steps on in windows.

In each window the traffic is generated from where it is, given the plans of driven
agents; its first second or so becomes what has happened.
"""

from collections.abc import Callable, Collection, Generator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.guidance.guidance_kind import AgentNow
from pd_editor.analysis.guidance.kinds.course import LANE_REACH_M, GoalPoint, nearest_on
from pd_editor.analysis.guidance.kinds.path import FollowLane, FollowPath
from pd_editor.analysis.guidance.report import term_outcomes
from pd_editor.base.errors import GenerationError
from pd_editor.base.foreign_code import asked
from pd_editor.editor.commands import ContinueScene
from pd_editor.editor.commands.roll_out import with_length
from pd_editor.experiments.closed_loop.world import HORIZON, Entrances, World
from pd_editor.experiments.work_engine.work_engine import time_limit
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.generation import (
    GenerationProgress,
    GenerationRequest,
    NoiseDrift,
    ScenarioGenerator,
    guidance_settings,
    supported_by,
)
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.guidance_terms import (
    GuidanceTerm,
    Point,
    TermOutcome,
    terms_without,
)
from pd_editor.scene.paths.candidate_grid import Role, Start, plan_paths
from pd_editor.scene.paths.driving_paths import velocity_of
from pd_editor.scene.paths.lasting_tracks import lasting
from pd_editor.scene.policy import (
    LEAST_PLAN_S,
    Observation,
    PlanEndError,
    Policy,
    checked_plan,
)
from pd_editor.scene.prediction import history
from pd_editor.scene.roles.traffic_choice import trajectory_locked_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_limits import MAX_STATES, MAX_STEPS
from pd_editor.scene.traffic_sample import TrafficSample

_HERE_M: Final = 2.0
_TO_GOAL_M: Final = 15.0
"""Way on which an agent leaves its path for a goal beside it."""


def guidance_now(
    world: World, window: Scenario, agent_ids: Collection[str]
) -> tuple[GuidanceTerm, ...]:
    """What is left of the terms of a roll-out for the agents that are generated now.

    A goal beyond the horizon becomes a path at a pace that gets there in time, unless
    something else leads its agent before.
    """
    scenario, there = world.scenario, set(window.agents.ids)
    gone = [name for name in scenario.agents.ids if name not in there]
    horizon_s = HORIZON * scenario.time_axis.step_s
    found: list[GuidanceTerm] = []
    far: list[GoalPoint] = []
    for term in terms_without(scenario.guidance, gone):
        ids = term.guided_ids
        if not term.is_in_force or (ids and not set(ids).intersection(agent_ids)):
            continue
        asked = term
        if isinstance(term, GoalPoint) and term.at_s is None:
            end = world.last_step - scenario.current_step
            asked = replace(term, at_s=end * scenario.time_axis.step_s)
        left = scenario.later_term(asked, world.step)
        if isinstance(left, GoalPoint) and (left.at_s or 0.0) > horizon_s:
            far.append(left)
        elif left is not None:
            found.append(left)
    leads = (GoalPoint, FollowPath, FollowLane)
    led = {one.agent_id for one in found if isinstance(one, leads)}
    for goal in sorted(far, key=lambda one: one.at_s or 0.0):
        way = None if goal.agent_id in led else _way_to(goal, window, horizon_s)
        led.add(goal.agent_id)
        found += [] if way is None else [way]
    return tuple(found)


def guidance_outcomes(
    before: Scenario, after: Scenario, driven: Collection[str]
) -> tuple[TermOutcome, ...]:
    """What a roll-out achieved of the guidance that it began with.

    Terms of agents that have left are judged up to then, those of all agents by the ones
    that stay. ``driven`` agents are not guided.
    """
    terms = [term for term in before.guidance if term.is_in_force]
    if not terms:
        return ()
    agents, now = after.agents, after.current_step
    kept = trajectory_locked_ids(before).union(driven)
    guided = agents.is_valid[:, now] & agents.kind_mask(ROAD_USER_KINDS)
    rows = np.flatnonzero(guided & ~np.isin(agents.ids, list(kept)))
    there = agents.is_valid[rows, now:]
    count = np.where(there.all(axis=1), there.shape[1], there.argmin(axis=1))
    lasts = dict(zip((agents.ids[row] for row in rows), count.tolist(), strict=True))
    found: list[TermOutcome] = []
    for term in terms:
        own = [lasts[name] for name in term.guided_ids if name in lasts]
        num_steps = min(own, default=there.shape[1])
        some = rows[count >= num_steps]
        steps = slice(now, now + num_steps)
        sample = TrafficSample.of(agents.taken(some).cut_to(steps))
        part = with_length(after, agents.cut_to(slice(now + num_steps)))
        (one,) = term_outcomes(part, sample, (term,))
        if num_steps < there.shape[1]:
            told = f"; left the map at {num_steps * after.time_axis.step_s:.1f} s"
            one = replace(one, achieved=one.achieved + told)
        found.append(one)
    return tuple(found)


def _way_to(
    goal: GoalPoint, window: Scenario, horizon_s: float
) -> FollowPath | GoalPoint | None:
    """The planned path to a goal, at which the agent is to be in time; None without one.

    An agent that is there stays.
    """
    row = window.agents.row_of[goal.agent_id]
    agent = AgentNow(scenario=window, row=row, lasts_s=goal.at_s)
    along, beside = nearest_on(agent.paths_m, np.array(goal.point_m))
    best = int((beside + np.maximum(-along, 0.0)).argmin())
    if beside[best] > LANE_REACH_M or along[best] < -_HERE_M:
        return None
    if along[best] < _HERE_M:
        return replace(goal, at_s=horizon_s)
    path = agent.paths_m[best]
    before = path[1:][arc_length(path)[1:] < along[best] - _TO_GOAL_M]
    points = (*map(_point, (path[0], *before)), goal.point_m)
    return FollowPath(
        agent_id=goal.agent_id,
        points_m=points,
        times_s=(*(None for _ in points[1:]), goal.at_s),
        weight=goal.weight,
    )


def _point(point_m: Float[np.ndarray, "2"]) -> Point:
    return float(point_m[0]), float(point_m[1])


MAX_DURATION_S: Final = 90.0
_NEW_NOISE_S: Final = 1.0
"""Time after which the noise of an agent is independent of what it was. With 4 s, more
agents stopped, and queues grew."""
_ROUTE_SPACING_M: Final = 1.0


@dataclass(frozen=True, kw_only=True)
class RollOutRequest:
    """What to roll out."""

    scenario: Scenario
    duration_s: float = 30.0
    replan_s: float = 1.0
    """Time between two generations of the traffic."""
    policies: Mapping[str, Policy] = field(default_factory=dict)
    """Who drives which agent."""
    keeps_density: bool = True
    """Whether vehicles and people enter for those that leave the map."""
    answer_s: float | None = 20.0
    """Most time that a policy may take for one answer; None: as long as it likes."""
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.scenario.road_map.lanes:
            raise GenerationError(
                "The scene has no lanes; traffic needs some to be rolled out on."
            )
        step_s = self.scenario.time_axis.step_s
        for what, value, least, most in (
            ("duration", self.duration_s, LEAST_PLAN_S, MAX_DURATION_S),
            ("time between two generations", self.replan_s, LEAST_PLAN_S, 3.0),
        ):
            if not least <= value <= most:
                raise GenerationError(
                    f"The {what} is {value:g} s; expected {least:g} to {most:g} s."
                )
        steps = self.scenario.current_step + 1 + round(self.duration_s / step_s)
        count = len(self.scenario.agents)
        if steps > MAX_STEPS or steps * count > MAX_STATES:
            raise GenerationError(
                f"There would be {count} agents over {steps} steps; at most {MAX_STEPS}"
                f" steps and {MAX_STATES} states are possible."
            )
        agents, now = self.scenario.agents, self.scenario.current_step
        for name in self.policies:
            if not agents.is_valid[agents.rows([name])[0], now]:
                raise GenerationError(
                    f"Agent {name} is not there at the current step, so no policy can "
                    "drive it."
                )
            lock = self.scenario.locks.get(name)
            if lock is not None and lock.keeps != "state":
                raise GenerationError(
                    f"The {lock.in_words} of agent {name} is locked, so no policy can "
                    "drive it; unlock the agent."
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class RollOut:
    """What has happened, and which policies ended before."""

    command: ContinueScene
    """The edit that makes the scene go on so."""
    scenario: Scenario
    ended: Mapping[str, str]
    """Who was not driven to the end, when and why, by the id of the agent."""
    failed: frozenset[str]
    """Agents whose policies failed; the others left the map, or had no further plan."""
    num_entered: int
    guidance: tuple[TermOutcome, ...]
    """What was achieved of the scene's guidance."""
    plans_m: Mapping[str, Mapping[int, Float[np.ndarray, "F 2"]]]
    """Where each driven agent was to go, by the step at which its policy planned it."""


def roll_out(
    request: RollOutRequest, generator: ScenarioGenerator
) -> Generator[GenerationProgress, None, RollOut]:
    """Yield progress after each window, and return what has happened.

    A policy that fails ends its own drive alone: its agent leaves the scene.

    Raises:
        GenerationError: a window cannot be generated.
        ModelError: the weights cannot be used.
    """
    rolling = Rolling.started(request, generator)
    while not rolling.is_over:
        yield from rolling.next_steps()
    return rolling.result()


@dataclass(kw_only=True, eq=False)
class Rolling:
    """A roll-out on its way; ``next_steps`` takes it to the next question to policies."""

    request: RollOutRequest
    generator: ScenarioGenerator
    world: World
    drivers: "_Drivers"
    entrances: Entrances
    random: np.random.Generator
    num_entered: int = 0

    @classmethod
    def started(
        cls, request: RollOutRequest, generator: ScenarioGenerator
    ) -> "Rolling":
        """At the current step, with policies that have been reset."""
        num_steps = round(request.duration_s / request.scenario.time_axis.step_s)
        world = World.beginning(request.scenario, num_steps, request.seed)
        drivers = _Drivers.started(request, world)
        return cls(
            request=request,
            generator=generator,
            world=world.without(drivers.ended),
            drivers=drivers,
            entrances=Entrances.of(world),
            random=np.random.default_rng([request.seed, request.scenario.current_step]),
        )

    @property
    def is_over(self) -> bool:
        """Whether the time is over."""
        return self.world.step >= self.world.last_step

    def observation(self, agent_id: str) -> Observation:
        """What the policy of an agent may know now."""
        return self.drivers.observation(self.world, agent_id)

    def next_steps(self) -> Generator[GenerationProgress, None, None]:
        """Ask the policies, generate the traffic if it is time to, and step on.

        Raises:
            GenerationError: the window cannot be generated.
            ModelError: the weights cannot be used.
        """
        request, axis = self.request, self.request.scenario.time_axis
        replan, replans = (
            round(seconds / axis.step_s) for seconds in (LEAST_PLAN_S, request.replan_s)
        )
        begun = self.world.step - axis.current_step
        self.world = self.drivers.planned(self.world)
        if begun % replans == 0:
            yield from self._generate()
        to_replan = replans - begun % replans
        steps = min(replan if self.drivers.policies else replans, to_replan)
        self.world = self.world.after(
            min(steps, self.world.last_step - self.world.step)
        )
        self.drivers.leave(self.world)

    def _generate(self) -> Generator[GenerationProgress, None, None]:
        """Plan the traffic anew; vehicles and people enter where there is room."""
        request, world = self.request, self.world
        enters = request.keeps_density and "new-agents" in supported_by(self.generator)
        wanted = self.entrances.wanted(world, self.random) if enters else None
        sample = yield from _generated(
            request, self.generator, world, self.drivers, self.entrances, wanted
        )
        if sample is not None:
            sample = self.entrances.entering(world.with_fresh_ids(sample), world)
            known = world.scenario.agents.row_of
            self.num_entered += sum(name not in known for name in sample.ids)
            self.world = world.planned(world.turning_on(sample))

    def result(self) -> RollOut:
        """What has happened up to now."""
        request = self.request
        command = ContinueScene(
            motion=self.world.motion_from(request.scenario.current_step),
            generator=self.generator.name,
            seed=request.seed,
            replan_s=request.replan_s,
            policies={name: one.name for name, one in request.policies.items()},
        )
        scenario = command.apply(request.scenario)
        return RollOut(
            command=command,
            scenario=scenario,
            guidance=guidance_outcomes(request.scenario, scenario, request.policies),
            ended=self.drivers.ended,
            failed=frozenset(self.drivers.failed),
            num_entered=self.num_entered,
            plans_m=self.drivers.plans_m,
        )


def _generated(
    request: RollOutRequest,
    generator: ScenarioGenerator,
    world: World,
    drivers: "_Drivers",
    entrances: Entrances,
    wanted: tuple | None,
) -> Generator[GenerationProgress, None, TrafficSample | None]:
    """The traffic of a window; None if nobody is there."""
    ids = world.generated_ids(tuple(drivers.policies))
    if not ids and wanted is None:
        return None
    scenario = lasting(world.window(), (*drivers.policies, *world.replayed))
    scenario = replace(scenario, guidance=guidance_now(world, scenario, ids))
    region, numbers = wanted or (None, {})
    seconds, total = world.elapsed_s, request.duration_s
    asked_for = GenerationRequest(
        scenario=scenario,
        agent_ids=ids,
        num_new_agents=numbers,
        region=region,
        moving_share=1.0 if numbers else None,
        admits=entrances.coming_in if numbers else None,
        only_on_road=bool(numbers),
        back_casts=False,
        guidance=guidance_settings(None, 1),
        reports_cost=False,
        seed=request.seed,
        drift=NoiseDrift(ids=world.scenario.agents.ids, place=seconds / _NEW_NOISE_S),
    )
    steps = generator.generate(asked_for)
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return stop.value.samples[0]
        yield GenerationProgress(
            fraction=seconds / total, message=f"{seconds:.0f} of {total:g} s"
        )


@dataclass(kw_only=True, eq=False)
class _Drivers:
    """Policies that still drive, with their routes."""

    policies: dict[str, Policy]
    routes_m: dict[str, Float[np.ndarray, "N 2"]]
    first_step: int
    answer_s: float | None
    ended: dict[str, str] = field(default_factory=dict)
    failed: set[str] = field(default_factory=set)
    plans_m: dict[str, dict[int, Float[np.ndarray, "F 2"]]] = field(
        default_factory=dict
    )

    @classmethod
    def started(cls, request: RollOutRequest, world: World) -> "_Drivers":
        """Policies that have been reset."""
        scenario = request.scenario
        drivers = cls(
            policies={},
            routes_m={},
            first_step=world.step,
            answer_s=request.answer_s,
        )
        for name, policy in request.policies.items():
            route = route_of(scenario, name)
            drivers.routes_m[name] = route
            reset = partial(policy.reset, scenario, name, route, request.seed)
            try:
                drivers.asked_in_time(reset, policy, " could not be reset")
            except GenerationError as error:
                drivers.end(name, world, error)
            else:
                drivers.policies[name] = policy
        return drivers

    def planned(self, world: World) -> World:
        """With new plans of all of them; those that fail leave the scene."""
        samples: list[TrafficSample] = []
        for name, policy in list(self.policies.items()):
            seen = self.observation(world, name)
            ask = partial(policy.plan, seen)
            try:
                answer = self.asked_in_time(ask, policy, " failed")
                plan = checked_plan(answer, seen, policy.name)
            except GenerationError as error:
                self.end(name, world, error)
                world = world.without([name])
                continue
            position = np.concatenate([seen.ego.position_m[:, -1], plan.position_m])
            self.plans_m.setdefault(name, {})[world.step] = position
            heading = np.append(seen.ego.heading_rad[0, -1], plan.heading_rad)
            velocity = velocity_of(
                position[None], seen.ego.velocity_mps[:, -1], seen.step_s
            )
            motion = (position[None], heading[None], velocity)
            samples.append(
                TrafficSample.of(seen.ego, (one[:, : HORIZON + 1] for one in motion))
            )
        for one in samples:
            world = world.planned(one)
        return world

    def leave(self, world: World) -> None:
        """End the drives of agents that have left the map."""
        agents = world.scenario.agents
        for name in list(self.policies):
            if not agents.is_valid[agents.row_of[name], world.step]:
                self.end(name, world)

    def end(
        self, name: str, world: World, error: GenerationError | None = None
    ) -> None:
        """End the drive of an agent, which left the map unless there is an error."""
        self.policies.pop(name, None)
        seconds = (world.step - self.first_step) * world.scenario.time_axis.step_s
        if error is None:
            self.ended[name] = f"{name} left the mapped road at {seconds:.1f} s."
            return
        self.ended[name] = f"{name} at {seconds:.1f} s: {error}"
        if not isinstance(error, PlanEndError):
            self.failed.add(name)

    def asked_in_time(
        self, ask: Callable[[], object], policy: Policy, failed: str
    ) -> object:
        """What a policy answers.

        Raises:
            GenerationError: it failed, or took too long.
        """

        def answer() -> object:
            with time_limit(self.answer_s):
                return ask()

        return asked(answer, f"The policy {policy.name}", failed)

    def observation(self, world: World, name: str) -> Observation:
        """What the policy of an agent may know now."""
        scenario = world.scenario
        agents, count = scenario.agents, world.step + 1
        row = agents.row_of[name]
        others = world.is_present()
        others[row] = False
        step_s = scenario.time_axis.step_s
        return Observation(
            ego=history(agents.taken([row]), count),
            others=history(agents.taken(others), count),
            road_map=scenario.road_map,
            route_m=self.routes_m[name],
            step_s=step_s,
            time_s=(world.step - self.first_step) * step_s,
            signals=tuple(
                replace(one, states=one.states[:count].copy())
                for one in scenario.signals
            ),
        )


def route_of(scenario: Scenario, agent_id: str) -> Float[np.ndarray, "N 2"]:
    """The agent's recorded way from now on, then the natural path along lanes."""
    agents, now = scenario.agents, scenario.current_step
    row = agents.row_of[agent_id]
    known = now + np.flatnonzero(agents.is_valid[row, now:])
    way = agents.position_m[row, known]
    # A track that stands would turn about itself.
    along = arc_length(way)
    moves = np.diff(np.floor(along / _ROUTE_SPACING_M), prepend=-1) > 0
    start = Start.at(agents, int(known[-1]), np.array([row]))
    # Time for which a route goes on beyond what is recorded.
    plans = plan_paths(scenario.road_map, start, 12.0)
    path = np.flatnonzero(plans.role == Role.MAIN)
    path = int(path[0]) if len(path) else int(np.argmin(plans.role))
    points = plans.paths.points_m[path]
    return np.concatenate([way[moves], points[1:]])
