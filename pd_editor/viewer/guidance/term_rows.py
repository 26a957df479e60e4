"""Words and inputs of guidance terms and of their way-points, for their list and their marks."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.path import (
    MAX_DRAWN_POINTS,
    POINT_FORMS,
    FollowPath,
    snapped,
)
from pd_editor.analysis.guidance.way_points import WayPoint
from pd_editor.base.errors import EditError
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.guidance_terms import (
    Form,
    GuidanceTerm,
    PairGuidance,
    Point,
    forms_of,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS
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


_ALL: Final = "All"
_FIELDS: Final = dict(zip(POINT_FORMS, ("speed_mps", "at_s", "waits_for"), strict=True))
"""Fields of a way-point by those of its path."""


def has_handles(term: FollowPath) -> bool:
    """Whether the points of a path are few enough to be edited one by one."""
    return len(term.points_m) <= MAX_DRAWN_POINTS


def point_inputs(
    term: FollowPath, chosen: int | None, scenario: Scenario
) -> list[GuidanceInput]:
    """The choice of a way-point, and what is asked at the chosen one."""
    names = [_name(one) for one in term.way_points()]
    choice = GuidanceInput(
        name="point",
        label="Way-point",
        value=_ALL if chosen is None else names[chosen],
        options=(_ALL, *names),
    )
    if chosen is None:
        return [choice]
    point = term.way_points()[chosen]
    nobody = POINT_FORMS["waits_for"].empty
    return [
        choice,
        *(
            form_input(name, form, getattr(point, _FIELDS[name]))
            for name, form in POINT_FORMS.items()
            if form.most
        ),
        GuidanceInput(
            name="waits_for",
            label=POINT_FORMS["waits_for"].label,
            value=point.waits_for or nobody,
            options=(nobody, *_others(term, point, scenario)),
        ),
    ]


def chosen_point(term: FollowPath, value: Any) -> int | None:
    """Place of the way-point that was chosen by its name; None: all."""
    names = [_name(one) for one in term.way_points()]
    return names.index(value) if value in names else None


def with_point_input(
    term: FollowPath, chosen: int, name: str, value: Any
) -> FollowPath:
    """The path with another value at a way-point.

    Raises:
        EditError: it is no value of this input.
    """
    form = POINT_FORMS.get(name)
    if form is None:
        raise EditError(f"A way-point has no value {name!r}.")
    if form.most:
        value = checked_number(form, value)
    else:
        value = None if value == form.empty else str(value)
    return _edited(term, chosen, lambda one: replace(one, **{_FIELDS[name]: value}))


def with_point_at(
    term: FollowPath,
    place: int,
    point_m: np.ndarray,
    scenario: Scenario,
    *,
    is_new: bool = False,
    is_free: bool = False,
) -> FollowPath:
    """The path with a way-point moved, or with a new one after it.

    ``is_free`` ones do not snap to lanes.

    Raises:
        EditError: it cannot be there.
    """
    if not is_free:
        point_m = snapped(scenario, term.agent_id, point_m)
    at: Point = (round(float(point_m[0]), 2), round(float(point_m[1]), 2))
    if not is_new:
        moved = _edited(term, place, lambda one: replace(one, point_m=at))
        return moved.checked_on_map(scenario)
    points = term.way_points()
    points.insert(
        place + 1,
        WayPoint(number=0, point_m=at, speed_mps=None, at_s=None, waits_for=None),
    )
    return term.with_way_points(points).checked_on_map(scenario)


def without_point(term: FollowPath, place: int) -> FollowPath:
    """The path without a way-point.

    Raises:
        EditError: no path is left.
    """
    points = term.way_points()
    del points[place]
    return term.with_way_points(points)


def _edited(
    term: FollowPath, place: int, edit: Callable[[WayPoint], WayPoint]
) -> FollowPath:
    points = term.way_points()
    points[place] = edit(points[place])
    return term.with_way_points(points)


def _name(point: WayPoint) -> str:
    return f"{point.number}: {point.asks}" if point.asks else str(point.number)


def _others(term: FollowPath, point: WayPoint, scenario: Scenario) -> list[str]:
    """Agents that move, the nearest to a way-point first, with the one waited for."""
    agents, now = scenario.agents, scenario.current_step
    counts = agents.is_valid[:, now] & agents.kind_mask(ROAD_USER_KINDS)
    counts &= agents.speed_mps()[:, now] > STANDING_MPS
    gap = np.linalg.norm(agents.position_m[:, now] - point.point_m, axis=-1)
    near = [agents.ids[row] for row in np.argsort(gap) if counts[row]]
    near = [one for one in near if one != term.agent_id][:20]
    known = point.waits_for
    return near if known is None or known in near else [known, *near]
