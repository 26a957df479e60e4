"""Draws the original scenario as a ghost behind the edited one."""

from typing import Final

import numpy as np
import viser
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.palette import Palette
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.meshes.agent_shapes import (
    AgentPoses,
    box_outline,
    poses_at,
    yaw_quaternions,
)
from pd_editor.viewer.meshes.colors import (
    inverse_aces,
    lit_from_above,
    shown_exactly,
    srgb_to_linear,
)
from pd_editor.viewer.meshes.flat_mesh import MeshNode, Primitive, ribbons
from pd_editor.viewer.meshes.ribbons import dotted, path_heights, path_ribbons
from pd_editor.viewer.overlay.messages import CompareEvent, CompareState
from pd_editor.viewer.tab.ui_context import UiContext

SAME_M: Final = 0.05
"""Tracks that stay so close to the original's are the same."""
DASH_WIDTH_M: Final = 0.3
DASH_HEIGHT_M: Final = 0.16
"""Above ribbons and rings: the ghost is looked at while it is shown."""


class OriginalView:
    """Nodes of one browser for the original; hidden until it is compared with."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._client = client
        self._palette = palette
        self._is_shown = False
        self._paths = MeshNode(client, "/original/paths")
        self._boxes: viser.BatchedMeshHandle | None = None
        self._drawn: tuple[AgentTracks, AgentTracks, Palette] | None = None
        self._rows = np.zeros(0, int)

    @property
    def num_changed(self) -> int:
        """Number of the original's agents that were deleted or have other tracks now."""
        return len(self._rows)

    def set_palette(self, palette: Palette) -> None:
        """Draw in another theme from the next frame on."""
        self._palette = palette
        if self._boxes is not None:
            self._boxes.batched_colors = self._colors(
                len(self._boxes.batched_positions)
            )

    def set_shown(self, is_shown: bool) -> None:
        """Show the original from the next frame on, or hide it now."""
        self._is_shown = is_shown
        self._paths.set_visible(is_shown)
        if self._boxes is not None:
            self._boxes.visible = is_shown

    def show(self, original: Scenario, scenario: Scenario, step: float) -> None:
        """Draw what differs from the original, at a fractional step."""
        if not self._is_shown:
            return
        wanted = (original.agents, scenario.agents, self._palette)
        is_current = self._drawn is not None and all(
            drawn is asked for drawn, asked in zip(self._drawn, wanted, strict=True)
        )
        if not is_current:
            self._drawn = wanted
            self._rows = changed_rows(original.agents, scenario.agents)
            self._paths.draw(_paths(original, scenario, self._rows, self._palette))
        self._place_boxes(original.agents, poses_at(original.agents, step))

    def _place_boxes(self, agents: AgentTracks, poses: AgentPoses) -> None:
        rows = self._rows[poses.is_present[self._rows]]
        count = max(len(rows), 1)
        positions, scales = np.zeros((2, count, 3), np.float32)
        turns = yaw_quaternions(np.zeros(count)).astype(np.float32)
        if len(rows):
            positions[:, :2], positions[:, 2] = poses.position_m[rows], DASH_HEIGHT_M
            scales[:, :2], scales[:, 2] = agents.size_m[rows], 1.0
            turns = yaw_quaternions(poses.heading_rad[rows]).astype(np.float32)
        if self._boxes is None:
            mesh = box_outline()
            self._boxes = self._client.scene.add_batched_meshes_simple(
                "/original/boxes",
                np.asarray(mesh.vertices, np.float32),
                np.asarray(mesh.faces, np.uint32),
                batched_wxyzs=turns,
                batched_positions=positions,
                batched_scales=scales,
                batched_colors=self._colors(count),
                flat_shading=True,
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )
            return
        if count != len(self._boxes.batched_positions):
            self._boxes.batched_colors = self._colors(count)
        self._boxes.batched_positions = positions
        self._boxes.batched_wxyzs = turns
        self._boxes.batched_scales = scales

    def _colors(self, count: int) -> np.ndarray:
        color = np.array(lit_from_above(self._palette.ghost), np.uint8)
        return np.tile(color, (count, 1))


def changed_rows(original: AgentTracks, now: AgentTracks) -> Int[np.ndarray, "N"]:
    """Rows of the original whose agents were deleted or have other tracks."""
    row_now = _rows_now(original, now)
    is_there = row_now >= 0
    differs = ~is_there
    if now is original or not is_there.any():
        return np.flatnonzero(differs)
    then, after = np.flatnonzero(is_there), row_now[is_there]
    steps = min(original.num_steps, now.num_steps)
    valid_then, valid_now = (
        original.is_valid[then, :steps],
        now.is_valid[after, :steps],
    )
    gap = np.linalg.norm(
        original.position_m[then, :steps] - now.position_m[after, :steps], axis=-1
    )
    moved = (gap > SAME_M) & valid_then & valid_now
    # An extension beyond the recording does not change recorded states.
    differs[then] = (moved | (valid_then & ~valid_now)).any(axis=1)
    return np.flatnonzero(differs)


def difference_notes(
    original: Scenario, scenario: Scenario, agent_ids: tuple[str, ...]
) -> dict[str, str]:
    """How far each agent is from its original, and how much faster, in two lines."""
    notes = {}
    for agent_id in agent_ids:
        before = original.agents.row_of.get(agent_id)
        after = scenario.agents.row_of.get(agent_id)
        if before is None or after is None:
            notes[agent_id] = "not in the original"
            continue
        steps = min(original.agents.num_steps, scenario.agents.num_steps)
        is_both = (
            original.agents.is_valid[before, :steps]
            & scenario.agents.is_valid[after, :steps]
        )
        current = scenario.current_step
        parts = []
        if current < steps and is_both[current]:
            now = _difference(original, scenario, before, after, current)
            parts.append(f"now: {now}")
        ahead = np.flatnonzero(is_both[current + 1 :])
        if len(ahead):
            last = current + 1 + int(ahead[-1])
            end = _difference(original, scenario, before, after, last)
            time_s = (last - current) * scenario.time_axis.step_s
            parts.append(f"at {time_s:.1f} s: {end}")
        notes[agent_id] = "\n".join(parts) if parts else "not comparable"
    return notes


def _difference(
    original: Scenario, scenario: Scenario, before: int, after: int, step: int
) -> str:
    old, new = original.agents, scenario.agents
    gap = np.linalg.norm(new.position_m[after, step] - old.position_m[before, step])
    faster = np.hypot(*new.velocity_mps[after, step]) - np.hypot(
        *old.velocity_mps[before, step]
    )
    pace = f"{abs(faster):.1f} m/s {'faster' if faster > 0 else 'slower'}"
    return (
        f"{gap:.1f} m from the original, {pace if abs(faster) >= 0.05 else 'as fast'}"
    )


def _rows_now(original: AgentTracks, now: AgentTracks) -> Int[np.ndarray, "A"]:
    found = (now.row_of.get(agent_id, -1) for agent_id in original.ids)
    return np.fromiter(found, int, len(original))


def _paths(
    original: Scenario, scenario: Scenario, rows: np.ndarray, palette: Palette
) -> list[Primitive]:
    agents = original.agents
    rows = rows[agents.kind_mask(ROAD_USER_KINDS)[rows]]
    points, is_dash = dotted(agents.position_m[rows], agents.is_valid[rows])
    color = inverse_aces(srgb_to_linear(np.array(palette.ghost) / 255.0))
    dashes = path_ribbons(
        points,
        is_dash,
        color=np.broadcast_to(color, (len(rows), 3)),
        opacity=np.full(is_dash.shape, 0.85),
        width_m=np.full(is_dash.shape, DASH_WIDTH_M),
        height_m=path_heights(DASH_HEIGHT_M, np.arange(len(rows))),
    )
    lines = _connectors(original, scenario, rows)
    lines = ribbons(Lines.of(lines), 0.1)
    connectors = Primitive(
        points_m=lines.points_m,
        faces=lines.faces,
        height_m=DASH_HEIGHT_M,
        color=shown_exactly(palette.ghost),
        opacity=0.7,
    )
    return [dashes, connectors]


def _connectors(
    original: Scenario, scenario: Scenario, rows: np.ndarray
) -> list[Float[np.ndarray, "2 2"]]:
    """Lines from the original to the present positions at the current step."""
    step = scenario.current_step
    old, new = original.agents, scenario.agents
    row_now = _rows_now(old, new)
    pairs = [(int(row), int(row_now[row])) for row in rows if row_now[row] >= 0]
    lines = [
        np.stack([old.position_m[before, step], new.position_m[after, step]])
        for before, after in pairs
        if _there(old.is_valid, before, step) and _there(new.is_valid, after, step)
    ]
    return [line for line in lines if np.linalg.norm(line[1] - line[0]) >= 1.0]


def _there(is_valid: Bool[np.ndarray, "A T"], row: int, step: int) -> bool:
    return step < is_valid.shape[1] and bool(is_valid[row, step])


class Comparison:
    """Shows the original scenario and texts about its differences."""

    def __init__(self, ui: UiContext) -> None:
        """Show no original yet."""
        self._ui = ui
        self._overlay = ui.overlay
        self._view = OriginalView(ui.client, ui.model.palette)
        self._is_held = False
        self._is_kept = False
        self._overlay.on("compare", self._heard)
        self._overlay.show(CompareState())

    @property
    def is_on(self) -> bool:
        """Whether the original is shown."""
        return self._is_held or self._is_kept

    def hold(self) -> None:
        """Show the original until ``release``."""
        self._set(is_held=True)

    def release(self) -> None:
        """End what ``hold`` began."""
        self._set(is_held=False)

    def keep(self, is_kept: bool) -> None:
        """Show the original for as long as this is set."""
        self._set(is_kept=is_kept)

    def set_palette(self, palette: Palette) -> None:
        """Draw in another theme from the next frame on."""
        self._view.set_palette(palette)

    def show(self) -> None:
        """Draw the original at the playhead."""
        if not self.is_on:
            return
        session = self._ui.session
        step = self._ui.workspace.playback.step
        self._view.show(session.original, session.scenario, step)
        self._overlay.show(CompareState(text=self._summary()))

    def notes(self) -> dict[str, str]:
        """Note on each selected agent."""
        if not self.is_on:
            return {}
        session = self._ui.session
        return difference_notes(session.original, session.scenario, session.selection)

    def _summary(self) -> str:
        session, count = self._ui.session, self._view.num_changed
        original = set(session.original.agents.ids)
        added = sum(agent not in original for agent in session.scenario.agents.ids)
        parts = []
        if session.scenario.applied_warp != session.base.applied_warp:
            parts.append("the road is warped")
        if count:
            parts.append(
                f"{count} {'agent differs' if count == 1 else 'agents differ'}"
            )
        if added:
            parts.append(f"{added} added")
        earlier = session.base.provenance.base
        name = f"Export of {earlier.root.scenario_id}" if earlier else "Original"
        return f"{name}: {', '.join(parts) if parts else 'nothing has changed'}"

    def _heard(self, event: CompareEvent) -> None:
        if event.kind == "hold":
            self.hold()
        else:
            self.release()

    def _set(self, *, is_held: bool | None = None, is_kept: bool | None = None) -> None:
        before = self.is_on
        self._is_held = self._is_held if is_held is None else is_held
        self._is_kept = self._is_kept if is_kept is None else is_kept
        if self.is_on == before:
            return
        self._view.set_shown(self.is_on)
        if not self.is_on:
            self._overlay.show(CompareState())
        self._ui.model.compared.emit()
