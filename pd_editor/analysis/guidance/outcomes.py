"""Outcomes of guidance terms: what was asked, what a sample achieved."""

from collections.abc import Collection, Sequence
from typing import Final

from pd_editor.analysis.guidance.feasibility import absences
from pd_editor.analysis.guidance.guidance_kind import Driven, Measured
from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.scene.guidance_outcome import TermOutcome
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_sample import TrafficSample

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
        measured = KINDS[term.kind].outcome(term, driven)
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
