"""Draws where a selected agent could go, as a fan to choose from."""

from collections.abc import Callable
from typing import Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.geometry.polyline import without_repeats
from pd_editor.paths.motion_primitives import CandidateSet
from pd_editor.scene.road_map import RoadMap
from pd_editor.viewer.meshes.colors import (
    CANDIDATE_COLOR,
    inverse_aces,
    shown_exactly,
    srgb_to_linear,
)
from pd_editor.viewer.meshes.flat_mesh import Primitive, glb_of, merged, ribbon
from pd_editor.viewer.meshes.ribbons import path_ribbons

HEIGHT_M: Final = 0.085
LANE_HEIGHT_M: Final = 0.06
LANE_WIDTH_M: Final = 0.12
PICK_DISTANCE_M: Final = 1.5
_SLOW: Final = np.array([240, 170, 40]) / 255.0
_FAST: Final = np.array([0, 150, 120]) / 255.0


class CandidatesView:
    """One node of one browser with the candidates of one agent."""

    def __init__(
        self, client: viser.ClientHandle, on_shown: Callable[[bool], None]
    ) -> None:
        """Draw nothing yet.

        Args:
            client: the browser.
            on_shown: told whether the fan is shown, so that others can step back.
        """
        self._client = client
        self._on_shown = on_shown
        self._handle: viser.GlbHandle | None = None
        self.shown: CandidateSet | None = None

    def show(
        self,
        candidates: CandidateSet | None,
        road_map: RoadMap | None = None,
        highlighted: int | None = None,
    ) -> None:
        """Draw the candidates of the first agent of a set, or nothing.

        Their reference lanes are drawn under them, as thin lines of ``road_map``.
        """
        self.shown = candidates
        self._on_shown(candidates is not None)
        if candidates is None:
            if self._handle is not None:
                self._handle.visible = False
            return
        parts = [_fan(candidates, highlighted)]
        if road_map is not None:
            parts.append(_reference_lanes(candidates, road_map))
        data = glb_of(parts)
        if self._handle is None:
            self._handle = self._client.scene.add_glb(
                "/candidates", data, cast_shadow=False, receive_shadow=False
            )
        else:
            self._handle.glb_data = data
            self._handle.visible = True

    def candidate_near(self, point_m: Float[np.ndarray, "2"]) -> int | None:
        """Index of the candidate whose path lies nearest to a point on the ground."""
        if self.shown is None:
            return None
        gap = np.linalg.norm(self.shown.position_m[0] - point_m, axis=-1).min(axis=-1)
        gap = np.where(self.shown.is_valid[0], gap, np.inf)
        nearest = int(gap.argmin())
        return nearest if gap[nearest] <= PICK_DISTANCE_M else None


def _reference_lanes(candidates: CandidateSet, road_map: RoadMap) -> Primitive:
    routes = candidates.lane_ids[0]
    lanes = dict.fromkeys(lane_id for route in routes for lane_id in route)
    lines = merged(
        [
            ribbon(
                without_repeats(road_map.lane_of[lane_id].centerline_m), LANE_WIDTH_M
            )
            for lane_id in lanes
            if lane_id in road_map.lane_of
        ]
    )
    return Primitive(
        points_m=lines.points_m,
        faces=lines.faces,
        height_m=LANE_HEIGHT_M,
        color=shown_exactly(CANDIDATE_COLOR),
        opacity=0.6,
    )


def _fan(candidates: CandidateSet, highlighted: int | None) -> Primitive:
    position = candidates.position_m[0]
    count, num_points = position.shape[:2]
    speed = np.clip(candidates.target_speed_mps[0] / 15.0, 0.0, 1.0)[:, None]
    color = inverse_aces(srgb_to_linear(_SLOW + speed * (_FAST - _SLOW)))
    opacity = np.full((count, num_points), 0.55)
    width = np.full((count, num_points), 0.45)
    if highlighted is not None:
        opacity[:] = 0.25
        opacity[highlighted] = 1.0
        width[highlighted] = 0.8
    is_valid = np.repeat(candidates.is_valid[0][:, None], num_points, axis=1)
    return path_ribbons(
        position,
        is_valid,
        color=color,
        opacity=opacity,
        width_m=width,
        height_m=HEIGHT_M,
    )
