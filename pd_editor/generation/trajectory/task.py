"""A scenario as the second stage's input."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from pd_editor.generation.core.sampler import sampling_mode
from pd_editor.generation.features.scene_features import (
    NUM_FUTURE_STEPS,
    STEP_S,
    SceneFeatures,
    packed,
    scene_features,
    seen_agents,
)
from pd_editor.generation.inputs.scene_batch import SceneTensors, batch_of
from pd_editor.generation.inputs.trajectory_pca import TrajectoryBasis
from pd_editor.generation.trajectory.guidance.latent_motion import (
    KnownMotion,
    LatentMotion,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    TermContext,
    TermGuidance,
)
from pd_editor.generation.trajectory.kept_beginning import KeptBeginning, projected
from pd_editor.generation.trajectory.network.decoding import (
    Motion,
    TrajectoryDecoder,
    motion_of,
    turned_as_vehicles,
)
from pd_editor.generation.trajectory.network.denoiser import TrajectoryConfig
from pd_editor.generation.trajectory.sampler import TrajectoryModel
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, Activity
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

_LEAST_KNOWN_STEPS: Final = 10
"""A context agent with fewer future steps is sampled like the others, and kept."""
SAME_STEP_S: Final = 1e-6
_MET_WITHIN_M: Final = 300.0
"""Agents at 25 m/s each that are further apart do not meet within the horizon."""
_NOISE_ROWS: Final = 64


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryTask:
    """A scenario as the network's input; G rows of it are sampled."""

    scenario: Scenario
    features: SceneFeatures
    scene: SceneTensors
    is_given: Bool[np.ndarray, "A"]
    is_sampled: Bool[np.ndarray, "A"]
    late: Int[np.ndarray, "L"]
    """Rows of the scenario's agents that enter later and are to be avoided."""
    kept: KeptBeginning
    kept_rows: tuple[int, Int[np.ndarray, "A"]]
    """Number of road users, and which of them are the agents of the features."""
    also: Int[np.ndarray, "N"]
    """Rows of the scenario that were to be prepared besides the sampled ones."""
    _contexts: dict[TrajectoryModel, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        rows: Int[np.ndarray, "G"],
        basis: TrajectoryBasis,
        *,
        config: TrajectoryConfig | None = None,
        also: Int[np.ndarray, "N"] | None = None,
    ) -> "TrajectoryTask":
        """Make a task of road users at the current step and those that enter soon.

        Agents that are not sampled are given if their trajectories are known. Those on
        which results of a network of some ``config`` do not depend are left out, but for
        the rows ``also``, which guidance looks at.
        """
        config = TrajectoryConfig() if config is None else config
        also = rows[:0] if also is None else also
        late = LateAgents.of(scenario).but_continuing(rows)
        known = _with_late_agents(scenario, late)
        every = np.arange(len(known.agents))
        is_open = _known_steps(known, every, basis).sum(axis=1) < _LEAST_KNOWN_STEPS
        reach = config.num_near_agents, config.num_blocks
        seen, users = seen_agents(known, np.union1d(rows, also), is_open, *reach)
        features = scene_features(
            known, knows_leaders=config.knows_leaders, agents=seen
        )
        scene = _without_gaps(batch_of([packed(features, basis.encode)]))
        is_sampled = np.isin(features.agent_row, rows)
        is_given = ~is_sampled & features.has_future
        partly = np.flatnonzero(~is_sampled & ~is_given)
        latent, is_known = _completed(known, features, partly, basis)
        scene.future[0, partly[is_known]] = torch.from_numpy(latent).float()
        is_given[partly[is_known]] = True
        return cls(
            scenario=scenario,
            features=features,
            scene=scene,
            is_given=is_given,
            is_sampled=is_sampled,
            late=late.row,
            kept=KeptBeginning.of(scenario, features.agent_row, is_sampled),
            kept_rows=(len(users), np.searchsorted(users, seen)),
            also=also,
        )

    def of_edited(
        self,
        scenario: Scenario,
        rows: Int[np.ndarray, "G"],
        also: Int[np.ndarray, "N"],
    ) -> "TrajectoryTask | None":
        """The same task of a scenario whose guidance alone differs, else None."""
        mine = self.scenario
        names = ("road_map", "agents", "time_axis", "applied_warp", "locks")
        is_same = all(getattr(mine, one) is getattr(scenario, one) for one in names)
        is_same = is_same and mine.focal_id == scenario.focal_id
        prepared = np.concatenate([self.also, self.features.agent_row])
        is_same &= bool(np.isin(also, prepared).all())
        sampled = self.features.agent_row[self.is_sampled]
        if not is_same or not np.array_equal(sampled, np.sort(rows)):
            return None
        return replace(self, scenario=scenario)

    def with_noise_of(self, ids: tuple[str, ...]) -> "TrajectoryTask":
        """The same task with the noise of agents in a given order, others after them."""
        names = [self.scenario.agents.ids[row] for row in self.features.agent_row]
        order = {name: row for row, name in enumerate(dict.fromkeys((*ids, *names)))}
        kept = np.array([order[name] for name in names], int)
        # Numbers of the first rows depend on how many there are, but not by blocks.
        count = -(-len(order) // _NOISE_ROWS) * _NOISE_ROWS
        return replace(self, kept_rows=(count, kept))

    def with_waiting_at(self, least_mps: float) -> "TrajectoryTask":
        """The same task, in which the network sees who waits at a least speed."""
        speed, activity = self.scene.agent_speed, self.scene.agent_activity
        seen = speed.clamp_min(least_mps)
        speed = torch.where(activity == Activity.WAITING, seen, speed)
        return replace(self, scene=replace(self.scene, agent_speed=speed), _contexts={})

    def context(self, model: TrajectoryModel) -> Any:
        """The encoded scene, computed once."""
        context = self._contexts.get(model)
        if context is None:
            with sampling_mode(self.scene.has_agent.numel()):
                context = self._contexts[model] = model.encode_context(self.scene)
        return context

    def to(self, device: torch.device) -> "TrajectoryTask":
        """Move the tensors to a device."""
        return replace(self, scene=self.scene.to(device), _contexts={})

    @property
    def _guided_steps(self) -> int:
        """Number of steps of the network, or to the end of a longer future."""
        axis = self.scenario.time_axis
        end = round(axis.future_s / STEP_S)
        return max(NUM_FUTURE_STEPS, end)

    def term_context(self, config: TermGuidance) -> TermContext:
        """What guidance terms are made from."""
        agents, now = self.scenario.agents, self.scenario.current_step
        rows = self.features.agent_row
        return TermContext(
            scenario=self.scenario,
            config=config,
            ids=tuple(agents.ids[row] for row in rows),
            kinds=tuple(agents.kinds[row] for row in rows),
            is_sampled=self.is_sampled,
            is_standing=agents.speed_mps()[rows, now] < STANDING_MPS,
            like=self.scene.agent_speed,
            duration_s=self._guided_steps * STEP_S,
        )

    def latent_motion(self, decoder: TrajectoryDecoder) -> LatentMotion:
        """Motion of all A agents as a function of latents, in the scene frame."""
        agents, axis = self.scenario.agents, self.scenario.time_axis
        now, rows = self.scenario.current_step, self.features.agent_row
        like = self.scene.agent_speed

        def tensor(values: np.ndarray) -> torch.Tensor:
            return torch.from_numpy(values).to(like)

        count = self._guided_steps
        steps = slice(now, now + count + 1)
        exists = agents.is_valid[rows, steps]
        missing = [(0, 0), (0, count + 1 - exists.shape[1])]
        # Recorded positions are at the model's steps only on the same time axis.
        same = abs(axis.step_s - STEP_S) < SAME_STEP_S
        is_known = np.pad(exists & ~self.is_sampled[:, None], missing) & same
        pairs = [*missing, (0, 0)]
        return LatentMotion.of(
            decoder,
            num_steps=count,
            origin_m=tensor(agents.position_m[rows, now]),
            heading_rad=tensor(agents.heading_rad[rows, now]),
            speed_mps=tensor(agents.speed_mps()[rows, now]),
            size_m=tensor(agents.size_m[rows]),
            is_sampled=torch.from_numpy(self.is_sampled).to(like.device),
            known=KnownMotion(
                position_m=tensor(np.pad(agents.position_m[rows, steps], pairs)),
                velocity_mps=tensor(np.pad(agents.velocity_mps[rows, steps], pairs)),
                heading_rad=tensor(np.pad(agents.heading_rad[rows, steps], missing)),
                exists=torch.from_numpy(is_known | self.is_sampled[:, None]).to(
                    like.device
                ),
                is_known=torch.from_numpy(is_known).to(like.device),
            ),
        )

    def no_motion(self, num_samples: int) -> Motion:
        """Zero motion, if no agent is sampled."""
        steps = self.scenario.time_axis.num_future_steps + 1
        shape = (num_samples, len(self.features.agent_row), steps)
        return Motion(
            position_m=np.zeros((*shape, 2)),
            heading_rad=np.zeros(shape),
            velocity_mps=np.zeros((*shape, 2)),
        )

    def motion(
        self, basis: TrajectoryBasis, latent: Float[torch.Tensor, "S 1 A 10"]
    ) -> Motion:
        """Decode the motion of all A agents of the features."""
        agents, now = self.scenario.agents, self.scenario.current_step
        rows = self.features.agent_row
        decoded = motion_of(
            basis,
            latent[:, 0].double().cpu().numpy(),
            agents.position_m[rows, now],
            agents.heading_rad[rows, now],
            agents.velocity_mps[rows, now],
            self.scenario.time_axis,
        )
        is_vehicle = agents.kind_mask(LANE_FOLLOWER_KINDS)[rows]
        step_s = self.scenario.time_axis.step_s
        return self.kept.joined(turned_as_vehicles(decoded, is_vehicle, step_s))

    def keep(
        self, basis: TrajectoryBasis
    ) -> Callable[[torch.Tensor], torch.Tensor] | None:
        """Projection of latents to those of locked beginnings; None without any."""
        if not len(self.kept):
            return None
        tables = self.kept.projection(basis, self.scene.has_agent.shape[1])
        matrix, offset = (
            torch.from_numpy(one)[None].to(self.scene.future) for one in tables
        )
        return lambda latent: projected(latent, matrix, offset)


def guidance_looks_at(
    scenario: Scenario, rows: Int[np.ndarray, "G"], terms: Collection[GuidanceTerm]
) -> Int[np.ndarray, "N"]:
    """Rows of the agents that terms name, or that agents at some rows could meet."""
    if not terms:
        return rows[:0]
    agents, now = scenario.agents, scenario.current_step
    position = agents.position_m[:, now]
    gap = np.hypot(*(position[:, None] - position[rows]).transpose(2, 0, 1))
    named = np.isin(agents.ids, [name for term in terms for name in term.named_ids])
    # Those that enter later come from anywhere.
    is_near = (gap <= _MET_WITHIN_M).any(axis=1) | ~agents.is_valid[:, now]
    return np.flatnonzero(is_near | named)


def _without_gaps(scene: SceneTensors) -> SceneTensors:
    """Remove candidate slots that no agent uses."""
    most = int(scene.has_candidate.sum(dim=-1).max()) if scene.has_agent.any() else 0
    return replace(
        scene,
        candidates=scene.candidates[:, :, :most],
        has_candidate=scene.has_candidate[:, :, :most],
    )


def _with_late_agents(scenario: Scenario, late: LateAgents) -> Scenario:
    """The scenario in which late agents that are seen soon enough exist from now on."""
    axis = scenario.time_axis
    # Agents that enter within this time are given, extended back to the current step.
    soon = late.entering_by(axis.current_step + round(4.0 / axis.step_s))
    if not len(soon.row):
        return scenario
    return replace(scenario, agents=soon.extended_backwards(scenario))


def _known_steps(
    scenario: Scenario, rows: Int[np.ndarray, "N"], basis: TrajectoryBasis
) -> Bool[np.ndarray, "N H"]:
    """At which steps of the basis trajectories are known; none on another time axis."""
    agents, now = scenario.agents, scenario.current_step
    steps = slice(now + 1, now + 1 + basis.num_steps)
    exists = agents.is_valid[rows, steps]
    exists = exists & np.isfinite(agents.position_m[rows, steps]).all(axis=-1)
    return exists & (abs(scenario.time_axis.step_s - basis.step_s) <= SAME_STEP_S)


def _completed(
    scenario: Scenario,
    features: SceneFeatures,
    partly: Int[np.ndarray, "N"],
    basis: TrajectoryBasis,
) -> tuple[Float[np.ndarray, "M 10"], Bool[np.ndarray, "N"]]:
    """Latents of context agents with partly known trajectories, and their mask."""
    agents, now = scenario.agents, scenario.current_step
    rows = features.agent_row[partly]
    exists = _known_steps(scenario, rows, basis)
    is_known = exists.sum(axis=1) >= _LEAST_KNOWN_STEPS
    if not is_known.any():
        return np.zeros((0, 10)), is_known
    steps = slice(now + 1, now + 1 + basis.num_steps)
    rows, exists = rows[is_known], exists[is_known]
    gap = agents.position_m[rows, steps] - agents.position_m[rows, now][:, None]
    turn = np.exp(-1j * agents.heading_rad[rows, now])[:, None]
    gap = np.where(exists[..., None], gap, 0.0)
    local = (gap[..., 0] + 1j * gap[..., 1]) * turn
    future = np.zeros((len(rows), basis.num_steps, 2))
    future[:, : local.shape[1]] = np.stack([local.real, local.imag], axis=-1)
    valid = np.zeros(future.shape[:2], bool)
    valid[:, : exists.shape[1]] = exists
    speed = np.asarray(features.agent_speed[partly][is_known], float)
    return basis.completed(future, valid, speed), is_known
