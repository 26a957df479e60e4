"""One thing that is wrong with a scenario."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Int

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario

ProblemKind = Literal[
    "collision",
    "later-collision",
    "off-road",
    "later-off-road",
    "friction",
    "sharp-road",
    "folded-road",
]
NOW_KINDS: Final[frozenset[ProblemKind]] = frozenset(
    {"collision", "off-road", "sharp-road", "folded-road"}
)
"""Problems of the state at the current step; the others come after it."""
_KIND_NAME: Final[dict[AgentKind, str]] = {
    kind: kind.value.replace("_", " ") for kind in AgentKind
} | {
    AgentKind.STATIC: "static object",
    AgentKind.BACKGROUND: "background object",
    AgentKind.CONSTRUCTION: "construction object",
    AgentKind.UNKNOWN: "object",
}
_GAP_STEPS: Final = 2
"""Spans that are no further apart are joined."""

ProblemKey = tuple[ProblemKind, tuple[str, ...]]
Spans = tuple[tuple[int, int], ...]


@dataclass(frozen=True, kw_only=True)
class SceneProblem:
    """A collision, an agent off the road or too fast, or a road that is too sharp."""

    kind: ProblemKind
    agent_ids: tuple[str, ...]
    """Those concerned; none where it is the road."""
    spans: Spans
    """First and last steps of the times at which it holds, in order."""
    worst_step: int
    severity: float
    """Shared area (m^2), distance from the road (m), acceleration over its limit, or
    radius wanted over radius; comparable within a kind."""
    headline: str
    """A few words for a list."""
    message: str
    """One sentence for the user."""
    place_m: tuple[float, float]
    """Where it happens first."""

    @property
    def key(self) -> ProblemKey:
        """What makes it the same problem after another edit."""
        return self.kind, self.agent_ids

    @property
    def first_step(self) -> int:
        """When it happens first."""
        return self.spans[0][0]

    @property
    def is_now(self) -> bool:
        """Whether it is about the state at the current step."""
        return self.kind in NOW_KINDS

    def num_steps(self) -> int:
        """How long it lasts in all."""
        return sum(last - first + 1 for first, last in self.spans)

    def holds_at(self, step: float) -> bool:
        """Whether it holds at a step; half steps are rounded."""
        nearest = round(step)
        return any(first <= nearest <= last for first, last in self.spans)


def spans_of(steps: Int[np.ndarray, "N"]) -> Spans:
    """Runs of rising steps as first and last ones; short gaps are passed over."""
    breaks = np.flatnonzero(np.diff(steps) > _GAP_STEPS)
    first = steps[np.concatenate([[0], breaks + 1])]
    last = steps[np.concatenate([breaks, [len(steps) - 1]])]
    return tuple(zip(first.tolist(), last.tolist(), strict=True))


def agent_name(agents: AgentTracks, row: int) -> str:
    """Kind and id for the middle of a sentence."""
    return f"{_KIND_NAME[agents.kinds[row]]} {agents.ids[row]}"


def at_time(scenario: Scenario, step: int) -> str:
    """The time of a step, counted from the current one, as the timeline shows it."""
    later = (step - scenario.current_step) * scenario.time_axis.step_s
    return f"at {later:.1f} s"


def capitalised(text: str) -> str:
    """A sentence's first letter made large."""
    return text[:1].upper() + text[1:]
