"""Hints for a first session, each gone once it was followed."""

from pd_editor.editor.commands import ReplaceTraffic, TransformAgents
from pd_editor.editor.session import EditorSession
from pd_editor.viewer.overlay.messages import HintsDone, HintsState
from pd_editor.viewer.overlay.overlay import Overlay


class Hints:
    """One small card over the picture; the browser remembers what was done."""

    def __init__(self, overlay: Overlay) -> None:
        """Show nothing yet."""
        self._overlay = overlay

    def show(self, session: EditorSession) -> None:
        """Send which hints the session has fulfilled, and whether there is no agent."""
        commands = [part for one in session.entries for part in one.command.parts]
        done = HintsDone(
            select=bool(session.selection),
            drag=any(isinstance(one, TransformAgents) for one in commands),
            bend=session.scenario.applied_warp is not None,
            regenerate=any(isinstance(one, ReplaceTraffic) for one in commands),
        )
        is_empty = not len(session.scenario.agents)
        self._overlay.show(HintsState(is_empty=is_empty, done=done))
