"""What the page's script looks after: viser's panel, the order of presses, hints, the sheet of keys."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import msgspec

from pd_editor.base.errors import InputError
from pd_editor.base.plain_text import one_line
from pd_editor.editor.commands import ReplaceTraffic, TransformAgents
from pd_editor.editor.commands.command import Command, parts_of
from pd_editor.viewer.overlay.messages import (
    HintsDone,
    HintsState,
    KeyGroup,
    KeyRow,
    KeysState,
    OrderEvent,
    OrderState,
    PanelEvent,
    PanelState,
)
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.tab.ui_context import Hotkey, UiContext

_NAME_OF_KEY: Final[Mapping[str, str]] = {
    "space": "Space",
    "escape": "Esc",
    "delete": "Del",
    "backspace": "Backspace",
    "pageup": "Page Up",
    "pagedown": "Page Down",
    "home": "Home",
    "end": "End",
    "enter": "Enter",
    "tab": "Tab",
    "arrowleft": "\u2190",
    "arrowright": "\u2192",
    "arrowup": "\u2191",
    "arrowdown": "\u2193",
}
_NAME_OF_MODIFIER: Final[Mapping[str, str]] = {
    "cmd/ctrl": "Ctrl",
    "shift": "Shift",
    "alt": "Alt",
}


MOUSE: Final[tuple[KeyRow, ...]] = (
    KeyRow(keys="Click", does="Select an agent; on the ground, select nothing"),
    KeyRow(keys="Shift or Ctrl+click", does="Add an agent, or take it off"),
    KeyRow(keys="Ctrl+drag", does="Select the agents in a box"),
    KeyRow(keys="Drag", does="Top view: select the agents in a box; 3-D view: turn"),
    KeyRow(keys="Drag an agent", does="Move the selected agents"),
    KeyRow(keys="Shift+drag an agent", does="Turn the selected agents"),
    KeyRow(keys="Drag a flag or a stop line", does="Move an agent's goal or stop line"),
    KeyRow(keys="Press and drag, placing", does="Place an agent and turn it"),
    KeyRow(keys="Drag the curve of speed", does="Drive faster or slower; Shift: fine"),
    KeyRow(keys="Right click", does="Menu of the agent or of the road"),
    KeyRow(keys="Right button, drag", does="Pan"),
    KeyRow(keys="Wheel", does="Zoom to the pointer"),
)
PAGE_KEYS: Final[tuple[KeyRow, ...]] = (
    KeyRow(
        keys="\u2190 \u2192, comma, full stop",
        does="Step one frame of 0.1 s; arrows with Shift: ten",
    ),
    KeyRow(
        keys="\u2191 \u2193 Page, Home, End",
        does="In the list of agents or problems: other rows",
    ),
    KeyRow(keys="Arrows, Enter, in a tool", does="Move a cross, press; Shift: farther"),
    KeyRow(keys="F6", does="To the panel, to the run bar, and back"),
    KeyRow(keys="Backspace, Ctrl+Y", does="As Del, as Ctrl+Shift+Z"),
    KeyRow(keys="H, hold", does="Drag to pan"),
    KeyRow(keys="O, hold", does="Compare with the original"),
    KeyRow(keys="1 to 5, placing", does="Choose the kind of agent"),
    KeyRow(keys="?, F1", does="This sheet"),
    KeyRow(keys="Ctrl+K", does="All commands, to search"),
)
"""Keys that the page's script handles itself, because they are held or not letters."""


class KeySheet:
    """Shows the keys that are registered, so that the sheet is always true."""

    def __init__(self, overlay: Overlay) -> None:
        """List nothing yet."""
        self._overlay = overlay
        self._num_opened = 0
        self._groups: tuple[KeyGroup, ...] = ()

    def tell(self, hotkeys: Sequence[Hotkey]) -> None:
        """Set the registered keys; those of the page are added."""
        keys = (*_of_hotkeys(hotkeys), *PAGE_KEYS)
        self._groups = (
            KeyGroup(title="Keys", rows=keys),
            KeyGroup(title="Mouse", rows=MOUSE),
        )
        self._show()

    def open(self) -> None:
        """Open the sheet; the page closes it."""
        self._num_opened += 1
        self._show()

    def _show(self) -> None:
        state = KeysState(groups=self._groups, num_opened=self._num_opened)
        self._overlay.show(state)


def _of_hotkeys(hotkeys: Sequence[Hotkey]) -> list[KeyRow]:
    return [
        KeyRow(keys=key_name(one.key, one.modifier), does=one.label)
        for one in hotkeys
        if one.key is not None
    ]


def key_name(key: str, modifier: str | None) -> str:
    """A key as printed on a keyboard, with its modifiers."""
    parts = [] if modifier is None else modifier.split("+")
    names = [_NAME_OF_MODIFIER.get(part, part) for part in parts]
    return "+".join([*names, _NAME_OF_KEY.get(key, key)])


class Hints:
    """One small card over the picture; the browser remembers what was done."""

    def __init__(self, ui: UiContext) -> None:
        """Show nothing yet."""
        self._ui = ui
        ui.model.shown.subscribe(self.show)

    def show(self) -> None:
        """Send which hints the session has fulfilled, and whether there is no agent."""
        session = self._ui.session
        commands = parts_of((one.command for one in session.entries), Command)
        done = HintsDone(
            select=bool(session.selection),
            drag=any(isinstance(one, TransformAgents) for one in commands),
            bend=session.scenario.applied_warp is not None,
            regenerate=any(isinstance(one, ReplaceTraffic) for one in commands),
        )
        is_empty = not len(session.scenario.agents)
        self._ui.overlay.show(HintsState(is_empty=is_empty, done=done))


class PressOrder:
    """Answers the page when a button or key that may arm a mode has been processed.

    A press on the picture that the user makes meanwhile waits in the page, so that it is
    the mode's even over a slow connection.
    """

    def __init__(
        self, overlay: Overlay, *, keys: Sequence[str], labels: Sequence[str]
    ) -> None:
        """Tell the page which keys, and which buttons of the panel, may arm a mode."""
        self._overlay = overlay
        self._arming = tuple(keys), tuple(labels)
        overlay.on("order", self._heard)
        self._answer(0)

    def _heard(self, event: OrderEvent) -> None:
        self._answer(event.number)

    def _answer(self, number: int) -> None:
        keys, labels = self._arming
        self._overlay.show(OrderState(keys=keys, labels=labels, answered=number))


TABS: Final = ("Scene", "Road", "Agents", "Generate", "Study", "History", "View")
SCENE, ROAD, AGENTS, GENERATE, STUDY, HISTORY, VIEW = TABS


class SidePanel:
    """Keeps the tab that is open, and opens it again after a reload.

    It shows an agent that is clicked in the place of what says nothing of agents, and
    that again once nothing is selected.

    It also tells when the pointer takes a slider and lets it go, which viser does not;
    without the page's script a slider's gesture is over when it rests.
    """

    def __init__(self, ui: UiContext, *, is_debug: bool) -> None:
        """Open the tab that was open; viser's own settings are offered to debug only."""
        self._ui = ui
        self._overlay = ui.overlay
        self._state = PanelState(tab=ui.workspace.view.panel_tab, is_debug=is_debug)
        self._overlay.on("panel", self._heard)
        self._overlay.show(self._state)
        self._left: str | None = None
        """The tab in whose place the selection is shown."""
        ui.model.agent_clicked.subscribe(self._agent_clicked)
        ui.model.shown.subscribe(self._return)
        ui.model.tab_asked.subscribe(partial(self._open, takes_focus=True))

    def _agent_clicked(self) -> None:
        """Show what is selected, unless the tab's tool is in use."""
        tab = self._ui.workspace.view.panel_tab or SCENE
        if self._ui.model.mode is None and tab in (SCENE, ROAD, STUDY):
            self._open(AGENTS)
            self._left = tab

    def _return(self) -> None:
        left = self._left
        if left is not None and not self._ui.session.selection:
            self._open(left)

    def _open(self, tab: str, *, takes_focus: bool = False) -> None:
        self._keep(tab)
        self._left = None
        asked = self._state.asked + 1
        self._state = msgspec.structs.replace(
            self._state, tab=tab, asked=asked, takes_focus=takes_focus
        )
        self._overlay.show(self._state)

    def _keep(self, tab: str) -> None:
        """Open this tab after a reload."""
        workspace = self._ui.workspace
        workspace.view = replace(workspace.view, panel_tab=tab)

    def _heard(self, event: PanelEvent) -> None:
        kind, title = event.kind, event.title
        if kind == "hold":
            self._ui.hold_slider()
        elif kind == "release":
            self._ui.release_slider()
        elif kind == "refused":
            typed, what = one_line(event.typed, 40), "whole " * event.is_whole
            told = f"{one_line(title, 60)}: {typed or 'this'} is no {what}number"
            kept = f"; {one_line(event.kept, 40)} stays" if event.kept else ""
            self._ui.report(InputError(f"{told}{kept}."))
        elif kind == "narrow":
            self._ui.client.gui.main_panel.minimize()
        else:
            self._keep(title[:60])
            if title != AGENTS:
                self._left = None
