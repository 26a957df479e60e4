"""Commands that continue a scene by a roll-out, and that begin it at another moment."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float32

from pd_editor.base.errors import EditError
from pd_editor.base.plain_text import MAX_ID_CHARACTERS, is_plain
from pd_editor.editor.commands.command import Command, agents_in_words, parts_of
from pd_editor.editor.commands.edit_limits import (
    check_new_id,
    check_positions,
    check_velocities,
)
from pd_editor.editor.commands.traffic import blank_tracks
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_states import MOTION
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.guidance_terms import terms_without
from pd_editor.scene.junction_phases import continued_signals
from pd_editor.scene.roles.focal_agent import focal_place_m, with_focal_agent
from pd_editor.scene.roles.traffic_choice import trajectory_locked_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_limits import MAX_STEPS
from pd_editor.scene.thresholds import SAME_STATE_M
from pd_editor.scene.time_axis import TimeAxis
from pd_editor.scene.traffic_sample import TrafficSample, check_finite


@dataclass(frozen=True, kw_only=True, eq=False)
class RolledMotion:
    """Motion of G agents at S steps: the current one, and all later ones.

    Each agent is there from a first to a last step, which are counted from the current one.
    """

    ids: tuple[str, ...]
    kinds: tuple[AgentKind, ...]
    first_step: tuple[int, ...]
    last_step: tuple[int, ...]
    size_m: Float32[np.ndarray, "G 2"]
    position_m: Float32[np.ndarray, "G S 2"]
    heading_rad: Float32[np.ndarray, "G S"]
    velocity_mps: Float32[np.ndarray, "G S 2"]

    def __post_init__(self) -> None:
        for name in ("size_m", *MOTION):
            check_finite(name, getattr(self, name), self.ids, ("step",))
        count, last = self.heading_rad.shape
        lists = (self.kinds, self.first_step, self.last_step, set(self.ids))
        if any(len(one) != count for one in (self.ids, *lists)) or not all(
            0 <= one <= end < last
            for one, end in zip(self.first_step, self.last_step, strict=True)
        ):
            raise EditError(
                "The roll-out needs one id, one kind, a first step and a last one of each "
                f"of its agents, from 0 to {last - 1}."
            )

    @classmethod
    def of(cls, agents: AgentTracks) -> "RolledMotion":
        """Motion of tracks whose first step is the current one."""
        there = agents.is_valid
        last = there.shape[1] - 1 - there[:, ::-1].argmax(axis=1)
        gone = ~there
        return cls(
            ids=agents.ids,
            kinds=agents.kinds,
            first_step=tuple(there.argmax(axis=1).tolist()),
            last_step=tuple(last.tolist()),
            size_m=agents.size_m.astype(np.float32),
            position_m=np.where(gone[..., None], 0, agents.position_m).astype("f4"),
            heading_rad=np.where(gone, 0, agents.heading_rad).astype("f4"),
            velocity_mps=np.where(gone[..., None], 0, agents.velocity_mps).astype("f4"),
        )

    @property
    def num_steps(self) -> int:
        """Number of steps."""
        return self.heading_rad.shape[1]

    @property
    def exists(self) -> Bool[np.ndarray, "G S"]:
        """Whether each agent is there at each step."""
        steps = np.arange(self.num_steps)
        first = np.array(self.first_step, int)[:, None]
        return (steps >= first) & (steps <= np.array(self.last_step, int)[:, None])


@dataclass(frozen=True, kw_only=True, eq=False)
class ContinueScene(Command):
    """Replace all that comes after the current step by a roll-out.

    Current states, locked tracks and locked beginnings stay; the motion is stored, so that a replay needs neither the generator
    nor the policies. The scene ends with the roll-out.
    """

    motion: RolledMotion
    generator: str
    model_sha256: str = ""
    seed: int = 0
    replan_s: float = 1.0
    policies: Mapping[str, str] = field(default_factory=dict)
    """Names of the policies, by the agent that each drove."""

    def __post_init__(self) -> None:
        check_positions(self.motion.position_m)
        check_velocities(self.motion.velocity_mps)
        names = (self.generator, self.model_sha256, *self.policies.values())
        for text in names:
            if not is_plain(text):
                raise EditError(
                    f"{text!r} cannot be the name of a generator or policy; expected a "
                    f"text of one line, at most {MAX_ID_CHARACTERS} characters."
                )

    @property
    def label(self) -> str:
        """Label with the number of agents, and who drove."""
        driven = "".join(
            f", {name} driven by {policy}" for name, policy in self.policies.items()
        )
        agents = agents_in_words(self.motion.ids)
        return f"Roll out {agents} ({self.generator}, seed {self.seed}{driven})"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario that goes on with the roll-out."""
        motion, now = self.motion, scenario.current_step
        count = now + motion.num_steps
        if count > MAX_STEPS:
            raise EditError(
                f"The scene would have {count} steps; at most {MAX_STEPS} are possible."
            )
        place, there = focal_place_m(scenario), scenario.agents.row_of
        locked = trajectory_locked_ids(scenario)
        held = self._held_steps(scenario)
        keeps = np.isin(scenario.agents.ids, [*locked, *held])
        agents = scenario.agents.without_future(now, count, keeps)
        new = [row for row, name in enumerate(motion.ids) if name not in there]
        for row in new:
            check_new_id(scenario, motion.ids[row])
        if new:
            sample = TrafficSample(
                ids=motion.ids,
                kinds=motion.kinds,
                size_m=motion.size_m,
                position_m=motion.position_m,
                heading_rad=motion.heading_rad,
                velocity_mps=motion.velocity_mps,
            )
            agents = agents.joined(blank_tracks(sample, np.array(new), count))
        rows = agents.rows(motion.ids)
        goes_on = agents.is_valid[rows, now]
        is_free = ~np.isin(motion.ids, list(locked))
        begins = now + np.array([held.get(name, 1) for name in motion.ids], int)
        begins = np.where(goes_on, begins, now)
        begins[~is_free] = count
        at = now + np.arange(motion.num_steps) >= begins[:, None]
        heading = wrap_angle(motion.heading_rad)
        tracks = (motion.position_m, heading, motion.velocity_mps)
        agents = agents.with_motion(rows, now, tracks, at)
        kept = np.ones((len(rows), count), bool)
        kept[:, now:] = motion.exists
        kept[:, now] |= goes_on
        kept[~is_free] = True
        for name, steps in held.items():
            kept[motion.ids.index(name), now : now + steps] = True
        agents = agents.with_rows(
            rows,
            position_m=agents.position_m[rows] * kept[..., None],
            heading_rad=agents.heading_rad[rows] * kept,
            velocity_mps=agents.velocity_mps[rows] * kept[..., None],
            is_valid=agents.is_valid[rows] & kept,
        )
        note = (
            f"{agents_in_words(motion.ids)} were rolled out by {self.generator}, seed "
            f"{self.seed}."
        )
        signals = continued_signals(scenario, count, self.seed)
        longer = replace(with_length(scenario, agents), signals=signals)
        return with_focal_agent(longer.with_agents(agents, note), place)

    def _held_steps(self, scenario: Scenario) -> dict[str, int]:
        """Steps of locked beginnings that the motion keeps: no rounding changes them."""
        agents, now, held = scenario.agents, scenario.current_step, {}
        kept = scenario.kept_steps()[:, now:].sum(axis=1)
        for row, name in enumerate(self.motion.ids):
            lock = scenario.locks.get(name)
            if lock is None or lock.keeps != "beginning":
                continue
            count = int(kept[agents.row_of[name]])
            was = agents.position_m[agents.row_of[name], now : now + count]
            gap = self.motion.position_m[row, :count] - was[: self.motion.num_steps]
            if np.linalg.norm(gap, axis=-1).max() <= SAME_STATE_M:
                held[name] = count
        return held


@dataclass(frozen=True, kw_only=True)
class BeginAt(Command):
    """Make another moment of the scene its current step.

    What was up to 5 s before it stays as the past, what comes later as the future.
    Times of guidance are those that are left; what is over, or of agents that are not
    there then, is left out.
    """

    is_beyond_locks: ClassVar[bool] = True

    time_s: float
    """Seconds after the current step; negative: before it."""
    keeps_guidance: bool = False
    """Without it guidance is left out: later commands of former recipes, which give terms
    by their index, count from none."""

    def __post_init__(self) -> None:
        if not math.isfinite(self.time_s):
            raise EditError(f"t = {self.time_s} s is no time; expected a number.")

    @property
    def label(self) -> str:
        """Label with the time."""
        return f"Start from t = {self.time_s:g} s"

    def step_in(self, axis: TimeAxis) -> int:
        """The moment on the scene's time axis."""
        return axis.current_step + round(self.time_s / axis.step_s)

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario that begins then."""
        axis, now = scenario.time_axis, self.step_in(scenario.time_axis)
        if now == axis.current_step:
            return scenario
        times = axis.times_s()
        if not 0 <= now < axis.num_steps:
            raise EditError(
                f"t = {self.time_s:g} s is not in the scene; expected {times[0]:.1f} to "
                f"{times[-1]:.1f} s."
            )
        if not scenario.agents.is_valid[:, now].any():
            raise EditError(f"Nobody is there at t = {self.time_s:g} s.")
        if not self.keeps_guidance:
            scenario = replace(scenario, guidance=())
        begun = _begun(scenario, now)
        is_there = begun.agents.is_valid[:, begun.current_step]
        row = begun.agents.row_of.get(begun.focal_id)
        if row is None or not is_there[row]:
            begun = replace(begun, focal_id="")
        note = f"The scene begins at t = {self.time_s:g} s of what it was made from."
        begun = begun.with_agents(begun.agents, note)
        return with_focal_agent(begun, focal_place_m(scenario))


def begun_like(base: Scenario, commands: Iterable[Command]) -> Scenario:
    """A scenario from the moment on that commands made the current one of another."""
    for part in parts_of(commands, BeginAt):
        now = max(part.step_in(base.time_axis), 0)
        if now >= base.time_axis.num_steps:
            # A roll-out reached further than what was recorded.
            last = base.time_axis.num_steps - 1
            base = with_length(base, base.agents.without_future(last, now + 1))
        base = _begun(base, now)
    return base


def with_length(scenario: Scenario, agents: AgentTracks) -> Scenario:
    """The scenario with tracks of another length."""
    count = agents.num_steps
    signals = tuple(
        replace(one, states=np.pad(one.states, (0, count), "edge")[:count])
        for one in scenario.signals
    )
    axis = scenario.time_axis.lasting(count)
    return replace(scenario, time_axis=axis, agents=agents, signals=signals)


def _begun(scenario: Scenario, now: int) -> Scenario:
    """The scenario with another current step, and as much of its past as is usual."""
    axis, usual = scenario.time_axis, TimeAxis()
    past = round((usual.current_step + 1) * usual.step_s / axis.step_s)
    first = max(now + 1 - past, 0)

    def cut(agents: AgentTracks) -> AgentTracks:
        is_seen = np.arange(agents.num_steps) <= now
        made_up = agents.has_made_up_past & (first < axis.current_step)
        agents = replace(
            agents, observed=agents.is_valid & is_seen, has_made_up_past=made_up
        ).cut_to(slice(first, None))
        return agents.taken(agents.is_valid.any(axis=1))

    agents, applied = cut(scenario.agents), scenario.applied_warp
    gone = [
        name
        for name, row in scenario.agents.row_of.items()
        if not scenario.agents.is_valid[row, now]
    ]
    terms = terms_without(scenario.guidance, gone)
    later = (scenario.later_term(term, now) for term in terms)
    if applied is not None:
        is_unedited = scenario.agents is applied.warped_agents
        applied = replace(
            applied,
            original_agents=cut(applied.original_agents),
            warped_agents=agents if is_unedited else cut(applied.warped_agents),
            original_guidance=(),
            warped_guidance=(),
        )
    start, end = axis.start_timestamp_ns, axis.end_timestamp_ns
    share = first / max(axis.num_steps - 1, 1)
    names = set(agents.ids)
    return replace(
        scenario,
        agents=agents,
        applied_warp=applied,
        guidance=tuple(term for term in later if term is not None),
        locks={name: one for name, one in scenario.locks.items() if name in names},
        retired_ids=scenario.retired_ids.union(scenario.agents.ids) - names,
        signals=tuple(
            replace(one, states=one.states[first:]) for one in scenario.signals
        ),
        time_axis=replace(
            axis,
            num_steps=axis.num_steps - first,
            current_step=now - first,
            start_timestamp_ns=start + type(start)((end - start) * share),
        ),
    )
