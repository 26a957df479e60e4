"""All elements of a tab; they know the model, and hardly one another."""

from pd_editor.generation.generators import GeneratorCatalogue
from pd_editor.viewer.agents.agent_list import AgentList
from pd_editor.viewer.agents.agent_panel import AgentPanel
from pd_editor.viewer.agents.placing import PlacingMode
from pd_editor.viewer.agents.pointer import Pointer
from pd_editor.viewer.agents.selecting import Selecting
from pd_editor.viewer.agents.speed_curve import SpeedCurve
from pd_editor.viewer.controls.branch_strip import BranchStrip
from pd_editor.viewer.controls.history_panel import HistoryPanel
from pd_editor.viewer.controls.key_sheet import KeySheet
from pd_editor.viewer.controls.page_aids import (
    AGENTS,
    ROAD,
    SCENE,
    STUDY,
    Hints,
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
from pd_editor.viewer.scene.hover import Hover
from pd_editor.viewer.scene.measure import Measure
from pd_editor.viewer.scene.picture import Picture
from pd_editor.viewer.scene.plans_view import PlansView
from pd_editor.viewer.scene.timeline import Timeline
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.study.study_panel import StudyPanel
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
        with tabs.add_tab("Generate"):
            self.generation = GenerationPanel(ui, generators, self.region, self.samples)
        with tabs.add_tab(STUDY):
            self.family = FamilyPanel(ui, generators)
            self.study = StudyPanel(ui, generators.offers)
        with tabs.add_tab("History"):
            self.history = HistoryPanel(ui, style, self.branches.toggle)
        with tabs.add_tab("View"):
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
