"""The menu at the pointer after a right click on the picture."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pd_editor.viewer.overlay.messages import MenuEntry, MenuState
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.picking import PointerRay


@dataclass(frozen=True)
class MenuItem:
    """One line of the menu."""

    label: str
    act: Callable[[], None]
    is_enabled: bool = True
    key: str = ""
    """Key of the same action, shown at the right."""


@dataclass(frozen=True, kw_only=True)
class Menu:
    """Title and items of a menu for the clicked element."""

    title: str
    items: tuple[MenuItem, ...]


class ContextMenu:
    """Shows the menu of what is under the pointer, and does what is chosen."""

    def __init__(
        self, overlay: Overlay, menu_at: Callable[[PointerRay], Menu | None]
    ) -> None:
        """Listen to right clicks; ``menu_at`` is the menu for a ray, or None."""
        self._overlay = overlay
        self._menu_at = menu_at
        self._items: Sequence[MenuItem] = ()
        self._number = 0
        overlay.on("menu", self._heard)

    def _heard(self, event: Mapping[str, Any]) -> None:
        if event.get("kind") == "open":
            ray = PointerRay.of_event(event)
            if ray is not None:
                self._open(ray)
            return
        chosen, number = event.get("index"), event.get("menu")
        if number != self._number or not isinstance(chosen, int):
            return
        items, self._items = self._items, ()
        if 0 <= chosen < len(items) and items[chosen].is_enabled:
            items[chosen].act()

    def _open(self, ray: PointerRay) -> None:
        menu = self._menu_at(ray)
        self._items = () if menu is None else menu.items
        self._number += 1
        state = MenuState(
            number=self._number,
            at=(ray.x_px, ray.y_px),
            title="" if menu is None else menu.title,
            items=tuple(
                MenuEntry(label=item.label, key=item.key, is_enabled=item.is_enabled)
                for item in self._items
            ),
        )
        self._overlay.show(state)
