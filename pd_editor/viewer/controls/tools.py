"""Tools of the toolbar: what they do, and their state."""

from pd_editor.editor.session import EditorSession
from pd_editor.viewer.agents.agent_list import AgentList
from pd_editor.viewer.controls.control_panel import ControlPanel
from pd_editor.viewer.controls.key_sheet import KeySheet
from pd_editor.viewer.controls.modes import Modes
from pd_editor.viewer.controls.picture import Picture
from pd_editor.viewer.controls.toolbar import ToolButton
from pd_editor.viewer.findings.scorecard_drawer import ScorecardDrawer
from pd_editor.viewer.scene.viewpoint import Viewpoint


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
) -> tuple[tuple[ToolButton, ...], ...]:
    """Groups of tools of a tab, from left to right."""
    comparison, live = picture.comparison, panels.generation.live_switch
    return (
        _history_tools(session, panels),
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
                "measure",
                modes.measure.toggle,
                "Measure distances (M)",
                is_active=lambda: modes.measure.is_active,
            ),
            ToolButton(
                "place",
                modes.placing.toggle,
                "Place agents (P)",
                is_active=lambda: modes.placing.is_active,
            ),
            ToolButton(
                "agents",
                agent_list.toggle,
                "Agent list (Ctrl+F)",
                is_active=lambda: agent_list.is_open,
            ),
            ToolButton(
                "scorecard",
                scorecard.toggle,
                "Scorecard: metrics beside recordings (I)",
                is_active=lambda: scorecard.is_open,
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
        (ToolButton("help", key_sheet.open, "Keys and mouse (?)"),),
    )


def _history_tools(
    session: EditorSession, panels: ControlPanel
) -> tuple[ToolButton, ...]:
    """Undo and redo, which name the edit."""

    def named(action: str, index: int, key: str) -> str:
        entries = session.entries
        what = f": {entries[index].label}" if 0 <= index < len(entries) else ""
        return f"{action}{what} ({key})"

    return (
        ToolButton(
            "undo",
            panels.history.undo,
            lambda: named("Undo", session.state.position - 1, "Ctrl+Z"),
            is_enabled=lambda: session.can_undo,
        ),
        ToolButton(
            "redo",
            panels.history.redo,
            lambda: named("Redo", session.state.position, "Ctrl+Shift+Z"),
            is_enabled=lambda: session.can_redo,
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
