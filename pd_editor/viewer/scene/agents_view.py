"""Draws the agents: one batch of instances per kind, moved on every frame."""

from dataclasses import dataclass

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.palette import Palette, agent_color
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.meshes.agent_shapes import (
    AgentPoses,
    contact_shadow,
    poses_at,
    shape_of,
    yaw_quaternions,
)
from pd_editor.viewer.meshes.colors import lit_from_above
from pd_editor.viewer.scene.camera import ViewScale, drawn_sizes_m
from pd_editor.viewer.state.events import Signal

BodyHandle = viser.BatchedMeshHandle


@dataclass(kw_only=True, eq=False)
class _Batch:
    """Instances of one kind; ``rows`` are their rows in the agent tracks."""

    rows: np.ndarray
    nodes: tuple[BodyHandle, ...]
    is_present: np.ndarray | None = None


class AgentsView:
    """Nodes of one browser for the agents' bodies."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._client = client
        self._palette = palette
        self.new_body = Signal[BodyHandle, AgentKind]()
        """A node that was made for agents of a kind."""
        self._batches: dict[AgentKind, _Batch] = {}
        self._shadows: viser.BatchedGlbHandle | None = None
        self._scenario: Scenario | None = None
        self._poses: AgentPoses | None = None
        self._view: ViewScale | None = None
        self._size_m = np.zeros((0, 2))

    def agent_at(self, kind: AgentKind, instance: int) -> str | None:
        """Id of the agent behind an instance that was pointed at."""
        batch = self._batches.get(kind)
        if batch is None or self._scenario is None or instance >= len(batch.rows):
            return None
        return self._scenario.agents.ids[batch.rows[instance]]

    @property
    def poses(self) -> AgentPoses | None:
        """Poses as drawn last."""
        return self._poses

    def set_palette(self, palette: Palette) -> None:
        """Redraw in another theme."""
        self._palette = palette
        if self._scenario is None:
            return
        for batch in self._batches.values():
            batch.nodes[0].batched_colors = self._colors(self._scenario, batch.rows)
            for node in batch.nodes[1:]:
                node.batched_colors = self._dark_colors(len(batch.rows))

    def set_view(self, view: ViewScale) -> None:
        """Size what is drawn for another camera, from the next frame on."""
        self._view = view
        self._size_m = np.zeros((0, 2))

    def show(self, scenario: Scenario, step: float) -> None:
        """Draw all agents at a fractional step."""
        if self._has_other_bodies(scenario):
            self._size_m = drawn_sizes_m(scenario.agents, self._view)
            self._rebuild(scenario)
        self._scenario = scenario
        if len(self._size_m) != len(scenario.agents):
            self._size_m = drawn_sizes_m(scenario.agents, self._view)
            for batch in self._batches.values():
                batch.is_present = None
        poses = poses_at(scenario.agents, step)
        self._poses = poses
        quaternions = yaw_quaternions(poses.heading_rad)
        for batch in self._batches.values():
            self._move(batch, scenario.agents, poses, quaternions)
        if self._shadows is not None:
            self._shadows.batched_positions = _lifted(poses.position_m, 0.09)
            self._shadows.batched_wxyzs = quaternions.astype(np.float32)
            # The shadow of an enlarged glyph would be a second, larger one.
            has_shadow = (
                poses.is_present & (self._size_m == scenario.agents.size_m)[:, 0]
            )
            self._shadows.batched_scales = np.column_stack(
                [self._size_m * has_shadow[:, None], has_shadow]
            ).astype(np.float32)

    def _has_other_bodies(self, scenario: Scenario) -> bool:
        if self._scenario is None:
            return True
        shown, wanted = self._scenario.agents, scenario.agents
        return (
            shown.ids != wanted.ids
            or shown.kinds != wanted.kinds
            or shown.size_m is not wanted.size_m
            or self._scenario.focal_id != scenario.focal_id
        )

    def _move(
        self,
        batch: _Batch,
        agents: AgentTracks,
        poses: AgentPoses,
        quaternions: Float[np.ndarray, "A 4"],
    ) -> None:
        positions = _lifted(poses.position_m[batch.rows], 0.0)
        turns = quaternions[batch.rows].astype(np.float32)
        is_present = poses.is_present[batch.rows]
        if batch.is_present is None or not np.array_equal(is_present, batch.is_present):
            batch.is_present = is_present
            scales = self._scales(batch.rows, agents) * is_present[:, None]
            for node in batch.nodes:
                node.batched_scales = scales
        for node in batch.nodes:
            node.batched_positions = positions
            node.batched_wxyzs = turns

    def _rebuild(self, scenario: Scenario) -> None:
        agents = scenario.agents
        kinds = dict.fromkeys(agents.kinds)
        for kind in [kind for kind in self._batches if kind not in kinds]:
            for node in self._batches.pop(kind).nodes:
                node.remove()
        for kind in kinds:
            rows = np.flatnonzero(agents.kind_mask([kind]))
            colors = self._colors(scenario, rows)
            old = self._batches.get(kind)
            if old is not None:
                self._batches[kind] = self._resized(old, rows, colors, agents)
            else:
                self._batches[kind] = self._added(kind, rows, colors, agents)
        if self._shadows is not None:
            self._shadows.remove()
            self._shadows = None
        if len(agents):
            self._shadows = self._client.scene.add_batched_glb(
                "/agent_shadows",
                contact_shadow(),
                batched_wxyzs=yaw_quaternions(np.zeros(len(agents))),
                batched_positions=np.zeros((len(agents), 3)),
                batched_scales=np.zeros((len(agents), 3)),
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )

    def _added(
        self, kind: AgentKind, rows: np.ndarray, colors: np.ndarray, agents: AgentTracks
    ) -> _Batch:
        shape = shape_of(kind)
        parts = [("body", shape.body, colors)]
        if shape.dark is not None:
            parts.append(("dark", shape.dark, self._dark_colors(len(rows))))
        nodes = []
        for name, mesh, part_colors in parts:
            node = self._client.scene.add_batched_meshes_simple(
                f"/agents/{kind}/{name}",
                np.asarray(mesh.vertices, np.float32),
                np.asarray(mesh.faces, np.uint32),
                batched_wxyzs=yaw_quaternions(np.zeros(len(rows))).astype(np.float32),
                batched_positions=np.zeros((len(rows), 3), np.float32),
                batched_scales=self._scales(rows, agents),
                batched_colors=part_colors,
                flat_shading=True,
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )
            self.new_body.emit(node, kind)
            nodes.append(node)
        return _Batch(rows=rows, nodes=tuple(nodes))

    def _resized(
        self, old: _Batch, rows: np.ndarray, colors: np.ndarray, agents: AgentTracks
    ) -> _Batch:
        """Update the instances of nodes, which keep their callbacks."""
        part_colors = (colors, self._dark_colors(len(rows)))
        for node, colored in zip(old.nodes, part_colors, strict=False):
            node.batched_positions = np.zeros((len(rows), 3), np.float32)
            node.batched_wxyzs = yaw_quaternions(np.zeros(len(rows))).astype(np.float32)
            node.batched_scales = self._scales(rows, agents)
            node.batched_colors = colored
        return _Batch(rows=rows, nodes=old.nodes)

    def _scales(self, rows: np.ndarray, agents: AgentTracks) -> np.ndarray:
        heights = [DEFAULT_HEIGHT_M[agents.kinds[row]] for row in rows]
        return np.column_stack([self._size_m[rows], heights]).astype(np.float32)

    def _colors(self, scenario: Scenario, rows: np.ndarray) -> np.ndarray:
        shown = (agent_color(scenario, self._palette, int(row)) for row in rows)
        return np.array([lit_from_above(color) for color in shown], np.uint8)

    def _dark_colors(self, count: int) -> np.ndarray:
        dark = np.array(lit_from_above(self._palette.glass), np.uint8)
        return np.tile(dark, (count, 1))


def _lifted(points_m: Float[np.ndarray, "N 2"], height_m: float) -> np.ndarray:
    return np.column_stack([points_m, np.full(len(points_m), height_m)]).astype(
        np.float32
    )
