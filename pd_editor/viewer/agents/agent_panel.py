"""The inspector of agents: numbers of the selection, and what to do with it."""

import math
from collections import Counter
from collections.abc import Callable, Collection
from typing import Any, Final

import numpy as np
import viser
from jaxtyping import Bool, Float, Int

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import (
    Command,
    DeleteAgents,
    DuplicateAgents,
    SetAgentActivity,
    SetAgentHeading,
    SetAgentKind,
    SetAgentPosition,
    SetAgentSize,
    SetAgentSpeed,
    SetFocalAgent,
    SnapToLane,
    new_agent_ids,
)
from pd_editor.scene.agent_kind import Activity, AgentKind
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.agents.lock_controls import LockControls, selected
from pd_editor.viewer.agents.placing import PlacingMode
from pd_editor.viewer.tab.panel_style import WITH_PAST, FixedText
from pd_editor.viewer.tab.ui_context import UiContext, set_property, set_value

KINDS: Final = tuple(str(kind) for kind in AgentKind)
MIXED: Final = "mixed"
MORE: Final = "Activity, kind, size, delete"
EDIT: Final = "Edit"
SNAP: Final = "Snap to lane"
DUPLICATE: Final = "Duplicate"
MAKE_FOCAL: Final = "Make focal"
DELETE: Final = "Delete"
PLACE: Final = "Place on road"
STOP_PLACING: Final = "Stop placing"
ACTIVITIES: Final = {one.in_words: one for one in Activity}
SIZE_NOTE: Final = "Size assumed (Argoverse 2 has none). Change it to record it."
PLURAL: Final[dict[AgentKind, str]] = {
    AgentKind.VEHICLE: "vehicles",
    AgentKind.PEDESTRIAN: "pedestrians",
    AgentKind.MOTORCYCLIST: "motorcyclists",
    AgentKind.CYCLIST: "cyclists",
    AgentKind.BUS: "buses",
    AgentKind.RIDERLESS_BICYCLE: "riderless bicycles",
}
_OWN_GESTURE: Final = "agent panel:"


class AgentPanel:
    """Numbers, kind and actions of the selected agents; without one, placing new ones."""

    def __init__(self, ui: UiContext, placing: PlacingMode) -> None:
        """Build it into the current tab."""
        self._ui = ui
        self._model = ui.model
        self._placing = placing
        gui = ui.client.gui
        self._summary = FixedText(gui, 2)
        self._state = gui.add_folder("State at t = 0")
        with self._state:
            self._speed = gui.add_number("Speed (m/s)", 0.0, step=0.1)
            self._heading = gui.add_number(
                "Heading (deg)",
                0.0,
                step=1.0,
                hint="Shown within half a turn: 400 is 40",
            )
        self.locks = LockControls(ui)
        self._more = gui.add_folder(MORE, expand_by_default=False)
        with self._more:
            self._activity = gui.add_dropdown(
                "Activity", tuple(ACTIVITIES), hint="Of parked agents few start"
            )
            self._kind = gui.add_dropdown("Kind", KINDS)
            self._position = gui.add_vector2("Position (m)", (0.0, 0.0), step=0.1)
            self._size = gui.add_vector2("Length, width (m)", (4.6, 1.9), step=0.1)
            self._acts = gui.add_button_group(
                EDIT, (SNAP, DUPLICATE, MAKE_FOCAL, DELETE), hint="Shift+L, Ctrl+D"
            )
        self._heading.precision = 1
        for handle in (self._speed, self._position, self._size):
            handle.precision = 2
        self._place_folder = gui.add_folder("Place an agent")
        with self._place_folder:
            self._new_kind = gui.add_dropdown("New agent", KINDS)
            self._back_cast = gui.add_checkbox(
                WITH_PAST,
                True,
                hint="Driven up to here along its lane; the export says so.",
            )
            self._place = gui.add_button(
                PLACE, icon=viser.Icon.CROSSHAIR, hint="P, then click the road"
            )
        self._listen()

    def _listen(self) -> None:
        ui = self._ui
        acts = {
            SNAP: self.snap,
            DUPLICATE: self.duplicate,
            MAKE_FOCAL: self.make_focal,
            DELETE: self.delete,
        }
        ui.on_option(self._acts, lambda name: acts[name]())
        ui.on_click(self._place, self._placing.toggle)
        ui.on_change(self._new_kind, lambda kind: self._placing.choose(AgentKind(kind)))
        ui.on_change(self._back_cast, self._set_with_past)
        self._placing.changed.subscribe(self._show_placing)
        self._model.shown.subscribe(self.show)
        self._model.checked.subscribe(self.show)
        ui.on_change(self._kind, self._set_kind)
        ui.on_change(self._activity, self._set_activity, failure="Activity not changed")
        ui.on_change(self._speed, self._set_speed, merge_key="speed")
        ui.on_change(self._heading, self._set_heading, merge_key="heading")
        ui.on_change(self._position, self._set_position, merge_key="position")
        ui.on_change(self._size, self._set_size, merge_key="size")

    def show(self) -> None:
        """Show the values of the selection; a value that differs among agents is empty."""
        scenario, selection = self._ui.session.scenario, self._ui.session.selection
        stale = self._model.findings.stale_ids()
        agents, step = scenario.agents, scenario.current_step
        rows = agents.rows(selection)
        is_there = bool(len(rows)) and bool(agents.is_valid[rows, step].all())
        title, line = summary(scenario, rows)
        self._summary.show(title, *stale_in_words(selection, stale) or (line,))
        for handle in (self._state, self._activity, self._kind, self._size):
            set_property(handle, "visible", is_there)
        set_property(self._position, "visible", is_there and len(rows) == 1)
        may_be_focal = len(rows) == 1 and selection != (scenario.focal_id,)
        acts = [SNAP, DUPLICATE] * is_there + [MAKE_FOCAL] * may_be_focal + [DELETE]
        set_property(self._acts, "options", tuple(acts))
        set_property(self._more, "visible", bool(len(rows)))
        is_assumed = is_there and not agents.has_known_size[rows].all()
        set_property(self._size, "hint", SIZE_NOTE if is_assumed else None)
        self.locks.show(scenario, selection)
        self._show_placing()
        if not (self._ui.gesture or "").startswith(_OWN_GESTURE):
            self._show_numbers(scenario, rows if is_there else rows[:0])

    def _show_numbers(self, scenario: Scenario, rows: Int[np.ndarray, "G"]) -> None:
        agents, step = scenario.agents, scenario.current_step
        kinds = {str(agents.kinds[row]) for row in rows}
        options = (MIXED, *KINDS) if len(kinds) > 1 else KINDS
        if tuple(self._kind.options) != options:
            self._kind.options = options
        kind = MIXED if len(kinds) > 1 else "".join(kinds)
        set_value(self._kind, kind)
        self._show_activity(scenario, rows)
        set_value(self._speed, common(agents.speed_mps()[rows, step], 2))
        degrees = np.degrees(agents.heading_rad[rows, step])
        set_value(self._heading, common(degrees, 1))
        x, y = agents.position_m[rows, step].T
        set_value(self._position, (common(x, 2), common(y, 2)))
        length, width = agents.size_m[rows].T
        set_value(self._size, (common(length, 2), common(width, 2)))

    def _show_activity(self, scenario: Scenario, rows: Int[np.ndarray, "G"]) -> None:
        found = sorted({Activity(int(one)) for one in scenario.activity()[rows]})
        names = tuple(ACTIVITIES)
        options = (MIXED, *names) if len(found) > 1 else names
        if tuple(self._activity.options) != options:
            self._activity.options = options
        shown = found[0] if found else Activity.UNKNOWN
        set_value(self._activity, MIXED if len(found) > 1 else shown.in_words)

    def delete(self) -> None:
        """Delete the selection."""
        self._apply(DeleteAgents, agent_ids=selected(self._ui))

    def duplicate(self) -> None:
        """Copy the selection, one car's length behind where it stands."""
        selection = selected(self._ui)
        scenario = self._ui.session.scenario
        row = int(scenario.agents.rows(selection)[0])
        heading = float(scenario.agents.heading_rad[row, scenario.current_step])
        gap = float(scenario.agents.size_m[row, 0]) + 2.0
        self._apply(
            DuplicateAgents,
            agent_ids=selection,
            new_ids=new_agent_ids(scenario, len(selection), prefix="copy"),
            dx_m=-gap * float(np.cos(heading)),
            dy_m=-gap * float(np.sin(heading)),
        )

    def snap(self) -> None:
        """Put the selection on its nearest lanes."""
        self._apply(SnapToLane, agent_ids=selected(self._ui))

    def _show_placing(self) -> None:
        is_active = self._placing.is_active
        is_shown = is_active or not self._ui.session.selection
        set_property(self._place_folder, "visible", is_shown)
        set_property(self._place, "label", STOP_PLACING if is_active else PLACE)
        set_property(self._place, "color", "orange" if is_active else None)
        set_value(self._new_kind, str(self._placing.kind))

    def _set_with_past(self, with_past: bool) -> None:
        self._placing.with_past = with_past

    def _apply(self, make: Callable[..., Command], **fields: Any) -> None:
        self._ui.apply(make(**fields))

    def make_focal(self) -> None:
        """Make the selected agent the focal one."""
        self._apply(SetFocalAgent, agent_id=selected(self._ui)[0])

    def _set_kind(self, kind: str) -> None:
        if kind != MIXED:
            self._apply(
                SetAgentKind, agent_ids=selected(self._ui), kind=AgentKind(kind)
            )

    def _set_activity(self, name: str) -> None:
        if name != MIXED:
            self._apply(
                SetAgentActivity,
                agent_ids=selected(self._ui),
                activity=ACTIVITIES[name],
            )

    def _set_speed(self, speed: float) -> None:
        if speed < 0:
            raise EditError(f"No agent drives at {speed:g} m/s; expected 0 or more.")
        self._preview(SetAgentSpeed, "speed", speed_mps=float(speed))

    def _set_heading(self, degrees: float) -> None:
        self._preview(
            SetAgentHeading, "heading", heading_rad=float(np.radians(degrees))
        )

    def _set_size(self, size: tuple[float, float]) -> None:
        length, width = (None if math.isnan(side) else float(side) for side in size)
        self._preview(SetAgentSize, "size", length_m=length, width_m=width)

    def _set_position(self, position: tuple[float, float]) -> None:
        (agent_id,) = selected(self._ui)[:1]
        x, y = map(float, position)
        self._ui.preview_value(
            f"{_OWN_GESTURE} position of {agent_id}",
            lambda: SetAgentPosition(agent_id=agent_id, x_m=x, y_m=y),
        )

    def _preview(self, make: Callable[..., Command], what: str, **fields: Any) -> None:
        selection = selected(self._ui)
        self._ui.preview_value(
            f"{_OWN_GESTURE} {what} of {selection}",
            lambda: make(agent_ids=selection, **fields),
        )


def common(values: Float[np.ndarray, "G"], digits: int) -> float:
    """Common value of all agents after rounding; else NaN, which a field shows as empty."""
    rounded = np.round(values, digits)
    is_shared = len(rounded) and (rounded == rounded[0]).all()
    return float(rounded[0]) if is_shared else math.nan


def summary(scenario: Scenario, rows: Int[np.ndarray, "G"]) -> tuple[str, ...]:
    """A title and lines about the agents that are selected."""
    if not len(rows):
        return (
            "Nothing is selected.",
            "Click an agent; Shift+click adds; Ctrl+drag draws a box.",
        )
    agents, step = scenario.agents, scenario.current_step
    if len(rows) > 1:
        counts = Counter(agents.kinds[row] for row in rows)
        parts = [counted(kind, count) for kind, count in counts.most_common()]
        absent = int((~agents.is_valid[rows, step]).sum())
        hint = "A new value applies to all; empty fields differ."
        if absent:
            hint = f"{absent} not there at t = 0, so no numbers can be set."
        return f"{len(rows)} agents: {', '.join(parts)}", hint
    row = int(rows[0])
    names = {scenario.focal_id: "focal agent", EGO_ID: "ego"}
    marks = [names[agents.ids[row]]] if agents.ids[row] in names else []
    is_valid = agents.is_valid[row]
    if not is_valid[step]:
        marks.append("comes later" if is_valid[step:].any() else "has left by t = 0")
    marks.append(_time_there(is_valid, scenario.time_axis.step_s))
    text = ", ".join(marks)
    return f"{agents.kinds[row].in_words} {agents.ids[row]}", (
        text[:1].upper() + text[1:]
    )


def stale_in_words(
    selection: tuple[str, ...], stale: Collection[str]
) -> tuple[str, ...]:
    """Line on selected agents whose trajectory no longer fits the road, if any."""
    count = sum(agent_id in stale for agent_id in selection)
    if not count:
        return ()
    if len(selection) == 1:
        return ("Its trajectory no longer fits: regenerate it (R).",)
    verb = "trajectory no longer fits" if count == 1 else "trajectories no longer fit"
    return (f"{count} {verb}: regenerate (R).",)


def _time_there(is_valid: Bool[np.ndarray, "T"], step_s: float) -> str:
    whole = f"{len(is_valid) * step_s:.3g} s"
    if is_valid.all():
        return f"there for all {whole}"
    return f"there for {is_valid.sum() * step_s:.3g} of {whole}"


def counted(kind: AgentKind, count: int) -> str:
    """A number of agents of a kind, such as "2 buses"."""
    if count == 1:
        return f"1 {kind.in_words}"
    return f"{count} {PLURAL.get(kind, f'{kind.in_words} objects')}"
