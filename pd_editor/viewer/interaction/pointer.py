"""Turns clicks, drags and boxes on the canvas into commands."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.editor.commands import TransformAgents
from pd_editor.errors import EditError
from pd_editor.geometry.angles import wrap_angle
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, AgentKind
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.interaction.camera import (
    dragged_ground_point,
    ground_point,
    projected,
)
from pd_editor.viewer.state.desk import Desk
from pd_editor.viewer.views.agents_view import AgentsView

TOGGLE_MODIFIERS: Final = ("shift", "cmd/ctrl")
BOX_MODIFIER: Final = "cmd/ctrl"
ROTATE_MODIFIER: Final = "shift"

GroundClick = Callable[[Float[np.ndarray, "2"]], bool]


@dataclass(kw_only=True, eq=False)
class _Grab:
    """An agent held by the pointer."""

    base: Scenario
    agent_ids: tuple[str, ...]
    start_m: np.ndarray
    center_m: np.ndarray
    height_m: float
    is_rotation: bool


class Pointer:
    """Pointer gestures of one browser tab."""

    def __init__(
        self, desk: Desk, agents_view: Callable[[], AgentsView], on_ground: GroundClick
    ) -> None:
        """Listen to the canvas.

        Args:
            desk: the tab's session and inbox.
            agents_view: where agents are drawn now.
            on_ground: offered every click that meets the ground; answers whether it
                took it (placing an agent, choosing a candidate).
        """
        self._desk = desk
        self._agents_view = agents_view
        self._on_ground = on_ground
        self._grab: _Grab | None = None
        self._last_node_click: tuple[float, float] | None = None
        self._takes_ground_first = False
        scene = desk.client.scene
        self._listen_to_ground(scene, None)
        self._listen_to_box(scene, BOX_MODIFIER)

    def set_takes_ground_first(self, takes: bool) -> None:
        """While placing, a click means the ground even if an agent is there."""
        self._takes_ground_first = takes

    def set_plain_drag_selects(self, selects: bool) -> None:
        """In the top view a plain drag draws a box instead of turning the camera."""
        scene = self._desk.client.scene
        scene.remove_rect_select_callback("all")
        self._listen_to_box(scene, BOX_MODIFIER)
        if selects:
            self._listen_to_box(scene, None)

    def attach(self, node: viser.BatchedMeshHandle, kind: AgentKind) -> None:
        """Make the instances of a node clickable and draggable."""

        def clicked(event: Any, *, toggles: bool) -> None:
            position, instance = event.screen_pos, event.instance_index
            self._desk.post(
                lambda: self._node_clicked(kind, instance, position, toggles)
            )

        @node.on_click
        async def _(event: Any) -> None:
            clicked(event, toggles=False)

        for modifier in TOGGLE_MODIFIERS:

            @node.on_click(modifier=modifier)
            async def _(event: Any) -> None:
                clicked(event, toggles=True)

        for modifier in (None, ROTATE_MODIFIER):

            @node.on_drag("left", modifier=modifier)
            async def _(event: Any) -> None:
                camera = np.array(event.client.camera.position)
                phase, instance = event.phase, event.instance_index
                start, end = event.start_position, event.end_position
                rotates = event.modifier is not None
                self._desk.post(
                    lambda: self._dragged(
                        kind, instance, phase, camera, start, end, rotates
                    ),
                    merge_key="drag" if phase == "update" else None,
                )

    def _listen_to_ground(self, scene: Any, modifier: Any) -> None:
        @scene.on_click(modifier=modifier)
        async def _(event: Any) -> None:
            origin, direction = event.ray_origin, event.ray_direction
            position = event.screen_pos
            self._desk.post(lambda: self._ground_clicked(origin, direction, position))

    def _listen_to_box(self, scene: Any, modifier: Any) -> None:
        @scene.on_rect_select(modifier=modifier)
        async def _(event: Any) -> None:
            low, high = event.screen_min, event.screen_max
            self._desk.post(lambda: self._box_selected(low, high))

    def _node_clicked(
        self,
        kind: AgentKind,
        instance: int | None,
        screen_position: tuple[float, float],
        toggles: bool,
    ) -> None:
        self._last_node_click = screen_position
        if self._takes_ground_first or instance is None:
            return
        agent_id = self._agents_view().agent_at(kind, instance)
        if agent_id is None:
            return
        selection = self._desk.session.selection
        if not toggles:
            selection = (agent_id,)
        elif agent_id in selection:
            selection = tuple(other for other in selection if other != agent_id)
        else:
            selection = (*selection, agent_id)
        self._desk.session.select(selection)

    def _ground_clicked(
        self, origin: Any, direction: Any, screen_position: tuple[float, float]
    ) -> None:
        # A click on an agent is reported for its node and for the scene.
        hit_node = self._last_node_click is not None and np.allclose(
            self._last_node_click, screen_position, atol=1e-4
        )
        self._last_node_click = None
        point = ground_point(origin, direction)
        if hit_node and not self._takes_ground_first:
            return
        if point is not None and self._on_ground(point):
            return
        self._desk.session.select(())

    def _box_selected(self, low: Any, high: Any) -> None:
        view = self._agents_view()
        poses = view.poses
        if poses is None:
            return
        agents = self._desk.session.scenario.agents
        heights = [DEFAULT_HEIGHT_M[kind] / 2 for kind in agents.kinds]
        centers = np.column_stack([poses.position_m, np.array(heights)])
        screen, is_ahead = projected(self._desk.client.camera, centers.reshape(-1, 3))
        inside = ((screen >= np.array(low)) & (screen <= np.array(high))).all(axis=-1)
        chosen = np.flatnonzero(inside & is_ahead & poses.is_present)
        self._desk.session.select(tuple(agents.ids[row] for row in chosen))

    def _dragged(
        self,
        kind: AgentKind,
        instance: int | None,
        phase: str,
        camera: np.ndarray,
        start: Any,
        end: Any,
        rotates: bool,
    ) -> None:
        if phase == "start":
            self._begin_drag(kind, instance, camera, start, rotates)
        grab = self._grab
        if grab is None:
            return
        there = self._desk.session.scenario.agents.row_of
        if self._desk.session.base is not grab.base or any(
            agent not in there for agent in grab.agent_ids
        ):
            # Another scenario was opened, or the agents deleted, under the pointer.
            self._grab = None
            return
        point = dragged_ground_point(camera, end, grab.height_m)
        if point is not None and phase != "start":
            self._desk.preview("drag", _command_of(grab, point), has_end=True)
        if phase == "end":
            self._grab = None
            self._desk.commit_gesture()

    def _begin_drag(
        self,
        kind: AgentKind,
        instance: int | None,
        camera: np.ndarray,
        start: Any,
        rotates: bool,
    ) -> None:
        self._grab = None
        agent_id = (
            None if instance is None else self._agents_view().agent_at(kind, instance)
        )
        point = dragged_ground_point(camera, start, float(start[2]))
        if agent_id is None or point is None:
            return
        session = self._desk.session
        if agent_id not in session.selection:
            session.select((agent_id,))
        agents = session.scenario.agents
        step = session.scenario.current_step
        rows = agents.rows(session.selection)
        rows = rows[agents.is_valid[rows, step]]
        if agents.row_of[agent_id] not in rows:
            raise EditError(
                f"Agent {agent_id} is not there at the current step, where edits act."
            )
        self._grab = _Grab(
            base=session.base,
            agent_ids=tuple(agents.ids[row] for row in rows),
            start_m=point,
            center_m=agents.position_m[rows, step].mean(axis=0),
            height_m=float(start[2]),
            is_rotation=rotates,
        )


def _command_of(grab: _Grab, point_m: np.ndarray) -> TransformAgents:
    """The move or turn that takes the grabbed point to the pointer."""
    if not grab.is_rotation:
        dx, dy = point_m - grab.start_m
        return TransformAgents(
            agent_ids=grab.agent_ids, dx_m=float(dx), dy_m=float(dy), rotation_rad=0.0
        )
    before, after = grab.start_m - grab.center_m, point_m - grab.center_m
    turn = np.arctan2(after[1], after[0]) - np.arctan2(before[1], before[0])
    return TransformAgents(
        agent_ids=grab.agent_ids,
        dx_m=0.0,
        dy_m=0.0,
        rotation_rad=float(wrap_angle(np.asarray(turn))),
    )
