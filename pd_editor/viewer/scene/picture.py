"""The picture of a tab: road, agents, trajectories and marks at the playhead; its legend."""

from collections.abc import Iterator
from typing import Final, Literal

import numpy as np
import viser

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.locks import Kept
from pd_editor.scene.palette import Palette, Rgb
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.signals import SignalState
from pd_editor.scene.top_view import FOCAL
from pd_editor.viewer.overlay.messages import LegendEntry, LegendState
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.agents_view import AgentsView
from pd_editor.viewer.scene.camera import ViewScale
from pd_editor.viewer.scene.map_view import MapView, SignalsView
from pd_editor.viewer.scene.marks_view import LabelsView, LocksView, MarksView
from pd_editor.viewer.scene.original_view import Comparison
from pd_editor.viewer.scene.ribbons_view import RibbonsView
from pd_editor.viewer.tab.ui_context import UiContext

_LOCKED: Final[dict[Kept, str]] = {
    "trajectory": "Locked trajectory",
    "beginning": "Locked beginning",
    "state": "Locked state",
}


class Legend:
    """A folding list over the picture, in the colours of the theme in force."""

    def __init__(self, overlay: Overlay) -> None:
        """Show nothing yet."""
        self._overlay = overlay

    def show(
        self,
        scenario: Scenario,
        palette: Palette,
        *,
        has_original_road: bool,
        has_original_agents: bool,
        has_plans: bool,
    ) -> None:
        """List what is in the picture, if need be with what is drawn of the original."""
        agents = scenario.agents
        entries: list[LegendEntry] = []
        if scenario.focal_id in agents.row_of:
            entries.append(_entry(FOCAL, "fill", _css(palette.focal)))
        if EGO_ID in agents.row_of:
            entries.append(_entry("Ego", "fill", _css(palette.ego)))
        entries += _kinds(scenario, palette)
        vehicle = _css(palette.kinds[AgentKind.VEHICLE])
        entries += [
            _entry("Past", "line", _css(palette.past)),
            _entry("Trajectory ahead", "line", vehicle),
        ]
        is_there = agents.is_valid[:, scenario.current_step]
        if (~is_there).any():
            entries.append(_entry("Not there at t = 0", "dots", vehicle))
        if has_plans:
            entries.append(_entry("Plan of a policy", "line", _css(palette.plan)))
        ghost = _css(palette.ghost)
        if has_original_road:
            entries.append(_entry("Original road", "line", ghost))
        if has_original_agents:
            entries.append(_entry("Original trajectory", "dots", ghost))
        kept = {lock.keeps for lock in scenario.locks.values()}
        entries += [
            _entry(text, "lock", "", keeps)
            for keeps, text in _LOCKED.items()
            if keeps in kept
        ]
        shown = {
            int(code) for one in scenario.signals for code in np.unique(one.states)
        }
        entries += [
            _entry(
                f"Signal: {state.name.lower()}", "line", _css(palette.signals[state])
            )
            for state in map(SignalState, sorted(shown))
        ]
        entries += [
            _entry("Selected", "ring", _css(palette.selection)),
            _entry("Problem", "ring", _css(palette.warning)),
        ]
        self._overlay.show(LegendState(entries=tuple(entries)))


def _kinds(scenario: Scenario, palette: Palette) -> Iterator[LegendEntry]:
    """The kinds that are there; kinds with one name have one colour."""
    present = set(scenario.agents.kinds)
    names = {kind.label: kind for kind in AgentKind if kind in present}
    for name, kind in names.items():
        glyph = "shaded" if kind is AgentKind.BUS else "fill"
        yield _entry(name, glyph, _css(palette.kinds[kind]))


def _css(color: Rgb) -> str:
    return f"rgb{color}"


def _entry(
    text: str,
    glyph: Literal["fill", "shaded", "line", "dots", "ring", "lock"],
    color: str,
    keeps: str = "",
) -> LegendEntry:
    return LegendEntry(text=text, glyph=glyph, color=color, keeps=keeps)


class Picture:
    """Road, agents and their marks, of the scenario or of a sample pointed at."""

    def __init__(self, ui: UiContext) -> None:
        """Make the views, without a scenario."""
        self._ui = ui
        self._model = model = ui.model
        self._drawn_step = -1.0
        client, palette = ui.client, model.palette
        self.map = MapView(client, palette)
        self._signals = SignalsView(client, palette)
        self.agents = AgentsView(client, palette)
        self.ribbons = RibbonsView(client, palette)
        self._marks = MarksView(client, palette)
        self._labels = LabelsView(ui.overlay)
        self._locks = LocksView(ui.overlay)
        self._legend = Legend(ui.overlay)
        self.comparison = Comparison(ui)
        self._themed = (
            self.map,
            self._signals,
            self.agents,
            self.ribbons,
            self._marks,
            self.comparison,
        )
        model.theme_changed.subscribe(self._follow_theme)
        model.playhead_moved.subscribe(self.request_frame)
        model.marks_changed.subscribe(self._mark)
        model.checked.subscribe(self._mark)
        model.compared.subscribe(self._compared)
        model.sample_pointed.subscribe(self._sample_pointed)
        model.fan_shown.subscribe(self.ribbons.set_muted)
        model.shown.subscribe(self.show_legend)
        model.run_changed.subscribe(self.show_legend)

    @property
    def is_behind(self) -> bool:
        """Whether the playhead has moved since agents were drawn."""
        return self._drawn_step != self._ui.workspace.playback.step

    def draw(self) -> None:
        """Draw the scenario at the playhead."""
        scenario = self._scenario
        self.map.show(scenario)
        self.ribbons.show(scenario)
        self.draw_frame()

    def draw_frame(self) -> None:
        """Draw agents and marks at the playhead."""
        self._drawn_step = self._ui.workspace.playback.step
        self._signals.show(self._scenario, self._drawn_step)
        self.agents.show(self._scenario, self._drawn_step)
        self._model.poses = self.agents.poses
        self.show_marks()

    def request_frame(self) -> None:
        """Draw the playhead's time soon; once for several requests in a row."""
        self._ui.post(self._draw_moved_frame, "frame")

    def show_marks(self) -> None:
        """Draw what marks agents: selection, problems, names, locks, terms."""
        session, step = self._ui.session, self._ui.workspace.playback.step
        poses = self._model.poses
        assert poses is not None
        scenario, selection = self._scenario, session.selection
        if scenario is not session.scenario:
            there = scenario.agents.row_of
            selection = tuple(name for name in selection if name in there)
            self._marks.show(scenario, poses, selection, (), None)
            self._labels.show(scenario, poses, step, selection, {})
            self._locks.show(scenario, poses)
            return
        warned, pointed_id = self._model.warned_at(step), self._model.pointed_id
        self._marks.show(scenario, poses, selection, warned, pointed_id)
        self._model.poses_drawn.emit()
        self.comparison.show()
        notes = self.comparison.notes()
        self._labels.show(scenario, poses, step, selection, notes)
        self._locks.show(scenario, poses)

    def show_legend(self) -> None:
        """Explain the colours that the scenario uses."""
        scenario = self._ui.session.scenario
        self._legend.show(
            scenario,
            self._model.palette,
            has_original_road=self.map.shows_original,
            has_original_agents=self.comparison.is_on,
            has_plans=bool(self._ui.workspace.plans_in_force),
        )

    def set_original_road_shown(self, is_shown: bool) -> None:
        """Outline the original road while it is warped, or do not."""
        self.map.set_ghost_wanted(is_shown)
        self.show_legend()

    def _mark(self) -> None:
        with self._ui.client.atomic():
            self.show_marks()

    def _follow_theme(self) -> None:
        """Draw in the colours of the workspace's theme."""
        for view in self._themed:
            view.set_palette(self._model.palette)
        self._signals.show(self._scenario, self._drawn_step)
        self.show_marks()

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
    def _scenario(self) -> Scenario:
        """The session's scenario, or the sample that is pointed at."""
        return self._model.sample or self._ui.session.scenario

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

    def _sample_pointed(self) -> None:
        with self._ui.client.atomic():
            self.draw()
