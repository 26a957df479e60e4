"""Kinds of events, and the value of one."""

from dataclasses import dataclass
from typing import Final

from pd_editor.scene.time_axis import TimeAxis

EVENT_KINDS: Final[dict[str, str]] = {
    "lane-change-left": "",
    "lane-change-right": "",
    "left-turn": "turn",
    "right-turn": "turn",
    "u-turn": "turn",
    "straight": "",
    "stands": "",
    "stop-and-go": "",
    "parked": "",
    "hard-braking": "braking",
    "following": "headway",
    "cut-in": "headway",
    "merge": "lag",
    "crossing": "pet",
    "yielding": "pet",
    "overtaking": "",
    "on-crosswalk": "",
    "cyclist-beside": "gap",
    "near-miss": "ttc",
}
"""The quantity that each kind of event has as its value; empty: none.

turn: degrees; braking: m/s2; headway, lag, pet (post-encroachment time) and ttc (time to
collision): seconds; gap: metres between the boxes.
"""


@dataclass(frozen=True, kw_only=True)
class SceneEvent:
    """Something that an agent does, alone or towards another one."""

    kind: str
    agent_id: str
    """Who does it: who cuts in, yields, overtakes, follows, or comes second."""
    other_id: str = ""
    begin_s: float
    """Seconds after the current step."""
    end_s: float
    value: float | None = None
    """What ``EVENT_KINDS`` names."""

    @property
    def agent_ids(self) -> tuple[str, ...]:
        """Who does it, and towards whom, if anybody."""
        return (self.agent_id, self.other_id) if self.other_id else (self.agent_id,)

    def first_step(self, axis: TimeAxis) -> int:
        """Step of a time axis at which it begins, or the one next to that."""
        step = axis.current_step + round(self.begin_s / axis.step_s)
        return min(max(step, 0), axis.num_steps - 1)
