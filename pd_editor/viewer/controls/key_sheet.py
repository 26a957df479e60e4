"""The sheet of all keys and mouse gestures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

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


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the sheet."""

    keys: str
    does: str


MOUSE: Final[tuple[Row, ...]] = (
    Row(keys="Click", does="Select an agent; on the ground, select nothing"),
    Row(keys="Shift or Ctrl+click", does="Add an agent, or take it off"),
    Row(keys="Ctrl+drag", does="Select the agents in a box"),
    Row(keys="Drag", does="Top view: select the agents in a box; 3-D view: turn"),
    Row(keys="Drag an agent", does="Move the selected agents"),
    Row(keys="Shift+drag an agent", does="Turn the selected agents"),
    Row(keys="Drag a flag or a stop line", does="Move an agent's goal or stop line"),
    Row(keys="Press and drag, placing", does="Place an agent and turn it"),
    Row(keys="Right click", does="Menu of the agent or of the road"),
    Row(keys="Right button, drag", does="Pan"),
    Row(keys="Wheel", does="Zoom to the pointer"),
)
PAGE_KEYS: Final[tuple[Row, ...]] = (
    Row(keys="\u2190 \u2192", does="Step one frame; with Shift, ten"),
    Row(
        keys="\u2191 \u2193 Page, Home, End",
        does="In the list of agents or problems: other rows",
    ),
    Row(keys="H, hold", does="Drag to pan"),
    Row(keys="O, hold", does="Compare with the original"),
    Row(keys="1 to 5, placing", does="Choose the kind of agent"),
    Row(keys="?, F1", does="This sheet"),
    Row(keys="Ctrl+K", does="All commands, to search"),
)
"""Keys that the page's script handles itself, because they are held or not letters."""


class KeySheet:
    """Shows the keys that are registered, so that the sheet is always true."""

    def __init__(self, overlay: Overlay) -> None:
        """List nothing yet."""
        self._overlay = overlay
        self._num_opened = 0
        self._groups: list[dict[str, Any]] = []

    def tell(self, hotkeys: Sequence[Hotkey]) -> None:
        """Set the registered keys; those of the page are added."""
        self._groups = [
            {"title": "Keys", "rows": _rows([*_of_hotkeys(hotkeys), *PAGE_KEYS])},
            {"title": "Mouse", "rows": _rows(MOUSE)},
        ]
        self._show()

    def open(self) -> None:
        """Open the sheet; the page closes it."""
        self._num_opened += 1
        self._show()

    def _show(self) -> None:
        self._overlay.show(
            "keys", {"groups": self._groups, "numOpened": self._num_opened}
        )


def _of_hotkeys(hotkeys: Sequence[Hotkey]) -> list[Row]:
    """One row per label; keys that do the same stand in one row."""
    keys: dict[str, list[str]] = {}
    for hotkey in hotkeys:
        if hotkey.key is not None:
            label = hotkey.label.split(" (")[0]
            keys.setdefault(label, []).append(key_name(hotkey.key, hotkey.modifier))
    return [Row(keys=", ".join(names), does=label) for label, names in keys.items()]


def key_name(key: str, modifier: str | None) -> str:
    """A key as printed on a keyboard, with its modifiers."""
    parts = [] if modifier is None else modifier.split("+")
    names = [_NAME_OF_MODIFIER.get(part, part) for part in parts]
    return "+".join([*names, _NAME_OF_KEY.get(key, key)])


def _rows(rows: Sequence[Row]) -> list[dict[str, str]]:
    return [{"keys": row.keys, "does": row.does} for row in rows]
