"""Top views for figures: roads, agents and their trajectories, by matplotlib."""

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.road_map import RoadMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Palette of Okabe and Ito, which colour-blind readers can distinguish."""
_ROAD, _LANE, _AGENT = "#e3e6ea", "#aab2bb", "#333333"


def draw_road(
    axes: "Axes",
    road_map: RoadMap,
    center_m: Float[np.ndarray, "2"],
    half_side_m: float,
) -> None:
    """Draw drivable areas and lane boundaries of a square, without ticks."""
    for area in road_map.drivable_areas:
        axes.fill(*area.boundary[:, :2].T, color=_ROAD, zorder=0, linewidth=0)
    for lane in road_map.lanes:
        for line in (lane.left_m, lane.right_m):
            axes.plot(*line[:, :2].T, color=_LANE, linewidth=0.4, zorder=1)
    axes.set_xlim(center_m[0] - half_side_m, center_m[0] + half_side_m)
    axes.set_ylim(center_m[1] - half_side_m, center_m[1] + half_side_m)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])


def draw_states(axes: "Axes", sample: TrafficSample, color: str = _AGENT) -> None:
    """Draw the boxes of agents at the current step; a line shows the heading."""
    boxes = box_corners(
        sample.position_m[:, 0], sample.heading_rad[:, 0], sample.size_m
    )
    for box, place, angle, size in zip(
        boxes,
        sample.position_m[:, 0],
        sample.heading_rad[:, 0],
        sample.size_m,
        strict=True,
    ):
        axes.fill(*box.T, color=color, alpha=0.85, zorder=4, linewidth=0)
        front = place + size[0] * unit_vector(angle)
        axes.plot(*np.stack([place, front]).T, color=color, linewidth=0.8, zorder=4)


def draw_trajectories(axes: "Axes", sample: TrafficSample) -> None:
    """Draw trajectories as lines with a point at each end."""
    color = COLORS[1]
    for path in sample.position_m:
        axes.plot(*path.T, color=color, linewidth=1.1, alpha=0.8, zorder=3)
        axes.plot(*path[-1], "o", color=color, markersize=2, zorder=3)


def draw_paths(axes: "Axes", paths_m: Sequence[Float[np.ndarray, "H 2"]]) -> None:
    """Draw paths, one colour after the other."""
    for path, color in zip(paths_m, itertools.cycle(COLORS)):
        axes.plot(*path.T, color=color, linewidth=0.8, alpha=0.8, zorder=3)
