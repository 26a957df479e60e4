"""What a user should know about a scenario at once, in words.

Left out, because recordings are full of them and nobody can mend them:

- overlaps without a road user (cones, bins, signs), of pedestrians with each other
  (they walk in groups), and of people with a bicycle that they push;
- later overlaps of agents that both stand: they merely come into view;
- pedestrians and things anywhere.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Int

from pd_editor.metrics.collision import first_overlap
from pd_editor.metrics.off_road import off_road
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario

WarningKind = Literal["overlap", "off-road", "future-overlap", "future-off-road"]

MOVING_M: Final = 0.5
"""An agent that stays within this distance stands."""
_KIND_NAME: Final[dict[AgentKind, str]] = {
    kind: kind.value.replace("_", " ") for kind in AgentKind
} | {
    AgentKind.STATIC: "static object",
    AgentKind.BACKGROUND: "background object",
    AgentKind.CONSTRUCTION: "construction object",
    AgentKind.UNKNOWN: "object",
}
_PUSHES_BICYCLE: Final = frozenset({AgentKind.PEDESTRIAN, AgentKind.CYCLIST})


@dataclass(frozen=True, kw_only=True)
class SceneWarning:
    """One thing that looks wrong."""

    kind: WarningKind
    agent_ids: tuple[str, ...]
    step: int
    """When it happens first."""
    message: str
    """One sentence for the user."""


def scene_warnings(
    scenario: Scenario, *, with_future: bool
) -> tuple[SceneWarning, ...]:
    """Warnings about the current step, and about the first trouble after it."""
    step = scenario.current_step
    now = np.array([step])
    warnings = [
        *_overlaps(scenario, now, "overlap"),
        *_off_road(scenario, now, "off-road"),
    ]
    later = np.arange(step + 1, scenario.time_axis.num_steps)
    if with_future and len(later):
        known = {(warning.kind, warning.agent_ids) for warning in warnings}
        warnings += [
            warning
            for warning in (
                *_overlaps(scenario, later, "future-overlap"),
                *_off_road(scenario, later, "future-off-road"),
            )
            if (warning.kind.removeprefix("future-"), warning.agent_ids) not in known
        ]
    return tuple(warnings)


def without_known(
    warnings: Iterable[SceneWarning],
    known: Iterable[SceneWarning],
    *,
    unmoved: Collection[str],
    untouched: Collection[str],
) -> tuple[SceneWarning, ...]:
    """Only warnings that edits caused.

    Args:
        warnings: what is wrong now.
        known: what was wrong in the recording.
        unmoved: agents whose state at the current step is as in the recording. A known
            warning about that step is left out as long as it names none but them.
        untouched: agents whose whole motion is as in the recording; likewise for
            known warnings about the future.
    """
    seen = {(warning.kind, warning.agent_ids) for warning in known}
    now, later = set(unmoved), set(untouched)
    return tuple(
        warning
        for warning in warnings
        if (warning.kind, warning.agent_ids) not in seen
        or not (later if warning.kind.startswith("future") else now).issuperset(
            warning.agent_ids
        )
    )


def _overlaps(
    scenario: Scenario, steps: Int[np.ndarray, "S"], kind: WarningKind
) -> list[SceneWarning]:
    agents = scenario.agents
    pairs, first = first_overlap(agents, steps)
    moves = _moves(agents, steps) if kind == "future-overlap" else None
    found = []
    for (one, two), step in zip(pairs.tolist(), first.tolist(), strict=True):
        matters = _pair_matters(agents.kinds[one], agents.kinds[two])
        if not matters or (moves is not None and not (moves[one] or moves[two])):
            continue
        first_name, second_name = (
            _name(agents, row)
            + ("" if agents.is_valid[row, scenario.current_step] else " (comes later)")
            for row in (one, two)
        )
        verb = "overlap" if moves is None else f"overlap {_delay(scenario, step)}"
        found.append(
            SceneWarning(
                kind=kind,
                agent_ids=(agents.ids[one], agents.ids[two]),
                step=step,
                message=f"{_upper(first_name)} and {second_name} {verb}.",
            )
        )
    return found


def _off_road(
    scenario: Scenario, steps: Int[np.ndarray, "S"], kind: WarningKind
) -> list[SceneWarning]:
    agents = scenario.agents
    outside = off_road(scenario, steps).center
    found = []
    for row in np.flatnonzero(outside.any(axis=1)).tolist():
        step = int(steps[outside[row].argmax()])
        place = (
            "is off the road"
            if kind == "off-road"
            else f"is off the road {_delay(scenario, step)}"
        )
        found.append(
            SceneWarning(
                kind=kind,
                agent_ids=(agents.ids[row],),
                step=step,
                message=f"{_upper(_name(agents, row))} {place}.",
            )
        )
    return found


def _moves(agents: AgentTracks, steps: Int[np.ndarray, "S"]) -> Bool[np.ndarray, "A"]:
    """Whether each agent leaves its place during the steps."""
    position = agents.position_m[:, steps]
    is_valid = agents.is_valid[:, steps]
    first = np.take_along_axis(position, is_valid.argmax(axis=1)[:, None, None], axis=1)
    distance = np.linalg.norm(position - first, axis=-1)
    return np.any(is_valid & (distance > MOVING_M), axis=1)


def _pair_matters(one: AgentKind, two: AgentKind) -> bool:
    kinds = {one, two}
    if not kinds & ROAD_USER_KINDS or kinds == {AgentKind.PEDESTRIAN}:
        return False
    return not (AgentKind.RIDERLESS_BICYCLE in kinds and kinds & _PUSHES_BICYCLE)


def _name(agents: AgentTracks, row: int) -> str:
    return f"{_KIND_NAME[agents.kinds[row]]} {agents.ids[row]}"


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _delay(scenario: Scenario, step: int) -> str:
    later = (step - scenario.current_step) * scenario.time_axis.step_s
    return f"in {later:.1f} s"
