"""Camera views of a browser tab."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.overlay.messages import CompassState, CurtainState, ViewState
from pd_editor.viewer.scene.camera import ground_point, projected, ray_through
from pd_editor.viewer.scene.framing import (
    LOOK_AHEAD_M,
    LOWEST_OF_MAP_RAD,
    LOWEST_RAD,
    PERSPECTIVE_FOV_RAD,
    TOP_VIEW_FOV_RAD,
    TOP_VIEW_HALF_HEIGHT_M,
    FreePart,
    agents_extent,
    facing_square,
    fitted,
    framing_direction,
    from_above,
    from_behind,
    map_extent,
)
from pd_editor.viewer.state.view_memory import Vector, ViewPose, vector
from pd_editor.viewer.tab.ui_context import UiContext

NORTH_RAD: Final = float(np.pi / 2)
AHEAD_M: Final = 70.0
"""Length of road ahead of a pose that is framed with it."""
UP: Final = (0.0, 0.0, 1.0)
TOP_TO_3D: Final = TOP_VIEW_HALF_HEIGHT_M / from_behind(np.zeros(2), 0.0).half_height_m
"""Ratio of the heights that the top view and a 3-D view of the same position show."""


class Viewpoint:
    """The 3-D and the top view of one tab, and what they frame.

    The page's script makes the wheel zoom to the pointer, pans, and keeps the camera
    above the ground; without it viser's own camera gestures remain.
    """

    def __init__(self, ui: UiContext) -> None:
        """Start with the view that the workspace stores."""
        self._ui = ui
        self._model = ui.model
        self._overlay = ui.overlay
        self._camera = ui.client.camera
        self._num_looks = 0
        self._overlay.on("compass", lambda _click: self.turn())

    @property
    def is_top(self) -> bool:
        """Whether the scene is seen from above, as a map."""
        return self._ui.workspace.view.is_top

    @property
    def is_heading_up(self) -> bool:
        """Whether the top view has the focal agent's heading up instead of north."""
        return self._ui.workspace.view.is_heading_up

    def restore(self) -> None:
        """Show what was shown before the page was reloaded, else the focal agent."""
        pose = self._ui.workspace.view.pose
        if pose is None:
            self.frame_opened()
        else:
            self._look(pose)

    def remember(self) -> None:
        """Store the pose for the next connection."""
        workspace = self._ui.workspace
        workspace.view = replace(workspace.view, pose=ViewPose.of(self._camera))

    def hold_picture(self, nodes: tuple[str, ...]) -> None:
        """Freeze the picture in the page until these nodes have changed.

        The page changes its camera and agents at once, but needs a few frames for a road:
        it would show the former road from the new camera.
        """
        self._num_looks += 1
        self._overlay.show(CurtainState(number=self._num_looks, nodes=nodes))

    def frame_opened(self) -> None:
        """Show the focal agent and what surrounds it; of an empty scene the whole map."""
        center_m, heading_rad = self._focal_pose()
        if not self._scenario.agents.is_valid.any():
            self._look(from_behind(center_m, heading_rad))
            self.frame_map()
            return
        if self.is_top:
            self._look(from_above(center_m, self._up_rad()))
            return
        ahead = np.array([np.cos(heading_rad), np.sin(heading_rad)])
        self._look(from_behind(center_m + LOOK_AHEAD_M * ahead, heading_rad))

    def frame_map(self) -> None:
        """Show the whole map, or where the traffic is if the map is huge."""
        self._fit(map_extent(self._scenario), LOWEST_OF_MAP_RAD)

    def frame_selection(self) -> None:
        """Show the selected agents with their trajectories, else the focal agent."""
        self.frame_agents(self._ui.session.selection or (self._scenario.focal_id,))

    def frame_agents(self, agent_ids: Iterable[str]) -> None:
        """Show agents, from above with their trajectories, else in the middle."""
        extent = agents_extent(self._scenario, agent_ids, with_tracks=self.is_top)
        if extent is not None and self.is_top:
            self._fit(extent)
        elif extent is not None:
            half_side_m = float(np.hypot(*np.ptp(extent, axis=0)[:2])) / 2
            self._fit_square(extent.mean(axis=0), half_side_m)

    def uncover(self) -> None:
        """Move along the ground if an element covers the selection or the focal agent."""
        ids = self._ui.session.selection or (self._scenario.focal_id,)
        agents = self._scenario.agents
        rows = [agents.row_of[name] for name in ids if name in agents.row_of]
        if not rows:
            return
        place_m = agents.position_m[rows, self._scenario.current_step].mean(axis=0)
        screen, is_ahead = projected(self._camera, np.append(place_m, 0.0)[None])
        x, y = screen[0].tolist()
        lowest = 1.0 - self._model.covered_px / max(self._camera.image_height, 1)
        if not (is_ahead[0] and 0.0 <= x <= 1.0 and lowest < y <= 1.0):
            return
        # Where an agent is brought that an element covered: a share of the uncovered
        # height.
        ray = ray_through(self._camera, (x, 0.75 * lowest))
        there_m = ground_point(self._camera.position, ray)
        if there_m is None:
            self.frame_agents(ids)
            return
        pose = ViewPose.of(self._camera)
        shift = np.append(place_m - there_m, 0.0)
        self._look(
            replace(
                pose,
                position_m=vector(pose.position_m + shift),
                look_at_m=vector(pose.look_at_m + shift),
            )
        )

    def frame_pose(self, pose: RigidMotion) -> None:
        """Show the road about a pose and ahead of it."""
        corners = np.array([[x, y] for x in (-10.0, AHEAD_M) for y in (-15.0, 15.0)])
        self._fit(np.column_stack([pose.apply(corners), np.zeros(len(corners))]))

    def frame_place(
        self, place_m: tuple[float, float], free: FreePart | None = None
    ) -> None:
        """Show a place and its surroundings, the place in the middle of the free part."""
        # Half side of the area that is shown around a position.
        self._fit_square(np.array([*place_m, 0.0]), 24.0, free)

    def _fit_square(
        self, center_m: np.ndarray, half_side_m: float, free: FreePart | None = None
    ) -> None:
        forward, up, _ = self._direction(LOWEST_RAD)
        square = facing_square(center_m, half_side_m, forward=forward, up=up)
        self._fit(square, free=free)

    def show_3d(self) -> None:
        """Switch to the 3-D view and frame it."""
        self._set_top(False)
        self._frame_work()
        self._model.view_switched.emit()

    def show_top(self) -> None:
        """Switch to the top view and frame it."""
        self._set_top(True)
        self._frame_work()
        self._model.view_switched.emit()

    def switch(self) -> None:
        """Switch between both views at the same position."""
        former = ViewPose.of(self._camera)
        self._set_top(not self.is_top)
        center_m = np.array(former.look_at_m[:2])
        if self.is_top:
            half_height_m = former.half_height_m * TOP_TO_3D
            self._look(from_above(center_m, self._up_rad(), half_height_m))
        else:
            pose = from_behind(center_m, self._focal_pose()[1])
            scale = former.half_height_m / (TOP_TO_3D * pose.half_height_m)
            look = np.subtract(pose.position_m, pose.look_at_m)
            self._look(replace(pose, position_m=vector(pose.look_at_m + scale * look)))
        if self._ui.session.selection:
            self.uncover()
        self._model.view_switched.emit()

    def turn(self) -> None:
        """Top view: north up or heading up; 3-D view: look north."""
        pose = ViewPose.of(self._camera)
        if self.is_top:
            workspace = self._ui.workspace
            workspace.view = replace(
                workspace.view, is_heading_up=not self.is_heading_up
            )
            center_m = np.array(pose.look_at_m[:2])
            self._look(from_above(center_m, self._up_rad(), pose.half_height_m))
            return
        offset = np.subtract(pose.position_m, pose.look_at_m)
        x, y, _ = pose.look_at_m
        south = y - float(np.hypot(*offset[:2]))
        self._look(replace(pose, position_m=(x, south, pose.position_m[2]), up=UP))

    def _show_compass(self) -> None:
        state = CompassState(is_top=self.is_top, is_heading_up=self.is_heading_up)
        self._overlay.show(state)

    @property
    def _scenario(self) -> Scenario:
        return self._ui.session.scenario

    def _set_top(self, is_top: bool) -> None:
        workspace = self._ui.workspace
        workspace.view = replace(workspace.view, is_top=is_top)

    def _frame_work(self) -> None:
        if self._ui.session.selection:
            self.frame_selection()
        else:
            self.frame_opened()

    def _fit(
        self,
        points_m: np.ndarray,
        lowest_rad: float = LOWEST_RAD,
        free: FreePart | None = None,
    ) -> None:
        if free is None:
            covered = self._model.covered_px / max(self._camera.image_height, 1)
            free = FreePart.above(covered)
        forward, up, fov_rad = self._direction(lowest_rad)
        aspect = float(self._camera.aspect)
        self._look(
            fitted(
                points_m,
                forward=forward,
                up=up,
                fov_rad=fov_rad,
                aspect=aspect,
                free=free,
            )
        )

    def _direction(self, lowest_rad: float) -> tuple[np.ndarray, Vector, float]:
        """Where to look when a part is framed, what is up, and the field of view."""
        if not self.is_top:
            pose = ViewPose.of(self._camera)
            return framing_direction(pose, lowest_rad), UP, PERSPECTIVE_FOV_RAD
        up_rad = self._up_rad()
        up = (float(np.cos(up_rad)), float(np.sin(up_rad)), 0.0)
        return np.array([0.0, 0.0, -1.0]), up, TOP_VIEW_FOV_RAD

    def _look(self, pose: ViewPose) -> None:
        self._num_looks += 1
        with self._ui.client.atomic():
            # First, so that the page removes its limits during the transition.
            self._overlay.show(ViewState(is_top=self.is_top, look=self._num_looks))
            pose.apply_to(self._camera)
            self._show_compass()

    def _up_rad(self) -> float:
        return self._focal_pose()[1] if self.is_heading_up else NORTH_RAD

    def _focal_pose(self) -> tuple[np.ndarray, float]:
        """Position of the focal agent at the current step; else the centre of the map."""
        agents, step = self._scenario.agents, self._scenario.current_step
        row = agents.row_of.get(self._scenario.focal_id)
        if row is None or not agents.is_valid[row, step]:
            points = np.concatenate(self._scenario.road_map.polylines)[:, :2]
            return points.mean(axis=0), NORTH_RAD
        return agents.position_m[row, step], float(agents.heading_rad[row, step])
