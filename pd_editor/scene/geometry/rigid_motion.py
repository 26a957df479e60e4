"""Rigid motions of the plane (SE(2))."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.angles import turned, wrap_angle


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
        return turned(points_m, self.rotation_rad) + np.array([self.x_m, self.y_m])

    def turn(
        self, vectors: Float[np.ndarray, "*shape 2"]
    ) -> Float[np.ndarray, "*shape 2"]:
        """Vectors (velocities, directions) of the posed frame, in the outer frame."""
        return turned(vectors, self.rotation_rad)

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
