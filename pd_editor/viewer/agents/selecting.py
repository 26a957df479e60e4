"""Selections by rule: all agents, the others, those of the same kind."""

import numpy as np

from pd_editor.base.errors import EditError
from pd_editor.viewer.tab.ui_context import UiContext


class Selecting:
    """Selects among the agents that the picture shows at the playhead."""

    def __init__(self, ui: UiContext) -> None:
        """Make the actions on a session's selection."""
        self._ui = ui

    def select_all(self) -> None:
        """Select every agent in the picture's time."""
        self._ui.session.select(self._present())

    def invert(self) -> None:
        """Select exactly those in the picture's time that are not selected."""
        selected = set(self._ui.session.selection)
        self._ui.session.select(
            agent for agent in self._present() if agent not in selected
        )

    def same_kind(self) -> None:
        """Select all in the picture's time of the kinds that are selected.

        Raises:
            EditError: nothing is selected.
        """
        session = self._ui.session
        agents = session.scenario.agents
        kinds = {agents.kinds[row] for row in agents.rows(session.selection)}
        if not kinds:
            raise EditError("Select an agent of the kind first.")
        session.select(
            agent
            for agent in self._present()
            if agents.kinds[agents.row_of[agent]] in kinds
        )

    def _present(self) -> tuple[str, ...]:
        poses = self._ui.model.poses
        ids = self._ui.session.scenario.agents.ids
        if poses is None or len(poses.is_present) != len(ids):
            return ()
        return tuple(ids[row] for row in np.flatnonzero(poses.is_present))
