"""Yielding: agents that would run into another one follow their trajectories later.

An agent that yields follows its trajectory by a clock of its own, which never runs faster
than time: it brakes, drives slower or stops, and goes on. No place is passed faster
than before, so limits of curves stay kept.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from pd_editor.analysis.metrics.box_overlaps import (
    boxes_touch,
    overlaps_of_pairs,
    pairs_that_meet,
    turned_boxes_touch,
)
from pd_editor.analysis.metrics.motion import WINDOW_STEPS, derivative_operators
from pd_editor.analysis.repair.current_states import counted
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.geometry.oriented_box import Boxes, BoxStates
from pd_editor.scene.paths.retiming import fill_gaps, fill_heading_gaps
from pd_editor.scene.thresholds import STANDING_MPS

MAX_BRAKING_MPS2: Final = 4.5
"""An agent that yields brakes at most so hard, unless its own trajectory does."""
GAP_M: Final = 1.0
"""Room kept ahead and behind, where there is as much now."""
_BEGINS_S: Final = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
_BRAKES_S: Final = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
_COMPARED_TOGETHER: Final = 4
"""Compared steps of another agent that are looked at as one disc first."""
_STEPS_TOGETHER: Final = 5
"""The same of steps of the own trajectory."""
LEAST_WAY_M: Final = 0.5
"""Agents with a shorter trajectory cannot yield."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Clocks:
    """K clocks, sorted by how much later they make an agent; the first one is time."""

    step: Float[np.ndarray, "K N"]
    """Step of the own trajectory that is reached at each step."""
    rate: Float[np.ndarray, "K N"]
    """Of the clock at each step, 0 to 1."""
    slope_1ps: Float[np.ndarray, "K"]
    """How fast the rate falls."""
    window: Int[np.ndarray, "K"]
    """When it falls: index of begin and duration; -1 of those that wait at the start."""
    first_slow: Int[np.ndarray, "K"]
    """First step at which it runs slower than time; N if there is none."""
    cell: Int[np.ndarray, "K T"]
    """Index into a table of T compared steps and N steps of the own trajectory."""


@lru_cache(maxsize=8)
def clocks(num_steps: int, step_s: float) -> Clocks:
    """Clocks that slow down, stay slow for a time or for good, and recover.

    Others wait before they start, which only agents that stand can do.
    """
    time = np.arange(num_steps) * step_s
    rates, slopes, windows = [np.ones(num_steps)], [0.0], [0]
    for window, (begins, brakes) in enumerate(product(_BEGINS_S, _BRAKES_S)):
        for slowest, stays in product(np.arange(0.0, 0.95, 0.1), (0.5, 1.5, np.inf)):
            slope = (1 - slowest) / brakes
            down = np.maximum(1 - slope * np.maximum(time - begins, 0), slowest)
            late = np.maximum(time - begins - brakes - stays, 0)
            # How fast a clock catches up with time again.
            rates.append(np.minimum(down + 0.2 * late, 1.0))
            slopes.append(slope)
            windows.append(window)
    for wait in np.arange(0.5, 6.1, 0.5):
        rates.append((time >= wait).astype(float))
        slopes.append(0.0)
        windows.append(-1)
    rate = np.array(rates)
    step = np.zeros_like(rate)
    np.cumsum((rate[:, 1:] + rate[:, :-1]) / 2, axis=1, out=step[:, 1:])
    order = np.argsort(-step.sum(axis=1), kind="stable")
    compared = _compared(num_steps)
    cell = np.rint(step[order][:, compared]).astype(int)
    rate = rate[order]
    is_slow = rate < 1
    return Clocks(
        step=step[order],
        rate=rate,
        first_slow=np.where(is_slow.any(axis=1), is_slow.argmax(axis=1), num_steps),
        slope_1ps=np.array(slopes)[order],
        window=np.array(windows)[order],
        cell=np.arange(len(compared)) * num_steps + cell,
    )


def _compared(num_steps: int) -> Int[np.ndarray, "T"]:
    # Every how many steps clocks are compared with other agents.
    return np.arange(2, num_steps, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Yielded:
    """Trajectories of the G agents that yield, from the current step on."""

    row: Int[np.ndarray, "G"]
    position_m: Float[np.ndarray, "G H 2"]
    heading_rad: Float[np.ndarray, "G H"]
    velocity_mps: Float[np.ndarray, "G H 2"]


def yielding(
    agents: AgentTracks,
    now: int,
    may_yield: Bool[np.ndarray, "A"],
    step_s: float,
    num_kept: Int[np.ndarray, "A"] | None = None,
    yields_last: Bool[np.ndarray, "A"] | None = None,
    asked_mps2: Float[np.ndarray, "A 2"] | None = None,
) -> Yielded:
    """Which agents yield to avoid collisions, and their new trajectories.

    Of two that would collide the one yields that has the other in front of it, or the
    other one if that does not help. Pairs that overlap now are left out. Agents that
    enter later are avoided from then on; they do not yield. Agents that cannot avoid
    anything drive on as before. Of its first ``num_kept`` steps after the current one
    no agent is driven later. Agents that yield last do so only where the other one cannot.
    Agents accelerate and brake no harder than ``asked_mps2`` where that is enough.
    """
    if num_kept is None:
        num_kept = np.zeros(len(agents), int)
    if yields_last is None:
        yields_last = np.zeros(len(agents), bool)
    if asked_mps2 is None:
        asked_mps2 = np.full((len(agents), 2), np.inf)
    scene = _Scene.of(agents, now, may_yield, step_s, num_kept, yields_last, asked_mps2)
    best, fewest = _fewest_conflicts(scene)
    if fewest and np.isfinite(asked_mps2).any():
        # One that brakes gently may leave others no way out.
        freely = replace(scene, asked_mps2=np.full_like(asked_mps2, np.inf))
        other, fewer = _fewest_conflicts(freely)
        best = other if fewer < fewest else best
    rows = np.flatnonzero(best)
    position, heading = scene.driven(rows, best[rows])
    position, heading = (
        position[:, : scene.num_until_end],
        heading[:, : scene.num_until_end],
    )
    velocity = np.zeros_like(position)
    if len(rows):
        velocity = np.gradient(position, step_s, axis=1)
        velocity[:, 0] = agents.velocity_mps[rows, now]
    heading = wrap_angle(heading)
    heading[:, 0] = agents.heading_rad[rows, now]
    return Yielded(
        row=rows,
        position_m=position,
        heading_rad=heading,
        velocity_mps=velocity,
    )


def _fewest_conflicts(scene: "_Scene") -> tuple[Int[np.ndarray, "A"], int]:
    """The clocks of all agents with which the fewest pairs collide, and their number."""
    plans = _Plans.of(scene)
    best, fewest = plans.clock.copy(), plans.num_conflicts
    for _ in range(8):
        if not plans.num_conflicts or not plans.advanced(scene):
            break
        if plans.num_conflicts < fewest:
            best, fewest = plans.clock.copy(), plans.num_conflicts
    return best, fewest


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scene(BoxStates):
    """A agents from the current step on: H steps, T with those that follow the end.

    Headings are without jumps of a whole turn.
    """

    speed_mps: Float[np.ndarray, "A T"]
    may_yield: Bool[np.ndarray, "A"]
    num_kept: Int[np.ndarray, "A"]
    yields_last: Bool[np.ndarray, "A"]
    asked_mps2: Float[np.ndarray, "A 2"]
    """Hardest acceleration and braking where that is enough; infinite: as usual."""
    pairs: Int[np.ndarray, "P 2"]
    """Those that could ever meet and of which one may yield."""
    keeps_gap: Bool[np.ndarray, "P"]
    """Whether they have the room of ``GAP_M`` now."""
    clocks: Clocks
    step_s: float
    num_until_end: int
    """H."""

    @classmethod
    def of(
        cls,
        agents: AgentTracks,
        now: int,
        may_yield: Bool[np.ndarray, "A"],
        step_s: float,
        num_kept: Int[np.ndarray, "A"],
        yields_last: Bool[np.ndarray, "A"],
        asked_mps2: Float[np.ndarray, "A 2"],
    ) -> "_Scene":
        is_valid = agents.is_valid[:, now:]
        position = fill_gaps(agents.position_m[:, now:], is_valid)
        heading = fill_heading_gaps(agents.heading_rad[:, now:], is_valid)
        # Agents go on so long after the end, so that none ends right before another
        # one.
        num_steps, beyond = position.shape[1], round(1.5 / step_s)
        last = position[:, -1:] - position[:, -2:-1]
        more = position[:, -1:] + np.arange(1, beyond + 1)[:, None] * last
        position = np.concatenate([position, more], axis=1)
        heading = np.pad(heading, [(0, 0), (0, beyond)], mode="edge")
        is_valid = np.pad(is_valid, [(0, 0), (0, beyond)], mode="edge")
        way = np.linalg.norm(np.diff(position, axis=1), axis=-1)
        mean = (way[:, 1:] + way[:, :-1]) / 2
        speed = np.concatenate([way[:, :1], mean, way[:, -1:]], axis=1) / step_s
        size = agents.size_m
        radius = np.hypot(size[:, 0] + 2 * GAP_M, size[:, 1]) / 2
        pairs = pairs_that_meet(position, is_valid, radius)
        may_yield = may_yield & (way.sum(axis=1) > LEAST_WAY_M)
        pairs = pairs[counted(agents, pairs) & may_yield[pairs].any(axis=1)]

        def apart(grown_m: Float[np.ndarray, "A 2"]) -> Bool[np.ndarray, "P"]:
            one, two = pairs.T
            # Agents that enter later are nowhere yet.
            now = Boxes(
                position_m=position[:, 0], heading_rad=heading[:, 0], size_m=grown_m
            )
            return ~is_valid[pairs, 0].all(axis=1) | ~boxes_touch(now[one], now[two])

        keeps_gap = apart(size + np.array([GAP_M, 0.0]))
        is_apart = apart(size)
        return cls(
            position_m=position,
            heading_rad=heading,
            speed_mps=speed,
            is_valid=is_valid,
            size_m=size,
            may_yield=may_yield,
            num_kept=num_kept,
            yields_last=yields_last,
            asked_mps2=asked_mps2,
            pairs=pairs[is_apart],
            keeps_gap=keeps_gap[is_apart],
            clocks=clocks(num_steps + beyond, step_s),
            step_s=step_s,
            num_until_end=num_steps,
        )

    def driven(
        self, rows: Int[np.ndarray, "G"], clock: Int[np.ndarray, "G"]
    ) -> tuple[Float[np.ndarray, "G N 2"], Float[np.ndarray, "G N"]]:
        """Positions and headings of agents by their clocks."""
        step = self.clocks.step[clock]
        before = np.minimum(step.astype(int), step.shape[1] - 2)
        fraction = step - before
        row = rows[:, None]
        heading = self.heading_rad[row, before]
        heading += fraction * (self.heading_rad[row, before + 1] - heading)
        position = self.position_m[row, before]
        step_m = self.position_m[row, before + 1] - position
        return position + fraction[..., None] * step_m, heading

    def rough_braking(self, rows: Int[np.ndarray, "G"]) -> Float[np.ndarray, "G K"]:
        """Braking that each clock asks for, roughly; infinite where it is impossible."""
        speed = self.speed_mps[rows]
        num_steps = speed.shape[1]
        lasts = np.rint(np.array(_BRAKES_S) / self.step_s).astype(int)
        fastest = np.zeros((len(rows), len(_BEGINS_S), len(_BRAKES_S)))
        for index, begins in enumerate(_BEGINS_S):
            first = round(begins / self.step_s)
            if first < num_steps:
                so_far = np.maximum.accumulate(speed[:, first:], axis=1)
                last = np.minimum(lasts, num_steps - 1 - first)
                fastest[:, index] = so_far[:, last]
        fastest = fastest.reshape(len(rows), -1)
        stands = speed[:, :1] < STANDING_MPS
        braking = fastest[:, self.clocks.window] * self.clocks.slope_1ps
        waiting = np.where(stands, 0.0, np.inf)
        return np.where(self.clocks.window < 0, waiting, braking)

    def is_possible(
        self, row: int, clock: Int[np.ndarray, "K"]
    ) -> Bool[np.ndarray, "K"]:
        """Whether an agent brakes within the limit by some clocks, or as hard as before."""
        steps = np.arange(self.speed_mps.shape[1])
        speed = np.interp(self.clocks.step[clock], steps, self.speed_mps[row])
        speed *= self.clocks.rate[clock]
        own = np.diff(self.speed_mps[row]).min(initial=0.0)
        hardest = -np.diff(speed, axis=1).min(axis=1, initial=0.0) / self.step_s
        limit = max(MAX_BRAKING_MPS2, -own / self.step_s)
        return hardest <= limit + 0.2

    def is_as_asked(
        self, row: int, clock: Int[np.ndarray, "K"]
    ) -> Bool[np.ndarray, "K"]:
        """Whether an agent keeps its limits by some clocks, or is no harsher than before.

        Accelerations are those of the metrics, in which limits are asked for.
        """
        count = self.num_until_end
        way = np.linalg.norm(np.diff(self.position_m[row], axis=0), axis=-1)
        along = np.pad(way.cumsum(), (1, 0))
        step = self.clocks.step[np.append(0, clock), :count]
        driven = np.interp(step, np.arange(len(along)), along)
        _, second, _ = derivative_operators(count, WINDOW_STEPS, self.step_s)
        fitted = driven @ second.T
        hardest = np.stack([fitted.max(axis=1), -fitted.min(axis=1)], axis=-1)
        allowed = np.maximum(hardest[0], self.asked_mps2[row])
        return (hardest[1:] <= allowed + 0.01).all(axis=-1)


@dataclass(kw_only=True, eq=False)
class _Plans:
    """The clocks of all agents, and which pairs collide then."""

    clock: Int[np.ndarray, "A"]
    position_m: Float[np.ndarray, "A N 2"]
    heading_rad: Float[np.ndarray, "A N"]
    first_step: Int[np.ndarray, "P"]
    """First step at which each pair collides; -1 if it does not."""
    tried: Bool[np.ndarray, "P 2"]
    """Which of each pair have tried to yield to the other one."""
    has_changed: Bool[np.ndarray, "A"]
    """Whose clock has changed since all began to try."""

    @classmethod
    def of(cls, scene: _Scene) -> "_Plans":
        count = len(scene.size_m)
        plans = cls(
            clock=np.zeros(count, int),
            position_m=scene.position_m.copy(),
            heading_rad=scene.heading_rad.copy(),
            first_step=np.full(len(scene.pairs), -1),
            tried=np.ones((len(scene.pairs), 2), bool),
            has_changed=np.zeros(count, bool),
        )
        plans._find_conflicts(scene, np.arange(len(scene.pairs)))
        plans._let_try(scene, np.arange(len(scene.pairs)))
        return plans

    @property
    def num_conflicts(self) -> int:
        """Number of pairs that collide."""
        return int((self.first_step >= 0).sum())

    def advanced(self, scene: _Scene) -> bool:
        """Let one of each pair that collides yield; false if none can any more."""
        pair = np.flatnonzero((self.first_step >= 0) & ~self.tried.all(axis=1))
        if not len(pair) and self.has_changed.any():
            # What was in the way then may be gone by now, where any clock has changed.
            involved = np.unique(scene.pairs[self.has_changed[scene.pairs].any(axis=1)])
            again = np.isin(scene.pairs, involved).any(axis=1)
            self._let_try(scene, np.flatnonzero(again))
            self.has_changed[:] = False
            pair = np.flatnonzero((self.first_step >= 0) & ~self.tried.all(axis=1))
        if not len(pair):
            return False
        pair = pair[np.argsort(self.first_step[pair], kind="stable")]
        side = self._side_that_yields(scene, pair)
        self.tried[pair, side] = True
        both = scene.pairs[pair]
        row = np.unique(both[np.arange(len(pair)), side])
        # Agents whose clocks are chosen together, which bounds the memory.
        parts = np.array_split(row, -(-len(row) // 16))
        clock = np.concatenate([self._best_clocks(scene, some) for some in parts])
        changed = clock != self.clock[row]
        row, clock = row[changed], clock[changed]
        self.has_changed[row] = True
        self.clock[row] = clock
        self.position_m[row], self.heading_rad[row] = scene.driven(row, clock)
        touched = np.isin(scene.pairs, row).any(axis=1)
        self._find_conflicts(scene, np.flatnonzero(touched))
        return True

    def _let_try(self, scene: _Scene, pair: Int[np.ndarray, "C"]) -> None:
        """Let both of each pair try to yield, unless they cannot or it is too late."""
        both = scene.pairs[pair]
        moves = scene.speed_mps[both, 0] >= STANDING_MPS
        # Braking moves an agent by 0.2 m until then: a collision so early is not
        # prevented.
        early = self.first_step[pair] * scene.step_s <= 0.3
        is_late = (self.first_step[pair] >= 0) & early
        self.tried[pair] = ~scene.may_yield[both] | (moves & is_late[:, None])

    def _side_that_yields(
        self, scene: _Scene, pair: Int[np.ndarray, "C"]
    ) -> Int[np.ndarray, "C"]:
        """The one with the other in front of it, unless it has tried in vain.

        Of two of which one yields last, the other one.
        """
        both, step = scene.pairs[pair], self.first_step[pair][:, None]
        place = self.position_m[both, step]
        forward = unit_vector(self.heading_rad[both, step])
        gap = place[:, ::-1] - place
        ahead = (forward * gap).sum(axis=-1)
        side = (ahead[:, 1] >= ahead[:, 0]).astype(int)
        last = scene.yields_last[both]
        side = np.where(last[:, 0] == last[:, 1], side, last[:, 0])
        has_tried = self.tried[pair, side]
        return np.where(has_tried, 1 - side, side)

    def _find_conflicts(self, scene: _Scene, pair: Int[np.ndarray, "C"]) -> None:
        boxes = BoxStates(
            position_m=self.position_m,
            heading_rad=self.heading_rad,
            size_m=scene.size_m,
            is_valid=scene.is_valid,
        )
        until = boxes.at_steps(slice(0, scene.num_until_end))
        found, step = overlaps_of_pairs(scene.pairs[pair], until)
        found, first = np.unique(found, return_index=True)
        self.first_step[pair] = -1
        self.first_step[pair[found]] = step[first]

    def _best_clocks(
        self, scene: _Scene, rows: Int[np.ndarray, "G"]
    ) -> Int[np.ndarray, "G"]:
        """The clock of each agent that avoids all others and is the least late.

        With the gap if one does, else without; as now if none avoids the others.
        """
        blocked = self._blocked(scene, rows)
        braking = scene.rough_braking(rows)
        best = self.clock[rows].copy()
        for index, row in enumerate(rows.tolist()):
            keeps = scene.clocks.first_slow > scene.num_kept[row]
            ways = [(MAX_BRAKING_MPS2, scene.is_possible)]
            if np.isfinite(scene.asked_mps2[row]).any():
                ways.insert(0, (scene.asked_mps2[row, 1], scene.is_as_asked))
            for (most, fits), table in product(ways, blocked):
                able = np.flatnonzero(keeps & (braking[index] <= most))
                free = able[~table[index].take(scene.clocks.cell[able]).any(axis=1)]
                # Clocks that ask for no harder braking come first.
                easy = free[braking[index, free] <= 3.0]
                # Clocks of an agent whose braking is looked at closely.
                some = np.concatenate([easy[:16], free[:16]])
                some = some[fits(row, some)]
                if len(some):
                    best[index] = some[0]
                    break
        return best

    def _blocked(
        self, scene: _Scene, rows: Int[np.ndarray, "G"]
    ) -> tuple[Bool[np.ndarray, "G TN"], Bool[np.ndarray, "G TN"]]:
        """Where on its own trajectory each agent cannot be, at each compared step.

        First with the gap to others, then where it would overlap them; that counts
        until the end only. Others that have the agent in front of them are left to
        yield themselves, unless they cannot, have tried or yield last.
        """
        num_steps = scene.speed_mps.shape[1]
        place = np.full(len(scene.size_m), -1)
        place[rows] = np.arange(len(rows))
        pair, side = np.nonzero(place[scene.pairs] >= 0)
        own = scene.pairs[pair, side]
        other = scene.pairs[pair, 1 - side]
        compared = _compared(num_steps)
        mine, theirs = _as_complex(scene.position_m), _as_complex(self.position_m)
        facing = np.exp(1j * scene.heading_rad), np.exp(1j * self.heading_rad)
        reach = np.hypot(scene.size_m[:, 0] + GAP_M, scene.size_m[:, 1]) / 2
        index, at, cell, offset = _cells_that_meet(
            _Stretches.of(theirs[:, compared], compared, _COMPARED_TOGETHER),
            _Stretches.of(mine, np.arange(num_steps), _STEPS_TOGETHER),
            other,
            own,
            reach[own] + reach[other],
        )
        a, b, now = own[index], other[index], compared[at]
        turns = facing[0][a, cell], facing[1][b, now]
        theirs_to_yield = scene.may_yield[other] & ~self.tried[pair, 1 - side]
        theirs_to_yield &= ~scene.yields_last[other] | scene.yields_last[own]
        ahead = np.real(offset * (turns[0] + turns[1]).conj())
        counts = (ahead >= 0) | ~theirs_to_yield[index]
        counts &= scene.is_valid[a, now] & scene.is_valid[b, now]
        index, at, cell, offset = (one[counts] for one in (index, at, cell, offset))
        a, b, turns = a[counts], b[counts], (turns[0][counts], turns[1][counts])
        room = np.array([GAP_M, 0.0]) * scene.keeps_gap[pair][index][:, None]
        sizes = scene.size_m[a], scene.size_m[b]
        near = turned_boxes_touch(offset, *turns, sizes[0] + room, sizes[1] + room)
        hit = near & (compared[at] < scene.num_until_end)
        hit[near] &= turned_boxes_touch(
            offset[near], *(one[near] for one in turns), *(one[near] for one in sizes)
        )
        flat = at * num_steps + cell
        tables = np.zeros((2, len(rows), len(compared) * num_steps), bool)
        for table, some in zip(tables, (near, hit), strict=True):
            table[place[a[some]], flat[some]] = True
        return tables[0], tables[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stretches:
    """Paths of A agents cut into C stretches of a few points, each in a disc."""

    center_m: Complex[np.ndarray, "A C"]
    radius_m: Float[np.ndarray, "A C"]
    point_m: Complex[np.ndarray, "A C M"]
    index: Int[np.ndarray, "C M"]
    """Index of each point; -1 beyond the end."""
    step: Int[np.ndarray, "C M"]

    @classmethod
    def of(
        cls, path_m: Complex[np.ndarray, "A N"], step: Int[np.ndarray, "N"], length: int
    ) -> "_Stretches":
        num_points = path_m.shape[1]
        count = -(-num_points // length)
        index = np.arange(count * length).reshape(count, length)
        held = np.minimum(index, num_points - 1)
        point = path_m[:, held]
        center = (point[..., 0] + point[..., -1]) / 2
        return cls(
            center_m=center,
            radius_m=np.abs(point - center[..., None]).max(axis=-1, initial=0.0),
            point_m=point,
            index=np.where(index < num_points, index, -1),
            step=step[held],
        )


def _cells_that_meet(
    one: _Stretches,
    two: _Stretches,
    row_of_one: Int[np.ndarray, "P"],
    row_of_two: Int[np.ndarray, "P"],
    reach_m: Float[np.ndarray, "P"],
) -> tuple[np.ndarray, ...]:
    """Pairs with a point of each of the two paths in reach, and the vector to the first.

    Points of the second path count that are not later: no clock runs ahead of time.
    """
    offset = one.center_m[row_of_one][:, :, None] - two.center_m[row_of_two][:, None]
    # For rounding, where paths are compared roughly.
    reach = (reach_m[:, None] + 0.01 + one.radius_m[row_of_one])[:, :, None]
    reach = reach + two.radius_m[row_of_two][:, None]
    near = np.real(offset) ** 2 + np.imag(offset) ** 2 <= reach**2
    near &= two.step[:, 0] <= one.step[:, -1:]
    pair, first, second = np.nonzero(near)
    mine = two.point_m[row_of_two[pair], second][:, None]
    offset = one.point_m[row_of_one[pair], first][:, :, None] - mine
    close = np.real(offset) ** 2 + np.imag(offset) ** 2 < reach_m[pair, None, None] ** 2
    close &= two.step[second][:, None] <= one.step[first][:, :, None]
    close &= (one.index[first] >= 0)[:, :, None] & (two.index[second] >= 0)[:, None]
    which, at, cell = np.nonzero(close)
    return (
        pair[which],
        one.index[first[which], at],
        two.index[second[which], cell],
        offset[close],
    )


def _as_complex(points_m: Float[np.ndarray, "A N 2"]) -> Complex[np.ndarray, "A N"]:
    return (points_m[..., 0] + 1j * points_m[..., 1]).astype(np.complex64)
