"""Padlocks beside locked agents, over the picture."""

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.meshes.agent_poses import AgentPoses
from pd_editor.viewer.overlay.messages import LockMark, LocksState, rounded_place
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.view_scale import ViewScale, drawn_sizes_m


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
