"""Selections: by clicks and boxes on the canvas, and by rule; drags have their own module."""

from typing import Any, Final

import numpy as np
import viser

from pd_editor.base.errors import EditError
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, AgentKind
from pd_editor.viewer.agents.agent_drag import AgentDrag
from pd_editor.viewer.agents.placing import PlacingMode
from pd_editor.viewer.scene.agents_view import AgentsView
from pd_editor.viewer.scene.camera import (
    CameraPose,
    SeenCamera,
    ground_point,
    projected,
)
from pd_editor.viewer.tab.ui_context import UiContext


class Selecting:
    """Selects among the agents that the picture shows at the playhead."""

    def __init__(self, ui: UiContext) -> None:
        """Make the actions on a session's selection."""
        self._ui = ui

    def select_all(self) -> None:
        """Select every agent in the picture's time."""
        self._ui.session.select(self._present())

    def invert(self) -> None:
        """Select exactly those in the picture's time that are not selected."""
        selected = set(self._ui.session.selection)
        self._ui.session.select(
            agent for agent in self._present() if agent not in selected
        )

    def same_kind(self) -> None:
        """Select all in the picture's time of the kinds that are selected.

        Raises:
            EditError: nothing is selected.
        """
        session = self._ui.session
        agents = session.scenario.agents
        kinds = {agents.kinds[row] for row in agents.rows(session.selection)}
        if not kinds:
            raise EditError("Select an agent of the kind first.")
        session.select(
            agent
            for agent in self._present()
            if agents.kinds[agents.row_of[agent]] in kinds
        )

    def _present(self) -> tuple[str, ...]:
        poses = self._ui.model.poses
        ids = self._ui.session.scenario.agents.ids
        if poses is None or len(poses.is_present) != len(ids):
            return ()
        return tuple(ids[row] for row in np.flatnonzero(poses.is_present))


TOGGLE_MODIFIERS: Final = ("shift", "cmd/ctrl")
BOX_MODIFIER: Final = "cmd/ctrl"


class Pointer:
    """Pointer gestures of one browser tab."""

    def __init__(self, ui: UiContext, agents_view: AgentsView) -> None:
        """Listen to the canvas and to agents that are drawn later."""
        self._ui = ui
        self._model = ui.model
        self._agents_view = agents_view
        self._seen_camera = SeenCamera(ui.client)
        self._drag = AgentDrag(ui, agents_view, self._seen_camera)
        self._last_node_click: tuple[float, float] | None = None
        self._listen_to_ground(ui.client.scene, None)
        self._view_switched()
        self._model.view_switched.subscribe(self._view_switched)
        agents_view.new_body.subscribe(self._attach)

    @property
    def _takes_ground_first(self) -> bool:
        """Whether a click means the ground even if an agent is there."""
        return isinstance(self._model.mode, PlacingMode)

    def _view_switched(self) -> None:
        """A plain drag draws a selection box in the top view, else it moves the camera."""
        scene = self._ui.client.scene
        scene.remove_rect_select_callback("all")
        self._listen_to_box(scene, BOX_MODIFIER)
        if self._ui.workspace.view.is_top:
            self._listen_to_box(scene, None)

    def _attach(self, node: viser.BatchedMeshHandle, kind: AgentKind) -> None:
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
        agent_id = self._agents_view.agent_at(kind, instance)
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
        self._model.agent_clicked.emit()

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
        if point is not None and self._model.ground_clicked.offer(point):
            return
        self._ui.session.select(())

    def _box_selected(self, low: Any, high: Any, camera: CameraPose) -> None:
        if self._drag.owns_box(low, high):
            return
        poses = self._model.poses
        if poses is None:
            return
        agents = self._ui.session.scenario.agents
        heights = [DEFAULT_HEIGHT_M[kind] / 2 for kind in agents.kinds]
        centers = np.column_stack([poses.position_m, np.array(heights)])
        screen, is_ahead = projected(camera, centers.reshape(-1, 3))
        inside = ((screen >= np.array(low)) & (screen <= np.array(high))).all(axis=-1)
        chosen = np.flatnonzero(inside & is_ahead & poses.is_present)
        self._ui.session.select(tuple(agents.ids[row] for row in chosen))
