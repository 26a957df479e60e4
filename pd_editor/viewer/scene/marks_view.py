"""Draws what stands at agents: rings, pointers, and over the picture names and padlocks."""

from collections.abc import Collection, Mapping
from typing import Final

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M
from pd_editor.scene.palette import Palette, Rgb
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.meshes.agent_shapes import AgentPoses, pointer, ring
from pd_editor.viewer.meshes.colors import lit_from_above
from pd_editor.viewer.overlay.messages import (
    Label,
    LabelsState,
    LockMark,
    LocksState,
    rounded_place,
)
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.camera import ViewScale, drawn_sizes_m
from pd_editor.viewer.scene.timeline import in_seconds

MAX_LABELS: Final = 3
"""More selected agents than this get none: their labels would cover each other."""


class LabelsView:
    """The labels of one browser; the page puts them 18 px beside their agents."""

    def __init__(self, overlay: Overlay) -> None:
        """Show none yet."""
        self._overlay = overlay
        self._view: ViewScale | None = None

    def set_view(self, view: ViewScale) -> None:
        """Know how large agents are drawn."""
        self._view = view

    def show(
        self,
        scenario: Scenario,
        poses: AgentPoses,
        step: float,
        selection: Collection[str],
        notes: Mapping[str, str],
    ) -> None:
        """Label the selected agents where they are drawn, with notes below."""
        agents = scenario.agents
        rows = [agents.row_of[agent] for agent in selection if agent in agents.row_of]
        rows = [row for row in rows if poses.is_present[row]]
        if len(selection) > MAX_LABELS:
            rows = []
        time_s = (step - scenario.current_step) * scenario.time_axis.step_s
        # The panel's numbers are those of t = 0: the label says when its own are not.
        when = "" if abs(time_s) < 0.05 else f" at {in_seconds(time_s)}"
        nearest = int(np.clip(np.round(step), 0, agents.num_steps - 1))
        sizes = drawn_sizes_m(agents, self._view) if rows else agents.size_m
        labels = []
        for row in rows:
            speed = float(np.hypot(*agents.velocity_mps[row, nearest]))
            agent_id = agents.ids[row]
            point = [*poses.position_m[row], DEFAULT_HEIGHT_M[agents.kinds[row]] / 2]
            labels.append(
                Label(
                    text=f"{agents.kinds[row]} {agent_id} · {speed:.1f} m/s{when}",
                    note=notes.get(agent_id, ""),
                    point=rounded_place(point),
                    radius=round(float(np.hypot(*sizes[row])) / 2, 2),
                )
            )
        self._overlay.show(LabelsState(labels=tuple(labels)))


class LocksView:
    """Padlocks of one browser; the page keeps them as large at every zoom."""

    def __init__(self, overlay: Overlay) -> None:
        """Show none yet."""
        self._overlay = overlay
        self._view: ViewScale | None = None

    def set_view(self, view: ViewScale) -> None:
        """Know how large agents are drawn."""
        self._view = view

    def show(self, scenario: Scenario, poses: AgentPoses) -> None:
        """Put a padlock beside each locked agent where it is drawn."""
        agents = scenario.agents
        sizes = drawn_sizes_m(agents, self._view) if scenario.locks else agents.size_m
        locks = []
        for agent_id, lock in scenario.locks.items():
            row = agents.row_of[agent_id]
            if not poses.is_present[row]:
                continue
            point = [*poses.position_m[row], DEFAULT_HEIGHT_M[agents.kinds[row]] / 2]
            locks.append(
                LockMark(
                    keeps=lock.keeps,
                    seconds=f"{lock.kept_s:g} s" if lock.keeps == "beginning" else "",
                    label=f"Locked: {lock.in_words} of agent {agent_id}",
                    point=rounded_place(point),
                    radius=round(float(sizes[row, 1]) / 2, 2),
                )
            )
        self._overlay.show(LocksState(locks=tuple(locks)))


MIN_MARK_PX: Final = 14.0
"""Marks are at least as large, however far away the camera is."""
RING_MARGIN_M: Final = 0.5
RING_WIDTH_PX: Final = 3.0
RIM_WIDTH_PX: Final = 1.0
RING_WIDTHS: Final = (0.05, 0.08, 0.13, 0.2, 0.3)
"""Widths of rings as shares of their radius; the nearest to the wanted one is taken."""
POINTER_SIZE_M: Final = 1.1
POINTER_GAP_M: Final = 0.6
RING_HEIGHT_M: Final = 0.12

_NO_TURN: Final = np.array([1.0, 0.0, 0.0, 0.0])


class MarksView:
    """Nodes of one browser for rings and pointers."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Create empty batches."""
        self._client = client
        self._view: ViewScale | None = None
        self._rim = self._batch("/marks/selection_rim", palette.selection_rim)
        self._selection = self._batch("/marks/selection", palette.selection)
        self._warnings = self._batch("/marks/warnings", palette.warning)
        self._pointed = self._batch("/marks/pointed", palette.pointed)
        self._focal = self._batch("/marks/focal", palette.focal, is_ring=False)
        self._ego = self._batch("/marks/ego", palette.ego, is_ring=False)

    def set_view(self, view: ViewScale) -> None:
        """Size the marks for another camera, from the next frame on."""
        self._view = view

    def set_palette(self, palette: Palette) -> None:
        """Colour the marks for another theme."""
        for batch, color in (
            (self._rim, palette.selection_rim),
            (self._selection, palette.selection),
            (self._warnings, palette.warning),
            (self._pointed, palette.pointed),
            (self._focal, palette.focal),
            (self._ego, palette.ego),
        ):
            batch.batched_colors = _colors(color, len(batch.batched_positions))

    def show(
        self,
        scenario: Scenario,
        poses: AgentPoses,
        selection: Collection[str],
        warned: Collection[str],
        pointed: str | None = None,
    ) -> None:
        """Put all marks where their agents are drawn."""
        lit = () if pointed is None else (pointed,)
        self._place_rings(
            # The ring of an agent pointed at stands outside that of the selection.
            self._pointed,
            scenario,
            poses,
            lit,
            RING_HEIGHT_M,
            1.4,
        )
        chosen = [agent for agent in warned if agent not in selection]
        self._place_rings(self._selection, scenario, poses, selection, RING_HEIGHT_M)
        self._place_rings(self._rim, scenario, poses, selection, RING_HEIGHT_M - 0.01)
        self._place_rings(self._warnings, scenario, poses, chosen, RING_HEIGHT_M - 0.02)
        self._place_pointer(self._focal, scenario, poses, scenario.focal_id)
        self._place_pointer(self._ego, scenario, poses, EGO_ID)

    def _batch(
        self, name: str, color: Rgb, *, is_ring: bool = True
    ) -> viser.BatchedMeshHandle:
        mesh = ring(1 - RING_WIDTHS[0]) if is_ring else pointer()
        return self._client.scene.add_batched_meshes_simple(
            name,
            np.asarray(mesh.vertices, np.float32),
            np.asarray(mesh.faces, np.uint32),
            batched_wxyzs=_NO_TURN[None].astype(np.float32),
            batched_positions=np.zeros((1, 3), np.float32),
            batched_scales=np.zeros((1, 3), np.float32),
            batched_colors=_colors(color, 1),
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
        margin_m: float = RING_MARGIN_M,
    ) -> None:
        row_of = scenario.agents.row_of
        rows = [row_of[agent] for agent in agent_ids if agent in row_of]
        rows = [row for row in rows if poses.is_present[row]]
        positions = np.zeros((max(len(rows), 1), 3), np.float32)
        scales = np.zeros((max(len(rows), 1), 3), np.float32)
        if rows:
            positions[:, :2] = poses.position_m[rows]
            positions[:, 2] = height_m
            size = drawn_sizes_m(scenario.agents, self._view)[rows]
            radius = np.hypot(size[:, 0], size[:, 1]) / 2 + margin_m
            per_m = self._pixels_per_m(positions)
            least = MIN_MARK_PX + (margin_m > RING_MARGIN_M) * 2 * RING_WIDTH_PX
            radius = np.maximum(radius, least / per_m)
            rim = RIM_WIDTH_PX / per_m if batch is self._rim else np.zeros(len(rows))
            width = (RING_WIDTH_PX / per_m + 2 * rim) / (radius + rim)
            _set_width(batch, float(np.median(width)))
            scales[:, :2] = (radius + rim)[:, None]
            scales[:, 2] = 1.0
        _assign(batch, positions, scales)

    def _place_pointer(
        self,
        batch: viser.BatchedMeshHandle,
        scenario: Scenario,
        poses: AgentPoses,
        agent_id: str,
    ) -> None:
        """Put a pyramid above an agent; from above it lies beside it, pointing at it."""
        positions = np.zeros((1, 3), np.float32)
        scales = np.zeros((1, 3), np.float32)
        turn = _NO_TURN
        row = scenario.agents.row_of.get(agent_id)
        if row is not None and poses.is_present[row]:
            height = DEFAULT_HEIGHT_M[scenario.agents.kinds[row]] + POINTER_GAP_M
            point = np.array([*poses.position_m[row], height])
            size = max(
                POINTER_SIZE_M, MIN_MARK_PX / float(self._pixels_per_m(point[None])[0])
            )
            view = self._view
            if view is not None and view.is_from_above:
                up = view.up * [1.0, 1.0, 0.0]
                up /= max(float(np.linalg.norm(up)), 1e-9)
                reach = _reach_m(scenario, poses, row, up)
                point += up * (reach + POINTER_GAP_M)
                turn = _turn_from_z(up)
            positions[0], scales[0] = point, size
        _assign(batch, positions, scales, turn)

    def _pixels_per_m(
        self, points_m: Float[np.ndarray, "N 3"]
    ) -> Float[np.ndarray, "N"]:
        if self._view is None:
            return np.full(len(points_m), 20.0)
        return self._view.pixels_per_m(np.asarray(points_m, float))


def _reach_m(
    scenario: Scenario, poses: AgentPoses, row: int, along: Float[np.ndarray, "3"]
) -> float:
    """How far an agent's box reaches from its middle in a direction."""
    heading = poses.heading_rad[row]
    ahead = abs(np.cos(heading) * along[0] + np.sin(heading) * along[1])
    aside = abs(np.cos(heading) * along[1] - np.sin(heading) * along[0])
    length, width = scenario.agents.size_m[row]
    return float(ahead * length + aside * width) / 2


def _turn_from_z(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4"]:
    """The rotation (w, x, y, z) that takes +z to a level direction."""
    half = np.sqrt(0.5)
    return np.array([half, -half * direction[1], half * direction[0], 0.0])


def _colors(color: Rgb, count: int) -> np.ndarray:
    return np.tile(np.array(lit_from_above(color), np.uint8), (count, 1))


def _set_width(batch: viser.BatchedMeshHandle, width: float) -> None:
    nearest = min(RING_WIDTHS, key=lambda known: abs(known - width))
    vertices = np.asarray(ring(1 - nearest).vertices, np.float32)
    if not np.array_equal(batch.vertices, vertices):
        batch.vertices = vertices


def _assign(
    batch: viser.BatchedMeshHandle,
    positions: np.ndarray,
    scales: np.ndarray,
    turn: np.ndarray = _NO_TURN,
) -> None:
    """Set all instance arrays together; unchanged ones are not sent again."""
    count = len(positions)
    if count != len(batch.batched_positions):
        color = np.asarray(batch.batched_colors)[:1]
        batch.batched_colors = np.repeat(color, count, axis=0)
    turns = np.tile(turn.astype(np.float32), (count, 1))
    if not np.array_equal(batch.batched_wxyzs, turns):
        batch.batched_wxyzs = turns
    if not np.array_equal(batch.batched_positions, positions):
        batch.batched_positions = positions
    shown = batch.batched_scales
    if shown is None or not np.array_equal(shown, scales):
        batch.batched_scales = scales
