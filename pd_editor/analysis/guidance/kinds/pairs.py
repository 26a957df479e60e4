"""Kinds of terms on two agents: yielding to another one, and threatening it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, ClassVar, Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.findings.collisions import later_collisions
from pd_editor.analysis.guidance.guidance_kind import (
    MAX_BRAKING_MPS2,
    AgentNow,
    Driven,
    Found,
    GuidanceKind,
    Measured,
    Plan,
    Refusal,
    Tool,
)
from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.analysis.metrics.traffic_view import whole_traffic
from pd_editor.analysis.threats.encounter import (
    APPROACH_WORDS,
    Approach,
    Track,
    encounter,
)
from pd_editor.analysis.threats.threat_feasibility import (
    OBSTACLES,
    encounter_in_words,
    expected_tracks,
    meets,
    obstacle_in_words,
    recorded_track,
    threat_obstacle,
)
from pd_editor.analysis.threats.threat_plans import ThreatAim, ThreatObstacle
from pd_editor.scene.guidance_terms import (
    AgentGuidance,
    Form,
    GuidanceTerm,
    PairGuidance,
)
from pd_editor.scene.paths.driving_paths import SPACING_M
from pd_editor.scene.scenario import Scenario

_STRIDE: Final = 2


@dataclass(frozen=True, kw_only=True)
class YieldTo(PairGuidance):
    """Let another agent pass first."""

    kind: ClassVar[str] = "yield-to"
    noun: ClassVar[str] = "yielding"

    @property
    def place(self) -> tuple[str, ...]:
        """An agent can yield to several others."""
        return self.kind, *self.named_ids

    @property
    def in_words(self) -> str:
        """Name of the term with both agents."""
        return f"yielding of agent {self.agent_id} to {self.other_id}"


def yield_problems(term: YieldTo, plan: Plan) -> Found:
    """Whether the paths of two agents meet, and whether one can wait before that."""
    if plan.keeps(term.agent_id):
        return
    agent, other = plan.agents(term.named_ids)
    if plan.generates(term.other_id):
        theirs = driven_paths_m(other)
    else:
        theirs = recorded_track(plan.scenario, other.row).position_m[None]
    places = _meeting_places_m(driven_paths_m(agent), theirs)
    if not len(places):
        yield (
            f"The paths of {agent.name} and {other.name} do not meet; choose another "
            "agent to yield to."
        )
        return
    length = float(plan.scenario.agents.size_m[agent.row, 0])
    room = float(places.max()) - length
    needed = agent.speed_mps**2 / (2 * max(room, 0.01))
    if room <= 0 and agent.speed_mps > 0:
        yield (
            f"{agent.subject} is where the paths meet already, so it cannot let "
            f"{other.name} pass; remove the term."
        )
    elif needed > MAX_BRAKING_MPS2:
        yield (
            f"To let {other.name} pass, {agent.name} would have to brake with "
            f"{needed:.1f} m/s² in {room:.0f} m from {agent.speed_mps:.1f} m/s; choose "
            "the other one to yield."
        )


def driven_paths_m(agent: AgentNow) -> Float[np.ndarray, "P N 2"]:
    """The parts of an agent's paths that it could drive."""
    most = int(agent.reach_m(agent.duration_s)[1] / SPACING_M) + 1
    return agent.paths_m[:, :most:_STRIDE]


def _meeting_places_m(
    mine_m: Float[np.ndarray, "P N 2"], theirs_m: Float[np.ndarray, "Q M 2"]
) -> Float[np.ndarray, "K"]:
    """Arc lengths at which each path of an agent first meets each of the other's."""
    places: list[float] = []
    for path in mine_m:
        gap = path[:, None, None] - theirs_m
        # Paths that come this close meet.
        meets = ((gap**2).sum(-1) < 2.5**2).any(axis=2)
        first = meets.argmax(axis=0)[meets.any(axis=0)]
        places += (first * _STRIDE * SPACING_M).tolist()
    return np.array(places)


def _yield_clash(
    term: YieldTo, other: GuidanceTerm, _shared: str | None, _plan: Plan
) -> Found:
    if isinstance(other, YieldTo) and term.named_ids == other.named_ids[::-1]:
        yield (
            f"Agents {term.agent_id} and {term.other_id} yield to each other; keep one "
            "of both terms."
        )


def _yield_outcome(term: YieldTo, driven: Driven) -> Measured | None:
    """Time between the agents at the places where both have been."""
    first, second = map(driven.track, term.named_ids)
    if first is None or second is None:
        return None
    asked = f"passes after agent {term.other_id}"
    place, time = np.nonzero(shared_places(first, second))
    if not len(place):
        return Measured(
            asked=asked,
            achieved=f"stays clear of the path of agent {term.other_id}",
            error=0.0,
            unit="s",
            is_obeyed=True,
            has_no_case=True,
        )
    after_s = float((place - time).min()) * driven.step_s
    achieved = (
        f"{after_s:.1f} s after it" if after_s > 0 else f"{-after_s:.1f} s before it"
    )
    return Measured(
        asked=asked,
        achieved=achieved,
        error=max(-after_s, 0.0),
        unit="s",
        is_obeyed=after_s > 0,
    )


def shared_places(first: Track, second: Track) -> Bool[np.ndarray, "H H"]:
    """Whether the box of one agent at a step is where the other one's is at another."""
    count = len(first.position_m)
    place, time = (one.ravel() for one in np.indices((count, count)))
    touches = boxes_touch(first.at(place), second.at(time))
    return touches.reshape(count, count)


YIELD: Final = GuidanceKind(
    value=YieldTo,
    title="Yield",
    short_title="Yield to",
    hint="Click the agent that passes first (Y)",
    icon="M3 4.5h14L10 16.5z",
    asks=lambda term: f"let {term.other_id} pass first",
    outcome=_yield_outcome,
    check=yield_problems,
    clash=_yield_clash,
    tool=Tool("pick", "click the agent that passes first.", "Yield to an agent", "Y"),
    shape="arrow",
)


@dataclass(frozen=True, kw_only=True)
class Threaten(PairGuidance):
    """Come dangerously close to another agent, which is left unchanged."""

    kind: ClassVar[str] = "threaten"
    noun: ClassVar[str] = "threat"

    severity: Annotated[float, Form("Severity", "severity", most=1.0, step=0.1)] = 1.0
    """0: a tight gap, 1: contact."""
    approach: Annotated[Approach, Form("How", "approach", choices=APPROACH_WORDS)] = (
        "rear"
    )

    @property
    def in_words(self) -> str:
        """Name of the term with both agents."""
        how = APPROACH_WORDS[self.approach]
        return f"threat of agent {self.agent_id} to {self.other_id} ({how})"


def _threat_problems(term: Threaten, plan: Plan) -> Found:
    """Why a threat cannot be carried out, and by which approach it could."""
    if plan.keeps(term.agent_id):
        return
    if not plan.scenario.time_axis.num_future_steps:
        yield Refusal(
            "The scenario ends at its current step, so no agent can threaten."
        )
        return
    ids = tuple(plan.agent_ids or ())
    obstacle = _obstacle(plan.scenario, term, ids)
    if obstacle is None:
        return
    others = [
        f'"{words}" ({approach})'
        for approach, words in APPROACH_WORDS.items()
        if approach != term.approach
        and _obstacle(plan.scenario, replace(term, approach=approach), ids) is None
    ]
    aim = ThreatAim.of(term.approach, term.severity)
    goal = "contact" if aim.is_contact else f"a gap of {aim.gap_m:.1f} m"
    way = f"the approach {' or '.join(others)}" if others else "another agent"
    axis = plan.scenario.time_axis
    other, duration_s = f"agent {term.other_id}", axis.future_s
    why = obstacle_in_words(obstacle, term.approach, other, duration_s)
    yield Refusal(
        f"Agent {term.agent_id} cannot come to {goal} with {other} "
        f"({APPROACH_WORDS[term.approach]}): {why}; choose {way}."
    )


def approach_obstacles(
    scenario: Scenario, term: Threaten
) -> dict[str, tuple[str, str]]:
    """Why approaches are infeasible, in few words and in a sentence; none of others.

    All other agents keep their trajectories. Empty if an agent is not there.
    """
    agents, now = scenario.agents, scenario.current_step
    rows = [agents.row_of.get(name, -1) for name in term.named_ids]
    if min(rows) < 0 or not agents.is_valid[rows, now].all():
        return {}
    duration_s = scenario.time_axis.future_s
    found: dict[str, tuple[str, str]] = {}
    for approach in APPROACH_WORDS:
        obstacle = _obstacle(scenario, replace(term, approach=approach), ())
        if obstacle is not None:
            other = f"agent {term.other_id}"
            why = obstacle_in_words(obstacle, approach, other, duration_s)
            found[approach] = (OBSTACLES[obstacle.kind], f"{why[0].upper()}{why[1:]}.")
    return found


@lru_cache(maxsize=256)
def _obstacle(
    scenario: Scenario, term: Threaten, generated_ids: tuple[str, ...]
) -> ThreatObstacle | None:
    """Cached: each sample of a run asks again."""
    (other,) = scenario.agents.rows((term.other_id,))
    is_kept = term.other_id not in generated_ids
    tracks = expected_tracks(scenario, int(other), is_kept=is_kept)
    return _obstacle_past(scenario, term, tracks, generated_ids)


def _obstacle_past(
    scenario: Scenario,
    term: Threaten,
    tracks: Sequence[Track],
    generated_ids: Sequence[str],
) -> ThreatObstacle | None:
    """What is in the way of a threat to an agent with such trajectories."""
    aim = ThreatAim.of(term.approach, term.severity)
    return threat_obstacle(scenario, term.named_ids, aim, tracks, generated_ids)


def _threat_clash(
    term: Threaten, other: GuidanceTerm, _shared: str | None, _plan: Plan
) -> Found:
    if isinstance(other, Threaten):
        if term.agent_id == other.agent_id:
            yield f"Agent {term.agent_id} threatens two agents; keep one of the threats."
        elif term.agent_id == other.other_id or term.other_id == other.agent_id:
            both = term.agent_id if term.agent_id == other.other_id else term.other_id
            yield (
                f"Agent {both} threatens another agent and is threatened, which leaves "
                "it unchanged; keep one of the threats."
            )
    elif isinstance(other, AgentGuidance) and term.agent_id == other.agent_id:
        yield (
            f"Agent {term.agent_id} threatens another agent, which decides its "
            f"trajectory, so its {other.name} may not be met; keep one of both terms."
        )


def _threat_outcome(term: Threaten, driven: Driven) -> Measured | None:
    """Encounter of the agent that threatens with the one that is threatened."""
    first, second = map(driven.track, term.named_ids)
    if first is None or second is None:
        return None
    found = encounter(first, second, driven.step_s, term.approach)
    aim = ThreatAim.of(term.approach, term.severity)
    is_met = meets(aim, found)
    until = round(found.at_s / driven.step_s)
    hit = _first_hit(driven, term, until)
    achieved, obstacle = encounter_in_words(found, aim.approach), None
    if hit is not None:
        achieved += f", but hits {hit[0]} after {hit[1]:.1f} s"
    if not is_met:
        ids = driven.sample.ids
        obstacle = _obstacle_past(driven.scenario, term, (second,), ids)
    if obstacle is not None:
        other, duration_s = f"agent {term.other_id}", driven.step_s * driven.num_steps
        why = obstacle_in_words(obstacle, term.approach, other, duration_s)
        achieved += f"; as {other} moves, {why}"
    elif not is_met and hit is None:
        achieved += "; the model can drive none of the ways that meet it"
    return Measured(
        asked=f"{'contact' if aim.is_contact else f'gap {aim.gap_m:.1f} m'} ({aim.approach})",
        achieved=achieved,
        # Stands for a gap that was never counted.
        error=abs(min(found.counted_gap_m, 1e3) - aim.gap_m),
        unit="m",
        is_obeyed=is_met and hit is None,
        is_feasible=obstacle is None,
    )


def _first_hit(driven: Driven, term: Threaten, until: int) -> tuple[str, float] | None:
    """What the agent that threatens hits first besides the other one, up to a step."""
    everyone = whole_traffic(driven.scenario, driven.sample)
    pairs, begins = later_collisions(everyone.from_step(driven.scenario.current_step))
    own = everyone.ids.index(term.agent_id)
    others = np.where(pairs[:, 0] == own, pairs[:, 1], pairs[:, 0])
    counted = (pairs == own).any(axis=1) & (begins <= until)
    for row in np.flatnonzero(counted)[np.argsort(begins[counted], kind="stable")]:
        if everyone.ids[others[row]] != term.other_id:
            return everyone.ids[others[row]], float(begins[row]) * driven.step_s
    return None


THREAT: Final = GuidanceKind(
    value=Threaten,
    title="Threaten",
    hint="Click the agent that is threatened (X)",
    icon="M11.5 2.5 5 11h4.3L8 17.5l7-9h-4.6z",
    asks=lambda term: (
        f"threaten {term.other_id} ({APPROACH_WORDS[term.approach]}, "
        f"{term.severity:.0%})"
    ),
    outcome=_threat_outcome,
    check=_threat_problems,
    clash=_threat_clash,
    tool=Tool("pick", "click the agent that it threatens.", "Threaten an agent", "X"),
    shape="arrow",
)
