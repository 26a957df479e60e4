"""Inputs of both stages: latents of trajectories, and scenes as batches of tensors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor

from pd_editor.base.errors import ModelError
from pd_editor.generation.core.devices import constant
from pd_editor.generation.features.map_pieces import (
    MIRRORED_BOUNDARY,
    MIRRORED_SHAPE,
    MIRRORED_SHAPE_SIGNS,
)
from pd_editor.generation.features.scene_features import PackedScene
from pd_editor.generation.features.scene_fields import (
    CANDIDATE_FIELDS,
    LATENT_SIZE,
    SCENE_FIELDS,
    Axis,
    SceneField,
)
from pd_editor.scene.geometry.angles import wrap_angle

NUM_ALONG: Final = 5
NUM_ACROSS: Final = LATENT_SIZE - NUM_ALONG
MIRRORED_LATENT_SIGNS: Final = (1.0,) * NUM_ALONG + (-1.0,) * NUM_ACROSS
"""Signs of the latents of a mirrored trajectory."""

_CHORD_STEPS: Final = 2
_TURNS_FROM_M: Final = 0.25
"""Least length of a chord that defines a heading."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryBasis:
    """Basis that maps H future points, in the agent's frame, to D latents.

    The residual to constant velocity straight ahead is projected on orthonormal
    components and divided by their standard deviations. Each component is along the
    heading or across it, so that mirroring a trajectory flips signs. The current point
    is not encoded, so it is exact.
    """

    step_s: float
    mean_m: Float[np.ndarray, "H"]
    """Mean residual along the heading; across it is zero by symmetry."""
    along: Float[np.ndarray, "5 H"]
    across: Float[np.ndarray, "5 H"]
    scale_m: Float[np.ndarray, "10"]
    """Standard deviation of each component, as the norm of H distances."""

    @classmethod
    def fit(
        cls,
        future_m: Float[np.ndarray, "N H 2"],
        speed_mps: Float[np.ndarray, "N"],
        step_s: float = 0.1,
    ) -> "TrajectoryBasis":
        """Fit the principal components of trajectories and of their mirror images."""
        residual = future_m - _straight_on(speed_mps, future_m.shape[1], step_s)
        mean = residual[..., 0].mean(0)
        count = max(len(residual), 1)
        along, along_scale = _components(residual[..., 0] - mean, NUM_ALONG, count)
        across, across_scale = _components(residual[..., 1], NUM_ACROSS, count)
        scale = np.concatenate([along_scale, across_scale])
        return cls(
            step_s=step_s,
            mean_m=mean,
            along=along,
            across=across,
            scale_m=np.maximum(scale, 0.05),
        )

    @property
    def num_steps(self) -> int:
        """Number of future points."""
        return len(self.mean_m)

    def encode(
        self, future_m: Float[np.ndarray, "*shape H 2"], speed_mps: np.ndarray
    ) -> Float[np.ndarray, "*shape 10"]:
        """Encode trajectories as latents; speeds are broadcast against leading axes.

        Points after the last step of the basis are ignored.
        """
        future_m = future_m[..., : self.num_steps, :]
        time = self.step_s * np.arange(1, self.num_steps + 1)
        offset = self.mean_m @ self.along.T
        pace = time @ self.along.T
        along = future_m[..., 0] @ self.along.T - offset
        along -= np.asarray(speed_mps)[..., None] * pace
        across = future_m[..., 1] @ self.across.T
        return np.concatenate([along, across], axis=-1) / self.scale_m

    def decode(
        self, latent: Float[np.ndarray, "*shape 10"], speed_mps: np.ndarray
    ) -> Float[np.ndarray, "*shape H 2"]:
        """Decode latents to trajectories; speeds are broadcast against leading axes."""
        scaled = latent * self.scale_m
        residual = np.stack(
            [
                scaled[..., :NUM_ALONG] @ self.along + self.mean_m,
                scaled[..., NUM_ALONG:] @ self.across,
            ],
            axis=-1,
        )
        return residual + _straight_on(speed_mps, self.num_steps, self.step_s)

    def completed(
        self,
        future_m: Float[np.ndarray, "N H 2"],
        is_valid: Bool[np.ndarray, "N H"],
        speed_mps: Float[np.ndarray, "N"],
    ) -> Float[np.ndarray, "N 10"]:
        """Most probable latents of partly known trajectories, under N(0, I) and 0.1 m."""
        noise_m = 0.1
        mean = self.decode(np.zeros((len(future_m), LATENT_SIZE)), speed_mps)
        known = is_valid.astype(float)[..., None]
        gap = np.where(known > 0, future_m - mean, 0.0)
        latent = np.empty((len(future_m), LATENT_SIZE))
        for axis, (basis, part) in enumerate(
            [
                (self.along, slice(None, NUM_ALONG)),
                (self.across, slice(NUM_ALONG, None)),
            ]
        ):
            matrix = self.scale_m[part, None] * basis
            normal = np.einsum("ih,nh,jh->nij", matrix, known[..., 0], matrix)
            normal += noise_m**2 * np.eye(len(matrix))
            right = gap[..., axis] @ matrix.T
            latent[:, part] = np.linalg.solve(normal, right[..., None])[..., 0]
        return latent

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays to store, by name; ``of_arrays`` is the inverse."""
        return {
            "step_s": np.array([self.step_s]),
            "mean_m": self.mean_m,
            "along": self.along,
            "across": self.across,
            "scale_m": self.scale_m,
        }

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray]) -> "TrajectoryBasis":
        """Make the basis from its arrays.

        Raises:
            ModelError: its steps take no time, as in a damaged file.
        """
        step_s = float(arrays["step_s"][0])
        if not step_s > 0:
            raise ModelError(
                f"The basis of the trajectories has steps of {step_s:g} s; expected more "
                "than 0. Its weights are damaged."
            )
        return cls(
            step_s=step_s,
            mean_m=np.asarray(arrays["mean_m"], float),
            along=np.asarray(arrays["along"], float),
            across=np.asarray(arrays["across"], float),
            scale_m=np.asarray(arrays["scale_m"], float),
        )


def heading_along(
    position_m: Float[np.ndarray, "*shape S 2"],
    first_rad: Float[np.ndarray, "*shape"],
) -> Float[np.ndarray, "*shape S"]:
    """Headings of agents along their paths, constant while they are stationary.

    The first one is given. On a path that starts backwards, headings oppose the motion.
    """
    steps = position_m.shape[-2]
    early = np.maximum(np.arange(steps) - _CHORD_STEPS, 0)
    late = np.minimum(np.arange(steps) + _CHORD_STEPS, steps - 1)
    chord = position_m[..., late, :] - position_m[..., early, :]
    course = np.arctan2(chord[..., 1], chord[..., 0])
    tells = np.hypot(chord[..., 0], chord[..., 1]) > _TURNS_FROM_M
    tells[..., 0] = True
    course[..., 0] = first_rad
    backs = np.abs(wrap_angle(course - first_rad[..., None])) > np.pi / 2
    moved = position_m[..., -1, :] - position_m[..., 0, :]
    reverses = np.hypot(moved[..., 0], moved[..., 1]) < 5.0
    course = np.where(backs & reverses[..., None], course + np.pi, course)
    last = np.maximum.accumulate(np.where(tells, np.arange(steps), 0), axis=-1)
    held = wrap_angle(np.take_along_axis(course, last, axis=-1))
    # The given heading is preserved exactly.
    return np.where(last == 0, first_rad[..., None], held)


def _straight_on(
    speed_mps: np.ndarray, num_steps: int, step_s: float
) -> Float[np.ndarray, "*shape H 2"]:
    time = step_s * np.arange(1, num_steps + 1)
    distance = np.asarray(speed_mps)[..., None] * time
    return np.stack([distance, np.zeros_like(distance)], axis=-1)


def _components(
    residual: Float[np.ndarray, "N H"], count: int, num_samples: int
) -> tuple[Float[np.ndarray, "K H"], Float[np.ndarray, "K"]]:
    values, vectors = np.linalg.eigh(residual.T @ residual / num_samples)
    order = np.argsort(values)[::-1][:count]
    components = vectors[:, order].T
    # eigh does not determine signs: the end of each component is made positive.
    components *= np.where(components[:, -1:] < 0, -1.0, 1.0)
    return components, np.sqrt(np.maximum(values[order], 0.0))


NUM_POSE_FEATURES: Final = 10

_FAR_M: Final = 30.0
NEAR_M: Final = 4.0


def relative_pose(
    pose: Float[Tensor, "*#shape 3"], seen_from: Float[Tensor, "*#shape 3"]
) -> Float[Tensor, "*shape 4"]:
    """x, y in metres, cosine and sine of ``pose`` in the frame of ``seen_from``.

    The only positional input of the trajectory network, which it makes invariant to motions.
    """
    gap = pose[..., :2] - seen_from[..., :2]
    cos, sin = seen_from[..., 2].cos(), seen_from[..., 2].sin()
    turn = pose[..., 2] - seen_from[..., 2]
    return torch.stack(
        [
            cos * gap[..., 0] + sin * gap[..., 1],
            cos * gap[..., 1] - sin * gap[..., 0],
            turn.cos(),
            turn.sin(),
        ],
        dim=-1,
    )


def pose_features(relative: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 10"]:
    """Features of a relative pose, of about unit scale and finer at short distances.

    They are the position in the viewer's frame at two scales, closeness, direction, and
    the viewer's position in the other frame, which for a lane is the offset along and
    beside it.
    """
    x, y, cos, sin = relative.unbind(-1)
    distance = torch.sqrt(x.square() + y.square() + 1e-6)
    squash = 1 / (distance + NEAR_M)
    ahead = -(cos * x + sin * y)
    beside = sin * x - cos * y
    return torch.stack(
        [
            x / _FAR_M,
            y / _FAR_M,
            x * squash,
            y * squash,
            NEAR_M * squash,
            cos,
            sin,
            ahead * squash,
            beside * squash,
            torch.tanh(beside / NEAR_M),
        ],
        dim=-1,
    )


def gathered(
    values: Shaped[Tensor, "B N *feature"], index: Int[Tensor, "B A K"]
) -> Shaped[Tensor, "B A K *feature"]:
    """Gather rows of each scene by index; an arbitrary row where the index is -1."""
    num_scenes, num_rows = values.shape[:2]
    first = torch.arange(num_scenes, device=values.device) * num_rows
    return selected(values.flatten(0, 1), index.clamp_min(0) + first[:, None, None])


def selected(
    table: Shaped[Tensor, "N ..."], row: Int[Tensor, "..."]
) -> Shaped[Tensor, "..."]:
    """Rows of a table, in the shape of their indices; faster than indexing."""
    return table.index_select(0, row.flatten()).unflatten(0, row.shape)


_SIZE_STEP: Final = 8
"""Padded sizes are multiples of this, so that there are few distinct shapes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneTensors:
    """B scenes of up to P pieces, E of the boundary and A agents, with D latent numbers.

    Scenes that share one map may hold it once.

    Fields mean what those of ``PackedScene`` mean; indices are -1 where there is
    none, and everything is 0 where ``has_piece``, ``has_boundary`` or ``has_agent`` is
    false.
    """

    piece_pose: Float[Tensor, "#B P 3"]
    piece_shape: Float[Tensor, "#B P F"]
    piece_kind: Int[Tensor, "#B P"]
    piece_signal: Float[Tensor, "#B P S"]
    has_piece: Bool[Tensor, "#B P"]
    boundary_pose: Float[Tensor, "#B E 3"]
    boundary_shape: Float[Tensor, "#B E G"]
    has_boundary: Bool[Tensor, "#B E"]
    agent_pose: Float[Tensor, "B A 3"]
    agent_speed: Float[Tensor, "B A"]
    agent_size: Float[Tensor, "B A 2"]
    agent_kind: Int[Tensor, "B A"]
    agent_activity: Int[Tensor, "B A"]
    has_agent: Bool[Tensor, "B A"]
    near_pieces: Int[Tensor, "B A M"]
    near_boundary: Int[Tensor, "B A N"]
    near_agents: Int[Tensor, "B A K"]
    candidates: Float[Tensor, "B A C D"]
    has_candidate: Bool[Tensor, "B A C"]
    future: Float[Tensor, "B A D"]
    has_future: Bool[Tensor, "B A"]

    @property
    def num_scenes(self) -> int:
        """Number of scenes B."""
        return len(self.has_agent)

    def with_one_map(self) -> "SceneTensors":
        """The scenes with the map of the first one, which they all share."""
        return replace(
            self,
            **{
                name: getattr(self, name)[:1]
                for name in (*_MAP_FIELDS, "has_piece", "has_boundary")
            },
        )

    def to(
        self, device: torch.device | str, dtype: torch.dtype | None = None
    ) -> "SceneTensors":
        """Move to a device; ``dtype`` is that of the floating-point tensors."""
        return self._mapped(
            lambda tensor: tensor.to(
                device, dtype if tensor.is_floating_point() else None
            )
        )

    def mirrored(self) -> "SceneTensors":
        """Mirror the scenes, exchanging left and right."""
        shape_signs = constant(MIRRORED_SHAPE_SIGNS, self.piece_shape)
        # The drivable area stays on the left, so boundary pieces are reversed.
        boundary = self.boundary_pose * constant([1.0, -1.0, -1.0], self.boundary_pose)
        boundary[..., 2] += torch.pi * self.has_boundary
        latent_signs = constant(MIRRORED_LATENT_SIGNS, self.future)
        pose_signs = constant([1.0, -1.0, -1.0], self.agent_pose)
        return replace(
            self,
            piece_pose=self.piece_pose * pose_signs,
            piece_shape=self.piece_shape[..., list(MIRRORED_SHAPE)] * shape_signs,
            boundary_pose=boundary,
            boundary_shape=self.boundary_shape[..., list(MIRRORED_BOUNDARY)],
            agent_pose=self.agent_pose * pose_signs,
            candidates=self.candidates * latent_signs,
            future=self.future * latent_signs,
        )

    def rotated(self, angle_rad: Float[Tensor, "B"]) -> "SceneTensors":
        """Rotate each scene about its centre, to the left."""
        return replace(
            self,
            piece_pose=_turned(self.piece_pose, self.has_piece, angle_rad),
            boundary_pose=_turned(self.boundary_pose, self.has_boundary, angle_rad),
            agent_pose=_turned(self.agent_pose, self.has_agent, angle_rad),
        )

    def _mapped(self, change: Callable[[Tensor], Tensor]) -> "SceneTensors":
        return SceneTensors(
            **{field.name: change(getattr(self, field.name)) for field in fields(self)}
        )


_MAP_FIELDS: Final = tuple(
    one.name for one in SCENE_FIELDS if one.axis in ("piece", "boundary")
)


def batch_of(
    scenes: Sequence[PackedScene], *, pads_single: bool = False
) -> SceneTensors:
    """Batch scenes, padded to the largest of them; a single scene only on request."""
    assert scenes, "a batch holds at least one scene"
    counts: dict[Axis, list[int]] = {
        "piece": [len(scene.piece_pose) for scene in scenes],
        "boundary": [len(scene.boundary_pose) for scene in scenes],
        "agent": [len(scene.agent_pose) for scene in scenes],
    }
    pads = pads_single or len(scenes) > 1
    sizes = {
        axis: padded_size(max(count)) if pads else max(*count, 1)
        for axis, count in counts.items()
    }

    def padded(field: SceneField) -> Tensor:
        first = field.in_memory(getattr(scenes[0], field.name)[:0])
        shape = (len(scenes), sizes[field.axis], *first.shape[1:])
        table = np.full(shape, field.fill, first.dtype)
        for row, scene in zip(table, scenes, strict=True):
            values = getattr(scene, field.name)
            row[: len(values)] = values
        return torch.from_numpy(table)

    def exists(axis: Axis) -> Tensor:
        return torch.from_numpy(
            np.arange(sizes[axis]) < np.array(counts[axis])[:, None]
        )

    return SceneTensors(
        **{one.name: padded(one) for one in (*SCENE_FIELDS, *CANDIDATE_FIELDS)},
        has_piece=exists("piece"),
        has_boundary=exists("boundary"),
        has_agent=exists("agent"),
    )


def padded_size(count: int) -> int:
    """Size to which a batch is padded that holds so many rows."""
    return -(-count // _SIZE_STEP) * _SIZE_STEP or _SIZE_STEP


def _turned(
    pose: Float[Tensor, "B N 3"],
    exists: Bool[Tensor, "B N"],
    angle_rad: Float[Tensor, "B"],
) -> Float[Tensor, "B N 3"]:
    cos, sin = angle_rad.cos()[:, None], angle_rad.sin()[:, None]
    x, y, heading = pose.unbind(-1)
    turned = torch.stack(
        [cos * x - sin * y, sin * x + cos * y, heading + angle_rad[:, None]], dim=-1
    )
    return torch.where(exists[..., None], turned, pose)
