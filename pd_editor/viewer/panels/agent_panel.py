"""The agent panel: numbers of the selection, and what to do with it."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import viser

from pd_editor.editor.commands import (
    Command,
    DeleteAgents,
    DuplicateAgents,
    SetAgentHeading,
    SetAgentKind,
    SetAgentPosition,
    SetAgentSize,
    SetAgentSpeed,
    SetFocalAgent,
    SnapToLane,
    new_agent_ids,
)
from pd_editor.errors import EditError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.interaction.placing import Placing
from pd_editor.viewer.state.desk import Desk, set_property, set_value
from pd_editor.viewer.state.page_text import plain

KINDS: Final = tuple(str(kind) for kind in AgentKind)
_OWN_GESTURE: Final = "agent panel:"
_SIZE_NOTE: Final = "*Size: the kind's default. Argoverse 2 tracks carry none; set it to make it known.*"


class AgentPanel:
    """Numbers, kind and actions of the selected agents, and placing new ones."""

    def __init__(self, desk: Desk, placing: Placing) -> None:
        """Build it into the current tab; it shows and steers the mode of placing."""
        self._desk = desk
        self._placing = placing
        gui = desk.client.gui
        self._summary = gui.add_markdown("")
        self._kind = gui.add_dropdown("Kind", KINDS)
        self._speed = gui.add_number("Speed (m/s)", 0.0, min=0.0, max=60.0, step=0.1)
        self._heading = gui.add_number("Heading (deg)", 0.0, step=1.0)
        self._position = gui.add_vector2("Position (m)", (0.0, 0.0), step=0.1)
        self._size = gui.add_vector2("Length, width (m)", (4.6, 1.9), step=0.1)
        self._heading.precision = 1
        for handle in (self._speed, self._position, self._size):
            handle.precision = 2
        self._size_note = gui.add_markdown(_SIZE_NOTE)
        self._actions = {
            "Snap to lane": gui.add_button("Snap to lane", color="gray"),
            "Duplicate": gui.add_button("Duplicate", color="gray", hint="Ctrl+D"),
            "Make focal": gui.add_button("Make focal", color="gray"),
            "Delete": gui.add_button("Delete", color="red", hint="Delete"),
        }
        with gui.add_folder("Place an agent"):
            self._new_kind = gui.add_dropdown("New agent", KINDS)
            self._back_cast = gui.add_checkbox(
                "With a past",
                False,
                hint="Back-cast along its lane; marked as made up.",
            )
            self._place = gui.add_button(
                "Place on road",
                icon=viser.Icon.CROSSHAIR,
                hint="P, then click the road",
            )
        self._listen()

    def _listen(self) -> None:
        desk = self._desk
        desk.on_click(self._actions["Snap to lane"], self.snap)
        desk.on_click(self._actions["Duplicate"], self.duplicate)
        desk.on_click(self._actions["Make focal"], self.make_focal)
        desk.on_click(self._actions["Delete"], self.delete)
        desk.on_click(self._place, self._placing.toggle)
        desk.on_change(
            self._new_kind, lambda kind: self._placing.choose(AgentKind(kind))
        )
        desk.on_change(self._back_cast, self._set_with_past)
        self._placing.on_change(self._show_placing)
        desk.on_change(self._kind, self._set_kind)
        desk.on_change(self._speed, self._set_speed, merge_key="speed")
        desk.on_change(self._heading, self._set_heading, merge_key="heading")
        desk.on_change(self._position, self._set_position, merge_key="position")
        desk.on_change(self._size, self._set_size, merge_key="size")

    def show(self, scenario: Scenario, selection: tuple[str, ...]) -> None:
        """Show the numbers of the selection."""
        agents, step = scenario.agents, scenario.current_step
        rows = agents.rows(selection)
        is_there = bool(len(rows)) and bool(agents.is_valid[rows, step].all())
        set_property(self._summary, "content", _summary(scenario, rows))
        for handle in (self._kind, self._speed, self._heading, self._size):
            set_property(handle, "disabled", not is_there)
        set_property(self._position, "disabled", not (is_there and len(rows) == 1))
        for button in self._actions.values():
            set_property(button, "disabled", not len(rows))
        set_property(self._actions["Make focal"], "disabled", len(rows) != 1)
        if not is_there:
            set_property(self._size_note, "visible", False)
            return
        is_default = not agents.has_known_size[rows].all()
        set_property(self._size_note, "visible", bool(is_default))
        if not (self._desk.gesture or "").startswith(_OWN_GESTURE):
            self._show_numbers(scenario, int(rows[0]))

    def _show_numbers(self, scenario: Scenario, row: int) -> None:
        agents, step = scenario.agents, scenario.current_step
        set_value(self._kind, str(agents.kinds[row]))
        speed = float(np.hypot(*agents.velocity_mps[row, step]))
        set_value(self._speed, round(speed, 2))
        heading = float(np.degrees(agents.heading_rad[row, step]))
        set_value(self._heading, round(heading, 1))
        x, y = np.round(agents.position_m[row, step], 2)
        set_value(self._position, (float(x), float(y)))
        length, width = np.round(agents.size_m[row], 2)
        set_value(self._size, (float(length), float(width)))

    def delete(self) -> None:
        """Delete the selection."""
        self._apply(DeleteAgents, agent_ids=self._selection())

    def duplicate(self) -> None:
        """Copy the selection, one car's length behind where it stands."""
        selection = self._selection()
        scenario = self._desk.session.scenario
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
        self._apply(SnapToLane, agent_ids=self._selection())

    def _show_placing(self) -> None:
        is_active = self._placing.is_active
        set_property(
            self._place, "label", "Stop placing" if is_active else "Place on road"
        )
        set_property(self._place, "color", "orange" if is_active else None)
        set_value(self._new_kind, str(self._placing.kind))

    def _set_with_past(self, with_past: bool) -> None:
        self._placing.with_past = with_past

    def _selection(self) -> tuple[str, ...]:
        selection = self._desk.session.selection
        if not selection:
            raise EditError("Select an agent first.")
        return tuple(selection)

    def _apply(self, make: Callable[..., Command], **fields: Any) -> None:
        self._desk.apply(make(**fields))

    def make_focal(self) -> None:
        """Make the selected agent the focal one."""
        self._apply(SetFocalAgent, agent_id=self._selection()[0])

    def _set_kind(self, kind: str) -> None:
        self._apply(SetAgentKind, agent_ids=self._selection(), kind=AgentKind(kind))

    def _set_speed(self, speed: float) -> None:
        self._preview(SetAgentSpeed, "speed", speed_mps=float(speed))

    def _set_heading(self, degrees: float) -> None:
        self._preview(
            SetAgentHeading, "heading", heading_rad=float(np.radians(degrees))
        )

    def _set_size(self, size: tuple[float, float]) -> None:
        self._preview(
            SetAgentSize, "size", length_m=float(size[0]), width_m=float(size[1])
        )

    def _set_position(self, position: tuple[float, float]) -> None:
        (agent_id,) = self._selection()[:1]
        command = SetAgentPosition(
            agent_id=agent_id, x_m=float(position[0]), y_m=float(position[1])
        )
        self._desk.preview(f"{_OWN_GESTURE} position of {agent_id}", command)

    def _preview(self, make: Callable[..., Command], what: str, **fields: Any) -> None:
        selection = self._selection()
        self._desk.preview(
            f"{_OWN_GESTURE} {what} of {selection}", make(agent_ids=selection, **fields)
        )


def _summary(scenario: Scenario, rows: np.ndarray) -> str:
    if not len(rows):
        return (
            "Click an agent to select it; Shift+click adds. "
            "Ctrl+drag draws a box. Drag moves, Shift+drag turns."
        )
    agents = scenario.agents
    if len(rows) > 1:
        return f"**{len(rows)} agents selected.** Numbers apply to all of them."
    row = int(rows[0])
    name = plain(agents.ids[row])
    marks = []
    if agents.ids[row] == scenario.focal_id:
        marks.append("focal agent")
    if not agents.is_valid[row, scenario.current_step]:
        marks.append("not there at the current step")
    count = int(agents.is_valid[row].sum())
    marks.append(f"{count} of {agents.num_steps} steps")
    return f"**{agents.kinds[row]} {name}** ({', '.join(marks)})"
