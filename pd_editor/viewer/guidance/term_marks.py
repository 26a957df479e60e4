"""Marks of guidance terms on the road: what the page draws over the picture."""

import itertools
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import numpy as np
from jaxtyping import Float
from msgspec import structs

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M
from pd_editor.scene.guidance_terms import GuidanceTerm, PairGuidance
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.guidance.term_rows import has_handles, sentence_of
from pd_editor.viewer.meshes.agent_shapes import AgentPoses
from pd_editor.viewer.overlay.messages import (
    Ground,
    GuidanceBadge,
    GuidanceMark,
    Place,
    rounded_place,
)

OFFER: Final = -1
"""Index of the offered goal, which is no term yet."""
DOT_HINT: Final = "drag to move, Alt: off the lane; click for its speed, time or wait"
NEW_DOT_HINT: Final = "click or drag: a way-point more"
DRAG_HINT: Final = "drag to set a goal"


def marks_of(
    scenario: Scenario,
    poses: AgentPoses,
    selection: Collection[str],
    notes: Mapping[int, tuple[str, ...]],
    *,
    chosen: int | None,
    chosen_point: int | None = None,
) -> list[GuidanceMark]:
    """One mark per term that has a place on the road, and badges of the other terms.

    Arrows and badges follow the drawn poses. Terms of agents that are not selected are
    fainter; paths of those that are have their way-points as well. ``notes`` are further
    lines of a term's tooltip, by its index.
    """
    marks = []
    badges: dict[str, list[GuidanceBadge]] = {}
    at = _places(scenario, poses)
    for index, term in enumerate(scenario.guidance):
        look = GuidanceBadge(
            index=index,
            kind=term.kind,
            is_on=term.is_on,
            is_faint=bool(selection) and not set(term.named_ids) & set(selection),
            is_chosen=index == chosen,
            lines=(sentence_of(term, scenario), *notes.get(index, ())),
            is_bad=bool(notes.get(index)),
        )
        place = _place_of(term, scenario, at)
        if place is not None:
            marks.append(structs.replace(place, **structs.asdict(look)))
            if isinstance(term, FollowPath) and has_handles(term) and not look.is_faint:
                point = chosen_point if look.is_chosen else None
                marks += _dots(term, index, scenario, point)
        elif KINDS[term.kind].shape == "badge":
            for agent_id in term.guided_ids:
                badges.setdefault(agent_id, []).append(look)
    for agent_id, looks in badges.items():
        place = at(agent_id)
        if place is not None:
            marks.append(GuidanceMark(shape="badge", at=place, badges=tuple(looks)))
    return marks


def _dots(
    term: FollowPath, index: int, scenario: Scenario, chosen: int | None
) -> list[GuidanceMark]:
    """The way-points of a path, and between them places for more."""
    row, now = scenario.agents.row_of.get(term.agent_id), scenario.current_step
    if row is None:
        return []
    gap = np.array(term.points_m) - scenario.agents.position_m[row, now]
    # A point under the agent would be pressed in its place.
    is_free = np.linalg.norm(gap, axis=-1) > scenario.agents.size_m[row, 0] / 2 + 0.5
    dots = [
        GuidanceMark(
            shape="dot",
            index=index,
            kind=term.kind,
            is_on=term.is_on,
            is_chosen=node == chosen,
            lines=(
                f"Way-point {one.number}{': ' * bool(one.asks)}{one.asks}",
                DOT_HINT,
            ),
            point=one.point_m,
            node=node,
            label=one.asks,
            achieved=_place_at(scenario, term.agent_id, one.at_s),
        )
        for node, one in enumerate(term.way_points())
        if is_free[node]
    ]
    between = [
        GuidanceMark(
            shape="dot",
            index=index,
            kind=term.kind,
            is_on=term.is_on,
            lines=(NEW_DOT_HINT,),
            points=(before, after),
            node=node,
            is_offer=True,
        )
        for node, (before, after) in enumerate(itertools.pairwise(term.points_m))
    ]
    return [*between, *dots]


def _place_at(scenario: Scenario, agent_id: str, at_s: float | None) -> Ground | None:
    """Where an agent is at a time; None if it is not there, or no time is given."""
    row = scenario.agents.row_of.get(agent_id)
    if row is None or at_s is None:
        return None
    agents = scenario.agents
    step = scenario.current_step + round(at_s / scenario.time_axis.step_s)
    if step >= agents.num_steps or not agents.is_valid[row, step]:
        return None
    return _rounded(agents.position_m[row, step])


def offered_goal(
    scenario: Scenario, selection: tuple[str, ...]
) -> tuple[str, Float[np.ndarray, "2"]] | None:
    """Agent and end of its trajectory: a flag that a drag makes a goal.

    None unless one agent is selected that drives on from t = 0, has no goal, and whose
    trajectory is not locked.
    """
    if len(selection) != 1:
        return None
    (agent_id,) = selection
    row, lock = scenario.agents.row_of.get(agent_id), scenario.locks.get(agent_id)
    has_goal = any(
        isinstance(term, GoalPoint) and term.agent_id == agent_id
        for term in scenario.guidance
    )
    if row is None or has_goal or (lock is not None and lock.keeps == "trajectory"):
        return None
    step = scenario.current_step
    is_valid = scenario.agents.is_valid[row, step:]
    if not is_valid[0] or not is_valid[1:].any():
        return None
    track = scenario.agents.position_m[row, step:][is_valid]
    # Shortest trajectory whose end is offered as a goal to drag.
    if float(np.linalg.norm(track[-1] - track[0])) < 4.0:
        return None
    return agent_id, track[-1]


def offer_mark(
    scenario: Scenario, poses: AgentPoses, agent_id: str, end_m: Float[np.ndarray, "2"]
) -> GuidanceMark:
    """Mark of an offered goal; the page hides it where it would cover its agent."""
    return GuidanceMark(
        shape="flag",
        index=OFFER,
        kind=GoalPoint.kind,
        lines=(f"{agent_id}: {DRAG_HINT}",),
        point=_rounded(end_m),
        start=_places(scenario, poses)(agent_id),
        is_offer=True,
    )


def arc_mark(
    scenario: Scenario, poses: AgentPoses, term: PairGuidance, index: int
) -> GuidanceMark | None:
    """Thin arc of a term that could be made; None if an agent is not drawn."""
    place = _place_of(term, scenario, _places(scenario, poses))
    if place is None:
        return None
    return structs.replace(place, index=index, kind=term.kind, shape="arc")


def _place_of(
    term: GuidanceTerm, scenario: Scenario, at: Callable[[str], Place | None]
) -> GuidanceMark | None:
    """Shape and points of a term; None if it has none, or its agents are not there."""
    kind = KINDS[term.kind]
    if isinstance(term, PairGuidance):
        start, end = at(term.agent_id), at(term.other_id)
        if start is None or end is None:
            return None
        return GuidanceMark(shape=kind.shape, start=start, end=end)
    if kind.points_m is None:
        return None
    points = tuple(_rounded(point) for point in kind.points_m(term, scenario))
    if kind.shape == "flag":
        start = at(*term.guided_ids)
        assert isinstance(term, GoalPoint)
        axis = scenario.time_axis
        end_s = axis.future_s if term.at_s is None else term.at_s
        there = _place_at(scenario, term.agent_id, end_s)
        return GuidanceMark(shape="flag", point=points[0], start=start, achieved=there)
    return GuidanceMark(shape=kind.shape, points=points)


def _places(scenario: Scenario, poses: AgentPoses) -> Callable[[str], Place | None]:
    """The middle of an agent as drawn, at half its height; None if it is not drawn."""
    agents = scenario.agents

    def at(agent_id: str) -> Place | None:
        row = agents.row_of.get(agent_id)
        if row is None or row >= len(poses.is_present) or not poses.is_present[row]:
            return None
        height_m = DEFAULT_HEIGHT_M[agents.kinds[row]] / 2
        return rounded_place((*poses.position_m[row], height_m))

    return at


def round_bodies(
    scenario: Scenario, poses: AgentPoses
) -> tuple[tuple[float, float, float, float], ...]:
    """Middle and radius of each agent as drawn, in metres."""
    agents, at = scenario.agents, _places(scenario, poses)
    half_m = (np.hypot(*agents.size_m.T) / 2).round(2).tolist()
    found = zip(map(at, agents.ids), half_m, strict=True)
    return tuple((*place, radius) for place, radius in found if place is not None)


def _rounded(point_m: Any) -> Ground:
    return round(float(point_m[0]), 2), round(float(point_m[1]), 2)
