"""All elements of a tab, which know the model and hardly one another, and its hot keys."""

from functools import partial

from pd_editor.generation.generators import GeneratorCatalogue
from pd_editor.viewer.agents.agent_list import AgentList
from pd_editor.viewer.agents.agent_panel import AgentPanel
from pd_editor.viewer.agents.placing import PlacingMode
from pd_editor.viewer.agents.pointer import Pointer, Selecting
from pd_editor.viewer.agents.speed_curve import SpeedCurve
from pd_editor.viewer.controls.branch_strip import BranchStrip
from pd_editor.viewer.controls.history_panel import HistoryPanel
from pd_editor.viewer.controls.page_aids import (
    AGENTS,
    GENERATE,
    HISTORY,
    ROAD,
    SCENE,
    STUDY,
    TABS,
    VIEW,
    Hints,
    KeySheet,
    SidePanel,
)
from pd_editor.viewer.controls.view_panel import ViewPanel
from pd_editor.viewer.files.export_panel import ExportPanel
from pd_editor.viewer.files.family_panel import FamilyPanel
from pd_editor.viewer.files.library_actions import LibraryActions
from pd_editor.viewer.files.scenario_panel import ScenarioPanel
from pd_editor.viewer.files.start_page import StartPage
from pd_editor.viewer.findings.scorecard_drawer import ScorecardDrawer
from pd_editor.viewer.findings.status_chip import StatusChip
from pd_editor.viewer.generation.candidates_panel import CandidatesPanel
from pd_editor.viewer.generation.generation_panel import GenerationPanel
from pd_editor.viewer.generation.region_drawing import RegionDrawing
from pd_editor.viewer.generation.sample_strip import SampleStrip
from pd_editor.viewer.guidance.guidance_panel import GuidancePanel
from pd_editor.viewer.guidance.steering import Steering
from pd_editor.viewer.guidance.time_handles import TimeHandles
from pd_editor.viewer.road.bending import Bending
from pd_editor.viewer.road.road_panel import RoadPanel
from pd_editor.viewer.road.signals_panel import SignalsPanel
from pd_editor.viewer.scene.measure import Measure
from pd_editor.viewer.scene.picking import Hover
from pd_editor.viewer.scene.picture import Picture
from pd_editor.viewer.scene.ribbons_view import PlansView
from pd_editor.viewer.scene.timeline import Timeline
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.study_panel import StudyPanel
from pd_editor.viewer.tab.panel_style import PanelStyle
from pd_editor.viewer.tab.ui_context import UiContext


class TabElements:
    """Elements over the picture, and the panels beside it.

    They hear of a change in the order in which they are made.
    """

    def __init__(
        self, ui: UiContext, generators: GeneratorCatalogue, *, is_debug: bool
    ) -> None:
        """Build the picture with what is over it, send it, and build the panels."""
        self._ui = ui
        with ui.client.atomic():
            self._add_picture(is_debug)
        ui.send_now()
        with ui.client.atomic():
            self._add_panels(generators)
            ui.model.shown.emit()

    def _add_picture(self, is_debug: bool) -> None:
        ui = self._ui
        self.timeline = Timeline(ui)
        self.viewpoint = Viewpoint(ui)
        self.start = StartPage(ui, self.timeline, self.viewpoint)
        SidePanel(ui, is_debug=is_debug)
        self.measure = Measure(ui)
        self.placing = PlacingMode(ui)
        self.region = RegionDrawing(ui)
        self.steering = Steering(ui)
        self.picture = Picture(ui)
        self.pointer = Pointer(ui, self.picture.agents)
        self.samples = SampleStrip(ui, self.viewpoint)
        self.branches = BranchStrip(ui, self.samples)
        self.scorecard = ScorecardDrawer(ui, self.timeline, self.viewpoint)
        self.selecting = Selecting(ui)
        SpeedCurve(ui, self.timeline)
        TimeHandles(ui)
        Hover(ui)
        self.plans = PlansView(ui)
        Hints(ui)
        self.key_sheet = KeySheet(ui.overlay)
        self.viewpoint.restore()
        self.picture.size_for_view()
        self.picture.draw()
        self.viewpoint.hold_picture(self.picture.map.road_nodes)

    def _add_panels(self, generators: GeneratorCatalogue) -> None:
        ui, gui = self._ui, self._ui.client.gui
        style = PanelStyle(gui)
        self.agent_list = AgentList(ui)
        tabs = gui.add_tab_group()
        with tabs.add_tab(SCENE):
            self.scenario = ScenarioPanel(ui, self.start)
            self.export = ExportPanel(ui)
            self.library = LibraryActions(ui, self.export, self.start)
        with tabs.add_tab(ROAD):
            self.road = RoadPanel(ui, style, self.picture, self.viewpoint)
            self.bending = Bending(ui, self.road)
            with gui.add_folder("Signals"):
                SignalsPanel(ui)
        with tabs.add_tab(AGENTS):
            steering = self.steering
            self.agent = AgentPanel(ui, self.placing)
            self.candidates = CandidatesPanel(ui, steering.mode)
            self.guidance = GuidancePanel(
                ui, steering.mode, steering.notes, steering.encounters
            )
        with tabs.add_tab(GENERATE):
            self.generation = GenerationPanel(
                ui, generators, self.region, self.samples, steering.notes.before_run
            )
        with tabs.add_tab(STUDY):
            self.family = FamilyPanel(ui, generators)
            self.study = StudyPanel(ui, generators.offers)
        with tabs.add_tab(HISTORY):
            self.history = HistoryPanel(ui, style, self.branches.toggle)
        with tabs.add_tab(VIEW):
            self.view = ViewPanel(ui, self.picture)
        self.chip = StatusChip(ui, self.timeline, self.viewpoint, self.export)

    def delete(self) -> None:
        """Delete the way-point that is chosen, else the selection."""
        if not self.guidance.remove_point():
            self.agent.delete()

    def escape(self) -> None:
        """Leave what is innermost: a gesture, a mode, a list; else clear the selection."""
        ui = self._ui
        if ui.gesture is not None:
            ui.abort_gesture()
        elif ui.model.mode is not None:
            ui.model.mode.stop()
        elif self.candidates.shows_candidates:
            self.candidates.hide_candidates()
        elif not (
            self.chip.close_list()
            or self.samples.close()
            or self.branches.close()
            or self.agent.locks.withdraw()
            or self.steering.encounters.close()
            or self.guidance.leave_point()
        ):
            ui.session.select(())

    def compare(self) -> None:
        """Compare two of the branches if they are shown, else of the samples."""
        (self.branches if self.branches.is_open else self.samples).compare()

    def close(self) -> None:
        """End what panels run."""
        self.generation.close()
        self.study.close()
        self.export.close()
        self.family.close()
        self.viewpoint.remember()


def add_hot_keys(ui: UiContext, tab: TabElements) -> None:
    """Register the hot keys of a tab."""
    _add_time_keys(ui, tab.timeline)
    key = ui.hotkey
    key("Undo", tab.history.undo, "Z", "cmd/ctrl")
    key("Redo", tab.history.redo, "Z", "cmd/ctrl+shift")
    key("Delete selection", tab.delete, "delete", failure="Not deleted")
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
    key("Draw a region to resample", tab.region.toggle, arms=True)
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
    key("Download in the chosen format", tab.export.download, failure="Not downloaded")
    key("All scenarios", tab.start.toggle, "N")
    key("Next scenario", lambda: tab.start.go(+1), "pagedown")
    key("Previous scenario", lambda: tab.start.go(-1), "pageup")
    for name in TABS:
        key(f"Open the tab {name}", partial(ui.model.tab_asked.emit, name))


def _add_time_keys(ui: UiContext, timeline: Timeline) -> None:
    ui.hotkey("Play or pause", timeline.toggle_play, "space")
    ui.hotkey("Play backwards; again: faster", partial(timeline.shuttle, -1), "J")
    ui.hotkey("Pause", partial(timeline.shuttle, 0), "K")
    ui.hotkey("Play; again: faster", partial(timeline.shuttle, 1), "L")
    ui.hotkey("Go to t = 0", timeline.go_to_current)
    ui.hotkey("Start from here", timeline.start_here)
    ui.hotkey("Next frame (right arrow)", lambda: timeline.step_by(1))
    ui.hotkey("Previous frame (left arrow)", lambda: timeline.step_by(-1))
