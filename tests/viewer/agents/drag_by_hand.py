"""Drag messages as viser sends them, for tests without a browser."""

import numpy as np

from pd_editor.viewer.scene.camera import CameraPose, projected
from tests.viewer.fake_browser import CAMERA, FakeTab

GRAB_HEIGHT_M = 1.0


def camera_above(x_m: float, y_m: float) -> CameraPose:
    """A camera that looks straight down, north up."""
    return CameraPose(
        position=np.array([x_m, y_m, 900.0]),
        wxyz=np.array([0.0, 1.0, 0.0, 0.0]),
        fov=0.14,
        aspect=1.4,
    )


class DragByHand:
    """One press on an agent; says what viser would say."""

    def __init__(self, tab: FakeTab, agent_id: str, *, rotates: bool = False) -> None:
        self.tab = tab
        agents = tab.session.scenario.agents
        row = agents.row_of[agent_id]
        self._body = tab.body_of(agent_id)
        self._rotates = rotates
        self._start = agents.position_m[row, 49]
        self.camera = camera_above(*self._start)
        """The camera that the browser shows the picture through."""
        self.known_camera: CameraPose | None = None
        """What the server takes it for, if that is another."""
        self.pixel_shift = (0.0, 0.0)
        """By how much the page's own positions are off."""

    def on_screen(self, point_m) -> tuple[float, float]:
        """Where the browser shows a point at the height of the grab."""
        point = np.array([[*point_m, GRAB_HEIGHT_M]])
        screen, _ = projected(self.camera, point)
        return (
            float(screen[0, 0]) + self.pixel_shift[0],
            float(screen[0, 1]) + self.pixel_shift[1],
        )

    def say(self, phase: str, point_m) -> None:
        """Send one message with the pointer at a point."""
        self._show(self.known_camera or self.camera)
        self.tab.send(
            {
                "type": "SceneNodeDragMessage",
                **self._body,
                "phase": phase,
                "start_position": (*self._start, GRAB_HEIGHT_M),
                "start_screen_pos": self.on_screen(self._start),
                "end_position": (*point_m, GRAB_HEIGHT_M),
                "end_screen_pos": self.on_screen(point_m),
                "button": "left",
                "modifier": "shift" if self._rotates else None,
            }
        )

    def _show(self, camera: CameraPose) -> None:
        """Let the page report a camera."""
        width, height = 1400, 1000
        self.tab.send(
            {
                **CAMERA,
                "position": camera.position.tolist(),
                "wxyz": camera.wxyz.tolist(),
                "fov": camera.fov,
                "image_width": width,
                "image_height": height,
                "look_at": [*camera.position[:2].tolist(), 0.0],
            }
        )

    def box(self, start_m, end_m) -> None:
        """The rectangle that a plain drag also draws in the top view."""
        corners = np.array([self.on_screen(start_m), self.on_screen(end_m)])
        low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        self._show(self.camera)
        self.tab.send(
            {
                "type": "ScenePointerMessage",
                "event_type": "rect-select",
                "ray_origin": None,
                "ray_direction": None,
                "screen_pos": (low, high),
                "modifier": None,
            }
        )
