"""Trajectories that a generator has sampled."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from pd_editor.base.errors import GenerationError
from pd_editor.scene.agent_kind import Activity, AgentKind
from pd_editor.scene.agent_states import MOTION, AgentStates
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scene_limits import MAX_LENGTH_M


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficSample:
    """Generated trajectories of G agents at S steps: the current one and all later ones."""

    ids: tuple[str, ...]
    kinds: tuple[AgentKind, ...]
    size_m: Float[np.ndarray, "G 2"]
    position_m: Float[np.ndarray, "G S 2"]
    heading_rad: Float[np.ndarray, "G S"]
    velocity_mps: Float[np.ndarray, "G S 2"]
    activity: tuple[Activity, ...] = ()
    """Of each agent at the current step; empty: unknown of all."""

    def __post_init__(self) -> None:
        for name in MOTION:
            check_finite(name, getattr(self, name), self.ids, ("step",))
        if not ((self.size_m > 0) & (self.size_m <= MAX_LENGTH_M)).all():
            raise GenerationError(
                f"The generated size_m holds a value that is not above 0 and at most "
                f"{MAX_LENGTH_M:g} m."
            )

    @classmethod
    def of(
        cls,
        agents: AgentStates,
        motion: Iterable[np.ndarray] | None = None,
        activity: tuple[Activity, ...] = (),
    ) -> "TrafficSample":
        """Trajectories of agents: their own, or other positions, headings and velocities."""
        own = (getattr(agents, name) for name in MOTION)
        named = zip(MOTION, own if motion is None else motion, strict=True)
        return cls(
            ids=agents.ids,
            kinds=agents.kinds,
            size_m=agents.size_m,
            activity=activity,
            **dict(named),
        )

    def check(self, num_steps: int | None = None, what: str = "The generated") -> None:
        """Refuse arrays that are not of its agents, or of other numbers of steps.

        Arrays of plugins may have been changed since the sample was made.

        Raises:
            GenerationError: a shape is wrong, or an id occurs twice.
        """
        count = len(self.ids)
        if num_steps is None:
            num_steps = (*np.shape(self.position_m), 0, 0)[1]
        for name, expected in (
            ("size_m", (count, 2)),
            ("position_m", (count, num_steps, 2)),
            ("heading_rad", (count, num_steps)),
            ("velocity_mps", (count, num_steps, 2)),
        ):
            values = np.asarray(getattr(self, name))
            if values.shape != expected:
                raise GenerationError(
                    f"{what} {name} has the shape {values.shape}; expected {expected}."
                )
            check_finite(name, values, self.ids, ("step",))
        if len(self.activity) not in (0, count):
            raise GenerationError(
                f"{what} activity is of {len(self.activity)} agents, not {count}."
            )
        if len(self.kinds) != count or len(set(self.ids)) != count:
            raise GenerationError("The generated agents need one kind and one id each.")

    def is_equal(self, other: "TrafficSample") -> bool:
        """Whether another sample has the same agents with the same trajectories."""
        return self.ids == other.ids and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in MOTION
        )

    def applied_to(
        self, agents: AgentTracks, rows: Int[np.ndarray, "G"], now: int
    ) -> AgentTracks:
        """Tracks in which some agents are there and move as in the sample."""
        motion = self.position_m, self.heading_rad, self.velocity_mps
        is_there = np.ones(self.heading_rad.shape, bool)
        return agents.with_motion(rows, now, motion, is_there)

    def without(self, gone: Collection[str]) -> "TrafficSample":
        """The sample without some agents."""
        rows = [row for row, name in enumerate(self.ids) if name not in gone]
        return TrafficSample(
            ids=tuple(self.ids[row] for row in rows),
            kinds=tuple(self.kinds[row] for row in rows),
            size_m=self.size_m[rows],
            position_m=self.position_m[rows],
            heading_rad=self.heading_rad[rows],
            velocity_mps=self.velocity_mps[rows],
            activity=tuple(self.activity[row] for row in rows if self.activity),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class MadeUpPast:
    """Made-up motion of G agents at the P steps before the current one."""

    ids: tuple[str, ...]
    num_steps: tuple[int, ...]
    """Number of the last steps at which each agent exists; it enters the scene then."""
    position_m: Float32[np.ndarray, "G P 2"]
    heading_rad: Float32[np.ndarray, "G P"]
    velocity_mps: Float32[np.ndarray, "G P 2"]

    def __post_init__(self) -> None:
        for name in MOTION:
            check_finite(name, getattr(self, name), self.ids, ("step",))
        steps = self.heading_rad.shape[1]
        if len(self.num_steps) != len(self.ids) or not all(
            0 <= count <= steps for count in self.num_steps
        ):
            raise GenerationError(
                "The made-up past needs a number of steps for each agent, from 0 to"
                f" {steps}."
            )

    @property
    def exists(self) -> Bool[np.ndarray, "G P"]:
        """Whether each agent exists at each step."""
        steps = self.heading_rad.shape[1]
        return np.arange(steps) >= steps - np.array(self.num_steps, int)[:, None]


def check_finite(
    field_name: str,
    values: Float[np.ndarray, "A *shape"],
    ids: Sequence[str],
    axes: Sequence[str],
) -> None:
    """Raise for NaN or infinity in an array of agents.

    Args:
        field_name: name of the array.
        values: the array; its first axis is agents.
        ids: ids of the agents.
        axes: names of the axes after the first one that are told.

    Raises:
        GenerationError: names the array, the first agent and the indices.
    """
    if np.isfinite(values).all():
        return
    row, *rest = np.argwhere(~np.isfinite(values))[0].tolist()
    place = "".join(
        f", {name} {index}" for name, index in zip(axes, rest, strict=False)
    )
    whose = ids[row] if row < len(ids) else f"number {row}"
    raise GenerationError(
        f"The generated {field_name} of agent {whose}{place} is "
        f"{values[(row, *rest)]}; expected finite numbers."
    )
