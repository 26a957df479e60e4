"""The sheet of all keys and mouse gestures."""

from collections.abc import Mapping, Sequence
from typing import Final

from pd_editor.viewer.overlay.messages import KeyGroup, KeyRow, KeysState
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.tab.ui_context import Hotkey

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
    """One row per label; keys that do the same stand in one row."""
    keys: dict[str, list[str]] = {}
    for hotkey in hotkeys:
        if hotkey.key is not None:
            label = hotkey.label.split(" (")[0]
            keys.setdefault(label, []).append(key_name(hotkey.key, hotkey.modifier))
    return [KeyRow(keys=", ".join(names), does=label) for label, names in keys.items()]


def key_name(key: str, modifier: str | None) -> str:
    """A key as printed on a keyboard, with its modifiers."""
    parts = [] if modifier is None else modifier.split("+")
    names = [_NAME_OF_MODIFIER.get(part, part) for part in parts]
    return "+".join([*names, _NAME_OF_KEY.get(key, key)])
