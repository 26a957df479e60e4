"""Words and inputs of guidance terms, for their list and their marks on the road."""

from dataclasses import replace
from typing import Any, Final

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.base.errors import EditError
from pd_editor.scene.guidance_terms import Form, GuidanceTerm, PairGuidance, forms_of
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.overlay.messages import GuidanceInput

WEIGHTS: Final = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Strengths that the slider of a term offers; the middle one is the default."""


def title_of(term: GuidanceTerm) -> str:
    """Name of a term's kind, with the agent that it refers to."""
    kind = KINDS[term.kind]
    if isinstance(term, PairGuidance):
        return f"{kind.short} {term.other_id}"
    return kind.title


def agents_of(term: GuidanceTerm, scenario: Scenario) -> str:
    """The guided agents in words."""
    count = len(term.guided_ids)
    if count > 1:
        return f"{count} agents"
    for agent_id in term.guided_ids:
        row = scenario.agents.row_of.get(agent_id)
        if row is None:
            return f"agent {agent_id}"
        return f"{str(scenario.agents.kinds[row]).replace('_', ' ')} {agent_id}"
    return "all agents"


def sentence_of(term: GuidanceTerm, scenario: Scenario) -> str:
    """What a term asks, in one line for a tooltip."""
    off = "" if term.is_on else " (off)"
    return f"{agents_of(term, scenario)}: {KINDS[term.kind].asks(term)}{off}"


def inputs_of(term: GuidanceTerm) -> list[GuidanceInput]:
    """The values of a term that can be edited, for the page: choices, then numbers."""
    forms = forms_of(type(term))
    return [
        form_input(name, form, form.choices.get(value, value))
        for name, form in sorted(forms.items(), key=lambda one: not one[1].choices)
        for value in (getattr(term, name),)
    ]


def form_input(name: str, form: Form, value: Any) -> GuidanceInput:
    """The input of a form that shows a value."""
    return GuidanceInput(
        name=name,
        label=form.label,
        value=value,
        unit=form.unit,
        least=form.least if form.first is None else form.first,
        most=form.most,
        step=form.step,
        options=tuple(form.choices.values()),
        empty=form.empty,
    )


def checked_number(form: Form, value: Any) -> float | None:
    """The number that was given in the input of a form.

    Raises:
        EditError: it is none.
    """
    if value is None and form.empty:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise EditError(f"{form.label} needs a number.")
    return float(value)


def with_input(term: GuidanceTerm, name: str, value: Any) -> GuidanceTerm:
    """The term with another value in one of its inputs.

    Raises:
        EditError: it is no value of this input.
    """
    form = forms_of(type(term)).get(name)
    if form is None:
        raise EditError(f"A {term.name} has no value {name!r}.")
    if form.choices:
        named = {words: one for one, words in form.choices.items()}
        if value not in named:
            raise EditError(
                f"{form.label} is one of {', '.join(named)}; {value!r} is not."
            )
        value = named[value]
    else:
        value = checked_number(form, value)
    return replace(term, **{name: value})


def weight_stop(weight: float) -> int:
    """Place of the slider's strength that is nearest to a weight."""
    return min(range(len(WEIGHTS)), key=lambda stop: abs(WEIGHTS[stop] - weight))
