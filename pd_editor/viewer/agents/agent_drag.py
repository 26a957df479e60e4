"""Dragging of agents by the pointer: moves them, or rotates them with Shift."""

import math
from collections import deque
from dataclasses import dataclass
from itertools import count
from typing import Any, Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.base.errors import EditError, LockedAgentError
from pd_editor.editor.commands import TransformAgents
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.scene.agents_view import AgentsView
from pd_editor.viewer.scene.camera import (
    CameraPose,
    SeenCamera,
    ground_point,
    projected,
    ray_through,
)
from pd_editor.viewer.tab.ui_context import UiContext

ROTATE_MODIFIER: Final = "shift"

ScreenPosition = tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class DragEvent:
    """One message of a drag, with the browser's camera at that time."""

    kind: AgentKind
    instance: int | None
    phase: str
    rotates: bool
    camera: CameraPose
    start_m: tuple[float, float, float]
    """The grabbed point, which moves with its agent."""
    end_m: tuple[float, float, float]
    """A point under the pointer, on a plane that faces the camera."""
    end_screen: ScreenPosition
    """The pointer, from the top left of the picture (0..1); the press at the start."""


@dataclass(kw_only=True, eq=False)
class _HeldAgents:
    """Agents held by the pointer."""

    owner: str
    scenario: Scenario
    agent_ids: tuple[str, ...]
    press: ScreenPosition
    offset_screen: ScreenPosition
    """From the press to the grabbed point: viser takes them half a pixel apart."""
    start_m: tuple[float, float, float]
    center_m: np.ndarray
    is_rotation: bool
    has_moved: bool = False


class AgentDrag:
    """Handles a press on an agent until its release.

    viser reports such a press also as a rectangle where a plain drag draws one, before or
    after the end of the drag; ``owns_box`` recognises it by the position of the press. A
    drag ends when its gesture is ended elsewhere (Escape, undo, a command of a panel):
    pointer events until the release are ignored.
    """

    def __init__(
        self,
        ui: UiContext,
        agents_view: AgentsView,
        seen_camera: SeenCamera,
    ) -> None:
        """Make a handler without an active drag."""
        self._ui = ui
        self._agents_view = agents_view
        self._seen_camera = seen_camera
        self._grab: _HeldAgents | None = None
        self._is_pressed = False
        # If a modifier changes during a drag, viser starts the drag again.
        self._presses: deque[ScreenPosition] = deque(maxlen=4)
        self._numbers = count()

    def attach(self, node: viser.BatchedMeshHandle, kind: AgentKind) -> None:
        """Make the instances of a node draggable."""
        for modifier in (None, ROTATE_MODIFIER):

            @node.on_drag("left", modifier=modifier)
            async def _(event: Any) -> None:
                drag = DragEvent(
                    kind=kind,
                    instance=event.instance_index,
                    phase=event.phase,
                    rotates=event.modifier is not None,
                    camera=self._seen_camera.pose,
                    start_m=event.start_position,
                    end_m=event.end_position,
                    end_screen=event.end_screen_pos,
                )
                self._ui.post(
                    lambda: self.dragged(drag),
                    merge_key="drag" if drag.phase == "update" else None,
                )

    def owns_box(self, low: ScreenPosition, high: ScreenPosition) -> bool:
        """Whether a rectangle comes from the press that drags agents."""
        is_owned = self._is_pressed or any(
            _is_corner(press, low, high) for press in self._presses
        )
        self._presses.clear()
        return is_owned

    def dragged(self, event: DragEvent) -> None:
        """Follow one message of a drag."""
        if event.phase == "start":
            self._is_pressed = True
            self._presses.append(event.end_screen)
            self._grab = self._grabbed(event)
        try:
            self._follow(event)
        finally:
            if event.phase == "end":
                self._is_pressed = False
                if self._grab is not None:
                    self._grab = None
                    self._ui.end_gesture()

    def _follow(self, event: DragEvent) -> None:
        """Move the held agents to the pointer."""
        grab = self._grab
        if grab is None:
            return
        if not self._still_holds(grab):
            self._grab = None
            return
        if event.phase == "start" or not _is_meant(grab, event):
            return
        x, y = event.end_screen
        direction = ray_through(
            event.camera, (x + grab.offset_screen[0], y + grab.offset_screen[1])
        )
        point = ground_point(event.camera.position, direction, grab.start_m[2])
        if point is not None:
            try:
                self._ui.preview(grab.owner, _command_of(grab, point))
            except LockedAgentError:
                # Said once; the rest of the drag would say it again at each event.
                self._grab = None
                raise
            grab.has_moved = True

    def _still_holds(self, grab: _HeldAgents) -> bool:
        """Whether nothing else has ended the drag's gesture or changed the scenario."""
        session = self._ui.session
        if not grab.has_moved:
            return session.scenario is grab.scenario
        return self._ui.gesture == grab.owner and session.state.is_previewing

    def _grabbed(self, event: DragEvent) -> _HeldAgents | None:
        agent_id = (
            None
            if event.instance is None
            else self._agents_view.agent_at(event.kind, event.instance)
        )
        if agent_id is None:
            return None
        session = self._ui.session
        if agent_id not in session.selection:
            session.select((agent_id,))
        self._ui.commit_gesture()
        if self._ui.show_current_step():
            # The agent is elsewhere at t = 0: this press is no longer on it.
            return None
        scenario = session.scenario
        agents, step = scenario.agents, scenario.current_step
        rows = agents.rows(session.selection)
        rows = rows[agents.is_valid[rows, step]]
        if agents.row_of[agent_id] not in rows:
            raise EditError(
                f"Agent {agent_id} is not there at the current step, where edits act."
            )
        return _HeldAgents(
            owner=f"drag {next(self._numbers)}",
            scenario=scenario,
            agent_ids=tuple(agents.ids[row] for row in rows),
            press=event.end_screen,
            offset_screen=_offset(event),
            start_m=event.start_m,
            center_m=agents.position_m[rows, step].mean(axis=0),
            is_rotation=event.rotates,
        )


def _is_corner(
    point: ScreenPosition, low: ScreenPosition, high: ScreenPosition
) -> bool:
    return all(
        # Share of the picture within which two events belong to the same press.
        min(abs(point[axis] - low[axis]), abs(point[axis] - high[axis])) < 1e-4
        for axis in (0, 1)
    )


def _offset(event: DragEvent) -> ScreenPosition:
    """From the press to where the grabbed point is seen; 0 while the view settles."""
    if not event.camera.sees(event.start_m, event.end_screen):
        return 0.0, 0.0
    screen, _ = projected(event.camera, np.array([event.start_m], float))
    x, y = screen[0] - np.asarray(event.end_screen)
    return float(x), float(y)


def _is_meant(grab: _HeldAgents, event: DragEvent) -> bool:
    """Whether the event's points belong to its camera and to the view of the press.

    A view that changes during a drag (by a key, or by a request of the server) must not
    move agents: ground points of two cameras are not comparable.
    """
    camera = event.camera
    return camera.sees(event.end_m, event.end_screen) and camera.sees(
        # Share of the picture by which a view that comes to rest may still move in a
        # drag.
        grab.start_m,
        grab.press,
        0.03,
    )


def _command_of(grab: _HeldAgents, point_m: Float[np.ndarray, "2"]) -> TransformAgents:
    """The move or turn that takes the grabbed point to the pointer."""
    start_m = np.array(grab.start_m[:2])
    if not grab.is_rotation:
        dx, dy = point_m - start_m
        return TransformAgents(
            agent_ids=grab.agent_ids, dx_m=float(dx), dy_m=float(dy), rotation_rad=0.0
        )
    before, after = start_m - grab.center_m, point_m - grab.center_m
    turn = np.arctan2(after[1], after[0]) - np.arctan2(before[1], before[0])
    return TransformAgents(
        agent_ids=grab.agent_ids,
        dx_m=0.0,
        dy_m=0.0,
        rotation_rad=math.remainder(float(turn), math.tau),
    )
