"""A problem of a scenario, as a value."""

from dataclasses import dataclass
from typing import Final, Literal

from pd_editor.metrics.step_spans import Spans, holds_at
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
"""Kinds of problems at the current step; the others are at later steps."""
_KIND_NAME: Final[dict[AgentKind, str]] = {
    AgentKind.STATIC: "static object",
    AgentKind.BACKGROUND: "background object",
    AgentKind.CONSTRUCTION: "construction object",
    AgentKind.UNKNOWN: "object",
}
ProblemKey = tuple[ProblemKind, tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class SceneProblem:
    """A collision, an agent off the road or too fast, or a road that bends too sharply."""

    kind: ProblemKind
    agent_ids: tuple[str, ...]
    """Ids of the agents involved; empty for a problem of the road."""
    spans: Spans
    """First and last steps of the intervals at which the problem holds, in order."""
    worst_step: int
    severity: float
    """Shared area (m^2), distance from the road (m), ratio of acceleration to its limit,
    or ratio of least to actual radius; comparable within a kind."""
    headline: str
    """Short text for lists."""
    message: str
    """One sentence for the user."""
    place_m: tuple[float, float]
    """Position of the first occurrence in the scene frame."""

    @property
    def key(self) -> ProblemKey:
        """Key by which a problem is recognised after further edits."""
        return self.kind, self.agent_ids

    @property
    def first_step(self) -> int:
        """First step at which the problem holds."""
        return self.spans[0][0]

    @property
    def is_now(self) -> bool:
        """Whether the problem is at the current step."""
        return self.kind in NOW_KINDS

    def num_steps(self) -> int:
        """Number of steps at which the problem holds."""
        return sum(last - first + 1 for first, last in self.spans)

    def holds_at(self, step: float) -> bool:
        """Whether the problem holds at a step; half steps are rounded."""
        return holds_at(self.spans, step)


def agent_name(agents: AgentTracks, row: int) -> str:
    """Kind and id of an agent, for the middle of a sentence."""
    kind = agents.kinds[row]
    return f"{_KIND_NAME.get(kind, kind.in_words)} {agents.ids[row]}"


def at_time(scenario: Scenario, step: int) -> str:
    """Time of a step relative to the current one, in the timeline's format."""
    later = (step - scenario.current_step) * scenario.time_axis.step_s
    return f"at {later:.1f} s"


def capitalised(text: str) -> str:
    """Capitalise the first letter of a sentence."""
    return text[:1].upper() + text[1:]
