"""Draws what is said about agents: selection, warnings, focal agent and ego, labels."""

from collections.abc import Collection
from typing import Final

import numpy as np
import viser

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.meshes.agent_poses import AgentPoses, yaw_quaternions
from pd_editor.viewer.meshes.agent_shapes import pointer, ring
from pd_editor.viewer.meshes.colors import (
    EGO_COLOR,
    FOCAL_COLOR,
    SELECTION_COLOR,
    WARNING_COLOR,
    Rgb,
    linearised,
)

MAX_LABELS: Final = 3
"""More selected agents than this get none: their labels would cover each other."""
RING_MARGIN_M: Final = 0.5
POINTER_SIZE_M: Final = (1.0, 1.0, 1.1)
POINTER_GAP_M: Final = 0.6


class MarksView:
    """Nodes of one browser for rings, pointers and labels."""

    def __init__(self, client: viser.ClientHandle) -> None:
        """Create empty batches."""
        self._client = client
        self._selection = self._batch("/marks/selection", SELECTION_COLOR)
        self._warnings = self._batch("/marks/warnings", WARNING_COLOR)
        self._focal = self._batch("/marks/focal", FOCAL_COLOR, is_ring=False)
        self._ego = self._batch("/marks/ego", EGO_COLOR, is_ring=False)
        self._labels: dict[str, viser.LabelHandle] = {}

    def show(
        self,
        scenario: Scenario,
        poses: AgentPoses,
        step: float,
        selection: Collection[str],
        warned: Collection[str],
    ) -> None:
        """Put all marks where their agents are drawn."""
        self._place_rings(self._selection, scenario, poses, selection, 0.11)
        self._place_rings(
            self._warnings,
            scenario,
            poses,
            [w for w in warned if w not in selection],
            0.10,
        )
        self._place_pointer(self._focal, scenario, poses, scenario.focal_id)
        self._place_pointer(self._ego, scenario, poses, EGO_ID)
        self._show_labels(scenario, poses, step, selection)

    def _batch(
        self, name: str, color: Rgb, *, is_ring: bool = True
    ) -> viser.BatchedMeshHandle:
        mesh = ring() if is_ring else pointer()
        return self._client.scene.add_batched_meshes_simple(
            name,
            np.asarray(mesh.vertices, np.float32),
            np.asarray(mesh.faces, np.uint32),
            batched_wxyzs=np.array([[1.0, 0, 0, 0]], np.float32),
            batched_positions=np.zeros((1, 3), np.float32),
            batched_scales=np.zeros((1, 3), np.float32),
            batched_colors=np.array([linearised(color)], np.uint8),
            flat_shading=True,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _place_rings(
        self,
        batch: viser.BatchedMeshHandle,
        scenario: Scenario,
        poses: AgentPoses,
        agent_ids: Collection[str],
        height_m: float,
    ) -> None:
        row_of = scenario.agents.row_of
        rows = [row_of[agent] for agent in agent_ids if agent in row_of]
        rows = [row for row in rows if poses.is_present[row]]
        positions = np.zeros((max(len(rows), 1), 3), np.float32)
        scales = np.zeros((max(len(rows), 1), 3), np.float32)
        if rows:
            positions[:, :2] = poses.position_m[rows]
            positions[:, 2] = height_m
            size = scenario.agents.size_m[rows]
            scales[:, :2] = (np.hypot(size[:, 0], size[:, 1]) / 2 + RING_MARGIN_M)[
                :, None
            ]
            scales[:, 2] = 1.0
        _assign(batch, positions, scales)

    def _place_pointer(
        self,
        batch: viser.BatchedMeshHandle,
        scenario: Scenario,
        poses: AgentPoses,
        agent_id: str,
    ) -> None:
        positions = np.zeros((1, 3), np.float32)
        scales = np.zeros((1, 3), np.float32)
        row = scenario.agents.row_of.get(agent_id)
        if row is not None and poses.is_present[row]:
            height = DEFAULT_HEIGHT_M[scenario.agents.kinds[row]]
            positions[0] = [*poses.position_m[row], height + POINTER_GAP_M]
            scales[0] = POINTER_SIZE_M
        _assign(batch, positions, scales)

    def _show_labels(
        self,
        scenario: Scenario,
        poses: AgentPoses,
        step: float,
        selection: Collection[str],
    ) -> None:
        agents = scenario.agents
        labelled = selection if len(selection) <= MAX_LABELS else ()
        wanted = [agent for agent in labelled if agent in agents.row_of]
        for agent_id in [a for a in self._labels if a not in wanted]:
            self._labels.pop(agent_id).remove()
        nearest = int(np.clip(np.round(step), 0, agents.num_steps - 1))
        for agent_id in wanted:
            row = agents.row_of[agent_id]
            speed = float(np.hypot(*agents.velocity_mps[row, nearest]))
            text = f"{agents.kinds[row]} {agent_id} · {speed:.1f} m/s"
            height = DEFAULT_HEIGHT_M[agents.kinds[row]] + 1.0
            x, y = poses.position_m[row]
            label = self._labels.get(agent_id)
            if label is None:
                label = self._client.scene.add_label(
                    f"/labels/{row}_{abs(hash(agent_id))}",
                    text,
                    font_screen_scale=0.9,
                    anchor="bottom-center",
                )
                self._labels[agent_id] = label
            if label.text != text:
                label.text = text
            label.position = (float(x), float(y), height)
            label.visible = bool(poses.is_present[row])


def _assign(
    batch: viser.BatchedMeshHandle, positions: np.ndarray, scales: np.ndarray
) -> None:
    """Set all instance arrays together; unchanged ones are not sent again."""
    if len(positions) != len(batch.batched_positions):
        batch.batched_wxyzs = yaw_quaternions(np.zeros(len(positions))).astype(
            np.float32
        )
        batch.batched_colors = np.repeat(
            np.asarray(batch.batched_colors)[:1], len(positions), axis=0
        )
    if not np.array_equal(batch.batched_positions, positions):
        batch.batched_positions = positions
    shown = batch.batched_scales
    if shown is None or not np.array_equal(shown, scales):
        batch.batched_scales = scales
