"""The row of tools over the picture's top left corner."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pd_editor.viewer.overlay.messages import Icon, Tool, ToolbarState
from pd_editor.viewer.overlay.overlay import Overlay


@dataclass(frozen=True, eq=False)
class ToolButton:
    """A button; its state is evaluated whenever the bar is shown."""

    icon: Icon
    press: Callable[[], None]
    hint: str | Callable[[], str]
    """What it does and its key; also its name for a screen reader."""
    release: Callable[[], None] | None = None
    """Called when the button is released, for actions that last while it is held."""
    is_active: Callable[[], bool] = lambda: False
    is_enabled: Callable[[], bool] = lambda: True


class Toolbar:
    """Tools that a user needs at any time, whatever tab of the panel is open."""

    def __init__(
        self, overlay: Overlay, groups: Sequence[Sequence[ToolButton]]
    ) -> None:
        """Offer groups of tools, from left to right, with gaps between them."""
        self._overlay = overlay
        self._groups = groups
        self._tools = {tool.icon: tool for group in groups for tool in group}
        overlay.on("toolbar", self._used)

    def show(self) -> None:
        """Show each tool as it is now."""
        tools = tuple(
            Tool(
                icon=tool.icon,
                hint=tool.hint if isinstance(tool.hint, str) else tool.hint(),
                is_active=tool.is_active(),
                is_enabled=tool.is_enabled(),
                is_held=tool.release is not None,
                starts_group=group is not self._groups[0] and tool is group[0],
            )
            for group in self._groups
            for tool in group
        )
        self._overlay.show(ToolbarState(tools=tools))

    def _used(self, event: Mapping[str, Any]) -> None:
        tool = self._tools.get(event.get("icon", ""))
        if tool is None:
            return
        if event.get("kind") == "press" and tool.is_enabled():
            tool.press()
        elif event.get("kind") == "release" and tool.release is not None:
            tool.release()
        self.show()
