"""The control panel of a tab: its panels, by what they work on."""

from collections.abc import Callable
from functools import partial

from pd_editor.analysis.guidance.kinds.course import FollowPath
from pd_editor.editor.session import SessionState
from pd_editor.generation.generators import GeneratorCatalogue
from pd_editor.viewer.agents.agent_list import AgentList
from pd_editor.viewer.agents.agent_panel import AgentPanel
from pd_editor.viewer.controls.history_panel import HistoryPanel
from pd_editor.viewer.controls.modes import Modes
from pd_editor.viewer.controls.picture import Picture
from pd_editor.viewer.controls.side_panel import AGENTS, SCENE
from pd_editor.viewer.controls.view_panel import ViewPanel
from pd_editor.viewer.files.basket_panel import BasketPanel
from pd_editor.viewer.files.dataset_panel import DatasetPanel
from pd_editor.viewer.files.export_panel import ExportPanel
from pd_editor.viewer.files.scenario_panel import ScenarioPanel
from pd_editor.viewer.files.unfinished_panel import UnfinishedPanel
from pd_editor.viewer.generation.candidates_panel import CandidatesPanel
from pd_editor.viewer.generation.generation_panel import GenerationPanel
from pd_editor.viewer.overlay.banner import Banner
from pd_editor.viewer.road.anchor_view import AnchorView
from pd_editor.viewer.road.road_panel import RoadPanel
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.state.finding_watch import FindingWatch
from pd_editor.viewer.study.study_panel import StudyPanel
from pd_editor.viewer.tab.panel_style import PanelStyle
from pd_editor.viewer.tab.ui_context import UiContext


class ControlPanel:
    """All panels of one tab."""

    def __init__(
        self,
        ui: UiContext,
        generators: GeneratorCatalogue,
        banner: Banner,
        *,
        problems: FindingWatch,
        picture: Picture,
        modes: Modes,
        viewpoint: Viewpoint,
        agent_list: AgentList,
        on_theme: Callable[[bool], None],
        on_run: Callable[[], None],
    ) -> None:
        """Build the panels.

        ``on_theme`` is called with whether the dark theme was chosen, ``on_run`` when
        the state of the generator's run has changed.
        """
        gui, style = ui.client.gui, PanelStyle(ui.client.gui)
        self._agent_list = agent_list
        self._is_built = False
        tabs = gui.add_tab_group()
        with tabs.add_tab(SCENE):
            self.scenario = ScenarioPanel(ui)
            self.export = ExportPanel(ui, lambda: problems.new, self.star)
            self.unfinished = UnfinishedPanel(ui)
            self.dataset = DatasetPanel(ui)
            self.basket = BasketPanel(
                ui, self.unfinished.follow, self.export.format_name
            )
        with tabs.add_tab("Road"):
            self.road = RoadPanel(
                ui,
                style,
                AnchorView(ui.client),
                on_ghost=picture.set_original_road_shown,
                on_frame=viewpoint.frame_pose,
            )
        with tabs.add_tab(AGENTS):
            self.agent = AgentPanel(ui, modes.placing, banner, agent_list.toggle)
        with tabs.add_tab("Guide"):
            modes.steering.build_panel(
                regenerate=self._regenerate,
                is_running=lambda: self._is_built and self.generation.is_running,
            )
        with tabs.add_tab("Drive"):
            self.candidates = CandidatesPanel(
                ui,
                picture.candidates,
                partial(modes.steering.mode.put, FollowPath.kind),
            )
            self.generation = GenerationPanel(
                ui,
                generators,
                lambda: picture.look_at_m,
                modes.region,
                picture.samples,
                on_run,
            )
            style.in_sight(self.generation.run_buttons)
        with tabs.add_tab("Study"):
            self.study = StudyPanel(ui, generators.offers)
        with tabs.add_tab("History"):
            self.history = HistoryPanel(ui, style)
        with tabs.add_tab("View"):
            self.view = ViewPanel(
                ui,
                viewpoint,
                on_theme=on_theme,
                on_layer=picture.map.set_layer_visible,
                on_ribbons=picture.ribbons.set_visible,
                on_compare=picture.comparison.keep,
            )
        # A search that finished under an earlier connection gives no new event.
        self.dataset.show()
        self._is_built = True

    def show(self, state: SessionState) -> None:
        """Show a state of the session in all panels."""
        scenario, selection = state.scenario, state.selection
        self.scenario.show(scenario)
        self.export.show(scenario)
        self.road.show(scenario, selection)
        self.agent.show(scenario, selection, self._agent_list.stale_ids())
        self.candidates.show(scenario, selection)
        self.generation.show(scenario)
        self.history.show()

    def after_check(self, state: SessionState) -> None:
        """Show what the problems of the future change: stale trajectories, the preflight."""
        stale = self._agent_list.stale_ids()
        self.agent.show(state.scenario, state.selection, stale)
        self.export.show_preflight(state.scenario)

    def close(self) -> None:
        """End what panels run."""
        self.generation.close()
        self.study.close()

    def star(self) -> None:
        """Put the current state into the basket."""
        self.basket.star()

    def _regenerate(self, agent_ids: tuple[str, ...] | None) -> None:
        self.generation.regenerate_agents(agent_ids)
