"""Draws what stands at agents over the picture: names and padlocks."""

from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.meshes.agent_shapes import AgentPoses
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
                    seconds=f"{lock.kept_s:g} s" if lock.keeps_beginning else "",
                    label=f"Locked: {lock.in_words} of agent {agent_id}",
                    point=rounded_place(point),
                    radius=round(float(sizes[row, 1]) / 2, 2),
                )
            )
        self._overlay.show(LocksState(locks=tuple(locks)))
