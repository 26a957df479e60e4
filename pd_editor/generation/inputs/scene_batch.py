"""Scenes as padded batches of tensors, and relative poses: the input of both stages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor

from pd_editor.generation.core.devices import constant
from pd_editor.generation.features.boundary_tokens import MIRRORED_BOUNDARY
from pd_editor.generation.features.scene_features import (
    MIRRORED_SHAPE,
    MIRRORED_SHAPE_SIGNS,
    PackedScene,
)
from pd_editor.generation.features.scene_fields import (
    CANDIDATE_FIELDS,
    SCENE_FIELDS,
    Axis,
    SceneField,
)
from pd_editor.generation.inputs.trajectory_pca import MIRRORED_LATENT_SIGNS

NUM_POSE_FEATURES: Final = 10

_FAR_M: Final = 30.0
NEAR_M: Final = 4.0


def relative_pose(
    pose: Float[Tensor, "*#shape 3"], seen_from: Float[Tensor, "*#shape 3"]
) -> Float[Tensor, "*shape 4"]:
    """x, y in metres, cosine and sine of ``pose`` in the frame of ``seen_from``."""
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
