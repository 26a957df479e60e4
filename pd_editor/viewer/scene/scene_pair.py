"""Two scenarios side by side in top view, on one clock."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from pd_editor.editor.library.thumbnail import PictureFrame, ground_path
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.overlay.messages import (
    Choice,
    PairAgent,
    PairSide,
    ScenePairEvent,
    ScenePairState,
)
from pd_editor.viewer.tab.ui_context import UiContext

_OTHER, _FOCAL, _EGO, _PEDESTRIAN = range(4)


class ScenePair:
    """The element ``pair``: the page draws two scenarios at its playhead.

    Each side has a menu of all scenarios of a strip.
    """

    def __init__(self, ui: UiContext, *, noun: str, use: Callable[[int], None]) -> None:
        """Show nothing yet; ``use`` is called with the index of one of both."""
        self._ui, self._overlay = ui, ui.overlay
        self._noun, self._use = noun, use
        self._offered: Mapping[int, tuple[str, Scenario]] = {}
        self._frame: PictureFrame | None = None
        self._adopted: int | None = None
        self._compared = (0, 0)
        self.is_open = False

    def open(
        self,
        index: int,
        offered: Mapping[int, tuple[str, Scenario]],
        frame: PictureFrame,
        *,
        adopted: int | None,
    ) -> None:
        """Show one beside the one in use, or that one beside the first other.

        ``offered`` are names and scenarios of the menus, by index, in their order.
        """
        self._offered, self._frame, self._adopted = offered, frame, adopted
        others = (*(one for one in offered if one == adopted), *offered)
        self._compared = next(one for one in others if one != index), index
        self._overlay.on("pair", self._heard)
        self._ui.model.pair_opened.emit()
        self._show()

    def _choose(self, side: int, index: int) -> None:
        """Put a scenario on one side; one that is on the other side changes places."""
        if index not in self._offered:
            return
        kept = self._compared[1 - side]
        if kept == index:
            kept = self._compared[side]
        self._compared = (index, kept) if side == 0 else (kept, index)
        self._show()

    def _show(self) -> None:
        frame, adopted = self._frame, self._adopted
        assert frame is not None
        self.is_open = True
        # Width of the ground that is sent, relative to the frame: the page can be
        # panned.
        wide = PictureFrame(middle_m=frame.middle_m, scale=frame.scale * 4.0)
        state = ScenePairState(
            is_open=True,
            noun=self._noun,
            half_width=round(frame.half_size_m[0], 1),
            offered=tuple(
                Choice(
                    value=index, text=f"{name}, in use" if index == adopted else name
                )
                for index, (name, _) in self._offered.items()
            ),
            sides=tuple(
                PairSide(
                    index=index,
                    is_adopted=index == adopted,
                    ground=ground_path(self._offered[index][1].road_map, wide),
                    agents=tuple(_paths(self._offered[index][1], frame)),
                )
                for index in self._compared
            ),
        )
        self._overlay.show(state)

    def close(self) -> bool:
        """Close it; returns whether it was open."""
        was_open, self.is_open = self.is_open, False
        if was_open:
            self._overlay.show(ScenePairState())
        return was_open

    def _heard(self, event: ScenePairEvent) -> None:
        if event.kind == "close":
            self.close()
        elif not self.is_open:
            return
        elif event.kind == "use":
            self._use(event.value)
        elif event.side in (0, 1):
            self._choose(event.side, event.value)


def _paths(scenario: Scenario, frame: PictureFrame) -> Iterator[PairAgent]:
    """Boxes and trajectories from the current step on, as far as agents exist.

    Positions are in decimetres from the middle of the frame, headings in hundredths of
    radians without jumps.
    """
    agents, now = scenario.agents, scenario.current_step
    for row in np.flatnonzero(agents.is_valid[:, now]).tolist():
        absent = np.flatnonzero(~agents.is_valid[row, now:])
        steps = slice(now, now + int(absent[0]) if len(absent) else None)
        place = 10 * (agents.position_m[row, steps] - frame.middle_m)
        heading = 100 * np.unwrap(agents.heading_rad[row, steps])
        table = np.rint(np.column_stack([place, heading])).astype(int)
        length, width = agents.size_m[row].tolist()
        yield PairAgent(
            length=round(length, 2),
            width=round(width, 2),
            color=_color(scenario, row),
            path=tuple(table.ravel().tolist()),
        )


def _color(scenario: Scenario, row: int) -> int:
    agents = scenario.agents
    if agents.ids[row] == scenario.focal_id:
        return _FOCAL
    if agents.ids[row] == EGO_ID:
        return _EGO
    return _PEDESTRIAN if agents.kinds[row] is AgentKind.PEDESTRIAN else _OTHER
