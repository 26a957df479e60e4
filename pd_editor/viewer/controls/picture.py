"""The picture of a tab: road, agents, trajectories and marks at the playhead."""

from collections.abc import Callable

import numpy as np
import viser

from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.findings.findings_view import FindingsView
from pd_editor.viewer.generation.candidates_view import CandidatesView
from pd_editor.viewer.generation.sample_strip import SampleStrip
from pd_editor.viewer.meshes.agent_poses import AgentPoses
from pd_editor.viewer.meshes.palette import DARK, LIGHT, Palette
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.agents_view import AgentsView, OnNewBody
from pd_editor.viewer.scene.comparison import Comparison
from pd_editor.viewer.scene.labels_view import LabelsView
from pd_editor.viewer.scene.legend import Legend
from pd_editor.viewer.scene.locks_view import LocksView
from pd_editor.viewer.scene.map_view import MapView
from pd_editor.viewer.scene.marks_view import MarksView
from pd_editor.viewer.scene.ribbons_view import RibbonsView
from pd_editor.viewer.scene.signals_view import SignalsView
from pd_editor.viewer.scene.view_scale import ViewScale
from pd_editor.viewer.tab.ui_context import UiContext


class Picture:
    """All views of one tab, drawn from the scenario or from a sample pointed at."""

    def __init__(
        self,
        ui: UiContext,
        overlay: Overlay,
        *,
        warned_at: Callable[[float], frozenset[str]],
        on_new_body: OnNewBody,
        show_terms: Callable[[AgentPoses], None],
        on_compare: Callable[[], None],
        on_fan: Callable[[bool], None],
        on_preview: Callable[[bool], None],
        on_samples: Callable[[], None],
        star: Callable[[], None],
    ) -> None:
        """Make the views, without a scenario.

        ``warned_at`` are agents with a problem at a step; ``on_new_body`` is called
        with every new node of agents, to make it clickable; ``on_preview`` with whether
        a sample is drawn instead of the scenario; ``star`` puts the scenario into the
        basket.
        """
        self._ui = ui
        self._warned_at = warned_at
        self._on_preview = on_preview
        self._show_terms = show_terms
        self._on_compare = on_compare
        self._drawn_step = -1.0
        self._pointed_id: str | None = None
        client, palette = ui.client, self._palette
        self.map = MapView(client, palette)
        self._signals = SignalsView(client, palette)
        self.agents = AgentsView(client, palette, on_new_body)
        self.ribbons = RibbonsView(client, palette)
        self._marks = MarksView(client, palette)
        self._labels = LabelsView(overlay)
        self._locks = LocksView(overlay)
        self._legend = Legend(overlay)
        self.comparison = Comparison(ui, overlay, palette, self._compared)
        self.samples = SampleStrip(
            ui,
            overlay,
            on_preview=self._sample_pointed,
            on_opened=on_samples,
            star=star,
        )
        self.findings = FindingsView(client, palette)
        self.candidates = CandidatesView(client, palette, on_fan)
        self._themed = (
            self.map,
            self._signals,
            self.agents,
            self.ribbons,
            self._marks,
            self.comparison,
            self.candidates,
            self.findings,
        )

    @property
    def poses(self) -> AgentPoses | None:
        """Agents as drawn now."""
        return self.agents.poses

    @property
    def is_behind(self) -> bool:
        """Whether the playhead has moved since agents were drawn."""
        return self._drawn_step != self._ui.workspace.playback.step

    def draw(self) -> None:
        """Draw the scenario at the playhead."""
        scenario = self._scenario
        self.map.show(scenario)
        self.ribbons.show(scenario)
        self._on_preview(scenario is not self._ui.session.scenario)
        self.draw_frame()

    def draw_frame(self) -> None:
        """Draw agents and marks at the playhead."""
        self._drawn_step = self._ui.workspace.playback.step
        self._signals.show(self._scenario, self._drawn_step)
        self.agents.show(self._scenario, self._drawn_step)
        self.show_marks()

    def request_frame(self) -> None:
        """Draw the playhead's time soon; once for several requests in a row."""
        self._ui.post(self._draw_moved_frame, "frame")

    def show_marks(self) -> None:
        """Draw what marks agents: selection, problems, names, locks, terms."""
        session, step = self._ui.session, self._ui.workspace.playback.step
        poses = self.poses
        assert poses is not None
        scenario, selection = self._scenario, session.selection
        if scenario is not session.scenario:
            there = scenario.agents.row_of
            selection = tuple(name for name in selection if name in there)
            self._marks.show(scenario, poses, selection, (), None)
            self._labels.show(scenario, poses, step, selection, {})
            self._locks.show(scenario, poses)
            return
        warned = self._warned_at(step)
        self._marks.show(scenario, poses, selection, warned, self._pointed_id)
        self._show_terms(poses)
        self.comparison.show()
        notes = self.comparison.notes()
        self._labels.show(scenario, poses, step, selection, notes)
        self._locks.show(scenario, poses)

    def show_legend(self) -> None:
        """Explain the colours that the scenario uses."""
        scenario = self._ui.session.scenario
        self._legend.show(
            scenario,
            self._palette,
            has_original_road=self.map.shows_original,
            has_original_agents=self.comparison.is_on,
        )

    def set_original_road_shown(self, is_shown: bool) -> None:
        """Outline the original road while it is warped, or do not."""
        self.map.set_ghost_wanted(is_shown)
        self.show_legend()

    def point_at(self, agent_id: str | None) -> None:
        """Mark the agent that is pointed at in a list."""
        self._pointed_id = agent_id
        with self._ui.client.atomic():
            self.show_marks()

    def follow_theme(self) -> None:
        """Draw in the colours of the workspace's theme."""
        for view in self._themed:
            view.set_palette(self._palette)
        self._signals.show(self._scenario, self._drawn_step)
        self.show_marks()
        self.show_legend()

    def follow_camera(self) -> None:
        """Keep elements with a least size on the screen at that size."""

        @self._ui.client.camera.on_update
        async def _(_camera: viser.CameraHandle) -> None:
            self._ui.inbox.post(self._camera_moved, merge_key="camera")

    def size_for_view(self) -> None:
        """Size elements with a least size for the camera's view."""
        self._view = ViewScale.of(self._ui.client.camera)
        for view in (self.agents, self._marks, self._labels, self._locks):
            view.set_view(self._view)

    @property
    def look_at_m(self) -> np.ndarray:
        """The point of the ground that the camera looks at."""
        return np.asarray(self._ui.client.camera.look_at)[:2]

    @property
    def _palette(self) -> Palette:
        return DARK if self._ui.workspace.is_dark else LIGHT

    @property
    def _scenario(self) -> Scenario:
        """The session's scenario, or the sample that is pointed at."""
        return self.samples.previewed or self._ui.session.scenario

    def _draw_moved_frame(self) -> None:
        if self.is_behind:
            with self._ui.client.atomic():
                self.draw_frame()

    def _camera_moved(self) -> None:
        if ViewScale.of(self._ui.client.camera).differs_from(self._view):
            with self._ui.client.atomic():
                self.size_for_view()
                self.draw_frame()

    def _compared(self) -> None:
        with self._ui.client.atomic():
            self.map.set_compared(self.comparison.is_on)
            self.show_marks()
            self.show_legend()
        self._on_compare()

    def _sample_pointed(self) -> None:
        with self._ui.client.atomic():
            self.draw()
