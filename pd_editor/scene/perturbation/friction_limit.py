"""Friction limit of speed in curves: v^2 |kappa| <= mu g (Scene-Attack, CVPR 2022)."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.road_warp import BEND_LENGTH_M, RoadWarp, WarpTerm

GRAVITY_MPS2: Final = 9.81
DRY_ROAD_FRICTION: Final = 0.7
"""Friction coefficient mu that Scene-Attack assumes."""
SAMPLE_SPACING_M: Final = 0.05


@dataclass(frozen=True, kw_only=True)
class WarpSummary:
    """Effect of a warp on a road that is straight ahead of its anchor."""

    max_curvature_per_m: float
    min_radius_m: float
    """Smallest radius of curvature; infinite if the road stays straight."""
    speed_limit_mps: float
    """Highest speed within the friction limit; infinite on a straight road."""
    lateral_shift_m: float
    """Shift to the left at the end of the bends."""


def road_curvature(
    warp: RoadWarp, x_m: Float[np.ndarray, "N"]
) -> Float[np.ndarray, "N"]:
    """Signed curvature, 1/m, of a warped straight road at distances ahead of the anchor."""
    return warp.curvature(x_m)


def friction_limited_speed(
    curvature_per_m: Float[np.ndarray, "*s"], friction_coefficient: float
) -> Float[np.ndarray, "*s"]:
    """Highest speed, m/s, within the friction limit of a curvature; infinite if straight."""
    bend = np.abs(curvature_per_m)
    with np.errstate(divide="ignore", over="ignore"):
        return np.sqrt(friction_coefficient * GRAVITY_MPS2 / bend)


def _edges_m(term: WarpTerm) -> tuple[float, ...]:
    """Distances ahead of the anchor where a term's second derivative may jump."""
    end = term.border_m + term.length_m
    if term.kind == "double-turn":
        return (term.border_m, term.border_m + BEND_LENGTH_M, end, end + BEND_LENGTH_M)
    return (term.border_m, end)


def summarise(
    warp: RoadWarp, friction_coefficient: float = DRY_ROAD_FRICTION
) -> WarpSummary:
    """Sharpest bend, speed limit and shift of a straight road under a warp."""
    end = warp.extent_m()
    x = np.linspace(0.0, end, max(int(end / SAMPLE_SPACING_M), 1) + 1)
    # The second derivative jumps where a bend ends, so both sides are evaluated.
    edges = np.array([edge for term in warp.terms for edge in _edges_m(term)])
    x = np.concatenate([x, edges - 1e-9, edges + 1e-9])
    sharpest = float(np.abs(road_curvature(warp, x)).max(initial=0.0))
    limit = friction_limited_speed(np.array([sharpest]), friction_coefficient)
    return WarpSummary(
        max_curvature_per_m=sharpest,
        min_radius_m=1 / sharpest if sharpest > 0 else float("inf"),
        speed_limit_mps=float(limit[0]),
        lateral_shift_m=float(warp.derivative(np.array([end]), 0)[0]),
    )
