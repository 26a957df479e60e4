"""Threats in a run: planned against sampled trajectories, guided, and completed.

The threatened agent is sampled first, without the threat, and then given: its trajectory
is the same as without the threat, bit for bit. Against it a trajectory of the attacker is
planned (``pd_editor.analysis.threats``). The second sampling is guided to it, so that all other
agents react. The result keeps as much of the network's trajectory as meets the aim
within the limits of acceleration; the plan itself, fitted to the latents, is the last
resort.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import pad

from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.threats.encounter import (
    IN_FRONT,
    Track,
    encounter,
    exertion,
    limits_of,
)
from pd_editor.analysis.threats.threat_feasibility import meets
from pd_editor.analysis.threats.threat_plans import (
    ModelFit,
    ThreatAim,
    ThreatPlans,
    threat_plans,
)
from pd_editor.generation.inputs import TrajectoryBasis
from pd_editor.generation.trajectory.guidance.latent_motion import PredictedMotion
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    ResidualRows,
    TermGuidance,
    row_weights,
)
from pd_editor.generation.trajectory.network.decoding import Motion, motion_of
from pd_editor.generation.trajectory.task import SAME_STEP_S
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis

_SHARES: Final = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)
"""Shares of the network's deviation from the plan that are tried, the largest first."""


def threats_in_force(terms: Sequence[GuidanceTerm]) -> tuple[Threaten, ...]:
    """Threats that are on."""
    return tuple(
        term for term in terms if isinstance(term, Threaten) and term.is_in_force
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ThreatScene:
    """The A agents of a scene on the time axis of the model."""

    scenario: Scenario
    rows: Int[np.ndarray, "A"]
    is_sampled: Bool[np.ndarray, "A"]
    basis: TrajectoryBasis

    def motion(self, latent: Float[np.ndarray, "S A 10"]) -> Motion:
        """Motion at the model's steps; of agents that are not sampled as recorded."""
        agents, now = self.scenario.agents, self.scenario.current_step
        count = self.basis.num_steps
        motion = motion_of(
            self.basis,
            latent,
            agents.position_m[self.rows, now],
            agents.heading_rad[self.rows, now],
            agents.velocity_mps[self.rows, now],
            TimeAxis(num_steps=count + 1, current_step=0, step_s=self.basis.step_s),
        )
        kept = np.flatnonzero(self.is_known & ~self.is_sampled)
        steps = slice(now, now + count + 1)
        for mine, theirs in (
            (motion.position_m, agents.position_m),
            (motion.heading_rad, agents.heading_rad),
            (motion.velocity_mps, agents.velocity_mps),
        ):
            mine[:, kept] = theirs[self.rows[kept], steps]
        return motion

    @property
    def is_known(self) -> Bool[np.ndarray, "A"]:
        """Agents whose trajectories are known at all steps of the model."""
        agents, axis = self.scenario.agents, self.scenario.time_axis
        now, count = axis.current_step, self.basis.num_steps
        is_long = axis.num_future_steps >= count
        same = abs(axis.step_s - self.basis.step_s) < SAME_STEP_S
        exists = agents.is_valid[self.rows, now : now + count + 1].all(axis=1)
        return self.is_sampled | (exists & is_long & same)

    def track(self, motion: Motion, sample: int, agent: int) -> Track:
        """Trajectory of one agent in one sample."""
        size = self.scenario.agents.size_m[self.rows[agent]]
        return Track.of(motion, (sample, agent), size)

    def encoded(
        self, agent: int, position_m: Float[np.ndarray, "N T 2"]
    ) -> Float[np.ndarray, "N 10"]:
        """Latents of trajectories of an agent, the current step first."""
        origin, turn, speed = self._pose(agent)
        return self.basis.encode((position_m[:, 1:] - origin) @ turn, speed)

    def fitted(
        self, agent: int, position_m: Float[np.ndarray, "N T 2"]
    ) -> Float[np.ndarray, "N T 2"]:
        """The nearest trajectories that latents can represent."""
        if not len(position_m):
            return position_m
        origin, turn, speed = self._pose(agent)
        local = self.basis.decode(self.encoded(agent, position_m), speed)
        return np.concatenate([position_m[:, :1], local @ turn.T + origin], axis=1)

    def _pose(
        self, agent: int
    ) -> tuple[
        Float[np.ndarray, "2"], Float[np.ndarray, "2 2"], Float[np.ndarray, "1"]
    ]:
        """Position, axes of the own frame as columns, and speed, now."""
        agents, now = self.scenario.agents, self.scenario.current_step
        row = self.rows[agent]
        velocity = agents.velocity_mps[[row], now]
        forward = unit_vector(agents.heading_rad[[row], now])[0]
        turn = np.stack([forward, left_of(forward)], axis=-1)
        return agents.position_m[row, now], turn, np.linalg.norm(velocity, axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedThreat:
    """A threat with its plan in each of S samples."""

    term: Threaten
    aim: ThreatAim
    attacker: int
    other: int
    plans: tuple[ThreatPlans, ...]

    @property
    def is_planned(self) -> Bool[np.ndarray, "S"]:
        """Samples in which the threat is feasible."""
        return np.array([len(one) > 0 for one in self.plans])


@dataclass(frozen=True, kw_only=True, eq=False)
class ThreatRun:
    """Threats of one run against the trajectories of a first sampling."""

    scene: ThreatScene
    config: TermGuidance
    threats: tuple[PlannedThreat, ...]
    first: Float[np.ndarray, "S A 10"]
    """Latents of the first sampling."""

    @classmethod
    def of(
        cls,
        scene: ThreatScene,
        terms: Sequence[Threaten],
        first: Float[np.ndarray, "S A 10"],
        config: TermGuidance,
    ) -> "ThreatRun":
        """Plan threats; those of agents that are not there, or not sampled, are left out.

        An agent that is threatened does not threaten others, and each agent threatens
        one other.
        """
        motion = scene.motion(first)
        ids = [scene.scenario.agents.ids[row] for row in scene.rows]
        threatened = {term.other_id for term in terms}
        planned: dict[int, PlannedThreat] = {}
        for term in terms:
            if term.agent_id not in ids or term.other_id not in ids:
                continue
            attacker, other = ids.index(term.agent_id), ids.index(term.other_id)
            can = scene.is_sampled[attacker] and scene.is_known[other]
            if can and term.agent_id not in threatened and attacker not in planned:
                planned[attacker] = _planned(scene, motion, term, attacker, other)
        return cls(
            scene=scene, config=config, threats=tuple(planned.values()), first=first
        )

    def is_given(self) -> Bool[np.ndarray, "A"]:
        """Sampled agents that are threatened, whose latents are those of the first."""
        given = np.zeros(len(self.scene.rows), bool)
        given[[one.other for one in self.threats]] = True
        return given & self.scene.is_sampled

    def terms(self, like: Tensor) -> tuple["ThreatTerm", ...]:
        """Terms that guide the attackers to their plans."""
        return tuple(
            ThreatTerm.of(one, self.config, like)
            for one in self.threats
            if one.is_planned.any()
        )

    def completed(
        self, latent: Float[np.ndarray, "S A 10"]
    ) -> Float[np.ndarray, "S A 10"]:
        """Attackers' trajectories moved to their plans as far as aims and limits ask."""
        result = latent.copy()
        for one in self.threats:
            planned = np.flatnonzero(one.is_planned)
            if not len(planned):
                continue
            goal = np.concatenate(
                [
                    self.scene.encoded(
                        one.attacker, one.plans[sample].best().position_m
                    )
                    for sample in planned
                ]
            )
            left = np.ones(len(planned), bool)
            for share in _SHARES:
                mine = latent[planned, one.attacker]
                result[planned[left], one.attacker] = (goal + share * (mine - goal))[
                    left
                ]
                motion = self.scene.motion(result)
                for index in np.flatnonzero(left):
                    left[index] = not self._is_met(one, motion, int(planned[index]))
        return result

    def _is_met(self, threat: PlannedThreat, motion: Motion, sample: int) -> bool:
        """Whether a sample has the asked encounter, within the attacker's limits."""
        scene = self.scene
        first = scene.track(motion, sample, threat.attacker)
        second = scene.track(motion, sample, threat.other)
        step_s = scene.basis.step_s
        found = encounter(first, second, step_s, threat.aim.approach)
        agents, now = scene.scenario.agents, scene.scenario.current_step
        row = scene.rows[threat.attacker]
        until = np.array([round(found.at_s / step_s)]) if found.is_contact else None
        used = exertion(
            first.position_m[None],
            agents.velocity_mps[row, now],
            float(agents.heading_rad[row, now]),
            limits_of(agents.kinds[row]),
            step_s,
            until=until,
        )
        return meets(threat.aim, found) and bool(used.is_possible[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class ThreatTerm:
    """Follows a planned threat, closely around the meeting."""

    agents: Int[Tensor, "1"]
    target_m: Float[Tensor, "S T 2"]
    accepted_m: Float[Tensor, "S T"]
    is_planned: Bool[Tensor, "S"]
    weight: float
    is_closed: bool = False

    @classmethod
    def of(
        cls, threat: PlannedThreat, config: TermGuidance, like: Tensor
    ) -> "ThreatTerm":
        """Make the term of a planned threat."""
        shape = next(one for one in threat.plans if len(one)).track.position_m.shape
        num_steps = shape[1]
        target = np.zeros((len(threat.plans), num_steps, 2))
        near = np.zeros((len(threat.plans), num_steps), bool)
        moment = np.arange(num_steps)
        for sample, plans in enumerate(threat.plans):
            if len(plans):
                target[sample] = plans.track.position_m[0]
                step = int(plans.meeting_step[0])
                # The plan is followed closely so many steps before and after the
                # meeting.
                near[sample] = np.abs(moment - step) <= 4
                # Gaps to the rear or the front are kept after the meeting.
                follows = threat.aim.approach in ("rear", *IN_FRONT)
                near[sample] |= (moment > step) & follows & (not threat.aim.is_contact)
        accepted = np.where(near, config.box_m, config.threat_m)
        return cls(
            agents=torch.tensor([threat.attacker], device=like.device),
            target_m=torch.from_numpy(target).to(like),
            accepted_m=torch.from_numpy(accepted).to(like),
            is_planned=torch.from_numpy(threat.is_planned).to(like.device),
            weight=threat.term.weight,
        )

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals to the planned positions, at the steps of the plan."""
        samples = motion.num_samples
        beyond = len(motion.time_s) - self.target_m.shape[1]
        target = pad(self.target_m[:samples, None], (0, 0, 0, beyond))
        weight = row_weights(1.0, self.weight, target[..., 0])
        accepted = pad(self.accepted_m[:samples, None], (0, beyond), value=torch.inf)
        weight = weight / accepted
        weight = torch.where(self.is_planned[:samples, None, None], weight, 0.0)
        axes = torch.eye(2, dtype=target.dtype, device=target.device)
        return [
            ResidualRows(
                agents=self.agents,
                order=0,
                direction=axis.expand(target.shape),
                target=(target * axis).sum(-1),
                weight=weight,
            )
            for axis in axes
        ]


def _planned(
    scene: ThreatScene, motion: Motion, term: Threaten, attacker: int, other: int
) -> PlannedThreat:
    aim = ThreatAim.of(term.approach, term.severity)
    plans: list[ThreatPlans] = []
    known = np.flatnonzero(scene.is_known)
    known = known[~np.isin(known, [attacker, other])]
    for sample in range(len(motion.position_m)):
        mine = motion.position_m[sample, attacker]
        away = np.linalg.norm(motion.position_m[sample, known] - mine, axis=-1)
        away = away.min(axis=1, initial=np.inf)
        near = known[np.argsort(away, kind="stable")]
        # The nearest 12 within 60 m count.
        near = near[np.isin(near, known[away < 60.0])]
        may_change = scene.is_sampled[near]

        def tracks(agents: Int[np.ndarray, "N"]) -> list[Track]:
            return [scene.track(motion, sample, one) for one in agents.tolist()]  # noqa: B023

        plans.append(
            threat_plans(
                scene.scenario,
                int(scene.rows[attacker]),
                scene.track(motion, sample, other),
                aim,
                kept=tracks(near[~may_change]),
                others=tracks(near[may_change][:12]),
                model=ModelFit(
                    reference_m=mine,
                    step_s=scene.basis.step_s,
                    fitted=lambda position: scene.fitted(attacker, position),
                ),
                most=1,
            )
        )
    return PlannedThreat(
        term=term, aim=aim, attacker=attacker, other=other, plans=tuple(plans)
    )
