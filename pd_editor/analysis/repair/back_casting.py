"""Back-casting: a made-up past for agents whose states were sampled or placed.

Plans run backwards in time along the reversed lanes, with the acceleration of the agent's
future at the current step. Each agent gets its first plan that stays on the road, turns no
harder than vehicles do and overlaps no other agent; without one it enters the scene as
late as its best one says.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import overlaps_of_pairs
from pd_editor.analysis.metrics.motion import COMFORT, MAX_CURVATURE_PER_M, TURNING_MPS
from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, Activity
from pd_editor.scene.agent_states import MOTION, STEPPED
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import heading_of, left_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.oriented_box import BoxStates
from pd_editor.scene.geometry.path_pieces import bounds_m, rectangles_meet
from pd_editor.scene.paths.candidate_grid import PlannedPaths, Role, Start, plan_paths
from pd_editor.scene.paths.driving_paths import SPACING_M, velocity_of
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS
from pd_editor.scene.traffic_sample import MadeUpPast

MEAN_ACCELERATION_MPS2: Final = 0.35
STD_ACCELERATION_MPS2: Final = 0.75
"""Acceleration of moving vehicles over the 5 s of recorded pasts (``train``)."""
STD_WALKING_MPS2: Final = 0.08
MAX_JOIN_MPS2: Final = 6.0
"""Larger accelerations at the current step are not continued into the past."""
_FASTEST_MPS: Final = 17.0
_OTHERS_MPS2: Final = (0.0, 0.8, -0.8, 1.6, -1.6, 2.4)
"""Changes of the drawn acceleration that are tried on the most natural path."""
_BRANCHES_MPS2: Final = (0.0, 0.8, -0.8)
_ARRIVALS: Final = ((2.5, 1.6), (1.2, 1.2), (0.4, 2.0))
"""Time since its stop (s), and braking before it, of a vehicle that has arrived."""
_ROAD_STRIDE: Final = 4


def made_up_past(
    scenario: Scenario, rows: Int[np.ndarray, "G"], seed: int
) -> MadeUpPast:
    """A past, up to the scenario's current step, of the agents at ``rows``.

    Their tracks before that step are not used; all other agents are obstacles. Position,
    heading and velocity are continuous at the current step, and so is the acceleration
    of moving agents that have a future.
    """
    plans = _Plans.of(scenario, rows, np.random.default_rng(seed))
    chosen, num_steps = _chosen(scenario, rows, plans)
    position, heading = plans.position_m[chosen], plans.heading_rad[chosen]
    velocity = -velocity_of(
        position,
        -scenario.agents.velocity_mps[rows, scenario.current_step],
        scenario.time_axis.step_s,
    )
    steps = np.arange(scenario.current_step, 0, -1)
    exists = steps <= num_steps[:, None]
    return MadeUpPast(
        ids=tuple(scenario.agents.ids[row] for row in rows),
        num_steps=tuple(num_steps.tolist()),
        position_m=(position[:, steps] * exists[..., None]).astype(np.float32),
        heading_rad=(heading[:, steps] * exists).astype(np.float32),
        velocity_mps=(velocity[:, steps] * exists[..., None]).astype(np.float32),
    )


def with_past(
    agents: AgentTracks, rows: Int[np.ndarray, "G"], now: int, past: MadeUpPast | None
) -> AgentTracks:
    """Tracks in which a made-up past, or none, replaces the history of agents."""
    cut: dict[str, np.ndarray] = {}
    for name in (*STEPPED, "observed"):
        cut[name] = getattr(agents, name)[rows]
        cut[name][:, :now] = 0
    cut["observed"][:, now] = True
    slot_of = {name: slot for slot, name in enumerate(past.ids)} if past else {}
    slots = np.array([slot_of.get(agents.ids[row], -1) for row in rows], int)
    made = slots >= 0
    if past is not None:
        steps = slice(now - past.heading_rad.shape[1], now)
        for name in MOTION:
            cut[name][made, steps] = getattr(past, name)[slots[made]]
        for name in ("is_valid", "observed"):
            cut[name][made, steps] = past.exists[slots[made]]
    return agents.with_rows(rows, **cut, has_made_up_past=made)


@dataclass(frozen=True, kw_only=True, eq=False)
class _SpeedPlans:
    """C speed plans backwards in time, in order of preference for each agent."""

    path: Int[np.ndarray, "C"]
    acceleration_mps2: Float[np.ndarray, "C"]
    """Mean acceleration of a moving agent."""
    stopped_s: Float[np.ndarray, "C"]
    """Time since a standing agent stopped; infinity if it was always there."""
    braking_mps2: Float[np.ndarray, "C"]

    @classmethod
    def of(
        cls,
        plans: PlannedPaths,
        start: Start,
        is_parked: Bool[np.ndarray, "G"],
        random: np.random.Generator,
    ) -> "_SpeedPlans":
        """Plans of all agents, each on its most natural path first."""
        normal = random.standard_normal(len(start.kinds)).clip(-2.5, 2.5)
        # Share of waiting vehicles that still drove 5 s ago (``train``).
        arrives = random.random(len(start.kinds)) < 0.2
        paths: list[list[int]] = [[] for _ in start.kinds]
        wanted = (Role.MAIN, Role.BRANCH, Role.CHANGE, Role.STRAIGHT, Role.OFF_LANE)
        for path in np.flatnonzero(np.isin(plans.role, wanted)).tolist():
            paths[plans.agent[path]].append(path)
        found: list[tuple[int, float, float, float]] = []
        for agent, (kind, (main, *branches)) in enumerate(
            zip(start.kinds, paths, strict=True)
        ):
            drives = kind in LANE_FOLLOWER_KINDS
            if start.speed_mps[agent] < STANDING_MPS:
                stood = [(main, 0.0, np.inf, 1.0)]
                came = [(main, 0.0, *one) for one in _ARRIVALS]
                if not drives or is_parked[agent]:
                    came = []
                found += came + stood if arrives[agent] else stood + came
            elif not drives:
                drawn = STD_WALKING_MPS2 * normal[agent]
                found += [(main, one, np.inf, 1.0) for one in (drawn, -drawn, 0.0)]
            else:
                drawn = MEAN_ACCELERATION_MPS2 + STD_ACCELERATION_MPS2 * normal[agent]
                found += [(main, drawn + one, np.inf, 1.0) for one in _OTHERS_MPS2]
                found += [
                    (path, drawn + one, np.inf, 1.0)
                    # The last one goes straight.
                    for path in (*branches[:-1][:3], *branches[-1:])
                    for one in _BRANCHES_MPS2
                ]
        table = np.array(found).reshape(-1, 4)
        return cls(
            path=table[:, 0].astype(int),
            acceleration_mps2=np.minimum(table[:, 1], COMFORT.acceleration_mps2),
            stopped_s=table[:, 2],
            braking_mps2=table[:, 3],
        )

    def reached_m(
        self,
        plans: PlannedPaths,
        speed_mps: Float[np.ndarray, "C"],
        joined_mps2: Float[np.ndarray, "C"],
        num_steps: int,
        step_s: float,
    ) -> Float[np.ndarray, "C {num_steps}+1"]:
        """Distance back along the path at each step, from the current one on."""
        limits, stands = plans.paths.speed_limit_mps, speed_mps < STANDING_MPS
        last = limits.shape[1] - 1
        reached = np.zeros((num_steps + 1, len(self.path)))
        speed = speed_mps.copy()
        for step in range(1, num_steps + 1):
            time_s = (step - 0.5) * step_s
            # Time constant with which the acceleration at the current step gives way to
            # the mean.
            fade = np.exp(-time_s / 1.2)
            pull = joined_mps2 * fade + self.acceleration_mps2 * (1 - fade)
            # An agent that stood has always stood before.
            drives = np.where(speed > 0, speed - pull * step_s, 0.0)
            came = np.maximum(time_s - self.stopped_s, 0.0) * self.braking_mps2
            stood = speed_mps * np.exp(-time_s / 0.3)
            new = np.where(stands, np.maximum(came, stood), drives)
            cell = np.minimum(reached[step - 1] / SPACING_M, last).astype(int)
            most = np.minimum(limits[self.path, cell], _FASTEST_MPS)
            least = speed - COMFORT.acceleration_mps2 * step_s
            new = np.minimum(new, np.maximum(most, least))
            new = np.maximum(new, 0.0)
            reached[step] = reached[step - 1] + (speed + new) / 2 * step_s
            speed = new
        return np.ascontiguousarray(reached.T)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Plans:
    """C plans, in order of preference for each agent; step 0 is the current one."""

    agent: Int[np.ndarray, "C"]
    """Index into the agents that get a past."""
    position_m: Float[np.ndarray, "C P_plus_1 2"]
    heading_rad: Float[np.ndarray, "C P_plus_1"]
    size_m: Float[np.ndarray, "C 2"]
    """Size of the box that must be free."""
    num_steps: Int[np.ndarray, "C"]
    """Number of steps back until the plan leaves the road."""

    @classmethod
    def of(
        cls, scenario: Scenario, rows: Int[np.ndarray, "G"], random: np.random.Generator
    ) -> "_Plans":
        """All plans of the agents at ``rows``."""
        agents, axis = scenario.agents, scenario.time_axis
        start, count = Start.of(scenario, rows), axis.current_step
        back = replace(
            start,
            heading_rad=wrap_angle(start.heading_rad + np.pi),
            velocity_mps=-start.velocity_mps,
        )
        duration, road = count * axis.step_s, scenario.road_map.reversed
        paths = plan_paths(road, back, duration, drivers_go_straight=True)
        is_parked = agents.activity[rows] == Activity.PARKED
        plans = _SpeedPlans.of(paths, start, is_parked, random)
        agent = paths.agent[plans.path]
        velocity = start.velocity_mps[agent]
        speed, joined = start.speed_mps[agent], _joined_mps2(scenario, rows)[agent]
        ahead = velocity / np.maximum(speed, 1e-9)[:, None]
        reached = plans.reached_m(
            paths, speed, (joined * ahead).sum(axis=-1), count, axis.step_s
        )
        position, heading = _driven(paths, plans.path, reached, start)
        position += (
            _bump_m(position, velocity, joined, axis.step_s)
            * (speed >= STANDING_MPS)[:, None, None]
        )
        moves = reached[:, -1] > 1.0
        on_road = _steps_on_road(
            scenario,
            position,
            # Roads go on beyond the end of the map.
            paths.beyond_lanes_m(plans.path, reached) == 0,
            moves,
        )
        back = velocity_of(position, -velocity, axis.step_s)
        possible = _possible_steps(back, heading, joined, axis.step_s)
        straight = paths.role[plans.path] == Role.OFF_LANE
        straight &= np.isin(agent, paths.choice.agent)
        # Longest way of a driver straight back instead of along lanes, which may cross
        # others.
        most = round(2.0 / axis.step_s)
        possible[straight] = np.minimum(possible[straight], most)
        drives = agents.kind_mask(LANE_FOLLOWER_KINDS)[rows][agent]
        return cls(
            agent=agent,
            position_m=position,
            heading_rad=wrap_angle(heading + np.pi),
            size_m=agents.size_m[rows][agent] + 0.1 * moves[:, None],
            num_steps=np.where(drives, np.minimum(on_road, possible), on_road),
        )

    def boxes(self, plan: Int[np.ndarray, "K"]) -> BoxStates:
        """Boxes of some plans at the steps before the current one, the latest first."""
        steps = np.arange(1, self.heading_rad.shape[1])
        return BoxStates(
            position_m=self.position_m[plan, 1:],
            heading_rad=self.heading_rad[plan, 1:],
            size_m=self.size_m[plan],
            is_valid=steps <= self.num_steps[plan, None],
        )


def _driven(
    plans: PlannedPaths,
    path: Int[np.ndarray, "C"],
    reached_m: Float[np.ndarray, "C P_plus_1"],
    start: Start,
) -> tuple[Float[np.ndarray, "C P_plus_1 2"], Float[np.ndarray, "C P_plus_1"]]:
    """Headings along paths, and positions that follow from them, without leaps of speed."""
    paths = plans.paths
    _, heading = paths.pose_at(path, reached_m)
    # Without a route an agent may move sideways or backwards.
    along = np.stack([np.diff(paths.x_m[:, :2]), np.diff(paths.y_m[:, :2])], axis=-1)
    slip = heading_of(along[:, 0]) - paths.heading_rad[:, 0]
    slip[plans.route >= 0] = 0.0
    ahead = unit_vector(heading + slip[path][:, None])
    position = np.empty_like(ahead)
    position[:, 0] = start.position_m[plans.agent[path]]
    position[:, 1:] = (ahead[:, 1:] + ahead[:, :-1]) / 2
    position[:, 1:] *= np.diff(reached_m)[..., None]
    return np.cumsum(position, axis=1), heading


def _possible_steps(
    velocity_mps: Float[np.ndarray, "C P_plus_1 2"],
    heading_rad: Float[np.ndarray, "C P_plus_1"],
    joined_mps2: Float[np.ndarray, "C 2"],
    step_s: float,
) -> Int[np.ndarray, "C"]:
    """Number of steps back until each plan turns harder than vehicles do.

    An agent that turns harder at the current step may have done so before.
    """
    gained = np.diff(velocity_mps, axis=1) / step_s
    middle = (velocity_mps[:, 1:] + velocity_mps[:, :-1]) / 2
    speed = np.hypot(middle[..., 0], middle[..., 1])
    yaw = np.abs(wrap_angle(np.diff(heading_rad, axis=1))) / step_s
    lateral = np.abs((left_of(middle) * gained).sum(axis=-1))
    lateral /= np.maximum(speed, STANDING_MPS)
    most = np.maximum(np.hypot(*joined_mps2.T), COMFORT.lateral_mps2)[:, None]
    over = np.maximum(lateral, speed * yaw) > most
    over |= yaw > MAX_CURVATURE_PER_M * np.maximum(speed, TURNING_MPS)
    return np.where(over.any(axis=1), over.argmax(axis=1), over.shape[1])


def _joined_mps2(
    scenario: Scenario, rows: Int[np.ndarray, "G"]
) -> Float[np.ndarray, "G 2"]:
    """Acceleration of each agent right after the current step; 0 without a future."""
    agents, axis = scenario.agents, scenario.time_axis
    if not axis.num_future_steps:
        return np.zeros((len(rows), 2))
    now = axis.current_step
    gained = agents.velocity_mps[rows, now + 1] - agents.velocity_mps[rows, now]
    gained *= agents.is_valid[rows, now + 1, None] / axis.step_s
    size = np.hypot(gained[:, 0], gained[:, 1])
    return gained * (MAX_JOIN_MPS2 / np.maximum(size, MAX_JOIN_MPS2))[:, None]


def _bump_m(
    position_m: Float[np.ndarray, "C P_plus_1 2"],
    velocity_mps: Float[np.ndarray, "C 2"],
    joined_mps2: Float[np.ndarray, "C 2"],
    step_s: float,
) -> Float[np.ndarray, "C P_plus_1 2"]:
    """Shift of the last second that gives plans an acceleration at the current step."""
    if position_m.shape[1] < 3:
        return np.zeros_like(position_m)
    before = (position_m[:, 0] - position_m[:, 2]) / (2 * step_s)
    missing = joined_mps2 - (velocity_mps - before) / step_s
    time_s = np.arange(position_m.shape[1]) * step_s
    # Velocities are central differences, so the shift is exact two steps ago.
    shape = time_s**2 / 2 * np.exp(-(time_s - 2 * step_s) / 0.4)
    return missing[:, None] * shape[:, None]


def _steps_on_road(
    scenario: Scenario,
    position_m: Float[np.ndarray, "C P_plus_1 2"],
    is_mapped: Bool[np.ndarray, "C P_plus_1"],
    moves: Bool[np.ndarray, "C"],
) -> Int[np.ndarray, "C"]:
    """Number of steps back until each plan is off the road where there is a map.

    An agent that is off the road now came from there.
    """
    last = position_m.shape[1] - 1
    count = np.full(len(position_m), last)
    asked = np.flatnonzero(moves & ~is_off_road(scenario, position_m[:, 0]))
    steps = np.arange(_ROAD_STRIDE, last + 1, _ROAD_STRIDE)
    is_off = is_off_road(scenario, position_m[asked][:, steps])
    is_off &= is_mapped[asked][:, steps]
    leaves = is_off.any(axis=1)
    count[asked[leaves]] = steps[is_off.argmax(axis=1)[leaves]] - _ROAD_STRIDE
    return count


def _chosen(
    scenario: Scenario, rows: Int[np.ndarray, "G"], plans: _Plans
) -> tuple[Int[np.ndarray, "G"], Int[np.ndarray, "G"]]:
    """Plan of each agent, and the number of steps back that it is free of others.

    Agents without a choice are served first, then those that stand.
    """
    agents, now = scenario.agents, scenario.current_step
    others = np.setdiff1d(np.flatnonzero(agents.is_valid[:, :now].any(axis=1)), rows)
    steps = np.arange(now - 1, -1, -1)
    kept = agents.at_steps(steps).taken(others)
    every = np.arange(len(plans.agent))
    free = _free_steps(plans.boxes(every), plans.num_steps, kept)
    number = np.bincount(plans.agent, minlength=len(rows))
    speed = np.hypot(*agents.velocity_mps[rows, now].T)
    return _served(plans, free, np.lexsort((speed, number > 1)))


def _served(
    plans: _Plans, free: Int[np.ndarray, "C"], order: Int[np.ndarray, "G"]
) -> tuple[Int[np.ndarray, "G"], Int[np.ndarray, "G"]]:
    """Plans and their numbers of free steps, each given those chosen before it."""
    last = plans.heading_rad.shape[1] - 1
    chosen, count = np.zeros(len(order), int), np.zeros(len(order), int)
    first = np.searchsorted(plans.agent, np.arange(len(order) + 1)).tolist()
    taken = plans.boxes(chosen[:0])
    for agent in order.tolist():
        own = np.arange(first[agent], first[agent + 1])
        best, most = own[0], -1
        for some in (own[:1], own[1:]):
            if most < last and len(some):
                steps = _free_steps(plans.boxes(some), free[some], taken)
                if steps.max() > most:
                    best, most = some[steps.argmax()], int(steps.max())
        chosen[agent], count[agent] = best, most
        mine = plans.boxes(chosen[[agent]])
        exists = np.arange(1, last + 1) <= most
        taken = taken.joined(replace(mine, is_valid=exists[None]))
    return chosen, count


def _free_steps(
    boxes: BoxStates, most: Int[np.ndarray, "K"], taken: BoxStates
) -> Int[np.ndarray, "K"]:
    """Number of first steps at which each box overlaps none of the taken ones."""
    free = most.copy()
    low, high = bounds_m(boxes.position_m, boxes.is_valid)
    radius = boxes.radius_m[:, None]
    taken_low, taken_high = bounds_m(taken.position_m, taken.is_valid)
    reach = taken.radius_m[:, None]
    pairs = np.argwhere(
        rectangles_meet(
            (low - radius)[:, None],
            (high + radius)[:, None],
            taken_low - reach,
            taken_high + reach,
        )
    )
    if len(pairs):
        pairs[:, 1] += len(most)
        pair, at = overlaps_of_pairs(pairs, boxes.joined(taken))
        np.minimum.at(free, pairs[pair, 0], at)
    return free
