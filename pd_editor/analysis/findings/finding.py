"""A finding: what is noticed about agents or the road of a scenario, as a value."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from jaxtyping import Int

from pd_editor.base.plain_text import number_of
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario

PastKind = Literal["harsh-past", "impossible-past"]
NowKind = Literal["collision", "off-road", "sharp-road", "folded-road", "no-past"]
"""Kinds of findings at the current step; the others, but past ones, are at later steps."""
FindingKind = (
    PastKind
    | NowKind
    | Literal[
        "later-collision",
        "later-off-road",
        "friction",
        "impossible-motion",
        "against-traffic",
        "guidance-not-run",
        "guidance-not-met",
        "near-pass",
        "short-time",
        "harsh-motion",
        "beyond-map",
        "far-from-lane",
        "standing",
        "fastest",
        "longest",
    ]
)
Severity = Literal["problem", "notice", "remark", "property"]
"""What does not occur in sound traffic; what is rare there; what a user of the data
should know of; and what is only told beside a metric."""
Source = Literal["recorded", "edited", "model", "guidance"]
SEVERITIES: Final[Mapping[str, Severity]] = {
    **dict.fromkeys(
        ("near-pass", "short-time", "harsh-motion", "harsh-past"), "notice"
    ),
    **dict.fromkeys(("beyond-map", "no-past"), "remark"),
    **dict.fromkeys(("far-from-lane", "standing", "fastest", "longest"), "property"),
}
"""Severities of kinds; the others are problems."""
_NOW_KINDS: Final = frozenset((*get_args(NowKind), *get_args(PastKind)))
_LESS_IS_WORSE: Final = frozenset(
    {"sharp-road", "folded-road", "near-pass", "short-time"}
)
_KIND_NAME: Final[dict[AgentKind, str]] = {
    AgentKind.STATIC: "static object",
    AgentKind.BACKGROUND: "background object",
    AgentKind.CONSTRUCTION: "construction object",
    AgentKind.UNKNOWN: "object",
}
FindingKey = tuple[str, tuple[str, ...], str]
IgnoredKey = tuple[str, tuple[str, ...], str, str]

Spans = tuple[tuple[int, int], ...]
"""First and last steps of intervals, in order."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What holds of some agents, or of the road, at some steps; where, and how much."""

    kind: FindingKind
    agent_ids: tuple[str, ...]
    """Ids of the agents involved; empty for a finding of the road."""
    spans: Spans
    """First and last steps of the intervals at which it holds, in order."""
    worst_step: int
    value: float
    """Worst value: shared area (m^2), distance from the road (m), acceleration, radius,
    gap (m) or time (s)."""
    limit: float
    """Limit of the value, in the same unit."""
    headline: str
    """Short text for lists."""
    message: str
    """One sentence for the user."""
    place_m: tuple[float, float]
    """Position of the first occurrence in the scene frame."""
    about: str = ""
    """What it is about if agents do not tell, such as the kind of a guidance term."""
    source: Source = "edited"
    sample: str = ""
    """Sampled trajectories that its agents follow; empty: none."""

    @property
    def key(self) -> FindingKey:
        """Key by which a finding is recognised after further edits."""
        return self.kind, self.agent_ids, self.about

    @property
    def ignored_key(self) -> IgnoredKey:
        """Key of a finding that a user ignores; it does not fit another sample's."""
        return *self.key, self.sample

    @property
    def severity(self) -> Severity:
        """Severity of its kind."""
        return SEVERITIES.get(self.kind, "problem")

    @property
    def is_problem(self) -> bool:
        """Whether it counts as a problem."""
        return self.severity == "problem"

    @property
    def is_fault(self) -> bool:
        """Whether it is a problem or a notice."""
        return self.severity in ("problem", "notice")

    @property
    def ratio(self) -> float:
        """How bad it is, comparable within a kind: value to limit; the value without."""
        if self.kind in _LESS_IS_WORSE:
            return self.limit / max(self.value, 1e-3)
        return self.value / (self.limit or 1.0)

    @property
    def first_step(self) -> int:
        """First step at which the finding holds."""
        return self.spans[0][0] if self.spans else self.worst_step

    @property
    def shown_step(self) -> int:
        """Step at which it is told: the first one of a problem, else the worst."""
        return self.first_step if self.is_problem else self.worst_step

    @property
    def is_now(self) -> bool:
        """Whether the finding is at the current step, or before."""
        return self.kind in _NOW_KINDS

    def num_steps(self) -> int:
        """Number of steps at which the finding holds."""
        return sum(last - first + 1 for first, last in self.spans)

    def holds_at(self, step: float) -> bool:
        """Whether the finding holds at a step; half steps are rounded."""
        return holds_at(self.spans, step)


def finding_of_agent(
    scenario: Scenario,
    kind: FindingKind,
    row: int,
    steps: Int[np.ndarray, "N"],
    *,
    value: float,
    words: tuple[str, str],
    limit: float = 0.0,
    worst: int | None = None,
) -> Finding:
    """A finding of one agent at increasing steps.

    The first of ``words`` follows its id as headline, the second its name as message.
    """
    agents, first = scenario.agents, int(steps[0])
    x, y = agents.position_m[row, first].tolist()
    return Finding(
        kind=kind,
        agent_ids=(agents.ids[row],),
        spans=spans_of(steps),
        worst_step=first if worst is None else worst,
        value=value,
        limit=limit,
        headline=f"{agents.ids[row]}{words[0]}",
        message=f"{capitalised(agent_name(agents, row))} {words[1]}",
        place_m=(x, y),
    )


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


def problems_in_words(counts: Mapping[str, int]) -> str:
    """Number of new problems, given by their kinds, and what of guidance is among them."""
    total = sum(counts.values())
    text = number_of(total, "new problem", "no")
    parts = [
        f"{counts[kind]} guidance {words}"
        for kind, words in (
            ("guidance-not-run", "not run"),
            ("guidance-not-met", "not met"),
        )
        if counts.get(kind)
    ]
    return f"{text} ({', '.join(parts)})" if parts else text


def spans_of(steps: Int[np.ndarray, "N"]) -> Spans:
    """First and last steps of the runs in increasing steps; short gaps are closed."""
    if steps[-1] - steps[0] < len(steps):
        return ((int(steps[0]), int(steps[-1])),)
    # Spans at most this far apart are joined.
    breaks = np.flatnonzero(np.diff(steps) > 2)
    first = steps[np.concatenate([[0], breaks + 1])]
    last = steps[np.concatenate([breaks, [len(steps) - 1]])]
    return tuple(zip(first.tolist(), last.tolist(), strict=True))


def holds_at(spans: Spans, step: float) -> bool:
    """Whether a step is in one of the intervals; half steps are rounded."""
    nearest = round(step)
    return any(first <= nearest <= last for first, last in spans)
