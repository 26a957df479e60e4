"""Turns clicks and boxes on the canvas into selections; drags have their own module."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, AgentKind
from pd_editor.viewer.agents.agent_drag import AgentDrag
from pd_editor.viewer.scene.agents_view import AgentsView
from pd_editor.viewer.scene.camera import ground_point, projected
from pd_editor.viewer.scene.seen_camera import CameraPose, SeenCamera
from pd_editor.viewer.tab.ui_context import UiContext

TOGGLE_MODIFIERS: Final = ("shift", "cmd/ctrl")
BOX_MODIFIER: Final = "cmd/ctrl"

GroundClick = Callable[[Float[np.ndarray, "2"]], bool]


class Pointer:
    """Pointer gestures of one browser tab."""

    def __init__(
        self,
        ui: UiContext,
        agents_view: Callable[[], AgentsView],
        on_ground: GroundClick,
        on_agent: Callable[[], None] = lambda: None,
    ) -> None:
        """Listen to the canvas.

        ``on_ground`` is called for every click on the ground; it returns whether it
        handled it (placing an agent, choosing a candidate). ``on_agent`` is called when
        a click has selected an agent.
        """
        self._ui = ui
        self._agents_view = agents_view
        self._on_ground = on_ground
        self._on_agent = on_agent
        self._seen_camera = SeenCamera(ui.client)
        self._drag = AgentDrag(ui, agents_view, self._seen_camera)
        self._last_node_click: tuple[float, float] | None = None
        self._takes_ground_first = False
        scene = ui.client.scene
        self._listen_to_ground(scene, None)
        self._listen_to_box(scene, BOX_MODIFIER)

    def set_takes_ground_first(self, takes: bool) -> None:
        """Set whether a click means the ground even if an agent is there (placing)."""
        self._takes_ground_first = takes

    def set_plain_drag_selects(self, selects: bool) -> None:
        """Set whether a plain drag draws a selection box (top view) or moves the camera."""
        scene = self._ui.client.scene
        scene.remove_rect_select_callback("all")
        self._listen_to_box(scene, BOX_MODIFIER)
        if selects:
            self._listen_to_box(scene, None)

    def attach(self, node: viser.BatchedMeshHandle, kind: AgentKind) -> None:
        """Make the instances of a node clickable and draggable."""

        def clicked(event: Any, *, toggles: bool) -> None:
            position, instance = event.screen_pos, event.instance_index
            self._ui.post(lambda: self._node_clicked(kind, instance, position, toggles))

        @node.on_click
        async def _(event: Any) -> None:
            clicked(event, toggles=False)

        for modifier in TOGGLE_MODIFIERS:

            @node.on_click(modifier=modifier)
            async def _(event: Any) -> None:
                clicked(event, toggles=True)

        self._drag.attach(node, kind)

    def _listen_to_ground(self, scene: Any, modifier: Any) -> None:
        @scene.on_click(modifier=modifier)
        async def _(event: Any) -> None:
            origin, direction = event.ray_origin, event.ray_direction
            position = event.screen_pos
            self._ui.post(lambda: self._ground_clicked(origin, direction, position))

    def _listen_to_box(self, scene: Any, modifier: Any) -> None:
        @scene.on_rect_select(modifier=modifier)
        async def _(event: Any) -> None:
            low, high = event.screen_min, event.screen_max
            camera = self._seen_camera.pose
            self._ui.post(lambda: self._box_selected(low, high, camera))

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
        selection = self._ui.session.selection
        if not toggles:
            selection = (agent_id,)
        elif agent_id in selection:
            selection = tuple(other for other in selection if other != agent_id)
        else:
            selection = (*selection, agent_id)
        self._ui.session.select(selection)
        self._on_agent()

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
        self._ui.session.select(())

    def _box_selected(self, low: Any, high: Any, camera: CameraPose) -> None:
        if self._drag.owns_box(low, high):
            return
        view = self._agents_view()
        poses = view.poses
        if poses is None:
            return
        agents = self._ui.session.scenario.agents
        heights = [DEFAULT_HEIGHT_M[kind] / 2 for kind in agents.kinds]
        centers = np.column_stack([poses.position_m, np.array(heights)])
        screen, is_ahead = projected(camera, centers.reshape(-1, 3))
        inside = ((screen >= np.array(low)) & (screen <= np.array(high))).all(axis=-1)
        chosen = np.flatnonzero(inside & is_ahead & poses.is_present)
        self._ui.session.select(tuple(agents.ids[row] for row in chosen))
