"""Two samples side by side in top view, on one clock."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from pd_editor.editor.library.thumbnail import PictureFrame, ground_path
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.overlay.messages import (
    PairAgent,
    PairOffer,
    PairSample,
    SamplePairState,
)
from pd_editor.viewer.overlay.overlay import Overlay

GROUND_SCALE: Final = 4.0
"""Width of the ground that is sent, relative to the frame: the page can be panned."""
_OTHER, _FOCAL, _EGO, _PEDESTRIAN = range(4)


class SamplePair:
    """The element ``sample-pair``: the page draws both samples at its playhead.

    Each side has a menu of all samples.
    """

    def __init__(
        self,
        overlay: Overlay,
        *,
        use: Callable[[int], None],
        choose: Callable[[int, int], None],
    ) -> None:
        """Show nothing yet.

        ``use`` adopts one of both samples; ``choose`` is called with a side, 0 or 1,
        and the sample that is wanted there.
        """
        self._overlay = overlay
        self._use = use
        self._choose = choose
        self.is_open = False
        overlay.on("sample-pair", self._heard)

    def show(
        self,
        samples: Sequence[tuple[int, Scenario]],
        frame: PictureFrame,
        *,
        adopted: int | None,
        offered: Sequence[int],
    ) -> None:
        """Show two samples with their indices, the left one first.

        ``offered`` are the samples of the menus, and ``adopted`` is the one in use.
        """
        self.is_open = True
        wide = PictureFrame(middle_m=frame.middle_m, scale=frame.scale * GROUND_SCALE)
        state = SamplePairState(
            is_open=True,
            half_width=round(frame.half_size_m[0], 1),
            ground=ground_path(samples[0][1].road_map, wide),
            offered=tuple(
                PairOffer(index=index, is_adopted=index == adopted) for index in offered
            ),
            samples=tuple(
                PairSample(
                    index=index,
                    is_adopted=index == adopted,
                    agents=tuple(_paths(scenario, frame)),
                )
                for index, scenario in samples
            ),
        )
        self._overlay.show(state)

    def close(self) -> bool:
        """Close it; returns whether it was open."""
        was_open, self.is_open = self.is_open, False
        if was_open:
            self._overlay.show(SamplePairState())
        return was_open

    def _heard(self, event: Mapping[str, Any]) -> None:
        kind, value, side = (event.get(name) for name in ("kind", "value", "side"))
        if kind == "close":
            self.close()
        elif not isinstance(value, int) or not self.is_open:
            return
        elif kind == "use":
            self._use(value)
        elif kind == "choose" and isinstance(side, int) and side in (0, 1):
            self._choose(side, value)


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
