"""Problems of guidance before a run, and how samples have obeyed it.

Before a run, a term is checked against the paths that its agent could take and against
limits of acceleration; of other traffic, only against agents that stand on each path to a
goal. Samples are compared with unguided ones.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.findings.collisions import later_collisions
from pd_editor.analysis.guidance.guidance_kind import (
    Driven,
    Found,
    Measured,
    Plan,
    Refusal,
)
from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.metrics.lanes import lane_deviation
from pd_editor.analysis.metrics.motion import kinematics
from pd_editor.analysis.metrics.road import departures
from pd_editor.analysis.metrics.traffic_view import generated_traffic, whole_traffic
from pd_editor.base.plain_text import listed
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, ROAD_USER_KINDS
from pd_editor.scene.generation import GuidanceReport, TrafficSample
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.guidance_terms import (
    GuidanceCost,
    GuidanceProblem,
    GuidanceTerm,
    Realism,
    TermOutcome,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS


def guidance_problems(
    scenario: Scenario,
    terms: Sequence[GuidanceTerm],
    agent_ids: Sequence[str] | None = None,
) -> tuple[GuidanceProblem, ...]:
    """Problems of terms before a run; terms that are off have none.

    ``agent_ids`` are those whose trajectories are generated; None: not known yet.
    """
    active = [term for term in terms if term.is_in_force]
    plan = Plan(scenario=scenario, terms=active, agent_ids=agent_ids)
    found: list[GuidanceProblem] = []
    for term in active:
        problems = list(absences(scenario, term, agent_ids))
        if not any(isinstance(problem, Refusal) for problem in problems):
            problems += KINDS[term.kind].check(term, plan)
        for other in active[: active.index(term)]:
            problems += _clashes(term, other, plan)
        found += [
            GuidanceProblem(
                term=term,
                severity="error" if isinstance(problem, Refusal) else "warning",
                message=str(problem),
            )
            for problem in problems
        ]
    return tuple(found)


def infeasible_terms(problems: Iterable[GuidanceProblem]) -> tuple[GuidanceTerm, ...]:
    """Terms with a problem."""
    return tuple(dict.fromkeys(problem.term for problem in problems))


def absences(
    scenario: Scenario, term: GuidanceTerm, agent_ids: Sequence[str] | None
) -> Found:
    """Agents that are gone, not there now, no road users, locked or not generated."""
    agents, now = scenario.agents, scenario.current_step
    for name in term.named_ids:
        row = agents.row_of.get(name)
        if row is None:
            yield Refusal(f"Agent {name} is gone; remove its {term.name}.")
        elif not agents.is_valid[row, now]:
            yield Refusal(
                f"Agent {name} is not there at t = 0, so its {term.name} has no effect; "
                "choose an agent that is."
            )
        elif agents.kinds[row] not in ROAD_USER_KINDS:
            yield Refusal(
                f"Agent {name} is a {agents.kinds[row].in_words} object, so its "
                f"{term.name} has no effect; choose a road user."
            )
    for name in term.guided_ids:
        if name not in agents.row_of:
            continue
        lock = scenario.locks.get(name)
        if lock is not None and lock.keeps == "trajectory":
            yield Refusal(
                f"The trajectory of agent {name} is locked, so its {term.name} has no "
                "effect; unlock it."
            )
        elif agent_ids is not None and name not in agent_ids:
            yield (
                f"Agent {name} is not regenerated, so its {term.name} has no effect; "
                "include it in the run."
            )


def _clashes(term: GuidanceTerm, other: GuidanceTerm, plan: Plan) -> Found:
    """Whether two terms ask the same agent for something else."""
    shared = _shared_agent(term, other)
    yield from KINDS[term.kind].clash(term, other, shared, plan)
    if other.kind != term.kind:
        yield from KINDS[other.kind].clash(other, term, shared, plan)


def _shared_agent(one: GuidanceTerm, other: GuidanceTerm) -> str | None:
    """An agent of both terms in words; None if there is none."""
    if not one.guided_ids and not other.guided_ids:
        return "Each agent"
    if not one.guided_ids or not other.guided_ids:
        return f"Agent {(one.guided_ids or other.guided_ids)[0]}"
    shared = [name for name in one.guided_ids if name in other.guided_ids]
    return f"Agent {shared[0]}" if shared else None


SLOWED: Final = ", slowed to avoid a collision"
"""Ends what agents achieved that yielded afterwards."""


def term_outcomes(
    scenario: Scenario,
    sample: TrafficSample,
    terms: Sequence[GuidanceTerm],
    infeasible: Collection[GuidanceTerm] = (),
    slowed_ids: Collection[str] = (),
) -> tuple[TermOutcome, ...]:
    """Outcome of each term in a sample, also of those that had no effect in it.

    ``infeasible`` terms were known to be so before the run. Agents with ``slowed_ids``
    were slowed afterwards to avoid a collision.
    """
    driven = Driven(scenario=scenario, sample=sample)
    found: list[TermOutcome] = []
    for term in terms:
        kind = KINDS[term.kind]
        theirs = driven.of(term.guided_ids, kind.agents)
        measured = kind.outcome(term, theirs) if len(theirs.rows) else None
        is_run = measured is not None
        if measured is None:
            measured = _without_effect(term, driven)
        ids = term.guided_ids or (measured.worst_id,)
        is_slowed = not set(slowed_ids).isdisjoint(ids)
        is_feasible = measured.is_feasible and term not in infeasible
        found.append(
            TermOutcome(
                term=term,
                is_run=is_run,
                is_feasible=is_feasible,
                asked=measured.asked,
                achieved=measured.achieved + SLOWED * is_slowed,
                error=measured.error,
                unit=measured.unit,
                is_obeyed=measured.is_obeyed
                and (is_feasible or not measured.has_no_case),
            )
        )
    return tuple(found)


def _without_effect(term: GuidanceTerm, driven: Driven) -> Measured:
    """Why a term had no effect: what is said before a run of agents that are missing."""
    found = absences(driven.scenario, term, driven.sample.ids)
    why = next(found, "No regenerated agent is of its kinds, or can follow it.")
    return Measured(
        asked=term.name,
        achieved=f"nothing: {why[0].lower()}{why[1:-1]}",
        error=float("nan"),
        unit="",
        is_obeyed=False,
    )


def guidance_reports(
    scenario: Scenario,
    samples: Sequence[TrafficSample],
    terms: Sequence[GuidanceTerm],
    unguided: Sequence[TrafficSample] = (),
    slowed_ids: Sequence[Sequence[str]] = (),
) -> tuple[GuidanceReport, ...]:
    """Reports on guided samples of the same agents.

    ``unguided`` are the unguided samples of the same seed, if they were made. Agents
    with ``slowed_ids`` were slowed to avoid a collision.
    """
    if not samples:
        return ()
    problems = guidance_problems(scenario, terms, samples[0].ids)
    infeasible = infeasible_terms(problems)
    # A contact that was asked for does not count.
    asked = {
        frozenset(term.named_ids)
        for term in terms
        if isinstance(term, Threaten) and term.is_on and term.severity == 1
    }
    plain = [AgentRealism.of(scenario, one, asked) for one in unguided]
    figures = [one.over() for one in plain]
    best = min(range(len(figures)), key=lambda index: _order(figures[index]), default=0)
    found: list[GuidanceReport] = []
    for index, sample in enumerate(samples):
        slowed = slowed_ids[index] if slowed_ids else ()
        outcomes = term_outcomes(scenario, sample, terms, infeasible, slowed)
        cost = None
        if figures:
            guided = AgentRealism.of(scenario, sample, asked)
            cost = GuidanceCost(guided=guided.over(), unguided=figures[index])
            outcomes = tuple(
                replace(
                    one,
                    cost=GuidanceCost(
                        guided=guided.over(one.term.guided_ids),
                        unguided=plain[index].over(one.term.guided_ids),
                    ),
                )
                for one in outcomes
            )
        found.append(
            GuidanceReport(
                outcomes=outcomes,
                cost=cost,
                unguided=unguided[best] if cost is not None and cost.is_worse else None,
                motion_problems=motion_problems(scenario, sample),
            )
        )
    return tuple(found)


def _order(figures: Realism) -> tuple[float, float, float]:
    """Order of unguided samples, the best one first."""
    return (figures.num_collisions, figures.off_road, figures.lateral_deviation_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentRealism:
    """Figures of the G agents of a sample, to be summed over some of them."""

    ids: tuple[str, ...]
    drives: Bool[np.ndarray, "G"]
    """Motor vehicles and cyclists."""
    off_road: Float[np.ndarray, "G"]
    """Share of steps with the centre outside the drivable area; NaN of others, and of
    vehicles that stand all the time."""
    collides: Bool[np.ndarray, "G"]
    lateral_m: Float[np.ndarray, "G S"]
    """Distance to the nearest reachable lane; NaN where there is none."""
    acceleration_mps2: Float[np.ndarray, "G S"]
    """NaN where it is not known."""

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        sample: TrafficSample,
        asked: Collection[frozenset[str]] = (),
    ) -> "AgentRealism":
        """Measure a sample; collisions of pairs of ids in ``asked`` do not count.

        Collisions and steps off the road are counted as in the list of findings.
        """
        view, now = generated_traffic(scenario, sample), scenario.current_step
        everyone = whole_traffic(scenario, sample)
        drives = np.array([kind in LANE_FOLLOWER_KINDS for kind in sample.kinds], bool)
        pairs, _ = later_collisions(everyone.from_step(now))
        names = [frozenset(everyone.ids[row] for row in pair) for pair in pairs]
        counted = np.array([pair not in asked for pair in names], bool)
        hits = np.isin(np.arange(len(drives)), pairs[counted])
        deviation, motion = lane_deviation(view), kinematics(view)
        total = np.hypot(motion.longitudinal_mps2, motion.lateral_mps2)
        speed = np.linalg.norm(sample.velocity_mps, axis=-1)
        moves = drives & (speed >= MOVING_MPS).any(axis=1)
        off_road = np.full(len(drives), np.nan)
        some = everyone.taken(np.flatnonzero(moves))
        off_road[moves] = departures(scenario, some).is_off_road[:, now:].mean(axis=1)
        return cls(
            ids=sample.ids,
            drives=drives,
            off_road=off_road,
            collides=hits,
            lateral_m=np.where(deviation.is_valid, deviation.lateral_m, np.nan),
            acceleration_mps2=np.where(motion.is_valid, total, np.nan),
        )

    def over(self, agent_ids: Collection[str] = ()) -> Realism:
        """Figures of some agents; of all without ids."""
        chosen = np.array([not agent_ids or one in agent_ids for one in self.ids], bool)
        drives = self.drives & chosen
        if not self.drives.any():
            # Scenes without vehicles have no figures.
            return Realism(
                off_road=0.0,
                num_collisions=0,
                lateral_deviation_m=0.0,
                acceleration_mps2=0.0,
            )
        return Realism(
            off_road=_mean(self.off_road[drives]),
            num_collisions=int(self.collides[chosen].sum()),
            lateral_deviation_m=_mean(self.lateral_m[drives]),
            acceleration_mps2=_mean(self.acceleration_mps2[drives]),
        )


def motion_problems(scenario: Scenario, sample: TrafficSample) -> tuple[str, ...]:
    """Sentences on agents that move as no vehicle can."""
    drives = np.array([kind in LANE_FOLLOWER_KINDS for kind in sample.kinds], bool)
    motion = kinematics(generated_traffic(scenario, sample))
    impossible = (motion.is_impossible() & motion.is_valid).any(axis=1) & drives
    forward = unit_vector(sample.heading_rad)
    step = (np.diff(sample.position_m, axis=1) * forward[:, 1:]).sum(-1)
    begins = (sample.velocity_mps[:, 0] * forward[:, 0]).sum(-1)
    # Way backwards from which on an agent counts as reversing.
    backwards = np.minimum(step, 0.0).sum(axis=1) < -1.0
    reverses = backwards & drives & (begins > 0)
    found: list[str] = []
    if impossible.any():
        found.append(
            f"{_names(sample, impossible)}: accelerations or curves that no vehicle can "
            "drive."
        )
    if reverses.any():
        found.append(f"{_names(sample, reverses)}: backwards out of forward motion.")
    return tuple(found)


def _names(sample: TrafficSample, mask: np.ndarray) -> str:
    return f"Agent {listed([sample.ids[row] for row in np.flatnonzero(mask)])}"


def _mean(values: np.ndarray) -> float:
    """Mean of the values that are known; 0 without any."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else 0.0
