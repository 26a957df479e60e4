"""What is under the pointer: picked, told in a tooltip, and offered in a menu."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import ON_LANE_M, lane_kinds_of
from pd_editor.scene.perturbation.warp_scenario import untouched_agent_ids
from pd_editor.scene.road_map import Lane, LaneMark, RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.meshes.agent_shapes import AgentPoses
from pd_editor.viewer.overlay.messages import (
    Ground,
    MenuEntry,
    MenuEvent,
    MenuState,
    Pixel,
    Ray,
    TooltipEvent,
    TooltipState,
)
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.camera import ground_point
from pd_editor.viewer.tab.ui_context import UiContext

REACH: Final = 0.005
"""Share of the distance by which an agent is enlarged for the pointer: some pixels."""
FARTHEST_M: Final = 1e7
"""Points beyond are no places: the pointer is at the horizon."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PointerRay:
    """A position of the pointer on the picture, and the ray that goes through it."""

    x_px: float
    y_px: float
    origin_m: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]

    @classmethod
    def of(cls, at_px: Pixel, ray: Ray | None) -> "PointerRay | None":
        """Ray of a page's event; None if it has none, or none with a direction."""
        if ray is None or np.abs(ray).max() > FARTHEST_M:
            return None
        origin, beyond = np.array(ray)
        direction = beyond - origin
        length = float(np.linalg.norm(direction))
        if length == 0.0:
            return None
        return cls(
            x_px=at_px[0],
            y_px=at_px[1],
            origin_m=origin,
            direction=direction / length,
        )

    @property
    def ground_m(self) -> Float[np.ndarray, "2"] | None:
        """Intersection with the ground; None for the sky."""
        return ground_point(self.origin_m, self.direction)


def point_of(point_m: Ground | None) -> Float[np.ndarray, "2"] | None:
    """Point of the ground that a page sent; None for the sky and the horizon."""
    if point_m is None or max(map(abs, point_m)) > FARTHEST_M:
        return None
    return np.array(point_m)


def agent_under(agents: AgentTracks, poses: AgentPoses, ray: PointerRay) -> int | None:
    """Row of the nearest agent whose box a ray meets."""
    if not len(agents):
        return None
    heights = np.array([DEFAULT_HEIGHT_M[kind] for kind in agents.kinds])
    cos, sin = np.cos(poses.heading_rad), np.sin(poses.heading_rad)
    offset = ray.origin_m[:2] - poses.position_m
    dx, dy, dz = ray.direction
    # In each agent's own frame, where its box is parallel to the axes.
    start = np.stack(
        [
            cos * offset[:, 0] + sin * offset[:, 1],
            cos * offset[:, 1] - sin * offset[:, 0],
            np.full(len(agents), ray.origin_m[2]) - heights / 2,
        ],
        axis=-1,
    )
    along = np.stack(
        [cos * dx + sin * dy, cos * dy - sin * dx, np.full(len(agents), dz)], axis=-1
    )
    distance = np.linalg.norm(start, axis=-1)
    half = np.column_stack([agents.size_m, heights]) / 2
    half = np.maximum(half, 0.3) + (REACH * np.minimum(distance, 150.0))[:, None] / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-half - start) / along, (half - start) / along
    near = np.nanmax(np.minimum(one, other), axis=-1)
    far = np.nanmin(np.maximum(one, other), axis=-1)
    is_hit = poses.is_present & (near <= far) & (far > 0)
    return int(np.where(is_hit, near, np.inf).argmin()) if is_hit.any() else None


_trees: WeakKeyDictionary[RoadMap, shapely.STRtree] = WeakKeyDictionary()


def lane_under(road_map: RoadMap, point_m: Float[np.ndarray, "2"]) -> Lane | None:
    """Lane that contains a point; of several the one with the nearest centre line."""
    tree = _trees.get(road_map)
    if tree is None:
        areas = [shapely.Polygon(lane.outline_m()) for lane in road_map.lanes]
        tree = _trees[road_map] = shapely.STRtree(shapely.make_valid(areas))
    point = shapely.Point(*map(float, point_m))
    found = tree.query(point, predicate="intersects")
    lanes = [road_map.lanes[index] for index in found]
    return min(
        lanes,
        key=lambda lane: shapely.LineString(lane.centerline_m).distance(point),
        default=None,
    )


class Hover:
    """Answers requests of the page, one each time that the pointer comes to rest."""

    def __init__(self, ui: UiContext) -> None:
        """Listen to the page."""
        self._ui = ui
        self._model = ui.model
        ui.overlay.on("tooltip", self._heard)

    def _heard(self, event: TooltipEvent) -> None:
        """Send the tooltip; none during playback."""
        ray, playback = PointerRay.of(event.at, event.ray), self._ui.workspace.playback
        if ray is None or playback.is_playing or self._model.mode is not None:
            return
        poses, agents = self._model.poses, self._ui.session.scenario.agents
        if poses is None:
            return
        row = agent_under(agents, poses, ray)
        lines = self._lines(ray, row)
        if lines:
            state = TooltipState(
                at=(ray.x_px, ray.y_px),
                lines=tuple(lines),
                agent=None if row is None else agents.ids[row],
                asked=event.ask,
            )
            self._ui.overlay.show(state)

    def _lines(self, ray: PointerRay, row: int | None) -> list[str]:
        session = self._ui.session
        scenario = session.scenario
        if row is not None:
            step = self._ui.workspace.playback.step
            return agent_lines(scenario, session.original, row, step)
        lane = (
            None
            if ray.ground_m is None
            else lane_under(scenario.road_map, ray.ground_m)
        )
        return [] if lane is None else lane_lines(lane)


def agent_lines(scenario: Scenario, base: Scenario, row: int, step: float) -> list[str]:
    """Lines of an agent's tooltip: name, speed, lane, and special properties."""
    agents, agent_id = scenario.agents, scenario.agents.ids[row]
    nearest = int(np.clip(np.round(step), 0, agents.num_steps - 1))
    speed = float(np.hypot(*agents.velocity_mps[row, nearest]))
    kind = agents.kinds[row].in_words
    lines = [f"{kind} {agent_id}", f"{speed:.1f} m/s ({speed * 3.6:.0f} km/h)"]
    lane_kinds = lane_kinds_of(agents.kinds[row])
    if lane_kinds:
        match = nearest_lanes(
            scenario.road_map,
            agents.position_m[row, nearest][None],
            heading_rad=agents.heading_rad[row, nearest][None],
            kinds=lane_kinds,
        )
        if match.is_valid[0] and match.distance_m[0] <= ON_LANE_M:
            lines.append(f"lane {match.lane_id[0]}")
    is_known = agent_id in base.agents.row_of
    untouched = untouched_agent_ids(scenario, base)
    marks = [
        word
        for word, holds in (
            ("focal agent", agent_id == scenario.focal_id),
            ("ego", agent_id == EGO_ID),
            ("new", not is_known),
            ("edited", is_known and agent_id not in untouched),
            ("not there at t = 0", not agents.is_valid[row, scenario.current_step]),
        )
        if holds
    ]
    return [*lines, ", ".join(marks)] if marks else lines


def lane_lines(lane: Lane) -> list[str]:
    """Lines of a lane's tooltip: id, kind and lane markings."""
    kind = lane.kind.lower()
    place = " in an intersection" if lane.is_intersection else ""
    lines = [
        f"{str(mark).lower().replace('_', ' ')} line at the {side}"
        for side, mark in (("left", lane.left_mark), ("right", lane.right_mark))
        if mark is not LaneMark.NONE
    ]
    told = ", ".join(lines) or "no lines marked"
    return [f"{kind} lane {lane.lane_id}{place}", told]


@dataclass(frozen=True)
class MenuItem:
    """One line of the menu."""

    label: str
    act: Callable[[], None]
    is_enabled: bool = True
    key: str = ""
    """Key of the same action, shown at the right."""


@dataclass(frozen=True, kw_only=True)
class Menu:
    """Title and items of a menu for the clicked element."""

    title: str
    items: tuple[MenuItem, ...]


class ContextMenu:
    """Shows the menu of what is under the pointer, and does what is chosen."""

    def __init__(
        self, overlay: Overlay, menu_at: Callable[[PointerRay], Menu | None]
    ) -> None:
        """Listen to right clicks; ``menu_at`` is the menu for a ray, or None."""
        self._overlay = overlay
        self._menu_at = menu_at
        self._items: Sequence[MenuItem] = ()
        self._number = 0
        overlay.on("menu", self._heard)

    def _heard(self, event: MenuEvent) -> None:
        if event.kind == "open":
            ray = PointerRay.of(event.at, event.ray)
            if ray is not None:
                self._open(ray)
            return
        chosen = event.index
        if event.menu != self._number:
            return
        items, self._items = self._items, ()
        if 0 <= chosen < len(items) and items[chosen].is_enabled:
            items[chosen].act()

    def _open(self, ray: PointerRay) -> None:
        menu = self._menu_at(ray)
        self._items = () if menu is None else menu.items
        self._number += 1
        state = MenuState(
            number=self._number,
            at=(ray.x_px, ray.y_px),
            title="" if menu is None else menu.title,
            items=tuple(
                MenuEntry(label=item.label, key=item.key, is_enabled=item.is_enabled)
                for item in self._items
            ),
        )
        self._overlay.show(state)
