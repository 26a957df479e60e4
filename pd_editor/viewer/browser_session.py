"""Session of one browser tab: keeps views, panels and pointer in step with its workspace."""

import threading
import time
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import viser

from pd_editor.analysis.findings.finding import Finding
from pd_editor.base.errors import LargeMapError, LockedAgentError, PdEditorError
from pd_editor.editor.cures import Cure
from pd_editor.editor.session import SessionState
from pd_editor.generation.generators import GeneratorCatalogue
from pd_editor.scene.base_reference import MapWindow
from pd_editor.scene.road_map import Lane
from pd_editor.scene.roles.traffic_choice import steered_agent_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.agents.agent_list import AgentList
from pd_editor.viewer.agents.agent_panel import PLACE, STOP_PLACING
from pd_editor.viewer.agents.pointer import Pointer
from pd_editor.viewer.agents.selecting import Selecting
from pd_editor.viewer.controls.control_panel import ControlPanel
from pd_editor.viewer.controls.hints import Hints
from pd_editor.viewer.controls.hot_keys import add_hot_keys
from pd_editor.viewer.controls.key_sheet import KeySheet
from pd_editor.viewer.controls.modes import Modes
from pd_editor.viewer.controls.picture import Picture
from pd_editor.viewer.controls.picture_menu import PictureMenu
from pd_editor.viewer.controls.press_order import PressOrder
from pd_editor.viewer.controls.side_panel import SidePanel
from pd_editor.viewer.controls.toolbar import Toolbar
from pd_editor.viewer.controls.tools import toolbar_tools
from pd_editor.viewer.files.map_window import MapWindowCard
from pd_editor.viewer.findings.scorecard_drawer import ScorecardActions, ScorecardDrawer
from pd_editor.viewer.findings.status_chip import ChipActions, StatusChip
from pd_editor.viewer.generation.generation_panel import (
    DRAW_REGION,
    STOP_DRAWING,
)
from pd_editor.viewer.overlay.banner import OFFER, Banner
from pd_editor.viewer.overlay.messages import (
    ConnectionState,
    FanState,
    PageState,
    ThemeState,
)
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.context_menu import ContextMenu
from pd_editor.viewer.scene.framing import FreePart
from pd_editor.viewer.scene.hover import Hover
from pd_editor.viewer.scene.picking import point_of
from pd_editor.viewer.scene.timeline import Timeline
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.state.finding_watch import FindingWatch
from pd_editor.viewer.state.inbox import Inbox
from pd_editor.viewer.state.workspace import Workspace
from pd_editor.viewer.tab.ui_context import UiContext

TIMELINE_REFRESH_S: Final = 0.25
SEARCH_PAUSE_S: Final = 0.02
FUTURE_CHECK_DELAY_S: Final = 0.4
"""Pause after an edit before the future is checked for problems."""
SEND_PAUSE_S: Final = 1e-3
BASKET_FOLLOW_S: Final = 1.0
"""Interval at which the basket is compared with what other tabs made of it."""
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

        With ``is_debug`` viser's own settings are offered.
        """
        self._client = client
        self._is_debug = is_debug
        self._workspace = workspace
        self._generators = generators
        self._inbox = Inbox(tick=self._tick, on_error=self._report)
        self._ui = UiContext(client, workspace, self._inbox)
        self.problems = FindingWatch(workspace)
        self._checks_future_at: float | None = None
        self._timeline_shown_at = 0.0
        self._retries_journal_at = 0.0
        self._follows_basket_at = 0.0
        self._is_built = False
        self._built = threading.Event()
        self._is_closed = False
        self._closing = threading.Lock()

    def start(self) -> None:
        """Build the page and start the worker."""
        self._inbox.post(self._build)
        self._inbox.post(self._built.set)
        self._inbox.start()

    def wait_until_built(self, seconds: float) -> None:
        """Wait for the page, at most for some time."""
        self._built.wait(seconds)

    def close(self) -> None:
        """Stop the worker; the workspace remains.

        Safe to call twice, from any thread: the second call waits for the first.
        """
        with self._closing:
            if self._is_closed:
                return
            self._is_closed = True
            self._built.set()
            self._inbox.close()
            if self._is_built:
                self.panels.close()
                self._workspace.session.remove_listener(self._changed)
                self._workspace.session.commit_gesture()
                self._viewpoint.remember()

    def _build(self) -> None:
        client, workspace = self._client, self._workspace
        with client.atomic():
            self._configure_page()
            self.overlay = Overlay(client, self._ui.post)
            self.overlay.on_ready = self._page_ready
            self.overlay.show(ConnectionState(is_new=workspace.is_new))
            self._banner = Banner(self.overlay)
            self.timeline = Timeline(
                self.overlay, self._banner, workspace.playback, self._request_frame
            )
            self._viewpoint = Viewpoint(self._ui, self.overlay, self._view_switched)
            self._ui.on_playhead_moved = self._playhead_moved
            self._side_panel = SidePanel(
                self.overlay, self._ui, is_debug=self._is_debug
            )
            self._build_picture()
        self._send_now()
        with client.atomic():
            self._build_panels()
            self._show_panels(workspace.session.state)
        workspace.session.add_listener(self._changed)
        workspace.tell = self._ui.notify
        self._is_built = True
        self.picture.follow_camera()
        self._request_check()

    def _page_ready(self) -> None:
        """Play once; frames for a page that cannot draw yet would only pile up."""
        if self._workspace.is_new:
            self._workspace.is_new = False
            self._workspace.playback.play()

    def _configure_page(self) -> None:
        client = self._client
        self._send_theme()
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

    def _build_picture(self) -> None:
        ui, overlay = self._ui, self.overlay
        self.pointer = Pointer(
            ui,
            lambda: self.picture.agents,
            self._ground_clicked,
            self._side_panel.agent_clicked,
        )
        self.modes = Modes(
            ui,
            overlay,
            self._banner,
            poses=lambda: self.picture.poses,
            on_change=self._mode_changed,
        )
        self.picture = Picture(
            ui,
            overlay,
            warned_at=self._warned_at,
            on_new_body=self.pointer.attach,
            show_terms=self.modes.steering.show_marks,
            on_compare=self._compared,
            on_fan=self._fan_changed,
            on_preview=self._previewed,
            on_samples=self._viewpoint.uncover,
            star=self._star,
        )
        self._viewpoint.covered_px = self.picture.samples.covered_px
        self._scorecard = ScorecardDrawer(
            ui,
            overlay,
            self.timeline,
            self.problems,
            ScorecardActions(
                go_to=self._show_finding,
                cure=self._cure,
                draw=self.picture.findings.show,
                redraw=self.picture.draw_frame,
                opened=self._scorecard_opened,
            ),
        )
        self._selecting = Selecting(ui, lambda: self.picture.poses)
        Hover(ui, overlay, lambda: self.picture.poses, lambda: self.modes.is_any_active)
        overlay.on("fan", self._fan_pointed)
        overlay.on("theme", self._theme_asked)
        self._hints = Hints(overlay)
        self._map_window = MapWindowCard(overlay)
        self._key_sheet = KeySheet(overlay)
        self.pointer.set_plain_drag_selects(self._viewpoint.is_top)
        self._viewpoint.restore()
        self.picture.size_for_view()
        self.picture.draw()
        self._viewpoint.hold_picture(self.picture.map.road_nodes)

    def _build_panels(self) -> None:
        ui, overlay, generators = self._ui, self.overlay, self._generators
        self.agent_list = AgentList(
            ui,
            overlay,
            problems=self.problems.problem_ids,
            on_pointed=self.picture.point_at,
            on_opened=self._agent_list_opened,
            on_lock=self._toggle_lock,
            picked=self.modes.steering.mode.pick,
        )
        self.panels = ControlPanel(
            ui,
            generators,
            self._banner,
            problems=self.problems,
            picture=self.picture,
            modes=self.modes,
            viewpoint=self._viewpoint,
            agent_list=self.agent_list,
            on_theme=self._theme_chosen,
            on_run=self._run_changed,
        )
        tools = toolbar_tools(
            ui.session,
            panels=self.panels,
            picture=self.picture,
            modes=self.modes,
            viewpoint=self._viewpoint,
            agent_list=self.agent_list,
            scorecard=self._scorecard,
            key_sheet=self._key_sheet,
        )
        self._toolbar = Toolbar(overlay, tools)
        self._build_status_chip()
        self.panels.scenario.on_part = lambda: self._ask_part(
            self._workspace.lanes_of_file(), "The map"
        )
        menu = PictureMenu(
            ui=ui,
            poses=lambda: self.picture.poses,
            selecting=self._selecting,
            modes=self.modes,
            panels=self.panels,
        )
        ContextMenu(overlay, menu.at)
        add_hot_keys(
            ui,
            panels=self.panels,
            picture=self.picture,
            modes=self.modes,
            viewpoint=self._viewpoint,
            agent_list=self.agent_list,
            scorecard=self._scorecard,
            key_sheet=self._key_sheet,
            timeline=self.timeline,
            selecting=self._selecting,
            escape=self.escape,
        )
        self._key_sheet.tell(ui.hotkeys)
        PressOrder(
            overlay,
            keys=[one.key for one in ui.hotkeys if one.arms and one.key],
            labels=(PLACE, STOP_PLACING, DRAW_REGION, STOP_DRAWING),
        )

    def _build_status_chip(self) -> None:
        generation = self.panels.generation
        self.chip = StatusChip(
            self._ui,
            self.overlay,
            self.timeline,
            self.problems,
            lambda: generation.run_state,
            ChipActions(
                cure=self._cure,
                cancel=generation.cancel,
                use_result=generation.use_result,
                run_guidance=lambda: generation.regenerate_agents(
                    steered_agent_ids(self._workspace.session.scenario)
                ),
                download=self.panels.export.download,
                frame=lambda problem, share: self._viewpoint.frame_place(
                    problem.place_m, FreePart.left_of(share)
                ),
                redraw=self._ignored_changed,
            ),
        )
        self.picture.samples.on_compare = self.chip.close_list

    def _ignored_changed(self) -> None:
        self.picture.draw_frame()
        self.picture.samples.show()
        self.panels.after_check(self._workspace.session.state)

    def _run_changed(self) -> None:
        if self._is_built:
            self.chip.show()
            self._toolbar.show()
            self.modes.steering.show()

    def _changed(self, before: SessionState, after: SessionState) -> None:
        """Show a change; an error in drawing is reported, and the change stays."""
        try:
            self._show_change(before, after)
        except Exception as error:  # noqa: BLE001  (the session has changed already)
            self._report(error)

    def _show_change(self, before: SessionState, after: SessionState) -> None:
        playback = self._workspace.playback
        self.picture.samples.stop_preview()
        is_other_scene = before.base is not after.base
        if is_other_scene:
            playback.open(after.scenario.time_axis)
        playback.limit(after.scenario.first_step, after.scenario.last_step)
        with self._client.atomic():
            if is_other_scene:
                self.modes.leave_scene()
                self._viewpoint.hold_picture(self.picture.map.road_nodes)
                self._viewpoint.frame_opened()
            self.picture.draw()
        # The picture is sent before texts, because it determines a slider's latency.
        self._send_now()
        if after.scenario is not before.scenario:
            is_whole = self._scorecard.is_open and not after.is_previewing
            self.problems.check(with_future=is_whole)
        with self._client.atomic():
            self.picture.show_marks()
            self._show_panels(after)
            if is_other_scene:
                self.panels.dataset.follow()
                self._ui.post(self.panels.unfinished.follow)
        # The end of a gesture does not change the scenario of the last preview.
        is_edited = after.scenario is not before.scenario or before.is_previewing
        if is_edited and not after.is_previewing:
            self._request_check()
            if not is_other_scene:
                self._tell_of_focal(before.scenario, after.scenario)

    def _tell_of_focal(self, before: Scenario, after: Scenario) -> None:
        """Notify the user of the new focal agent if the former one is not there."""
        if before.focal_id == after.focal_id or before.focal_id in after.agents.row_of:
            return
        if after.focal_id:
            title = f"Agent {after.focal_id} is the focal agent now"
            former = before.focal_id
            self._ui.notify(title, f"Agent {former} was removed." if former else "")
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

    def _show_page(self) -> None:
        """Set title and theme of the page; a star marks a scenario with edits in force."""
        session = self._workspace.session
        mark = "*" if session.state.position else ""
        title = f"{session.scenario.scenario_id}{mark} - Path Diffuser Editor"
        self.overlay.show(PageState(title=title, is_dark=self._workspace.is_dark))

    def _show_panels(self, state: SessionState) -> None:
        self._show_page()
        self.panels.show(state)
        self.modes.steering.show()
        self.timeline.show()
        self.chip.show()
        self.agent_list.show()
        self._scorecard.show()
        self._toolbar.show()
        self.modes.measure.show()
        self.picture.show_legend()
        self._hints.show(self._workspace.session)

    def _fan_changed(self, is_shown: bool) -> None:
        """Mute other elements while possible trajectories are shown, and explain clicks."""
        self.picture.ribbons.set_muted(is_shown)
        self.overlay.show(FanState(is_shown=is_shown))
        session = self._workspace.session
        if not is_shown or len(session.selection) != 1:
            self._banner.hide("candidates")
            return
        agents, (agent_id,) = session.scenario.agents, session.selection
        kind = agents.kinds[agents.row_of[agent_id]].in_words
        self._banner.show(
            "candidates",
            f"Possible trajectories of {kind} {agent_id}: click one to use it.",
            button="Done (Esc)",
            on_press=self.panels.candidates.hide_candidates,
            priority=OFFER,
        )

    def _fan_pointed(self, event: Mapping[str, Any]) -> None:
        """Highlight the possible trajectory under the pointer."""
        self.panels.candidates.point_at(point_of(event.get("point")))

    def _tick(self) -> float | None:
        if not self._is_built:
            return None
        if self._ui.tick():
            # A refused value is still in its input, because no change updates panels.
            self._show_panels(self._workspace.session.state)
        now = time.monotonic()
        if self._checks_future_at is not None and now >= self._checks_future_at:
            self._checks_future_at = None
            self.problems.check(with_future=True)
            self.agent_list.show()
            self.modes.steering.check()
            with self._client.atomic():
                self.picture.draw_frame()
                self.chip.after_check()
                self.panels.after_check(self._workspace.session.state)
        if now >= self._retries_journal_at:
            self._retries_journal_at = now + JOURNAL_RETRY_S
            self._workspace.retry_journals()
            self.chip.show()
        if now >= self._follows_basket_at:
            self._follows_basket_at = now + BASKET_FOLLOW_S
            self.panels.basket.follow()
            self.panels.unfinished.follow()
        is_searching = self._workspace.search_on()
        if is_searching:
            self.panels.dataset.show()
        playback = self._workspace.playback
        is_due, pause_s = playback.advance()
        if is_due:
            with self._client.atomic():
                self.picture.draw_frame()
            if now - self._timeline_shown_at > TIMELINE_REFRESH_S:
                self._timeline_shown_at = now
                self.timeline.show()
        elif self.picture.is_behind:
            self.picture.draw_frame()
            self.timeline.show()
        return SEARCH_PAUSE_S if is_searching and pause_s is None else pause_s

    def _warned_at(self, step: float) -> frozenset[str]:
        return self.problems.agents_at(step) | self._scorecard.agents_at(step)

    def _previewed(self, is_sample: bool) -> None:
        self._scorecard.set_muted(is_sample)

    def _cure(self, cure: Cure) -> None:
        if cure.command is not None:
            self._ui.apply(cure.command)
        else:
            ids = cure.regenerated_ids
            self.panels.generation.regenerate_agents(ids, is_cure=True)

    def _star(self) -> None:
        self.panels.star()

    def _toggle_lock(self) -> None:
        self.panels.agent.locks.toggle()

    def _request_frame(self) -> None:
        self.picture.request_frame()

    def _playhead_moved(self) -> None:
        self.picture.request_frame()
        self.timeline.show()

    def _request_check(self) -> None:
        self._checks_future_at = time.monotonic() + FUTURE_CHECK_DELAY_S

    def _ask_part(self, lanes: tuple[Lane, ...], about: str) -> None:
        def open_part(window: MapWindow) -> None:
            self._ui.commit_gesture()
            self._workspace.open_window(window)

        title = f"{about} has {len(lanes)} lanes: drag a square, or click its middle."
        self._map_window.ask(lanes, title, open_part)

    def _report(self, error: Exception) -> None:
        if isinstance(error, LargeMapError) and self._is_built:
            self._ask_part(error.scene.lanes, error.scene.name)
        elif isinstance(error, LockedAgentError) and self._is_built:
            self.panels.agent.locks.offer(error)
        else:
            self._ui.report(error)
        if (
            isinstance(error, PdEditorError)
            and self._is_built
            and self._ui.gesture is None
        ):
            self._show_panels(self._workspace.session.state)

    def _ground_clicked(self, point_m: np.ndarray) -> bool:
        if self.modes.placing.is_active:
            self.modes.placing.place(point_m)
            return True
        return (
            self.panels.candidates.shows_candidates
            and self.panels.candidates.adopt_near(point_m)
        )

    def _mode_changed(self) -> None:
        self.pointer.set_takes_ground_first(self.modes.placing.is_active)
        self._toolbar.show()

    def escape(self) -> None:
        """Leave what is innermost: a gesture, a mode, a list; else clear the selection."""
        if self._ui.gesture is not None:
            self._ui.abort_gesture()
        elif self.modes.leave():
            return
        elif self.panels.candidates.shows_candidates:
            self.panels.candidates.hide_candidates()
        elif not (
            self.chip.close_list()
            or self.picture.samples.close()
            or self.panels.agent.locks.withdraw()
            or self.modes.steering.encounters.close()
        ):
            self._workspace.session.select(())

    def _theme_asked(self, event: Mapping[str, Any]) -> None:
        """Take the theme that the page asks for: the browser's, or the one kept there."""
        is_dark = event.get("isDark") is True
        if is_dark != self._workspace.is_dark:
            self.panels.view.show_theme(is_dark)
            self._set_theme(is_dark)

    def _theme_chosen(self, is_dark: bool) -> None:
        self.overlay.show(ThemeState(is_dark=is_dark))
        self._set_theme(is_dark)

    def _send_theme(self) -> None:
        self._client.gui.configure_theme(
            dark_mode=self._workspace.is_dark, show_logo=False, show_share_button=False
        )

    def _set_theme(self, is_dark: bool) -> None:
        self._workspace.is_dark = is_dark
        self._send_theme()
        with self._client.atomic():
            self.picture.follow_theme()
            self._show_panels(self._workspace.session.state)

    def _compared(self) -> None:
        if self._is_built:
            self._toolbar.show()

    def _agent_list_opened(self) -> None:
        if self.agent_list.is_open:
            self._scorecard.set_open(False)
        self._toolbar.show()

    def _scorecard_opened(self) -> None:
        if self._scorecard.is_open and self.agent_list.is_open:
            self.agent_list.toggle()
        self._toolbar.show()
        self.picture.draw_frame()

    def _show_finding(self, finding: Finding, covered_share: float) -> None:
        """Select the agents of a finding, and show it at that time."""
        agents = self._workspace.session.scenario.agents
        self.timeline.seek(float(finding.shown_step))
        self._workspace.session.select(finding.agent_ids)
        rows = agents.rows(finding.agent_ids)
        x, y = agents.position_m[rows, finding.shown_step].mean(axis=0)
        free = FreePart.right_of(covered_share)
        self._viewpoint.frame_place((float(x), float(y)), free)

    def _view_switched(self) -> None:
        self.pointer.set_plain_drag_selects(self._viewpoint.is_top)
        self._toolbar.show()
