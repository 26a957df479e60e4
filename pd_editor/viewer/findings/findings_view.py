"""Draws findings of the scorecard on the road: parts of trajectories, worst poses."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import viser

from pd_editor.analysis.findings.finding import Finding
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.palette import Palette
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.meshes.colors import shown_exactly
from pd_editor.viewer.meshes.flat_mesh import FlatMesh, MeshNode, Primitive, facing_up
from pd_editor.viewer.meshes.ribbons import dotted, path_ribbons

HEIGHT_M: Final = 0.058
"""Under the ribbons of the trajectories, which are narrower."""
ABOVE_M: Final = 1e-3
MARGIN_M: Final = 0.8
"""Bands are wider than their agents by this."""
FRAME_GAP_M: Final = 0.35
FRAME_WIDTH_M: Final = 0.35
"""The frame around the pose at the worst step."""


class FindingsView:
    """One node of one browser; faults beyond comfort only are striped."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._palette = palette
        self._node = MeshNode(client, "/findings")
        self._scenario: Scenario | None = None
        self._findings: tuple[Finding, ...] = ()

    def show(self, scenario: Scenario, findings: Sequence[Finding]) -> None:
        """Draw findings of a scenario; none hides the node."""
        wanted = tuple(findings)
        if self._findings == wanted and (not wanted or scenario is self._scenario):
            return
        self._scenario, self._findings = scenario, wanted
        self._send()

    def set_palette(self, palette: Palette) -> None:
        """Redraw in another theme."""
        self._palette = palette
        self._send()

    def _send(self) -> None:
        if self._scenario is not None and self._findings:
            self._node.draw(
                finding_primitives(self._scenario, self._findings, self._palette)
            )
        self._node.set_visible(bool(self._findings))


def finding_primitives(
    scenario: Scenario, findings: Sequence[Finding], palette: Palette
) -> list[Primitive]:
    """Bands along the parts of trajectories, and frames around the worst poses."""
    agents, now = scenario.agents, scenario.current_step
    known = [
        (one, agents.row_of[name])
        for one in findings
        for name in one.agent_ids
        if name in agents.row_of
    ]
    if not known:
        return []
    spans = [(one, row, first, last) for one, row in known for first, last in one.spans]
    rows = np.array([row for _, row, _, _ in spans])
    mild = np.array([not one.is_problem for one, _, _, _ in spans])
    # A step more at both ends: an instant is a short piece of the trajectory as well.
    first, last = np.array([(first - 1, last + 1) for _, _, first, last in spans]).T
    begin = min(now, *(one.first_step for one, _ in known))
    steps = np.arange(begin, agents.num_steps)
    is_in = (steps >= first[:, None]) & (steps <= last[:, None])
    is_in &= agents.is_valid[rows, begin:]
    points = agents.position_m[rows, begin:]
    width = agents.size_m[rows, 1] + MARGIN_M
    striped, is_stripe = dotted(points[mild], is_in[mild])
    color = shown_exactly(palette.warning)
    return [
        _bands(striped, is_stripe, width[mild], HEIGHT_M, color),
        _bands(points[~mild], is_in[~mild], width[~mild], HEIGHT_M + ABOVE_M, color),
        _frames(scenario, known, color),
    ]


def _bands(
    points_m: np.ndarray,
    is_valid: np.ndarray,
    width_m: np.ndarray,
    height_m: float,
    color: tuple[float, float, float],
) -> Primitive:
    shape = is_valid.shape
    band = path_ribbons(
        points_m,
        is_valid,
        color=np.tile(color, (len(points_m), 1)),
        opacity=np.ones(shape),
        width_m=np.broadcast_to(width_m[:, None], shape),
        height_m=np.full(len(points_m), height_m),
    )
    # Without opacities per vertex the band is opaque, and always under the ribbons.
    return Primitive(
        points_m=band.points_m, faces=band.faces, height_m=band.height_m, color=color
    )


def _frames(
    scenario: Scenario,
    findings: Sequence[tuple[Finding, int]],
    color: tuple[float, float, float],
) -> Primitive:
    agents = scenario.agents
    rows = np.array([row for _, row in findings])
    steps = np.array([one.worst_step for one, _ in findings])
    pose = agents.position_m[rows, steps], agents.heading_rad[rows, steps]
    inner = agents.size_m[rows] + 2 * FRAME_GAP_M
    # [F 8 2]: the inner corners, then the outer ones.
    corners = np.concatenate(
        [box_corners(*pose, inner), box_corners(*pose, inner + 2 * FRAME_WIDTH_M)],
        axis=1,
    )
    side = np.arange(4)
    after = (side + 1) % 4
    faces = np.concatenate(
        [
            np.stack([side, side + 4, after], axis=-1),
            np.stack([after, side + 4, after + 4], axis=-1),
        ]
    )
    mesh = facing_up(
        FlatMesh(
            points_m=corners.reshape(-1, 2),
            faces=(8 * np.arange(len(rows))[:, None, None] + faces).reshape(-1, 3),
        )
    )
    return Primitive(
        points_m=mesh.points_m,
        faces=mesh.faces,
        height_m=HEIGHT_M + 2 * ABOVE_M,
        color=color,
    )
