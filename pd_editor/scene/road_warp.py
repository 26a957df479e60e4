"""Warp of the road ahead of an anchor (Scene-Attack, CVPR 2022).

In the anchor's frame (x ahead, y left) a warp is the shear (x, y) -> (x, y + f(x))
with f = 0 behind a border. f is a sum of terms; with u = x - border >= 0:

- smooth turn: f = P/p (u/l)^p up to u = l, then straight on with slope P/l;
- double turn: S(u) - S(u - l), where S is a smooth turn of length 10 m;
- ripple: f = P (1 - cos(2 pi u / l)).
"""

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import EditError
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import heading_of, unit_vector
from pd_editor.scene.geometry.rigid_motion import RigidMotion

MAX_POWER: Final = 10.0
BEND_LENGTH_M: Final = 10.0
"""Length of each of the two bends of a double turn."""

WarpKind = Literal["smooth-turn", "double-turn", "ripple-road"]
WARP_KINDS: Final[tuple[WarpKind, ...]] = ("smooth-turn", "double-turn", "ripple-road")
DEFAULT_LENGTH_M: Final[dict[WarpKind, float]] = {
    "smooth-turn": 10.0,
    "double-turn": 10.0,
    "ripple-road": 60.0,
}


def _bend(
    u: Float[np.ndarray, "*s"], power: float, length: float, exponent: float, order: int
) -> Float[np.ndarray, "*s"]:
    """Smooth turn S (order 0) or its first or second derivative."""
    inside = np.clip(u / length, 0.0, 1.0)
    if order == 0:
        straight = np.maximum(u - length, 0.0) * power / length
        return power / exponent * inside**exponent + straight
    if order == 1:
        return power / length * inside ** (exponent - 1)
    curve = power * (exponent - 1) / length**2 * inside ** (exponent - 2)
    return np.where((u >= 0) & (u < length), curve, 0.0)


@dataclass(frozen=True, kw_only=True)
class WarpTerm:
    """One term of a warp: kind, strength and lengths."""

    kind: WarpKind
    power: float
    """Strength P in -10..10; positive bends to the left."""
    length_m: float
    """Bend length, distance between the two bends, or wave length l."""
    border_m: float = 5.0
    """Distance ahead of the anchor at which the bend begins."""
    exponent: float = 3.0
    """Exponent p of the turns; a ripple has none."""

    def __post_init__(self) -> None:
        if self.kind not in WARP_KINDS:
            raise EditError(
                f"Unknown warp {self.kind!r}; choose one of {', '.join(WARP_KINDS)}."
            )
        values = (self.power, self.length_m, self.border_m, self.exponent)
        if not all(np.isfinite(value) for value in values):
            raise EditError("A warp's numbers must be finite.")
        if abs(self.power) > MAX_POWER:
            raise EditError(f"Power {self.power:g} is outside -10..10.")
        if not 1.0 <= self.length_m <= 500.0:
            raise EditError(f"Length {self.length_m:g} m is outside 1..500 m.")
        if not 0.0 <= self.border_m <= 500.0:
            raise EditError(f"Border {self.border_m:g} m is outside 0..500 m.")
        if not 2.0 <= self.exponent <= 8.0:
            raise EditError(f"Exponent {self.exponent:g} is outside 2..8.")

    def derivative(
        self, x_m: Float[np.ndarray, "*s"], order: int
    ) -> Float[np.ndarray, "*s"]:
        """F (order 0), f' (1) or f'' (2) at distances ahead of the anchor."""
        u = np.asarray(x_m, float) - self.border_m
        if self.kind == "smooth-turn":
            return _bend(u, self.power, self.length_m, self.exponent, order)
        if self.kind == "double-turn":
            there = _bend(u, self.power, BEND_LENGTH_M, self.exponent, order)
            back = _bend(
                u - self.length_m, self.power, BEND_LENGTH_M, self.exponent, order
            )
            return there - back
        wave = 2 * np.pi / self.length_m
        if order == 1:
            value = wave * np.sin(wave * u)
        else:
            value = np.cos(wave * u)
            value = wave**2 * value if order else 1 - value
        return np.where(u >= 0, self.power * value, 0.0)


@dataclass(frozen=True, kw_only=True)
class RoadWarp:
    """Sum of warp terms ahead of an anchor pose, as a motion of the plane."""

    anchor: RigidMotion
    """Pose in the scene frame; points behind it do not move."""
    terms: tuple[WarpTerm, ...]

    @property
    def is_identity(self) -> bool:
        """Whether the warp moves no point."""
        return all(term.power == 0 for term in self.terms)

    def derivative(
        self, x_m: Float[np.ndarray, "*s"], order: int
    ) -> Float[np.ndarray, "*s"]:
        """F (order 0), f' (1) or f'' (2) at distances ahead of the anchor."""
        total = np.zeros(np.shape(x_m))
        for term in self.terms:
            total = total + term.derivative(x_m, order)
        return total

    def moved(self, by_m: Float[np.ndarray, "2"]) -> "RoadWarp":
        """The same warp in a frame whose points are ``by_m`` further."""
        x, y = (np.array([self.anchor.x_m, self.anchor.y_m]) + by_m).tolist()
        return replace(self, anchor=replace(self.anchor, x_m=x, y_m=y))

    def apply(self, points_m: Float[np.ndarray, "*s 2"]) -> Float[np.ndarray, "*s 2"]:
        """Warp points of the original plane (scene frame)."""
        return self._shear(points_m, 1.0)

    def undo(self, points_m: Float[np.ndarray, "*s 2"]) -> Float[np.ndarray, "*s 2"]:
        """Map points of the warped plane back to the original plane (scene frame)."""
        return self._shear(points_m, -1.0)

    def _shear(
        self, points_m: Float[np.ndarray, "*s 2"], sign: float
    ) -> Float[np.ndarray, "*s 2"]:
        ahead = self.distance_ahead(points_m)
        left = self.anchor.turn(np.array([0.0, 1.0]))
        return points_m + sign * self.derivative(ahead, 0)[..., None] * left

    def distance_ahead(
        self, points_m: Float[np.ndarray, "*s 2"]
    ) -> Float[np.ndarray, "*s"]:
        """X in the anchor's frame; the same before and after the warp."""
        forward = self.anchor.turn(np.array([1.0, 0.0]))
        origin = np.array([self.anchor.x_m, self.anchor.y_m])
        return (points_m - origin) @ forward

    def turn(
        self,
        points_m: Float[np.ndarray, "*s 2"],
        vectors: Float[np.ndarray, "*s 2"],
        sign: float = 1.0,
    ) -> Float[np.ndarray, "*s 2"]:
        """Warp vectors at points: J v with J = [[1, 0], [f', 1]].

        ``sign`` -1 applies the inverse to vectors of the warped plane.
        """
        forward = self.anchor.turn(np.array([1.0, 0.0]))
        left = self.anchor.turn(np.array([0.0, 1.0]))
        slope = self.derivative(self.distance_ahead(points_m), 1)
        return vectors + (sign * slope * (vectors @ forward))[..., None] * left

    def curvature(self, x_m: Float[np.ndarray, "*s"]) -> Float[np.ndarray, "*s"]:
        """Curvature f'' / (1 + f'^2)^1.5, 1/m, of a warped road that was straight."""
        return self.derivative(x_m, 2) / (1 + self.derivative(x_m, 1) ** 2) ** 1.5

    def border_m(self) -> float:
        """Distance ahead of the anchor up to which nothing moves."""
        return min((t.border_m for t in self.terms if t.power != 0), default=np.inf)

    def extent_m(self) -> float:
        """Distance ahead of the anchor after which no new bend begins."""
        ends = [
            term.border_m
            + term.length_m
            + (BEND_LENGTH_M if term.kind == "double-turn" else 0.0)
            for term in self.terms
            if term.power != 0
        ]
        return max(ends, default=0.0)


def warped_agents(
    agents: AgentTracks, warp: RoadWarp, sign: float = 1.0
) -> AgentTracks:
    """Transform agents by a warp, or by its inverse (sign -1).

    Positions are sheared; headings and velocities follow by the Jacobian J, so that a
    velocity stays the rate of its position and speeds scale by |J t|. States behind
    the warp's border keep their exact values.
    """
    ahead = warp.distance_ahead(agents.position_m)
    touched = agents.is_valid & (ahead > warp.border_m())
    before = agents.position_m[touched]
    direction = unit_vector(agents.heading_rad[touched])

    heading = agents.heading_rad.copy()
    heading[touched] = heading_of(warp.turn(before, direction, sign))
    velocity = agents.velocity_mps.copy()
    velocity[touched] = warp.turn(before, agents.velocity_mps[touched], sign)
    position = agents.position_m.copy()
    position[touched] = warp.apply(before) if sign > 0 else warp.undo(before)
    return replace(
        agents, position_m=position, heading_rad=heading, velocity_mps=velocity
    )
