"""Problems of guidance terms before a run: contradictions, and what cannot be met.

A term is checked against the paths that its agent could take and against limits of
acceleration; of other traffic, only against agents that stand on each path to a goal.
"""

from collections.abc import Iterable, Sequence

from pd_editor.analysis.guidance.guidance_kind import Found, Plan, Refusal
from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.guidance_outcome import GuidanceProblem
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scenario import Scenario


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
        if lock is not None and lock.keeps_trajectory:
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
