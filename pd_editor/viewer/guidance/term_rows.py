"""Words and inputs of guidance terms, for their list and their marks on the road."""

from dataclasses import dataclass, replace
from typing import Any, Final, get_args

from pd_editor.base.errors import EditError
from pd_editor.scene.guidance_terms import (
    APPROACH_WORDS,
    AvoidCollisions,
    ComfortLimits,
    FollowLane,
    FollowPath,
    GoalPoint,
    GuidanceTerm,
    KeepGap,
    Side,
    SpeedLimit,
    StayOnRoad,
    StopAtLine,
    TargetSpeed,
    Threaten,
    YieldTo,
)
from pd_editor.scene.scenario import Scenario

WEIGHTS: Final = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Strengths that the slider of a term offers; the middle one is the default."""
TITLES: Final[dict[str, str]] = {
    GoalPoint.kind: "Goal",
    FollowPath.kind: "Path",
    FollowLane.kind: "Lanes",
    StopAtLine.kind: "Stop at a line",
    YieldTo.kind: "Yield",
    Threaten.kind: "Threaten",
    TargetSpeed.kind: "Target speed",
    SpeedLimit.kind: "Speed limit",
    KeepGap.kind: "Keep a gap",
    AvoidCollisions.kind: "Avoid collisions",
    StayOnRoad.kind: "Stay on the road",
    ComfortLimits.kind: "Comfort limits",
}
SHORT_TITLES: Final[dict[str, str]] = {
    **TITLES,
    StopAtLine.kind: "Stop line",
    YieldTo.kind: "Yield to",
    TargetSpeed.kind: "Speed",
    KeepGap.kind: "Gap",
    AvoidCollisions.kind: "Avoid",
    StayOnRoad.kind: "On road",
    ComfortLimits.kind: "Comfort",
}
"""Names that fit on a tool's button."""
ANY_SIDE: Final = "either side"


@dataclass(frozen=True)
class Input:
    """One value of a term that is edited in its row of the list."""

    name: str
    """Field of the term."""
    label: str
    value: float | str | None
    unit: str = ""
    least: float = 0.0
    most: float = 0.0
    step: float = 0.5
    options: tuple[str, ...] = ()
    """Values to choose among; empty for a number."""
    empty: str = ""
    """Meaning of an empty number; empty text: a number is needed."""


def title_of(term: GuidanceTerm) -> str:
    """Name of a term's kind, with the agent that it refers to."""
    title = TITLES[term.kind]
    if isinstance(term, YieldTo):
        return f"Yield to {term.other_id}"
    if isinstance(term, Threaten):
        return f"Threaten {term.other_id}"
    return title


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
    match term:
        case GoalPoint():
            when = "at the end" if term.at_s is None else f"at {term.at_s:g} s"
            asks = f"be here {when}"
        case FollowPath():
            asks = "follow this path"
        case FollowLane():
            asks = "follow these lanes"
        case StopAtLine():
            asks = "stop at this line"
        case YieldTo():
            asks = f"let {term.other_id} pass first"
        case Threaten():
            how = APPROACH_WORDS[term.approach]
            asks = f"threaten {term.other_id} ({how}, {term.severity:.0%})"
        case TargetSpeed():
            asks = f"drive at {term.speed_mps:g} m/s"
        case SpeedLimit():
            asks = f"at most {term.speed_mps:g} m/s"
        case KeepGap():
            asks = f"keep {term.gap_m:g} m to the agent ahead"
        case AvoidCollisions():
            side = "" if term.side is None else f", swerve to the {term.side}"
            asks = f"avoid collisions{side}"
        case StayOnRoad():
            asks = "stay on the road"
        case ComfortLimits():
            asks = "drive comfortably"
    off = "" if term.is_on else " (off)"
    return f"{agents_of(term, scenario)}: {asks}{off}"


def inputs_of(term: GuidanceTerm) -> tuple[Input, ...]:
    """The values of a term that can be edited."""
    match term:
        case GoalPoint():
            at = Input(
                "at_s", "Time", term.at_s, unit="s", least=0.5, most=60.0, empty="end"
            )
            return (at,)
        case TargetSpeed() | SpeedLimit():
            speed = Input(
                "speed_mps", "Speed", term.speed_mps, unit="m/s", least=0.0, most=60.0
            )
            return (speed,)
        case KeepGap():
            gap = Input("gap_m", "Gap", term.gap_m, unit="m", least=0.5, most=200.0)
            return (gap,)
        case ComfortLimits():
            return tuple(
                Input(
                    name,
                    label,
                    getattr(term, name),
                    unit="m/s\u00b2",
                    least=0.2,
                    most=12.0,
                    step=0.1,
                )
                for name, label in (
                    ("max_acceleration_mps2", "Speed up"),
                    ("max_braking_mps2", "Brake"),
                    ("max_lateral_mps2", "Sideways"),
                )
            )
        case AvoidCollisions():
            side = Input(
                "side",
                "Swerve",
                term.side or ANY_SIDE,
                options=(ANY_SIDE, *get_args(Side)),
            )
            return (side,)
        case Threaten():
            return (
                Input(
                    "approach",
                    "How",
                    APPROACH_WORDS[term.approach],
                    options=tuple(APPROACH_WORDS.values()),
                ),
                Input(
                    "severity", "Severity", term.severity, least=0.0, most=1.0, step=0.1
                ),
            )
        case _:
            return ()


def with_input(term: GuidanceTerm, name: str, value: Any) -> GuidanceTerm:
    """The term with another value in one of its inputs.

    Raises:
        EditError: it is no value of this input.
    """
    found = [one for one in inputs_of(term) if one.name == name]
    if not found:
        raise EditError(f"A {term.name} has no value {name!r}.")
    (shown,) = found
    if shown.options:
        if value not in shown.options:
            raise EditError(
                f"{shown.label} is one of {', '.join(shown.options)}; {value!r} is not."
            )
        named = {words: approach for approach, words in APPROACH_WORDS.items()}
        value = None if value == ANY_SIDE else named.get(value, value)
    elif value is None:
        if not shown.empty:
            raise EditError(f"{shown.label} needs a number.")
    elif isinstance(value, bool) or not isinstance(value, int | float):
        raise EditError(f"{shown.label} needs a number.")
    else:
        value = float(value)
    return replace(term, **{name: value})


def weight_stop(weight: float) -> int:
    """Place of the slider's strength that is nearest to a weight."""
    return min(range(len(WEIGHTS)), key=lambda stop: abs(WEIGHTS[stop] - weight))
