"""The status line: what is wrong with the scenario right now, in words."""

from typing import Final

from pd_editor.problems.check import checked, scene_problems
from pd_editor.problems.scene_problem import SceneProblem
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.desk import Desk, set_property
from pd_editor.viewer.state.page_text import plain

MAX_LISTED: Final = 4


class StatusPanel:
    """Warnings on top of all panels, and a button that selects whom they name."""

    def __init__(self, desk: Desk) -> None:
        """Build it into the current container."""
        self._desk = desk
        self._warnings: tuple[SceneProblem, ...] = ()
        self._recorded: tuple[SceneProblem, ...] = ()
        self._base: Scenario | None = None
        gui = desk.client.gui
        self._text = gui.add_markdown("")
        self._select = gui.add_button(
            "Select these agents", color="orange", visible=False
        )
        desk.on_click(self._select, lambda: desk.session.select(self._named()))

    def check(self, *, with_future: bool) -> None:
        """Look at the scenario; warnings about the future wait for a calm moment.

        What the recording itself contains is counted, not listed.
        """
        session = self._desk.session
        if self._base is not session.base:
            self._base = session.base
            self._recorded = scene_problems(session.base)
        found = checked(
            session.scenario, session.base, self._recorded, with_future=with_future
        )
        self._warnings = found.new

    def warned_now(self) -> frozenset[str]:
        """Agents with something wrong at the current step."""
        return frozenset(
            agent_id
            for warning in self._warnings
            if warning.is_now
            for agent_id in warning.agent_ids
        )

    def problem_ids(self) -> tuple[frozenset[str], frozenset[str]]:
        """Agents with a problem at any time, and those with one after t = 0."""
        named = [
            (w.kind.startswith("future"), set(w.agent_ids)) for w in self._warnings
        ]
        everywhere = frozenset().union(*(ids for _, ids in named))
        later = frozenset().union(*(ids for is_later, ids in named if is_later))
        return everywhere, later

    @property
    def num_problems(self) -> int:
        """How many warnings edits have caused."""
        return len(self._warnings)

    def show(self) -> None:
        """Show the warnings found last."""
        count = len(self._warnings)
        set_property(self._select, "visible", count > 0)
        if not count:
            recorded = len(self._recorded)
            text = "No overlaps, nobody off the road."
            if recorded:
                text = f"No new warnings ({recorded} in the recording itself)."
            set_property(self._text, "content", text)
            return
        lines = [f"- {plain(w.message)}" for w in self._warnings[:MAX_LISTED]]
        if count > MAX_LISTED:
            lines.append(f"- ... and {count - MAX_LISTED} more")
        if any(not warning.is_now for warning in self._warnings):
            lines.append("\nFutures can be regenerated in the Drive tab (R).")
        title = f"**{count} warning{'s' if count > 1 else ''}**\n\n"
        set_property(self._text, "content", title + "\n".join(lines))

    def _named(self) -> tuple[str, ...]:
        there = self._desk.session.scenario.agents.row_of
        named = dict.fromkeys(
            agent_id for warning in self._warnings for agent_id in warning.agent_ids
        )
        return tuple(agent_id for agent_id in named if agent_id in there)
