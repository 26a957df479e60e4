"""Tools of the toolbar: what they do, and their state."""

from pd_editor.editor.session import EditorSession
from pd_editor.viewer.interaction.viewpoint import Viewpoint
from pd_editor.viewer.overlay.agent_list import AgentList
from pd_editor.viewer.overlay.key_sheet import KeySheet
from pd_editor.viewer.overlay.scorecard_drawer import ScorecardDrawer
from pd_editor.viewer.overlay.toolbar import ToolButton
from pd_editor.viewer.tab.control_panel import ControlPanel
from pd_editor.viewer.tab.modes import Modes
from pd_editor.viewer.tab.picture import Picture


def toolbar_tools(
    session: EditorSession,
    *,
    panels: ControlPanel,
    picture: Picture,
    modes: Modes,
    viewpoint: Viewpoint,
    agent_list: AgentList,
    scorecard: ScorecardDrawer,
    key_sheet: KeySheet,
) -> tuple[ToolButton, ...]:
    """Tools of a tab, from left to right."""
    history, live = panels.history, panels.generation.live_switch

    def named(action: str, index: int, key: str) -> str:
        entries = session.entries
        what = f": {entries[index].label}" if 0 <= index < len(entries) else ""
        return f"{action}{what} ({key})"

    def undo_hint() -> str:
        return named("Undo", session.state.position - 1, "Ctrl+Z")

    def redo_hint() -> str:
        return named("Redo", session.state.position, "Ctrl+Shift+Z")

    return (
        ToolButton(
            icon="undo",
            press=history.undo,
            hint=undo_hint,
            is_enabled=lambda: session.can_undo,
        ),
        ToolButton(
            icon="redo",
            press=history.redo,
            hint=redo_hint,
            is_enabled=lambda: session.can_redo,
        ),
        ToolButton(
            icon="3d",
            press=viewpoint.show_3d,
            hint=lambda: "3-D view (V switches)",
            is_active=lambda: not viewpoint.is_top,
            starts_group=True,
        ),
        ToolButton(
            icon="top",
            press=viewpoint.show_top,
            hint=lambda: "Top view (V switches)",
            is_active=lambda: viewpoint.is_top,
        ),
        ToolButton(
            icon="fit",
            press=viewpoint.frame_map,
            hint=lambda: "Show the whole map (Home)",
            starts_group=True,
        ),
        ToolButton(
            icon="frame",
            press=viewpoint.frame_selection,
            hint=lambda: "Frame the selection, or the focal agent (F)",
        ),
        ToolButton(
            icon="measure",
            press=modes.measure.toggle,
            hint=lambda: "Measure distances (M)",
            is_active=lambda: modes.measure.is_active,
            starts_group=True,
        ),
        ToolButton(
            icon="place",
            press=modes.placing.toggle,
            hint=lambda: "Place agents (P)",
            is_active=lambda: modes.placing.is_active,
        ),
        ToolButton(
            icon="agents",
            press=agent_list.toggle,
            hint=lambda: "Agent list (Ctrl+F)",
            is_active=lambda: agent_list.is_open,
        ),
        ToolButton(
            icon="scorecard",
            press=scorecard.toggle,
            hint=lambda: "Scorecard: metrics beside recordings (I)",
            is_active=lambda: scorecard.is_open,
        ),
        ToolButton(
            icon="compare",
            press=picture.comparison.hold,
            release=picture.comparison.release,
            hint=lambda: "Compare with the original (hold O)",
            is_active=lambda: picture.comparison.is_on,
        ),
        ToolButton(
            icon="live",
            press=live.toggle,
            hint=lambda: "Live: traffic reacts while you edit (Shift+R)",
            is_active=lambda: live.is_on,
        ),
        ToolButton(
            icon="help",
            press=key_sheet.open,
            hint=lambda: "Keys and mouse (?)",
            starts_group=True,
        ),
    )
