"""A small top view of a scenario's current state, as SVG."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.analysis.metrics.road import drivable_ground
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.thresholds import MOVED_M

HALF_WIDTH_M: Final = 54.0
HALF_HEIGHT_M: Final = 36.0
_ROADSIDE_M: Final = 10.0
_EVERY_STEPS: Final = 10
STANDS: Final = ' begin="indefinite"'
"""Text of a picture without which its agents move."""
# Colours that differ clearly on light and on dark ground.
_ROAD: Final = "#8b98a5"
_FOCAL: Final = "#e06a1b"
_EGO: Final = "#17a08f"
_PEDESTRIAN: Final = "#d6337f"
_OTHER: Final = "#3d7fe6"


@dataclass(frozen=True, kw_only=True)
class PictureFrame:
    """The part of a scene that a picture shows: around a point, and so many times as wide."""

    middle_m: tuple[float, float]
    scale: float = 1.0

    @property
    def half_size_m(self) -> tuple[float, float]:
        """Half of its width and height."""
        return HALF_WIDTH_M * self.scale, HALF_HEIGHT_M * self.scale

    @classmethod
    def around_agents(
        cls, shown: Sequence[tuple[Scenario, Sequence[str]]]
    ) -> "PictureFrame":
        """A frame of the mapped road with nearly all of some agents on it, at t = 0."""
        scenario, _ = shown[0]
        ground = drivable_ground(scenario.road_map)
        now, focal = scenario.current_step, (scenario.focal_id,)
        places = [_middle(scenario, focal, now)[None]]
        for one, agent_ids in shown:
            rows = one.agents.rows(agent_ids)
            places.append(
                one.agents.position_m[rows[one.agents.is_valid[rows, now]], now]
            )
        place = np.concatenate(places)
        on_road = shapely.dwithin(ground, shapely.points(place), _ROADSIDE_M)
        place = place[on_road] if on_road.any() else place
        low, high = np.quantile(place, (0.01, 0.99), axis=0)
        half_m = np.array([HALF_WIDTH_M, HALF_HEIGHT_M])
        wanted = (high - low) / 2 / half_m
        scale = float(np.clip(wanted.max() * 1.1, 1.0, 3.0))
        middle = (low + high) / 2
        if on_road.any():
            # Beside the map there is nothing to see.
            first, last = np.reshape(shapely.bounds(ground), (2, 2))
            spare = np.maximum((last - first) / 2 + _ROADSIDE_M - scale * half_m, 0.0)
            centre = (first + last) / 2
            middle = np.clip(middle, centre - spare, centre + spare)
        x, y = middle.tolist()
        return cls(middle_m=(x, y), scale=scale)


def thumbnail(
    scenario: Scenario,
    frame: PictureFrame | None = None,
    *,
    agent_ids: Sequence[str] = (),
    step: int | None = None,
) -> str:
    """Render drivable area, agents and their trajectories, north up, as SVG.

    Args:
        scenario: what is rendered.
        frame: None: around the focal agent, or around those of ``agent_ids``.
        agent_ids: agents that stand out instead of the focal one.
        step: None: the current one.
    """
    agents, now = scenario.agents, scenario.current_step if step is None else step
    marked = agent_ids or (scenario.focal_id,)
    there = np.flatnonzero(agents.is_valid[:, now])
    # Width of trajectories in small pictures of a given frame, per scale.
    line_m = 1.0 if frame is None else 1.5 * frame.scale
    if frame is None:
        x, y = _middle(scenario, marked, now).tolist()
        # Scale of pictures of single agents.
        frame = PictureFrame(middle_m=(x, y), scale=0.6 if agent_ids else 1.0)
    middle, (half_width, half_height) = np.array(frame.middle_m), frame.half_size_m
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="'
        f"{-half_width:g} {-half_height:g} {2 * half_width:g} "
        f'{2 * half_height:g}">',
        f'<path fill="{_ROAD}" fill-opacity="0.45" fill-rule="evenodd" '
        f'd="{ground_path(scenario.road_map, frame)}"/>',
    ]
    # Least rendered size; smaller agents would be a fraction of a pixel.
    size = np.maximum(agents.size_m[there], 1.6 * frame.scale)
    position = agents.position_m[there, now]
    corners = box_corners(position, agents.heading_rad[there, now], size)
    lasts = len(range(now, agents.num_steps, _EVERY_STEPS))
    step_s = _EVERY_STEPS * scenario.time_axis.step_s
    near = (np.abs(position - middle) < [half_width, half_height]).all(axis=-1)
    for row, box in zip(there[near].tolist(), corners[near], strict=True):
        color = _color(scenario, row, marked)
        ahead = np.flatnonzero(agents.is_valid[row, now:])[::_EVERY_STEPS] + now
        way = agents.position_m[row, ahead]
        parts.append(
            f'<polyline fill="none" stroke="{color}" stroke-opacity="0.6" '
            f'stroke-width="{line_m:.2g}" points="{_points(way - middle)}"/>'
            f'<polygon fill="{color}" points="{_points(box - middle)}">'
            f"{_motion(way, agents.heading_rad[row, ahead], way[0] - middle, lasts, step_s)}"
            "</polygon>"
        )
    return "".join([*parts, "</svg>"])


def _motion(
    way: Float[np.ndarray, "N 2"],
    heading_rad: Float[np.ndarray, "N"],
    begin: Float[np.ndarray, "2"],
    most: int,
    step_s: float,
) -> str:
    """Motion along a way, which is there for at most some points; empty for who stands.

    Who turns is turned about where its box is drawn, which is then moved.
    """
    if np.ptp(way, axis=0).max() < MOVED_M:
        return ""
    turned = np.degrees(np.unwrap(heading_rad) - heading_rad[0])
    missing = most - len(way)
    moves = np.pad(way - way[0], ((0, missing), (0, 0)), mode="edge")
    turns = np.pad(turned, (0, missing), mode="edge")
    kinds = [("translate", _points(moves).replace(" ", ";"))]
    if np.abs(turned).max() >= 3.0:
        about = _points(begin[None]).replace(",", " ")
        kinds.append(("rotate", ";".join(f"{-one:.0f} {about}" for one in turns)))
    return "".join(
        f'<animateTransform attributeName="transform" type="{kind}" additive="sum"{STANDS}'
        f' dur="{(most - 1) * step_s:g}s" repeatCount="indefinite" values="{values}"/>'
        for kind, values in kinds
    )


def _middle(
    scenario: Scenario, agent_ids: Sequence[str], step: int
) -> Float[np.ndarray, "2"]:
    agents, now = scenario.agents, step
    there = agents.is_valid[:, now]
    rows = [agents.row_of[one] for one in agent_ids if one in agents.row_of]
    if there[rows].any():
        return agents.position_m[rows, now][there[rows]].mean(axis=0)
    if there.any():
        return np.median(agents.position_m[there, now], axis=0)
    ground = drivable_ground(scenario.road_map)
    if shapely.is_empty(ground):
        return np.zeros(2)
    return shapely.get_coordinates(shapely.centroid(ground))[0]


def _color(scenario: Scenario, row: int, marked: Sequence[str]) -> str:
    agents = scenario.agents
    if agents.ids[row] in marked:
        return _FOCAL
    if agents.ids[row] == EGO_ID:
        return _EGO
    return _PEDESTRIAN if agents.kinds[row] is AgentKind.PEDESTRIAN else _OTHER


@lru_cache(maxsize=16)
def ground_path(road_map: RoadMap, frame: PictureFrame) -> str:
    """Outline of the drivable area in a frame, in metres from its middle with y down."""
    (x, y), (half_width, half_height) = frame.middle_m, frame.half_size_m
    window = shapely.box(
        x - half_width, y - half_height, x + half_width, y + half_height
    )
    ground = shapely.intersection(drivable_ground(road_map), window)
    rings = [
        ring
        for part in shapely.get_parts(shapely.simplify(ground, 0.3))
        if isinstance(part, shapely.Polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    return "".join(
        f"M{_points(shapely.get_coordinates(ring) - [x, y])}Z" for ring in rings
    )


def _points(offset_m: Float[np.ndarray, "N 2"]) -> str:
    """Points of the SVG, in decimetres with y down."""
    return " ".join(f"{x:.1f},{-y:.1f}" for x, y in offset_m.tolist())
