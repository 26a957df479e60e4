"""A small top view of a scenario's current state, as SVG."""

from typing import Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.geometry.oriented_box import box_corners
from pd_editor.metrics.road.off_road import drivable_ground
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import EGO_ID, Scenario

HALF_WIDTH_M: Final = 54.0
HALF_HEIGHT_M: Final = 36.0
LEAST_SIZE_M: Final = 1.6
"""Least rendered size; smaller agents would be a fraction of a pixel."""
_SIMPLER_M: Final = 0.3
_EVERY_STEPS: Final = 10
# Colours that can be told apart on light and on dark ground.
_ROAD: Final = "#8b98a5"
_FOCAL: Final = "#e06a1b"
_EGO: Final = "#17a08f"
_PEDESTRIAN: Final = "#d6337f"
_OTHER: Final = "#3d7fe6"


def thumbnail(scenario: Scenario) -> str:
    """Render drivable area, agents and their trajectories, north up, as SVG."""
    agents, now = scenario.agents, scenario.current_step
    there = np.flatnonzero(agents.is_valid[:, now])
    middle = _middle(scenario)
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="'
        f"{-HALF_WIDTH_M:g} {-HALF_HEIGHT_M:g} {2 * HALF_WIDTH_M:g} "
        f'{2 * HALF_HEIGHT_M:g}">',
        f'<path fill="{_ROAD}" fill-opacity="0.45" fill-rule="evenodd" '
        f'd="{_ground_path(scenario, middle)}"/>',
    ]
    size = np.maximum(agents.size_m[there], LEAST_SIZE_M)
    position = agents.position_m[there, now]
    corners = box_corners(position, agents.heading_rad[there, now], size)
    near = (np.abs(position - middle) < [HALF_WIDTH_M, HALF_HEIGHT_M]).all(axis=-1)
    for row, box in zip(there[near].tolist(), corners[near], strict=True):
        color = _color(scenario, row)
        ahead = np.flatnonzero(agents.is_valid[row, now:])[::_EVERY_STEPS] + now
        way = _points(agents.position_m[row, ahead] - middle)
        parts.append(
            f'<polyline fill="none" stroke="{color}" stroke-opacity="0.6" '
            f'points="{way}"/><polygon fill="{color}" points="{_points(box - middle)}"/>'
        )
    return "".join([*parts, "</svg>"])


def _middle(scenario: Scenario) -> Float[np.ndarray, "2"]:
    agents, now = scenario.agents, scenario.current_step
    there = agents.is_valid[:, now]
    focal = agents.row_of.get(scenario.focal_id)
    if focal is not None and there[focal]:
        return agents.position_m[focal, now]
    if there.any():
        return np.median(agents.position_m[there, now], axis=0)
    ground = drivable_ground(scenario.road_map)
    if shapely.is_empty(ground):
        return np.zeros(2)
    return shapely.get_coordinates(shapely.centroid(ground))[0]


def _color(scenario: Scenario, row: int) -> str:
    agents = scenario.agents
    if agents.ids[row] == scenario.focal_id:
        return _FOCAL
    if agents.ids[row] == EGO_ID:
        return _EGO
    return _PEDESTRIAN if agents.kinds[row] is AgentKind.PEDESTRIAN else _OTHER


def _ground_path(scenario: Scenario, middle: Float[np.ndarray, "2"]) -> str:
    x, y = middle.tolist()
    window = shapely.box(
        x - HALF_WIDTH_M, y - HALF_HEIGHT_M, x + HALF_WIDTH_M, y + HALF_HEIGHT_M
    )
    ground = shapely.intersection(drivable_ground(scenario.road_map), window)
    rings = [
        ring
        for part in shapely.get_parts(shapely.simplify(ground, _SIMPLER_M))
        if isinstance(part, shapely.Polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    return "".join(
        f"M{_points(shapely.get_coordinates(ring) - middle)}Z" for ring in rings
    )


def _points(offset_m: Float[np.ndarray, "N 2"]) -> str:
    """Points of the SVG, in decimetres with y down."""
    return " ".join(f"{x:.1f},{-y:.1f}" for x, y in offset_m.tolist())
