"""A scenario as the second stage's input, and beginnings that are kept."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.generation.core.sampler import sampling_mode
from pd_editor.generation.features.scene_features import (
    NUM_FUTURE_STEPS,
    STEP_S,
    SceneFeatures,
    packed,
    scene_features,
    seen_agents,
)
from pd_editor.generation.inputs import (
    SceneTensors,
    TrajectoryBasis,
    batch_of,
    heading_along,
)
from pd_editor.generation.trajectory.guidance.latent_motion import (
    KnownMotion,
    LatentMotion,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    TermContext,
    TermGuidance,
)
from pd_editor.generation.trajectory.network.decoding import (
    Motion,
    TrajectoryDecoder,
    motion_of,
    turned_as_vehicles,
)
from pd_editor.generation.trajectory.network.denoiser import TrajectoryConfig
from pd_editor.generation.trajectory.sampler import TrajectoryModel
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, Activity
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

_POSITION_NOISE_M: Final = 0.6
"""Tolerance of each kept position, against latents of unit variance: recorded positions
jitter, and a rest that follows from the jitter is not drivable."""
_VELOCITY_NOISE_MPS: Final = 0.5
"""Tolerance of the velocity at the end of the kept beginning."""
_BLEND_S: Final = 2.0
"""Time in which the offset of the rest decays."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptBeginning:
    """Kept states of K sampled agents at the current step and F later ones.

    Positions are linear in an agent's latents, so a known beginning is a linear system. Each
    predicted clean sample is moved to the nearest latents that solve it (inpainting in the
    latent basis); the basis does not represent a recorded beginning exactly, so the decoded
    rest is joined to it by a decaying offset without a jump of position or velocity.
    """

    index: Int[np.ndarray, "K"]
    is_kept: Bool[np.ndarray, "K F_plus_1"]
    """Steps at which an agent exists and its state is kept."""
    last: Int[np.ndarray, "K"]
    """Last kept step, at least 1."""
    position_m: Float[np.ndarray, "K F_plus_1 2"]
    heading_rad: Float[np.ndarray, "K F_plus_1"]
    velocity_mps: Float[np.ndarray, "K F_plus_1 2"]
    step_s: float

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        agent_row: Int[np.ndarray, "A"],
        is_sampled: Bool[np.ndarray, "A"],
    ) -> "KeptBeginning":
        """Kept beginnings of the sampled agents with such a lock.

        ``agent_row`` are the rows of the task's agents in the scenario.
        """
        now, agents = scenario.current_step, scenario.agents
        is_kept = (scenario.kept_steps() & agents.is_valid)[agent_row, now:]
        index = np.flatnonzero(is_sampled & (is_kept.sum(axis=1) > 1))
        rows, is_kept = agent_row[index], is_kept[index]
        last = is_kept.shape[1] - 1 - is_kept[:, ::-1].argmax(axis=1)
        return cls(
            index=index,
            is_kept=is_kept,
            last=last,
            position_m=agents.position_m[rows, now:],
            heading_rad=agents.heading_rad[rows, now:],
            velocity_mps=agents.velocity_mps[rows, now:],
            step_s=scenario.time_axis.step_s,
        )

    def __len__(self) -> int:
        return len(self.index)

    def projection(
        self, basis: TrajectoryBasis, num_agents: int
    ) -> tuple[Float[np.ndarray, "A 10 10"], Float[np.ndarray, "A 10"]]:
        """Matrix and offset that move latents of each agent to those that are kept.

        The result is the most probable latents under the prediction with unit variance
        and the kept states; other agents have the identity.
        """
        size = len(basis.scale_m)
        matrix = np.tile(np.eye(size), (num_agents, 1, 1))
        offset = np.zeros((num_agents, size))
        if abs(self.step_s - basis.step_s) > 1e-6:
            return matrix, offset
        for place, agent in enumerate(self.index):
            rows, target = self._system(basis, place)
            gain = np.linalg.solve(rows.T @ rows + np.eye(size), rows.T)
            matrix[agent] -= gain @ rows
            offset[agent] = gain @ target
        return matrix, offset

    def _system(
        self, basis: TrajectoryBasis, place: int
    ) -> tuple[Float[np.ndarray, "R 10"], Float[np.ndarray, "R"]]:
        """Rows and targets of one agent in units of their tolerances."""
        size = len(basis.scale_m)
        first = self.position_m[place, 0]
        turn = np.exp(-1j * self.heading_rad[place, 0])
        speed = np.full(size + 1, np.hypot(*self.velocity_mps[place, 0]))
        units = basis.decode(np.concatenate([np.zeros((1, size)), np.eye(size)]), speed)
        mean, shape = units[0], units[1:] - units[0]
        steps = np.flatnonzero(self.is_kept[place, 1 : basis.num_steps + 1])
        gap = self.position_m[place, steps + 1] - first
        local = (gap[:, 0] + 1j * gap[:, 1]) * turn
        points = np.stack([local.real, local.imag], axis=-1) - mean[steps]
        rows = [shape[:, steps].reshape(size, -1).T / _POSITION_NOISE_M]
        targets = [points.reshape(-1) / _POSITION_NOISE_M]
        end = int(self.last[place]) - 1
        if 1 <= end < basis.num_steps - 1:
            velocity = self.velocity_mps[place, end + 1]
            local = (velocity[0] + 1j * velocity[1]) * turn
            wanted = np.array([local.real, local.imag])
            unit = 1 / (2 * basis.step_s * _VELOCITY_NOISE_MPS)
            rows.append((shape[:, end + 1] - shape[:, end - 1]).T * unit)
            targets.append(
                wanted / _VELOCITY_NOISE_MPS - (mean[end + 1] - mean[end - 1]) * unit
            )
        return np.concatenate(rows), np.concatenate(targets)

    def joined(self, motion: Motion) -> Motion:
        """Motion of all agents in which kept states are exact and the rest continues them."""
        if not len(self):
            return motion
        position = motion.position_m.copy()
        heading = motion.heading_rad.copy()
        velocity = motion.velocity_mps.copy()
        num_steps = position.shape[2]
        for place, agent in enumerate(self.index):
            last, kept = int(self.last[place]), self.is_kept[place]
            rest = slice(last, num_steps)
            own = position[:, agent]
            decoded = own[:, rest].copy()
            if len(decoded[0]) > 1:
                slope = (decoded[:, 1] - own[:, last - 1]) / (2 * self.step_s)
                offset = self.position_m[place, last] - decoded[:, 0]
                drift = self.velocity_mps[place, last] - slope
                decoded = decoded + self._decaying(offset, drift, num_steps - last)
            own[:, rest] = decoded
            own[:, kept] = self.position_m[place, kept]
            heading[:, agent, rest] = self._headings(place, own[:, rest])
            heading[:, agent, kept] = self.heading_rad[place, kept]
            velocity[:, agent, 1:] = np.gradient(own, self.step_s, axis=1)[:, 1:]
            velocity[:, agent, kept] = self.velocity_mps[place, kept]
        return Motion(position_m=position, heading_rad=heading, velocity_mps=velocity)

    def _decaying(
        self,
        offset_m: Float[np.ndarray, "S 2"],
        drift_mps: Float[np.ndarray, "S 2"],
        num_steps: int,
    ) -> Float[np.ndarray, "S N 2"]:
        """Offset at the steps after the beginning: a cubic that ends at rest at zero."""
        share = np.minimum(np.arange(num_steps) * self.step_s / _BLEND_S, 1.0)[:, None]
        stays = (1 + 2 * share) * (1 - share) ** 2
        rises = share * (1 - share) ** 2 * _BLEND_S
        return stays * offset_m[:, None] + rises * drift_mps[:, None]

    def _headings(
        self, place: int, path_m: Float[np.ndarray, "S N 2"]
    ) -> Float[np.ndarray, "S N"]:
        """Headings along the rest of the path, turned smoothly from the kept one."""
        first = np.full(len(path_m), self.heading_rad[place, self.last[place]])
        course = heading_along(path_m, first)
        if course.shape[1] < 2:
            return course
        turn = wrap_angle(first - course[:, 1])
        after_s = np.maximum(np.arange(course.shape[1]) - 1, 0) * self.step_s
        # In a second the heading turns from the kept one to that of the path.
        share = np.maximum(1 - after_s, 0.0)
        return wrap_angle(course + share * turn[:, None])


def projected(
    latent: Float[Tensor, "S B A 10"],
    matrix: Float[Tensor, "B A 10 10"],
    offset: Float[Tensor, "B A 10"],
) -> Float[Tensor, "S B A 10"]:
    """Latents moved to those of the kept beginnings."""
    return torch.einsum("baij,sbaj->sbai", matrix, latent) + offset


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
