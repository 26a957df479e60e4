"""Observable model of a browser tab: what it shows beside its session."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from pd_editor.analysis.findings.finding import Finding
from pd_editor.scene.palette import DARK, LIGHT, Palette
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.meshes.agent_shapes import AgentPoses
from pd_editor.viewer.state.events import Signal
from pd_editor.viewer.state.finding_watch import FindingWatch
from pd_editor.viewer.state.workspace import Workspace

Drawer = Literal["agents", "scorecard"]


@dataclass(frozen=True, kw_only=True)
class RunState:
    """State of a running generation, or of a waiting result."""

    text: str = ""
    """Short text; empty to show problems instead."""
    fraction: float | None = None
    """Fraction that is done; None without a running generation."""
    action: str = ""
    """Label of a button that applies a waiting result."""


class ActiveMode(Protocol):
    """A mode in which presses on the picture mean something else."""

    def stop(self) -> None:
        """End the mode."""


class TabModel:
    """Values that several elements of a tab share, with a signal for each kind of change.

    An element reads the model and the session, and subscribes in its constructor; no
    element knows who else shows what it has changed.
    """

    def __init__(self, workspace: Workspace) -> None:
        """Make the model of a tab that shows a workspace."""
        self._workspace = workspace
        self.findings = FindingWatch(workspace)
        self.shown = Signal[()]()
        """All that is beside the picture is to be shown again, after an edit for example."""
        self.scene_left = Signal[()]()
        """Another scene was opened; the picture still shows the former one."""
        self.scene_shown = Signal[()]()
        """Another scene is in the picture."""
        self.theme_changed = Signal[()]()
        self.view_switched = Signal[()]()
        """The top view or the 3-D view is shown instead of the other."""
        self.playhead_moved = Signal[()]()
        self.poses: AgentPoses | None = None
        """Agents as drawn now."""
        self.poses_drawn = Signal[()]()
        """The session's agents are drawn at ``poses``."""
        self.marks_changed = Signal[()]()
        """What is marked in the picture is to be drawn again."""
        self.pointed_id: str | None = None
        """Agent that is pointed at in a list."""
        self.compared = Signal[()]()
        """The original scenario is shown or hidden."""
        self.covered = {"timeline": 174}
        """Height in pixels of the picture's lower part that each element covers."""
        self.checked = Signal[()]()
        """The findings of the future are known, or others of them are ignored."""
        self.marked_findings: tuple[Finding, ...] = ()
        """Findings of the scorecard whose agents are marked."""
        self.mode: ActiveMode | None = None
        """Mode to which presses on the picture belong."""
        self.mode_changed = Signal[()]()
        self.drawer: Drawer | None = None
        """What is open over the picture's left side."""
        self.drawer_changed = Signal[()]()
        self.agent_clicked = Signal[()]()
        """A click on the picture has selected an agent."""
        self.agent_picked = Signal[str]()
        """Offers the one agent that was chosen in a list to a mode that asks for one."""
        self.ground_clicked = Signal[np.ndarray]()
        """Offers a click on the ground, in metres."""
        self.chosen_term: int | None = None
        self.chosen_point: int | None = None
        """Index of the guidance term that stands out, and of a way-point of its path."""
        self.term_chosen = Signal[()]()
        self.fan_shown = Signal[bool]()
        """Possible trajectories are shown or hidden."""
        self.run: RunState | None = None
        """The generation that runs or waits to be used."""
        self.run_changed = Signal[()]()
        self.run_requested = Signal[tuple[str, ...] | None, bool]()
        """Trajectories of some agents, or of all (None), are wanted; whether as a cure."""
        self.sample: Scenario | None = None
        """A sample or a branch that is drawn instead of the session's scenario."""
        self.sample_pointed = Signal[()]()
        self.pair_opened = Signal[()]()
        self.tab_asked, self.save_requested = Signal[str](), Signal[()]()
        """A tab of the panel is to be opened; the scenario is to be put into the library."""
        self.library_changed = Signal[()]()

    @property
    def covered_px(self) -> int:
        """Height of the picture's lower part that is covered."""
        return max(self.covered.values())

    def preview(self, scenario: Scenario | None) -> None:
        """Draw a scenario in the place of the session's without an edit; None: that one."""
        if scenario is not self.sample:
            self.sample = scenario
            self.sample_pointed.emit()

    @property
    def palette(self) -> Palette:
        """Colours of the theme in force."""
        return DARK if self._workspace.is_dark else LIGHT

    @property
    def is_running(self) -> bool:
        """Whether a generation is running."""
        return self.run is not None and self.run.fraction is not None

    def warned_at(self, step: float) -> frozenset[str]:
        """Agents with a new problem or a marked finding at a step."""
        return self.findings.agents_at(step) | frozenset(
            name
            for one in self.marked_findings
            if one.holds_at(step)
            for name in one.agent_ids
        )

    def point_at(self, agent_id: str | None) -> None:
        """Mark an agent that is pointed at in a list; None marks none."""
        self.pointed_id = agent_id
        self.marks_changed.emit()

    def choose_term(self, index: int | None, point: int | None = None) -> None:
        """Let a guidance term stand out in the list and on the road, or its way-point."""
        self.chosen_term, self.chosen_point = index, point
        self.term_chosen.emit()

    def open_drawer(self, drawer: Drawer | None) -> None:
        """Open a drawer, which closes the other one; None closes both."""
        if drawer != self.drawer:
            self.drawer = drawer
            self.drawer_changed.emit()

    def toggle_drawer(self, drawer: Drawer) -> None:
        """Open a drawer, or close it."""
        self.open_drawer(None if self.drawer == drawer else drawer)
