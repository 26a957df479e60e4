"""The row of tools over the picture's top left corner."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.editor.session import EditorSession
from pd_editor.viewer.controls.history_panel import HistoryPanel
from pd_editor.viewer.controls.tab_elements import TabElements
from pd_editor.viewer.guidance.guidance_panel import NEEDS_ONE
from pd_editor.viewer.overlay.messages import Icon, Tool, ToolbarEvent, ToolbarState
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.tab.ui_context import UiContext


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

    def __init__(self, ui: UiContext, tab: TabElements) -> None:
        """Offer groups of tools, from left to right, with gaps between them."""
        self._overlay = ui.overlay
        self._groups = _tool_groups(ui, tab)
        self._tools = {tool.icon: tool for group in self._groups for tool in group}
        self._overlay.on("toolbar", self._used)
        model = ui.model
        for signal in (
            model.shown,
            model.run_changed,
            model.mode_changed,
            model.view_switched,
            model.drawer_changed,
            model.compared,
        ):
            signal.subscribe(self.show)

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

    def _used(self, event: ToolbarEvent) -> None:
        tool = self._tools.get(event.icon)
        if tool is None:
            return
        if event.kind == "press" and tool.is_enabled():
            tool.press()
        elif event.kind == "release" and tool.release is not None:
            tool.release()
        self.show()


def _tool_groups(ui: UiContext, tab: TabElements) -> tuple[tuple[ToolButton, ...], ...]:
    """Groups of tools of a tab, from left to right."""
    model, viewpoint = ui.model, tab.viewpoint
    comparison, live = tab.picture.comparison, tab.generation.live_switch
    return (
        (ToolButton("scenes", tab.start.toggle, "All scenarios (N)"),),
        _history_tools(ui.session, tab.history),
        _picture_tools(ui, tab),
        _view_tools(viewpoint),
        (
            ToolButton("fit", viewpoint.frame_map, "Show the whole map (Home)"),
            ToolButton(
                "frame",
                viewpoint.frame_selection,
                "Frame the selection, or the focal agent (F)",
            ),
        ),
        (
            ToolButton(
                "agents",
                partial(model.toggle_drawer, "agents"),
                "Agent list (Ctrl+F)",
                is_active=lambda: model.drawer == "agents",
            ),
            ToolButton(
                "scorecard",
                partial(model.toggle_drawer, "scorecard"),
                "Scorecard: metrics beside recordings (I)",
                is_active=lambda: model.drawer == "scorecard",
            ),
            ToolButton(
                "compare",
                comparison.hold,
                "Compare with the original (hold O)",
                release=comparison.release,
                is_active=lambda: comparison.is_on,
            ),
            ToolButton(
                "live",
                live.toggle,
                "Live: traffic reacts while you edit (Shift+R)",
                is_active=lambda: live.is_on,
            ),
        ),
        (ToolButton("help", tab.key_sheet.open, "Keys and mouse (?)"),),
    )


def _history_tools(
    session: EditorSession, history: HistoryPanel
) -> tuple[ToolButton, ...]:
    """Undo and redo, which name the edit."""

    def named(action: str, index: int, key: str) -> str:
        entries = session.entries
        what = f": {entries[index].label}" if 0 <= index < len(entries) else ""
        return f"{action}{what} ({key})"

    return (
        ToolButton(
            "undo",
            history.undo,
            lambda: named("Undo", session.state.position - 1, "Ctrl+Z"),
            is_enabled=lambda: session.can_undo,
        ),
        ToolButton(
            "redo",
            history.redo,
            lambda: named("Redo", session.state.position, "Ctrl+Shift+Z"),
            is_enabled=lambda: session.can_redo,
        ),
    )


def _picture_tools(ui: UiContext, tab: TabElements) -> tuple[ToolButton, ...]:
    """What presses on the picture mean: to select and drag, else to draw something."""
    model, session, guiding = ui.model, ui.session, tab.steering.mode

    def select() -> None:
        if model.mode is not None:
            model.mode.stop()

    def has_one() -> bool:
        return len(session.selection) == 1

    def guide(kind: Literal["goal-point", "follow-path", "stop-at-line"]) -> ToolButton:
        hint = KINDS[kind].hint
        return ToolButton(
            kind,
            lambda: guiding.toggle(kind),
            lambda: hint if has_one() else f"{NEEDS_ONE}. {hint}",
            is_active=lambda: guiding.tool == kind,
            is_enabled=has_one,
        )

    return (
        ToolButton(
            "select",
            select,
            "Select and drag agents (Esc)",
            is_active=lambda: model.mode is None,
        ),
        ToolButton(
            "place",
            tab.placing.toggle,
            "Place agents (P)",
            is_active=lambda: tab.placing.is_active,
        ),
        guide("goal-point"),
        guide("follow-path"),
        guide("stop-at-line"),
        ToolButton(
            "bend",
            tab.bending.toggle,
            "Bend the road: pull it aside (W)",
            is_active=lambda: tab.bending.is_active,
        ),
        ToolButton(
            "measure",
            tab.measure.toggle,
            "Measure distances (M)",
            is_active=lambda: tab.measure.is_active,
        ),
    )


def _view_tools(viewpoint: Viewpoint) -> tuple[ToolButton, ...]:
    return (
        ToolButton(
            "3d",
            viewpoint.show_3d,
            "3-D view (V switches)",
            is_active=lambda: not viewpoint.is_top,
        ),
        ToolButton(
            "top",
            viewpoint.show_top,
            "Top view (V switches)",
            is_active=lambda: viewpoint.is_top,
        ),
    )
