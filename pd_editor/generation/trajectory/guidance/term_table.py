"""Terms of a run, made from their values."""

from collections.abc import Sequence
from typing import Final

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.guidance.kinds.space import AvoidCollisions
from pd_editor.generation.trajectory.guidance import (
    interaction_terms,
    path_terms,
    road_terms,
    speed_terms,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    TermContext,
    TermMakers,
    TrajectoryTerm,
)
from pd_editor.scene.guidance_terms import GuidanceTerm

TERM_MAKERS: Final[TermMakers] = {
    **path_terms.MAKERS,
    **speed_terms.MAKERS,
    **road_terms.MAKERS,
    **interaction_terms.MAKERS,
}
"""Maker of each kind of value; threats are planned (``threat_run``)."""


def trajectory_terms(
    terms: Sequence[GuidanceTerm], context: TermContext, *, avoids: bool = False
) -> tuple[TrajectoryTerm, ...]:
    """Terms of a run, without those that are off or of weight zero.

    With ``avoids``, agents that are led somewhere avoid collisions as far as they can.
    """
    active = [term for term in terms if term.is_in_force]
    made: list[TrajectoryTerm] = []
    for kind, make in TERM_MAKERS.items():
        values = [term for term in active if type(term) is kind]
        made += make(values, context) if values else []
    if avoids:
        made += _avoidance_of_led(active, context)
    return tuple(made)


def _avoidance_of_led(
    active: Sequence[GuidanceTerm], context: TermContext
) -> Sequence[TrajectoryTerm]:
    """A light term of agents that are led somewhere, unless they take part in a threat."""
    led = {name for one in active if KINDS[one.kind].leads for name in one.guided_ids}
    for one in active:
        if isinstance(one, Threaten):
            led -= set(one.named_ids)
    weight = context.config.led_weight
    if not led or not weight:
        return []
    value = AvoidCollisions(agent_ids=tuple(sorted(led)), weight=weight)
    term = interaction_terms.AvoidTerm.of(value, context, is_light=True)
    return [] if term is None else [term]
