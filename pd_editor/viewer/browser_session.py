"""Session of one browser tab: builds its elements, and tells them what has changed."""

import threading
import time
from collections.abc import Callable

import viser

from pd_editor.base.errors import (
    GenerationError,
    LargeMapError,
    LargeSceneError,
    LockedAgentError,
    PdEditorError,
)
from pd_editor.editor.session import SessionState
from pd_editor.generation.generators import GeneratorCatalogue
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.agents.agent_panel import PLACE, STOP_PLACING
from pd_editor.viewer.controls.page_aids import PressOrder
from pd_editor.viewer.controls.picture_menu import PictureMenu
from pd_editor.viewer.controls.tab_elements import TabElements, add_hot_keys
from pd_editor.viewer.controls.toolbar import Toolbar
from pd_editor.viewer.controls.view_panel import configure_page
from pd_editor.viewer.generation.generation_panel import DRAW_REGION, STOP_DRAWING
from pd_editor.viewer.overlay.messages import ConnectionState, PageState
from pd_editor.viewer.scene.picking import ContextMenu
from pd_editor.viewer.state.events import Inbox
from pd_editor.viewer.state.workspace import Workspace
from pd_editor.viewer.tab.ui_context import UiContext


class BrowserSession:
    """State of one connection; a reload makes a new one for the same workspace."""

    ui: UiContext
    elements: TabElements

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
        self.workspace = workspace
        self._generators = generators
        self._inbox = Inbox(tick=self._tick, on_error=self._report)
        self._checks_future_at: float | None = None
        self._timeline_shown_at = 0.0
        self._retries_journal_at = 0.0
        self._follows_library_at = 0.0
        self.is_built = False
        """Whether the page has all its elements."""
        self._built = threading.Event()
        self._is_closed = False
        self._closing = threading.Lock()

    def start(self, then: Callable[[], None] | None = None) -> None:
        """Build the page and start the worker, with something to do ``then``."""
        self._inbox.post(self._build)
        if then is not None:
            self._inbox.post(then)
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
            if self.is_built:
                self.elements.close()
                self.workspace.session.remove_listener(self._changed)
                self.workspace.session.commit_gesture()

    def _build(self) -> None:
        client, workspace = self._client, self.workspace
        with client.atomic():
            configure_page(client, is_dark=workspace.is_dark)
            self.ui = ui = UiContext(client, workspace, self._inbox)
            ui.overlay.on_ready = self._page_ready
            ui.overlay.show(ConnectionState(is_new=workspace.is_new))
            ui.model.shown.subscribe(self._show_page)
            self.elements = tab = TabElements(
                ui, self._generators, is_debug=self._is_debug
            )
            Toolbar(ui, tab).show()
            ContextMenu(ui.overlay, PictureMenu(ui=ui, tab=tab).at)
            add_hot_keys(ui, tab)
            tab.key_sheet.tell(ui.hotkeys)
            PressOrder(
                ui.overlay,
                keys=[one.key for one in ui.hotkeys if one.arms and one.key],
                labels=(PLACE, STOP_PLACING, DRAW_REGION, STOP_DRAWING),
            )
        workspace.session.add_listener(self._changed)
        workspace.tell = ui.notify
        self.is_built = True
        tab.picture.follow_camera()
        self._request_check()

    def _page_ready(self) -> None:
        """Play once; frames for a page that cannot draw yet would only pile up."""
        if self.workspace.is_new:
            self.workspace.is_new = False
            if not self.elements.start.is_open:
                self.workspace.playback.play()

    def _show_page(self) -> None:
        """Set title and theme of the page; a star marks a scenario with edits in force."""
        session = self.workspace.session
        mark = "*" if session.state.position else ""
        title = f"{session.scenario.scenario_id}{mark} - Path Diffuser Editor"
        self.ui.overlay.show(PageState(title=title, is_dark=self.workspace.is_dark))

    def _changed(self, before: SessionState, after: SessionState) -> None:
        """Show a change; an error in drawing is reported, and the change stays."""
        try:
            self._show_change(before, after)
        except Exception as error:  # noqa: BLE001  (the session has changed already)
            self._report(error)

    def _show_change(self, before: SessionState, after: SessionState) -> None:
        model, tab, playback = self.ui.model, self.elements, self.workspace.playback
        model.sample = None
        is_other_scene = before.base is not after.base
        axis = after.scenario.time_axis
        # A roll-out makes the scene longer.
        if is_other_scene or axis != before.scenario.time_axis:
            playback.open(axis)
        playback.limit(after.scenario.first_step, after.scenario.last_step)
        with self._client.atomic():
            if is_other_scene:
                model.scene_left.emit()
                tab.viewpoint.hold_picture(tab.picture.map.road_nodes)
                tab.viewpoint.frame_opened()
            tab.picture.draw()
        # The picture of a drag is sent before texts; all else is one frame of the page.
        if after.is_previewing:
            self.ui.send_now()
        if after.scenario is not before.scenario:
            is_whole = model.drawer == "scorecard" and not after.is_previewing
            model.findings.check(with_future=is_whole)
        with self._client.atomic():
            tab.picture.show_marks()
            model.shown.emit()
            if is_other_scene:
                model.scene_shown.emit()
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
            self.ui.notify(title, f"Agent {former} was removed." if former else "")
        else:
            self.ui.notify(
                "No focal agent",
                "It was removed; the next agent on this road becomes the focal one.",
                "warning",
            )

    def _request_check(self) -> None:
        # Pause after an edit before the future is checked for problems.
        self._checks_future_at = time.monotonic() + 0.4

    def _tick(self) -> float | None:
        if not self.is_built:
            return None
        workspace, model, tab = self.workspace, self.ui.model, self.elements
        if self.ui.tick():
            # A refused value is still in its input, because no change updates panels.
            model.shown.emit()
        now = time.monotonic()
        if self._checks_future_at is not None and now >= self._checks_future_at:
            self._checks_future_at = None
            model.findings.check(with_future=True)
            with self._client.atomic():
                model.checked.emit()
        if now >= self._retries_journal_at:
            # Interval of attempts to write edits that could not be stored on disk.
            self._retries_journal_at = now + 3.0
            workspace.retry_journals()
        if now >= self._follows_library_at:
            # Interval at which the library is compared with what other tabs made of it.
            self._follows_library_at = now + 1.0
            tab.start.follow()
            tab.chip.show()
        is_searching = workspace.search_on()
        if is_searching:
            tab.start.follow_search()
        is_due, pause_s = workspace.playback.advance()
        if is_due:
            with self._client.atomic():
                tab.picture.draw_frame()
            if now - self._timeline_shown_at > 0.25:
                self._timeline_shown_at = now
                tab.timeline.show()
        elif tab.picture.is_behind:
            tab.picture.draw_frame()
            tab.timeline.show()
        return 0.02 if is_searching and pause_s is None else pause_s

    def _report(self, error: Exception) -> None:
        if isinstance(error, LargeMapError) and self.is_built:
            scene = error.scene
            self.elements.scenario.map_window.ask(scene.lanes, scene.name)
        elif isinstance(error, LargeSceneError) and self.is_built:
            self.elements.scenario.moment.ask(error.scene)
        elif isinstance(error, LockedAgentError) and self.is_built:
            self.elements.agent.locks.offer(error)
        else:
            self.ui.report(error)
        if isinstance(error, GenerationError) and self.is_built:
            self.elements.generation.result.refuse(error)
        if (
            isinstance(error, PdEditorError)
            and self.is_built
            and self.ui.gesture is None
        ):
            self.ui.model.shown.emit()
