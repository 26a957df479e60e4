"""Hot keys, in the order of the command palette."""

from functools import partial

from pd_editor.viewer.controls.tab_elements import TabElements
from pd_editor.viewer.scene.timeline import Timeline
from pd_editor.viewer.tab.ui_context import UiContext


def add_hot_keys(ui: UiContext, tab: TabElements) -> None:
    """Register the hot keys of a tab."""
    _add_time_keys(ui, tab.timeline)
    key = ui.hotkey
    key("Undo", tab.history.undo, "Z", "cmd/ctrl")
    key("Redo", tab.history.redo, "Z", "cmd/ctrl+shift")
    key("Redo (Ctrl+Y)", tab.history.redo, "Y", "cmd/ctrl")
    key("Delete selection", tab.delete, "delete", failure="Not deleted")
    key(
        "Delete selection (Backspace)",
        tab.delete,
        "backspace",
        failure="Not deleted",
    )
    key(
        "Duplicate selection",
        tab.agent.duplicate,
        "D",
        "cmd/ctrl",
        failure="Not duplicated",
    )
    key("Snap to lane", tab.agent.snap, "L", "shift", failure="Not snapped to a lane")
    key(
        "Lock or unlock the selection",
        tab.agent.locks.toggle,
        "K",
        "shift",
        failure="Lock not changed",
    )
    key("Select all agents", tab.selecting.select_all, "A", "cmd/ctrl")
    key("Invert the selection", tab.selecting.invert, "I", "cmd/ctrl")
    key("Select all of the same kind", tab.selecting.same_kind)
    key("Agent list", partial(ui.model.toggle_drawer, "agents"), "F", "cmd/ctrl")
    key("Scorecard", partial(ui.model.toggle_drawer, "scorecard"), "I")
    key("Place an agent", tab.placing.toggle, "P", arms=True)
    tab.steering.add_hotkeys()
    key("Show possible trajectories", tab.candidates.toggle_candidates, "G")
    key("Regenerate selected, guided or all agents", tab.generation.regenerate, "R")
    key("Resample, or add agents", tab.generation.resample)
    key("Live on or off", tab.generation.live_switch.toggle, "R", "shift")
    key("Roll out in closed loop", tab.generation.closed_loop.roll_out)
    key("Choose among samples of the last run", tab.samples.focus, "J", "shift")
    key("Compare two samples, or branches", tab.compare, "C")
    key("Branches of the history", tab.branches.toggle, "U")
    key("Cancel the generation", tab.generation.cancel)
    key("Bend the road by hand", tab.bending.toggle, "W", arms=True)
    key("Reset road", tab.road.reset)
    key("Switch 3-D and top view", tab.viewpoint.switch, "V")
    key("Frame selection", tab.viewpoint.frame_selection, "F")
    key("Show the whole map", tab.viewpoint.frame_map, "home")
    key("Measure distances", tab.measure.toggle, "M", arms=True)
    key("Turn the view north, or to the heading", tab.viewpoint.turn)
    key("Keys and mouse", tab.key_sheet.open)
    key("Clear selection", tab.escape, "escape")
    key("Save to library", tab.library.save, "S")
    key("All scenarios", tab.start.toggle, "N")
    key("Next scenario", lambda: tab.start.go(+1), "pagedown")
    key("Previous scenario", lambda: tab.start.go(-1), "pageup")


def _add_time_keys(ui: UiContext, timeline: Timeline) -> None:
    ui.hotkey("Play or pause", timeline.toggle_play, "space")
    ui.hotkey("Play backwards; again: faster", partial(timeline.shuttle, -1), "J")
    ui.hotkey("Pause", partial(timeline.shuttle, 0), "K")
    ui.hotkey("Play; again: faster", partial(timeline.shuttle, 1), "L")
    ui.hotkey("Go to t = 0", timeline.go_to_current)
    ui.hotkey("Start from here", timeline.start_here)
    ui.hotkey("Next frame (right arrow)", lambda: timeline.step_by(1))
    ui.hotkey("Previous frame (left arrow)", lambda: timeline.step_by(-1))
