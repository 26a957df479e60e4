"""Rigid motions of the plane (SE(2))."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.angles import wrap_angle


@dataclass(frozen=True, kw_only=True)
class RigidMotion:
    """A rotation followed by a translation; also the pose of a frame.

    As a pose, ``apply`` takes coordinates in the posed frame to the outer frame.
    """

    x_m: float
    y_m: float
    rotation_rad: float

    def apply(
        self, points_m: Float[np.ndarray, "*shape 2"]
    ) -> Float[np.ndarray, "*shape 2"]:
        """Points of the posed frame, in the outer frame."""
        cos, sin = np.cos(self.rotation_rad), np.sin(self.rotation_rad)
        x, y = points_m[..., 0], points_m[..., 1]
        return np.stack(
            [cos * x - sin * y + self.x_m, sin * x + cos * y + self.y_m], axis=-1
        )

    def turn(
        self, vectors: Float[np.ndarray, "*shape 2"]
    ) -> Float[np.ndarray, "*shape 2"]:
        """Vectors (velocities, directions) of the posed frame, in the outer frame."""
        cos, sin = np.cos(self.rotation_rad), np.sin(self.rotation_rad)
        x, y = vectors[..., 0], vectors[..., 1]
        return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)

    def inverse(self) -> "RigidMotion":
        """The motion that undoes this one."""
        cos, sin = np.cos(self.rotation_rad), np.sin(self.rotation_rad)
        return RigidMotion(
            x_m=float(-cos * self.x_m - sin * self.y_m),
            y_m=float(sin * self.x_m - cos * self.y_m),
            rotation_rad=-self.rotation_rad,
        )

    def after(self, first: "RigidMotion") -> "RigidMotion":
        """The motion that does ``first``, then this one."""
        x, y = self.apply(np.array([first.x_m, first.y_m]))
        angle = wrap_angle(np.array([self.rotation_rad + first.rotation_rad]))
        return RigidMotion(x_m=float(x), y_m=float(y), rotation_rad=float(angle[0]))
