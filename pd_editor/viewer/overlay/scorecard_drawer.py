"""The scorecard over the picture's left side, and charts of the selected agents."""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.metrics.agent_profile import agent_profile
from pd_editor.metrics.scorecard import Level, Occurrence, ScoreRow, scorecard
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.state.ui_context import UiContext

MAX_CHARTED: Final = 3
"""Number of selected agents with lines in the charts."""
_TONE: Final[dict[Level, str]] = {
    "usual": "good",
    "unusual": "warn",
    "extreme": "bad",
}


class ScorecardDrawer:
    """The element ``scorecard``; a row goes to where its value is worst.

    Metrics are computed while it is open only, after an edit and not during a gesture.
    """

    def __init__(
        self,
        ui: UiContext,
        overlay: Overlay,
        *,
        go_to: Callable[[Occurrence], None],
        on_opened: Callable[[], None],
    ) -> None:
        """Start closed.

        Args:
            ui: the session and its page.
            overlay: where it is shown.
            go_to: takes selection, camera and time to an occurrence.
            on_opened: called when it was opened or closed.
        """
        self._ui = ui
        self._overlay = overlay
        self._go_to = go_to
        self._on_opened = on_opened
        self._scored: Scenario | None = None
        self._rows: tuple[ScoreRow, ...] = ()
        self._charted: tuple[Scenario, tuple[str, ...]] | None = None
        self.is_open = False
        overlay.on("scorecard", self._used)

    def toggle(self) -> None:
        """Open it, or close it."""
        self.set_open(not self.is_open)

    def set_open(self, is_open: bool) -> None:
        """Open or close it."""
        if is_open == self.is_open:
            return
        self.is_open = is_open
        self._scored = self._charted = None
        if is_open:
            self.show()
        else:
            self._overlay.show("scorecard", {"isOpen": False})
        self._on_opened()

    def show(self) -> None:
        """Follow scenario and selection."""
        session = self._ui.session
        if not self.is_open or session.state.is_previewing:
            return
        scenario = session.scenario
        if self._scored is not scenario:
            self._scored, self._rows = scenario, scorecard(scenario)
            self._overlay.show(
                "scorecard",
                {"isOpen": True, "rows": [_row(scenario, row) for row in self._rows]},
            )
        charted = (scenario, session.selection[:MAX_CHARTED])
        if self._charted != charted:
            self._charted = charted
            self._overlay.show("charts", _charts(*charted))

    def _used(self, event: Mapping[str, Any]) -> None:
        kind = event.get("kind")
        if kind == "close":
            self.set_open(False)
        elif kind == "row" and self.is_open:
            names = [row.name for row in self._rows]
            name = event.get("name")
            worst = self._rows[names.index(name)].worst if name in names else None
            there = self._ui.session.scenario.agents.row_of
            if worst is not None and worst.agent_id in there:
                self._go_to(worst)


def _row(scenario: Scenario, row: ScoreRow) -> dict[str, Any]:
    scale, unit = (100.0, "%") if row.unit == "share" else (1.0, row.unit)
    usual = row.usual
    low, high = (f"{scale * value:.3g}" for value in (usual.low, usual.high))
    value = "\u2013" if math.isnan(row.value) else f"{scale * row.value:.3g} {unit}"
    where = ""
    if row.worst is not None:
        later = row.worst.step - scenario.current_step
        where = f"{row.worst.agent_id}, {later * scenario.time_axis.step_s:.1f} s"
    return {
        "name": row.name,
        "title": row.title,
        "tone": _TONE[row.level],
        "level": row.level,
        "value": value,
        "usual": f"{low} \u2013 {high}",
        "where": where,
    }


def _charts(scenario: Scenario, ids: tuple[str, ...]) -> dict[str, Any]:
    """Lines of the charts; None where an agent is not there."""
    profiles = [agent_profile(scenario, one) for one in ids]
    titles = ("Speed, m/s", "Acceleration, m/s\u00b2", "Gap to the nearest, m")
    return {
        "ids": [one.agent_id for one in profiles],
        "time": profiles[0].time_s.round(2).tolist() if profiles else [],
        "charts": [
            {"title": title, "lines": [_numbers(line) for line in lines]}
            for title, lines in zip(
                titles,
                (
                    [one.speed_mps for one in profiles],
                    [one.acceleration_mps2 for one in profiles],
                    [one.gap_m for one in profiles],
                ),
                strict=True,
            )
        ],
    }


def _numbers(values: Float[np.ndarray, "T"]) -> list[float | None]:
    return [
        round(value, 2) if math.isfinite(value) else None for value in values.tolist()
    ]
