"""Session of one browser tab: keeps views, panels and pointer in step with its workspace."""

import threading
import time
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import viser

from pd_editor.editor.session import SessionState
from pd_editor.errors import LockedAgentError, PdEditorError
from pd_editor.generators import GeneratorCatalogue
from pd_editor.metrics.findings import Finding
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.guidance.steering import Steering
from pd_editor.viewer.interaction.comparison import Comparison
from pd_editor.viewer.interaction.context_menu import ContextMenu
from pd_editor.viewer.interaction.framing import FreePart
from pd_editor.viewer.interaction.hover import Hover
from pd_editor.viewer.interaction.picking import point_of
from pd_editor.viewer.interaction.placing import PlacingMode
from pd_editor.viewer.interaction.pointer import Pointer
from pd_editor.viewer.interaction.region_drawing import RegionDrawing
from pd_editor.viewer.interaction.selecting import Selecting
from pd_editor.viewer.interaction.viewpoint import Viewpoint
from pd_editor.viewer.meshes.palette import DARK, LIGHT, Palette
from pd_editor.viewer.overlay.agent_list import AgentList
from pd_editor.viewer.overlay.banner import OFFER, Banner
from pd_editor.viewer.overlay.hints import Hints
from pd_editor.viewer.overlay.key_sheet import KeySheet
from pd_editor.viewer.overlay.legend import Legend
from pd_editor.viewer.overlay.measure import Measure
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.overlay.sample_strip import SampleStrip
from pd_editor.viewer.overlay.scorecard_drawer import (
    ScorecardActions,
    ScorecardDrawer,
)
from pd_editor.viewer.overlay.side_panel import SidePanel
from pd_editor.viewer.overlay.status_chip import ChipActions, StatusChip
from pd_editor.viewer.overlay.timeline import Timeline
from pd_editor.viewer.overlay.toolbar import Tool, Toolbar
from pd_editor.viewer.panels.agent_panel import AgentPanel
from pd_editor.viewer.panels.basket_panel import BasketPanel
from pd_editor.viewer.panels.dataset_panel import DatasetPanel
from pd_editor.viewer.panels.export_panel import ExportPanel
from pd_editor.viewer.panels.generation.candidates_panel import CandidatesPanel
from pd_editor.viewer.panels.generation.generation_panel import GenerationPanel
from pd_editor.viewer.panels.history_panel import HistoryPanel
from pd_editor.viewer.panels.panel_style import PanelStyle
from pd_editor.viewer.panels.road_panel import RoadPanel
from pd_editor.viewer.panels.scenario_panel import ScenarioPanel
from pd_editor.viewer.panels.study_panel import StudyPanel
from pd_editor.viewer.panels.unfinished_panel import UnfinishedPanel
from pd_editor.viewer.panels.view_panel import ViewPanel
from pd_editor.viewer.picture_menu import PictureMenu
from pd_editor.viewer.state.inbox import Inbox
from pd_editor.viewer.state.problem_watch import ProblemWatch
from pd_editor.viewer.state.ui_context import UiContext
from pd_editor.viewer.state.workspace import Workspace
from pd_editor.viewer.views.agents_view import AgentsView
from pd_editor.viewer.views.anchor_view import AnchorView
from pd_editor.viewer.views.candidates_view import CandidatesView
from pd_editor.viewer.views.findings_view import FindingsView
from pd_editor.viewer.views.labels_view import LabelsView
from pd_editor.viewer.views.locks_view import LocksView
from pd_editor.viewer.views.map_view import MapView
from pd_editor.viewer.views.marks_view import MarksView
from pd_editor.viewer.views.ribbons_view import RibbonsView
from pd_editor.viewer.views.view_scale import ViewScale

TIMELINE_REFRESH_S: Final = 0.25
SEARCH_PAUSE_S: Final = 0.02
FUTURE_CHECK_DELAY_S: Final = 0.4
"""Pause after an edit before the future is checked for problems."""
SEND_PAUSE_S: Final = 1e-3
JOURNAL_RETRY_S: Final = 3.0
"""Interval of attempts to write edits that could not be stored on disk."""


class BrowserSession:
    """State of one connection; a reload makes a new one for the same workspace."""

    def __init__(
        self,
        client: viser.ClientHandle,
        workspace: Workspace,
        generators: GeneratorCatalogue,
        *,
        is_debug: bool = False,
    ) -> None:
        """Prepare the session; ``start`` builds the page on the session's own thread.

        Args:
            client: the connection.
            workspace: what it works on.
            generators: what generates traffic.
            is_debug: whether viser's own settings are offered.
        """
        self._client = client
        self._is_debug = is_debug
        self._workspace = workspace
        self._generators = generators
        self._inbox = Inbox(tick=self._tick, on_error=self._report)
        self._ui = UiContext(client, workspace, self._inbox)
        self._problems = ProblemWatch(workspace)
        self._checks_future_at: float | None = None
        self._timeline_shown_at = 0.0
        self._retries_journal_at = 0.0
        self._drawn_step = -1.0
        self._is_built = False
        self._pointed_id: str | None = None
        self._is_closed = False
        self._closing = threading.Lock()

    def start(self) -> None:
        """Build the page and start the worker."""
        self._inbox.post(self._build)
        self._inbox.start()

    def close(self) -> None:
        """Stop the worker; the workspace remains.

        Safe to call twice, from any thread: the second call waits for the first.
        """
        with self._closing:
            if self._is_closed:
                return
            self._is_closed = True
            self._inbox.close()
            if self._is_built:
                self._generation_panel.close()
                self._study_panel.close()
                self._workspace.session.remove_listener(self._changed)
                self._workspace.session.commit_gesture()
                self._viewpoint.remember()

    def _build(self) -> None:
        client, workspace = self._client, self._workspace
        palette = DARK if workspace.is_dark else LIGHT
        with client.atomic():
            self._configure_page()
            self._overlay = Overlay(self._ui)
            self._banner = Banner(self._overlay)
            self._timeline = Timeline(
                self._overlay, self._banner, workspace.playback, self._request_frame
            )
            self._viewpoint = Viewpoint(self._ui, self._overlay)
            self._ui.on_playhead_moved = self._playhead_moved
            SidePanel(self._overlay, self._ui, is_debug=self._is_debug)
            self._measure = Measure(
                self._overlay,
                self._banner,
                workspace.session,
                self._measuring_changed,
            )
            self._map = MapView(client, palette)
            self._pointer = Pointer(
                self._ui, lambda: self._agents, self._ground_clicked
            )
            self._placing = PlacingMode(self._ui, self._overlay, self._banner)
            self._placing.on_change(self._placing_changed)
            self._region = RegionDrawing(self._ui, self._overlay, self._banner)
            self._region.on_change(self._region_changed)
            self._steering = Steering(
                self._ui, self._overlay, self._banner, lambda: self._agents.poses
            )
            self._steering.mode.on_change(self._guiding_changed)
            self._agents = AgentsView(client, palette, self._pointer.attach)
            self._selecting = Selecting(self._ui, lambda: self._agents.poses)
            Hover(
                self._ui,
                self._overlay,
                lambda: self._agents.poses,
                lambda: (
                    self._placing.is_active
                    or self._measure.is_active
                    or self._region.is_active
                    or self._steering.mode.is_active
                ),
            )
            self._overlay.on("fan", self._fan_pointed)
            self._ribbons = RibbonsView(client, palette)
            self._marks = MarksView(client, palette)
            self._labels = LabelsView(self._overlay)
            self._locks = LocksView(self._overlay)
            self._legend, self._hints = Legend(self._overlay), Hints(self._overlay)
            self._key_sheet = KeySheet(self._overlay)
            self._comparison = Comparison(
                self._ui, self._overlay, palette, self._comparison_changed
            )
            self._samples = SampleStrip(
                self._ui,
                self._overlay,
                on_preview=self._sample_pointed,
                star=self._star,
            )
            self._findings = FindingsView(client, palette)
            self._scorecard = ScorecardDrawer(
                self._ui,
                self._overlay,
                self._timeline,
                self._problems,
                ScorecardActions(
                    go_to=self._show_finding,
                    apply=self._ui.apply,
                    regenerate=self._regenerate_agents,
                    draw=self._findings.show,
                    redraw=self._draw_frame,
                    opened=self._scorecard_opened,
                ),
            )
            self._candidates = CandidatesView(client, palette, self._fan_changed)
            self._pointer.set_plain_drag_selects(self._viewpoint.is_top)
            self._viewpoint.restore()
            self._size_for_view()
            self._draw()
        self._send_now()
        with client.atomic():
            self._build_panels()
            self._build_toolbar()
            self._build_status_chip()
            self._build_menu()
            self._add_hotkeys()
            self._key_sheet.tell(self._ui.hotkeys)
            self._show_panels(workspace.session.state)
        workspace.session.add_listener(self._changed)
        workspace.tell = self._ui.notify
        self._is_built = True
        self._follow_camera()
        self._request_check()
        if workspace.starts_playing:
            workspace.starts_playing = False
            workspace.playback.play()

    def _configure_page(self) -> None:
        client = self._client
        client.gui.configure_theme(
            dark_mode=self._workspace.is_dark, show_logo=False, show_share_button=False
        )
        client.gui.set_panel_label("Path Diffuser Editor")
        client.gui.main_panel.dock_right()
        client.gui.main_panel.set_width(372)
        # No environment map: without a fast GPU the page would prepare it for seconds,
        # with an almost transparent picture meanwhile. Sky and ground replace it.
        client.scene.configure_environment_map(None)
        client.scene.configure_default_lights(enabled=True, cast_shadow=False)
        client.scene.add_light_hemisphere(
            "/sky",
            sky_color=(255, 255, 255),
            ground_color=(150, 150, 150),
            intensity=2.2,
            wxyz=(np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0),
        )

    def _build_panels(self) -> None:
        gui, ui, workspace = self._client.gui, self._ui, self._workspace
        style = PanelStyle(gui)
        self._agent_list = AgentList(
            ui,
            self._overlay,
            problems=self._problems.problem_ids,
            on_pointed=self._agent_pointed,
            on_opened=self._agent_list_opened,
            on_lock=self._toggle_lock,
        )
        tabs = gui.add_tab_group()
        with tabs.add_tab("Scene"):
            self._scenario_panel = ScenarioPanel(ui)
            self._export_panel = ExportPanel(
                ui,
                lambda: len(self._problems.new),
                self._star,
            )
            self._unfinished_panel = UnfinishedPanel(ui)
            self._dataset_panel = DatasetPanel(ui)
            self._basket_panel = BasketPanel(ui, self._unfinished_panel.refresh)
        with tabs.add_tab("Road"):
            self._road_panel = RoadPanel(
                ui,
                style,
                AnchorView(self._client),
                on_ghost=self._map.set_ghost_wanted,
                on_frame=self._viewpoint.frame_pose,
            )
        with tabs.add_tab("Agents"):
            self._agent_panel = AgentPanel(
                ui, self._placing, self._banner, self._agent_list.toggle
            )
        with tabs.add_tab("Guide"):
            self._steering.build_panel(
                regenerate=self._regenerate,
                is_running=lambda: self._is_built and self._generation_panel.is_running,
            )
        with tabs.add_tab("Drive"):
            self._candidates_panel = CandidatesPanel(
                ui, self._candidates, self._steering.mode.follow_path
            )
            self._generation_panel = GenerationPanel(
                ui,
                self._generators,
                lambda: np.asarray(self._client.camera.look_at)[:2],
                self._region,
                self._samples,
                self._run_changed,
            )
        with tabs.add_tab("Study"):
            self._study_panel = StudyPanel(ui, self._generators.offers)
        with tabs.add_tab("History"):
            self._history_panel = HistoryPanel(ui, style)
        with tabs.add_tab("View"):
            ViewPanel(
                ui,
                is_dark=workspace.is_dark,
                on_camera=self._camera_chosen,
                on_theme=self._theme_chosen,
                on_layer=self._map.set_layer_visible,
                on_ribbons=self._ribbons.set_visible,
                on_compare=self._comparison.keep,
            )
        # A search that finished under an earlier connection gives no new event.
        self._dataset_panel.show()

    def _build_menu(self) -> None:
        self._menu = ContextMenu(
            self._overlay,
            PictureMenu(
                ui=self._ui,
                poses=lambda: self._agents.poses,
                placing=self._placing,
                selecting=self._selecting,
                agent_panel=self._agent_panel,
                candidates_panel=self._candidates_panel,
                generation_panel=self._generation_panel,
                road_panel=self._road_panel,
                measure=self._measure,
                steering=self._steering,
            ).at,
        )

    def _build_toolbar(self) -> None:
        session, view = self._workspace.session, self._viewpoint
        history, agent_list = self._history_panel, self._agent_list
        live = self._generation_panel.live_switch

        def named(action: str, index: int, key: str) -> str:
            entries = session.entries
            what = f": {entries[index].label}" if 0 <= index < len(entries) else ""
            return f"{action}{what} ({key})"

        def undo_hint() -> str:
            return named("Undo", session.state.position - 1, "Ctrl+Z")

        def redo_hint() -> str:
            return named("Redo", session.state.position, "Ctrl+Shift+Z")

        self._toolbar = Toolbar(
            self._overlay,
            (
                Tool(
                    icon="undo",
                    press=history.undo,
                    hint=undo_hint,
                    is_enabled=lambda: session.can_undo,
                ),
                Tool(
                    icon="redo",
                    press=history.redo,
                    hint=redo_hint,
                    is_enabled=lambda: session.can_redo,
                ),
                Tool(
                    icon="3d",
                    press=self._show_3d,
                    hint=lambda: "3-D view (V switches)",
                    is_active=lambda: not view.is_top,
                    starts_group=True,
                ),
                Tool(
                    icon="top",
                    press=self._show_top,
                    hint=lambda: "Top view (V switches)",
                    is_active=lambda: view.is_top,
                ),
                Tool(
                    icon="fit",
                    press=view.frame_map,
                    hint=lambda: "Show the whole map (Home)",
                    starts_group=True,
                ),
                Tool(
                    icon="frame",
                    press=view.frame_selection,
                    hint=lambda: "Frame the selection, or the focal agent (F)",
                ),
                Tool(
                    icon="measure",
                    press=self._measure.toggle,
                    hint=lambda: "Measure distances (M)",
                    is_active=lambda: self._measure.is_active,
                    starts_group=True,
                ),
                Tool(
                    icon="place",
                    press=self._placing.toggle,
                    hint=lambda: "Place agents (P)",
                    is_active=lambda: self._placing.is_active,
                ),
                Tool(
                    icon="agents",
                    press=agent_list.toggle,
                    hint=lambda: "Agent list (Ctrl+F)",
                    is_active=lambda: agent_list.is_open,
                ),
                Tool(
                    icon="scorecard",
                    press=self._scorecard.toggle,
                    hint=lambda: "Scorecard: metrics beside recordings (I)",
                    is_active=lambda: self._scorecard.is_open,
                ),
                Tool(
                    icon="compare",
                    press=self._comparison.hold,
                    release=self._comparison.release,
                    hint=lambda: "Compare with the original (hold O)",
                    is_active=lambda: self._comparison.is_on,
                ),
                Tool(
                    icon="live",
                    press=live.toggle,
                    hint=lambda: "Live: traffic reacts while you edit (Shift+R)",
                    is_active=lambda: live.is_on,
                ),
                Tool(
                    icon="help",
                    press=self._key_sheet.open,
                    hint=lambda: "Keys and mouse (?)",
                    starts_group=True,
                ),
            ),
        )

    def _build_status_chip(self) -> None:
        generation = self._generation_panel
        self._chip = StatusChip(
            self._ui,
            self._overlay,
            self._timeline,
            self._problems,
            lambda: generation.run_state,
            ChipActions(
                apply=self._ui.apply,
                regenerate=generation.regenerate_agents,
                cancel=generation.cancel,
                use_result=generation.use_result,
                download=self._export_panel.download,
                frame=lambda problem, share: self._viewpoint.frame_place(
                    problem.place_m, FreePart.left_of(share)
                ),
                redraw=self._draw_frame,
            ),
        )

    def _run_changed(self) -> None:
        if self._is_built:
            self._chip.show()
            self._toolbar.show()
            self._steering.show()

    def _add_hotkeys(self) -> None:
        key = self._ui.hotkey
        key("Play or pause", self._timeline.toggle_play, "space")
        key("Go to t = 0", self._timeline.go_to_current)
        key("Next frame (right arrow)", lambda: self._timeline.step_by(1))
        key("Previous frame (left arrow)", lambda: self._timeline.step_by(-1))
        key("Undo", self._history_panel.undo, "Z", "cmd/ctrl")
        key("Redo", self._history_panel.redo, "Z", "cmd/ctrl+shift")
        key("Redo (Ctrl+Y)", self._history_panel.redo, "Y", "cmd/ctrl")
        key(
            "Delete selection",
            self._agent_panel.delete,
            "delete",
            failure="Not deleted",
        )
        key(
            "Delete selection (Backspace)",
            self._agent_panel.delete,
            "backspace",
            failure="Not deleted",
        )
        key(
            "Duplicate selection",
            self._agent_panel.duplicate,
            "D",
            "cmd/ctrl",
            failure="Not duplicated",
        )
        key(
            "Snap to lane",
            self._agent_panel.snap,
            "L",
            failure="Not snapped to a lane",
        )
        key(
            "Lock or unlock the selection",
            self._toggle_lock,
            "K",
            failure="Lock not changed",
        )
        key("Select all agents", self._selecting.select_all, "A", "cmd/ctrl")
        key("Invert the selection", self._selecting.invert, "I", "cmd/ctrl")
        key("Select all of the same kind", self._selecting.same_kind)
        key("Agent list", self._agent_list.toggle, "F", "cmd/ctrl")
        key("Scorecard", self._scorecard.toggle, "I")
        key("Place an agent", self._placing.toggle, "P")
        self._steering.add_hotkeys()
        key("Show possible trajectories", self._candidates_panel.toggle_candidates, "G")
        key("Regenerate trajectories", self._generation_panel.regenerate, "R")
        key(
            "Live regeneration on or off",
            self._generation_panel.live_switch.toggle,
            "R",
            "shift",
        )
        key("Choose among the samples of the last run", self._samples.focus, "J")
        key("Cancel the generation", self._generation_panel.cancel)
        key("Reset road", self._road_panel.reset)
        key("Switch 3-D and top view", self._switch_view, "V")
        key("Frame selection", self._viewpoint.frame_selection, "F")
        key("Show the whole map", self._viewpoint.frame_map, "home")
        key("Measure distances", self._measure.toggle, "M")
        key("Turn the view north, or to the heading", self._viewpoint.turn)
        key("Keys and mouse", self._key_sheet.open)
        key("Clear selection", self._escape, "escape")
        key("Star: into the basket", self._basket_panel.star, "S")
        key("Next scenario", lambda: self._dataset_panel.go(+1), "pagedown")
        key("Previous scenario", lambda: self._dataset_panel.go(-1), "pageup")

    def _changed(self, before: SessionState, after: SessionState) -> None:
        """Show a change; an error in drawing is reported, and the change stays."""
        try:
            self._show_change(before, after)
        except Exception as error:  # noqa: BLE001  (the session has changed already)
            self._report(error)

    def _show_change(self, before: SessionState, after: SessionState) -> None:
        playback = self._workspace.playback
        self._samples.stop_preview()
        is_other_scene = before.base is not after.base
        if is_other_scene:
            playback.open(after.scenario.time_axis)
        playback.last_step = after.scenario.last_step
        with self._client.atomic():
            if is_other_scene:
                self._measure.stop()
                self._region.clear()
                self._steering.mode.stop()
                self._viewpoint.hold_picture(self._map.road_nodes)
                self._viewpoint.frame_opened()
            self._draw()
        # The picture is sent before texts, because it determines a slider's latency.
        self._send_now()
        if after.scenario is not before.scenario:
            self._problems.check(with_future=False)
        with self._client.atomic():
            self._show_marks()
            self._show_panels(after)
            if is_other_scene:
                self._dataset_panel.follow(after.scenario.scenario_id)
                self._ui.post(self._unfinished_panel.refresh)
        # The end of a gesture does not change the scenario of the last preview.
        is_edited = after.scenario is not before.scenario or before.is_previewing
        if is_edited and not after.is_previewing:
            self._request_check()
            if not is_other_scene:
                self._tell_of_focal(before.scenario, after.scenario)

    def _regenerate(self) -> None:
        self._generation_panel.regenerate()

    def _regenerate_agents(self, agent_ids: tuple[str, ...]) -> None:
        self._generation_panel.regenerate_agents(agent_ids)

    def _star(self) -> None:
        self._basket_panel.star()

    def _tell_of_focal(self, before: Scenario, after: Scenario) -> None:
        """Notify the user of the new focal agent if the former one was removed."""
        if before.focal_id == after.focal_id or before.focal_id in after.agents.row_of:
            return
        if after.focal_id:
            title = f"Agent {after.focal_id} is the focal agent now"
            self._ui.notify(title, f"Agent {before.focal_id or '-'} was removed.")
        else:
            self._ui.notify(
                "No focal agent",
                "It was removed; the next agent on this road becomes the focal one.",
                "warning",
            )

    def _send_now(self) -> None:
        """Let viser's thread send queued messages; it needs the interpreter lock."""
        self._client.flush()
        time.sleep(SEND_PAUSE_S)

    @property
    def _drawn_scenario(self) -> Scenario:
        """The session's scenario, or the sample that is pointed at."""
        return self._samples.previewed or self._workspace.session.scenario

    def _sample_pointed(self) -> None:
        with self._client.atomic():
            self._draw()

    def _draw(self) -> None:
        """Draw the scenario at the playhead."""
        scenario = self._drawn_scenario
        self._map.show(scenario)
        self._ribbons.show(scenario)
        self._scorecard.set_muted(scenario is not self._workspace.session.scenario)
        self._draw_frame()

    def _draw_frame(self) -> None:
        self._agents.show(self._drawn_scenario, self._workspace.playback.step)
        self._show_marks()

    def _show_marks(self) -> None:
        session, step = self._workspace.session, self._workspace.playback.step
        poses = self._agents.poses
        assert poses is not None
        scenario, selection = self._drawn_scenario, session.selection
        if scenario is not session.scenario:
            there = scenario.agents.row_of
            selection = tuple(name for name in selection if name in there)
            self._marks.show(scenario, poses, selection, (), None)
            self._labels.show(scenario, poses, step, selection, {})
            self._locks.show(scenario, poses)
            return
        warned = self._problems.agents_at(step) | self._scorecard.agents_at(step)
        self._marks.show(scenario, poses, selection, warned, self._pointed_id)
        self._steering.show_marks(poses)
        self._comparison.show()
        notes = self._comparison.notes()
        self._labels.show(scenario, poses, step, selection, notes)
        self._locks.show(scenario, poses)

    def _comparison_changed(self) -> None:
        with self._client.atomic():
            self._map.set_compared(self._comparison.is_on)
            self._show_marks()
            self._show_legend()
        if self._is_built:
            self._toolbar.show()

    def _show_legend(self) -> None:
        scenario = self._workspace.session.scenario
        has_original = scenario.applied_warp is not None or self._comparison.is_on
        palette = DARK if self._workspace.is_dark else LIGHT
        self._legend.show(scenario, palette, has_original=has_original)

    def _follow_camera(self) -> None:
        """Keep elements with a least size on the screen at that size."""

        @self._client.camera.on_update
        async def _(_camera: viser.CameraHandle) -> None:
            self._inbox.post(self._camera_moved, merge_key="camera")

    def _camera_moved(self) -> None:
        if ViewScale.of(self._client.camera).differs_from(self._view):
            with self._client.atomic():
                self._size_for_view()
                self._draw_frame()

    def _size_for_view(self) -> None:
        self._view = ViewScale.of(self._client.camera)
        for view in (self._agents, self._marks, self._labels, self._locks):
            view.set_view(self._view)

    def _show_page(self) -> None:
        """Set title and theme of the page; a star marks a scenario with edits in force."""
        session = self._workspace.session
        mark = "*" if session.state.position else ""
        self._overlay.show(
            "page",
            {
                "title": f"{session.scenario.scenario_id}{mark} - Path Diffuser Editor",
                "isDark": self._workspace.is_dark,
            },
        )

    def _show_panels(self, state: SessionState) -> None:
        scenario, selection = state.scenario, state.selection
        self._show_page()
        self._scenario_panel.show(scenario)
        self._export_panel.show(scenario)
        self._road_panel.show(scenario, selection)
        self._agent_panel.show(scenario, selection, self._agent_list.stale_ids())
        self._candidates_panel.show(scenario, selection)
        self._generation_panel.show(scenario)
        self._steering.show()
        self._history_panel.show()
        self._timeline.show()
        self._chip.show()
        self._agent_list.show()
        self._scorecard.show()
        self._toolbar.show()
        self._measure.show()
        self._show_legend()
        self._hints.show(self._workspace.session)

    def _fan_changed(self, is_shown: bool) -> None:
        """Mute other elements while possible trajectories are shown, and explain clicks."""
        self._ribbons.set_muted(is_shown)
        self._overlay.show("fan", {"isShown": is_shown})
        session = self._workspace.session
        if not is_shown or len(session.selection) != 1:
            self._banner.hide("candidates")
            return
        agents, (agent_id,) = session.scenario.agents, session.selection
        kind = str(agents.kinds[agents.row_of[agent_id]]).replace("_", " ")
        self._banner.show(
            "candidates",
            f"Possible trajectories of {kind} {agent_id}: click one to use it.",
            button="Done (Esc)",
            on_press=self._candidates_panel.hide_candidates,
            priority=OFFER,
        )

    def _fan_pointed(self, event: Mapping[str, Any]) -> None:
        """Highlight the possible trajectory under the pointer."""
        self._candidates_panel.point_at(point_of(event.get("point")))

    def _tick(self) -> float | None:
        if not self._is_built:
            return None
        if self._ui.tick():
            # A refused value is still in its input, because no change updates panels.
            self._show_panels(self._workspace.session.state)
        now = time.monotonic()
        if self._checks_future_at is not None and now >= self._checks_future_at:
            self._checks_future_at = None
            self._problems.check(with_future=True)
            self._agent_list.show()
            self._steering.check()
            with self._client.atomic():
                self._draw_frame()
                self._chip.after_check()
                self._export_panel.show_preflight(self._workspace.session.scenario)
        if now >= self._retries_journal_at:
            self._retries_journal_at = now + JOURNAL_RETRY_S
            self._workspace.retry_journals()
            self._chip.show()
        is_searching = self._workspace.search_on()
        if is_searching:
            self._dataset_panel.show()
        playback = self._workspace.playback
        is_due, pause_s = playback.advance()
        if is_due:
            with self._client.atomic():
                self._draw_frame()
            if now - self._timeline_shown_at > TIMELINE_REFRESH_S:
                self._timeline_shown_at = now
                self._timeline.show()
        elif self._drawn_step != playback.step:
            self._draw_frame()
            self._timeline.show()
        self._drawn_step = playback.step
        return SEARCH_PAUSE_S if is_searching and pause_s is None else pause_s

    def _request_frame(self) -> None:
        """Draw the playhead's time soon; once for several requests in a row."""
        self._ui.post(self._draw_moved_frame, "frame")

    def _playhead_moved(self) -> None:
        self._request_frame()
        self._timeline.show()

    def _draw_moved_frame(self) -> None:
        if self._drawn_step != self._workspace.playback.step:
            with self._client.atomic():
                self._draw_frame()
            self._drawn_step = self._workspace.playback.step

    def _request_check(self) -> None:
        self._checks_future_at = time.monotonic() + FUTURE_CHECK_DELAY_S

    def _report(self, error: Exception) -> None:
        if isinstance(error, LockedAgentError) and self._is_built:
            self._agent_panel.locks.offer(error)
        else:
            self._ui.report(error)
        if (
            isinstance(error, PdEditorError)
            and self._is_built
            and self._ui.gesture is None
        ):
            self._show_panels(self._workspace.session.state)

    def _ground_clicked(self, point_m: np.ndarray) -> bool:
        if self._placing.is_active:
            self._placing.place(point_m)
            return True
        return (
            self._candidates_panel.shows_candidates
            and self._candidates_panel.adopt_near(point_m)
        )

    def _placing_changed(self) -> None:
        self._pointer.set_takes_ground_first(self._placing.is_active)
        if self._placing.is_active:
            self._end_modes("placing")
        self._toolbar.show()

    def _region_changed(self) -> None:
        if self._region.is_active:
            self._end_modes("region")

    def _guiding_changed(self) -> None:
        if self._steering.mode.is_active:
            self._end_modes("guiding")

    def _measuring_changed(self, is_measuring: bool) -> None:
        if is_measuring:
            self._end_modes("measuring")
        self._toolbar.show()

    def _end_modes(self, kept: str) -> None:
        """End all modes that take clicks on the picture, except one."""
        if kept != "measuring":
            self._measure.stop()
        if kept != "region":
            self._region.stop()
        if kept != "guiding":
            self._steering.mode.stop()
        if kept != "placing" and self._placing.is_active:
            self._placing.toggle()

    def _escape(self) -> None:
        """Leave the active mode or gesture; without one, clear the selection."""
        if self._ui.gesture is not None:
            self._ui.abort_gesture()
        elif self._measure.is_active:
            self._measure.stop()
        elif self._region.is_active:
            self._region.stop()
        elif self._steering.mode.is_active:
            self._steering.mode.stop()
        elif self._placing.is_active:
            self._placing.toggle()
        elif self._candidates_panel.shows_candidates:
            self._candidates_panel.hide_candidates()
        elif not (self._samples.close() or self._agent_panel.locks.withdraw()):
            self._workspace.session.select(())

    def _theme_chosen(self, is_dark: bool) -> None:
        self._workspace.is_dark = is_dark
        self._show_page()
        palette: Palette = DARK if is_dark else LIGHT
        self._client.gui.configure_theme(
            dark_mode=is_dark, show_logo=False, show_share_button=False
        )
        with self._client.atomic():
            self._map.set_palette(palette)
            self._agents.set_palette(palette)
            self._ribbons.set_palette(palette)
            self._marks.set_palette(palette)
            self._comparison.set_palette(palette)
            self._candidates.set_palette(palette)
            self._findings.set_palette(palette)
            self._show_marks()
            self._show_legend()
            self._show_panels(self._workspace.session.state)

    def _toggle_lock(self) -> None:
        self._agent_panel.locks.toggle()

    def _agent_list_opened(self) -> None:
        if self._agent_list.is_open:
            self._scorecard.set_open(False)
        self._toolbar.show()

    def _scorecard_opened(self) -> None:
        if self._scorecard.is_open and self._agent_list.is_open:
            self._agent_list.toggle()
        self._toolbar.show()
        self._draw_frame()

    def _show_finding(self, finding: Finding, covered_share: float) -> None:
        """Select the agent of a finding, and show it at that time."""
        agents = self._workspace.session.scenario.agents
        self._timeline.seek(float(finding.worst_step))
        self._workspace.session.select((finding.agent_id,))
        x, y = agents.position_m[agents.row_of[finding.agent_id], finding.worst_step]
        free = FreePart.right_of(covered_share)
        self._viewpoint.frame_place((float(x), float(y)), free)

    def _agent_pointed(self, agent_id: str | None) -> None:
        self._pointed_id = agent_id
        with self._client.atomic():
            self._show_marks()

    def _camera_chosen(self, name: str) -> None:
        if name == "3-D view":
            self._show_3d()
        elif name == "Top view":
            self._show_top()
        else:
            self._viewpoint.frame_selection()

    def _show_3d(self) -> None:
        self._viewpoint.show_3d()
        self._view_changed()

    def _show_top(self) -> None:
        self._viewpoint.show_top()
        self._view_changed()

    def _switch_view(self) -> None:
        self._viewpoint.switch()
        self._view_changed()

    def _view_changed(self) -> None:
        self._pointer.set_plain_drag_selects(self._viewpoint.is_top)
        self._toolbar.show()
