"""Scenes as padded batches of tensors: the input of both stages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
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
