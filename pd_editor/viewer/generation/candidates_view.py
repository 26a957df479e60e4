"""Draws the candidates of a selected agent as a fan."""

from typing import Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.palette import Palette
from pd_editor.scene.paths.motion_primitives import CandidateSet
from pd_editor.scene.road_map import RoadMap
from pd_editor.viewer.meshes.colors import (
    inverse_aces,
    shown_exactly,
    srgb_to_linear,
)
from pd_editor.viewer.meshes.flat_mesh import Primitive, glb_of, ribbons
from pd_editor.viewer.meshes.ribbons import path_heights, path_ribbons

HEIGHT_M: Final = 0.085
LANE_HEIGHT_M: Final = 0.06
LANE_WIDTH_M: Final = 0.12
PATH_WIDTH_M: Final = 0.4
HIGHLIGHTED_WIDTH_M: Final = 0.8
RIM_M: Final = 0.12
"""Each path has a rim in the road's colour, which sets it off from those below."""
PICK_DISTANCE_M: Final = 1.5
FAST_MPS: Final = 15.0
"""Speed from which a candidate has the full colour of a fast one."""


class CandidatesView:
    """One node of one browser with the candidates of one agent."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._client = client
        self._palette = palette
        self._handle: viser.GlbHandle | None = None
        self._road_map: RoadMap | None = None
        self._highlighted: int | None = None
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
        self.shown, self._road_map = candidates, road_map
        self._highlighted = highlighted
        if candidates is None:
            if self._handle is not None:
                self._handle.visible = False
            return
        parts = [_fan(candidates, highlighted, self._palette)]
        if road_map is not None:
            parts.insert(0, _reference_lanes(candidates, road_map, self._palette))
        data = glb_of(parts)
        if self._handle is None:
            self._handle = self._client.scene.add_glb(
                "/candidates", data, cast_shadow=False, receive_shadow=False
            )
        else:
            self._handle.glb_data = data
            self._handle.visible = True

    def set_palette(self, palette: Palette) -> None:
        """Redraw in another theme."""
        self._palette = palette
        if self.shown is not None:
            self.show(self.shown, self._road_map, self._highlighted)

    def candidate_near(self, point_m: Float[np.ndarray, "2"]) -> int | None:
        """Index of the candidate whose path is nearest to a point on the ground."""
        if self.shown is None:
            return None
        gap = np.linalg.norm(self.shown.position_m[0] - point_m, axis=-1).min(axis=-1)
        gap = np.where(self.shown.is_valid[0], gap, np.inf)
        nearest = int(gap.argmin())
        return nearest if gap[nearest] <= PICK_DISTANCE_M else None


def _reference_lanes(
    candidates: CandidateSet, road_map: RoadMap, palette: Palette
) -> Primitive:
    routes = candidates.lane_ids[0]
    lanes = dict.fromkeys(lane_id for route in routes for lane_id in route)
    lines = Lines.of(
        [
            road_map.lane_of[lane_id].centerline_m
            for lane_id in lanes
            if lane_id in road_map.lane_of
        ]
    )
    lines = ribbons(lines.without_repeats(), LANE_WIDTH_M)
    return Primitive(
        points_m=lines.points_m,
        faces=lines.faces,
        height_m=LANE_HEIGHT_M,
        color=shown_exactly(palette.candidate),
        opacity=0.6,
    )


def _fan(
    candidates: CandidateSet, highlighted: int | None, palette: Palette
) -> Primitive:
    """Mesh of all paths; shorter ones are drawn over longer ones."""
    position = candidates.position_m[0]
    count, num_points = position.shape[:2]
    length = np.linalg.norm(np.diff(position, axis=1), axis=-1).sum(axis=1)
    opacity, width = np.full(count, 0.9), np.full(count, PATH_WIDTH_M)
    if highlighted is not None:
        opacity[:] = 0.3
        opacity[highlighted], width[highlighted] = 1.0, HIGHLIGHTED_WIDTH_M
        length[highlighted] = -1.0
    order = np.argsort(-length, kind="stable")
    order = order[candidates.is_valid[0][order]]
    speed = np.clip(candidates.target_speed_mps[0, order] / FAST_MPS, 0.0, 1.0)
    stops = np.array(palette.candidate_speeds, float)
    at = [np.interp(speed, [0.0, 0.5, 1.0], channel) for channel in stops.T]
    shown = np.stack(
        [
            np.broadcast_to(np.array(palette.lane, float), (len(order), 3)),
            np.stack(at, axis=-1),
        ],
        axis=1,
    )
    # Every path twice: its rim, and itself on that.
    twice = np.repeat(order, 2)
    is_rim = np.tile([True, False], len(order))
    along = (len(twice), num_points)
    thick = width[twice] + 2 * RIM_M * is_rim
    return path_ribbons(
        position[twice],
        np.ones(along, bool),
        color=inverse_aces(srgb_to_linear(shown.reshape(-1, 3) / 255.0)),
        opacity=np.broadcast_to(opacity[twice, None], along),
        width_m=np.broadcast_to(thick[:, None], along),
        height_m=path_heights(HEIGHT_M, np.arange(len(twice))),
    )
