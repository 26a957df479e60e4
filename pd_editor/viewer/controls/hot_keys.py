"""Hot keys, in the order of the command palette."""

from collections.abc import Callable

from pd_editor.viewer.agents.agent_list import AgentList
from pd_editor.viewer.agents.selecting import Selecting
from pd_editor.viewer.controls.control_panel import ControlPanel
from pd_editor.viewer.controls.key_sheet import KeySheet
from pd_editor.viewer.controls.modes import Modes
from pd_editor.viewer.controls.picture import Picture
from pd_editor.viewer.findings.scorecard_drawer import ScorecardDrawer
from pd_editor.viewer.scene.timeline import Timeline
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.tab.ui_context import UiContext


def add_hot_keys(
    ui: UiContext,
    *,
    panels: ControlPanel,
    picture: Picture,
    modes: Modes,
    viewpoint: Viewpoint,
    agent_list: AgentList,
    scorecard: ScorecardDrawer,
    key_sheet: KeySheet,
    timeline: Timeline,
    selecting: Selecting,
    escape: Callable[[], None],
) -> None:
    """Register the hot keys of a tab."""
    key = ui.hotkey
    key("Play or pause", timeline.toggle_play, "space")
    key("Go to t = 0", timeline.go_to_current)
    key("Next frame (right arrow)", lambda: timeline.step_by(1))
    key("Previous frame (left arrow)", lambda: timeline.step_by(-1))
    key("Undo", panels.history.undo, "Z", "cmd/ctrl")
    key("Redo", panels.history.redo, "Z", "cmd/ctrl+shift")
    key("Redo (Ctrl+Y)", panels.history.redo, "Y", "cmd/ctrl")
    key("Delete selection", panels.agent.delete, "delete", failure="Not deleted")
    key(
        "Delete selection (Backspace)",
        panels.agent.delete,
        "backspace",
        failure="Not deleted",
    )
    key(
        "Duplicate selection",
        panels.agent.duplicate,
        "D",
        "cmd/ctrl",
        failure="Not duplicated",
    )
    key("Snap to lane", panels.agent.snap, "L", failure="Not snapped to a lane")
    key(
        "Lock or unlock the selection",
        panels.agent.locks.toggle,
        "K",
        failure="Lock not changed",
    )
    key("Select all agents", selecting.select_all, "A", "cmd/ctrl")
    key("Invert the selection", selecting.invert, "I", "cmd/ctrl")
    key("Select all of the same kind", selecting.same_kind)
    key("Agent list", agent_list.toggle, "F", "cmd/ctrl")
    key("Scorecard", scorecard.toggle, "I")
    key("Place an agent", modes.placing.toggle, "P", arms=True)
    modes.steering.add_hotkeys()
    key("Show possible trajectories", panels.candidates.toggle_candidates, "G")
    key("Regenerate the selection, else all", panels.generation.regenerate, "R")
    key(
        "Live regeneration on or off",
        panels.generation.live_switch.toggle,
        "R",
        "shift",
    )
    key("Choose among the samples of the last run", picture.samples.focus, "J")
    key("Compare two samples of the last run", picture.samples.compare, "C")
    key("Cancel the generation", panels.generation.cancel)
    key("Reset road", panels.road.reset)
    key("Switch 3-D and top view", viewpoint.switch, "V")
    key("Frame selection", viewpoint.frame_selection, "F")
    key("Show the whole map", viewpoint.frame_map, "home")
    key("Measure distances", modes.measure.toggle, "M", arms=True)
    key("Turn the view north, or to the heading", viewpoint.turn)
    key("Keys and mouse", key_sheet.open)
    key("Clear selection", escape, "escape")
    key("Star: into the basket", panels.basket.star, "S")
    key("Next scenario", lambda: panels.dataset.go(+1), "pagedown")
    key("Previous scenario", lambda: panels.dataset.go(-1), "pageup")
