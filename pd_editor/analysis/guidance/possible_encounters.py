"""What could happen to an agent: every threat to it, and every yield, that is feasible."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, get_args

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.guidance.guidance_kind import AgentNow, Plan
from pd_editor.analysis.guidance.kinds.pairs import (
    Threaten,
    YieldTo,
    driven_paths_m,
    yield_problems,
)
from pd_editor.analysis.threats.encounter import APPROACH_WORDS, Approach, Track
from pd_editor.analysis.threats.threat_feasibility import (
    recorded_track,
    tracks_in_the_way,
)
from pd_editor.analysis.threats.threat_plans import ThreatAim, threat_plans
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.thresholds import MOVING_MPS, STANDING_MPS

SEVERITIES: Final = (1.0, 0.5, 0.0)
"""Severities that are tried, the gravest first."""
_MEETS_M: Final = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PossibleEncounter:
    """A term that is feasible for two agents, and what would happen."""

    term: Threaten | YieldTo
    at_s: float
    """When the agents meet by the plan, or when the other one passes; trajectories of the
    model meet up to 2 s earlier or later."""
    gap_m: float | None
    """How near they come, 0 for contact; None of a yield."""
    way_m: Float[np.ndarray, "H 2"]
    """Way of the agent that the term guides, up to there."""

    @property
    def in_words(self) -> str:
        """What the guided agent does, when, and how near, without its name."""
        if isinstance(self.term, YieldTo):
            return f"lets {self.term.other_id} pass at about {self.at_s:.0f} s"
        how = f"{self.gap_m:.1f} m" if self.gap_m else "contact"
        # The plan is feasible, but trajectories of the model bend less than it may.
        doubt = " (may miss)" if self.term.approach == "side" else ""
        when = f"at about {self.at_s:.0f} s"
        return f"{APPROACH_WORDS[self.term.approach]}: {how} {when}{doubt}"


def endangered_id(scenario: Scenario, selection: tuple[str, ...] = ()) -> str | None:
    """The one selected agent, else the ego, else the focal agent; None if none is there."""
    agents, now = scenario.agents, scenario.current_step
    chosen = selection if len(selection) == 1 else ()
    wanted = (*chosen, EGO_ID, scenario.focal_id)
    there = (one for one in wanted if one in agents.row_of)
    return next(
        (one for one in there if agents.is_valid[agents.row_of[one], now]), None
    )


def possible_encounters(
    scenario: Scenario, agent_id: str, is_stopped: Callable[[], bool] = lambda: False
) -> tuple[PossibleEncounter, ...]:
    """Threats to an agent that keeps its trajectory, and yields to it and by it.

    One of each approach, of the gravest severity that is feasible: contacts first, then
    near misses, then yields, each by time. Looks no further once ``is_stopped``.
    """
    found: list[PossibleEncounter] = []
    for one in _possible_encounters(scenario, agent_id):
        if is_stopped():
            break
        if one is not None:
            found.append(one)
    kinds = {0.0: 0, None: 2}
    return tuple(sorted(found, key=lambda one: (kinds.get(one.gap_m, 1), one.at_s)))


def _possible_encounters(
    scenario: Scenario, agent_id: str
) -> Iterator[PossibleEncounter | None]:
    """None after each agent that was looked at."""
    agents, now = scenario.agents, scenario.current_step
    row = agents.row_of[agent_id]
    other = recorded_track(scenario, row)
    there = agents.is_valid[:, now] & agents.kind_mask(ROAD_USER_KINDS)
    there[row] = False
    time_s = scenario.time_axis.step_s * np.arange(len(other.position_m))
    away = np.linalg.norm(agents.position_m[:, now, None] - other.position_m, axis=-1)
    # Acceleration with which an agent may get near.
    reach = agents.speed_mps()[:, now, None] * time_s + 4.0 / 2 * time_s**2
    size = np.hypot(*agents.size_m.T) + np.hypot(*other.size_m) + 1.0
    rows = np.flatnonzero(there & (away < reach + size[:, None]).any(axis=1))
    for one in rows.tolist():
        locked = scenario.locks.get(agents.ids[one])
        if locked is None or locked.keeps != "trajectory":
            yield from _threats(scenario, one, row, other)
            yield from _yields(scenario, one, row)
        yield from _yields(scenario, row, one)
        yield None


def _threats(
    scenario: Scenario, row: int, other_row: int, other: Track
) -> Iterator[PossibleEncounter]:
    agents, now = scenario.agents, scenario.current_step
    stands = agents.speed_mps()[row, now] < STANDING_MPS
    kept = tracks_in_the_way(scenario, (row, other_row))
    # Who stands does not cut in but pulls out, and has nothing to brake.
    without = ("cut-in", "brakes") if stands else ("pulls-out",)
    for approach in get_args(Approach):
        for severity in SEVERITIES if approach not in without else ():
            aim = ThreatAim.of(approach, severity)
            plans = threat_plans(scenario, row, other, aim, kept=kept, most=1)
            if len(plans):
                step = int(plans.meeting_step[0])
                yield PossibleEncounter(
                    term=Threaten(
                        agent_id=agents.ids[row],
                        other_id=agents.ids[other_row],
                        approach=approach,
                        severity=severity,
                    ),
                    at_s=step * scenario.time_axis.step_s,
                    gap_m=float(plans.gap_m[0]),
                    way_m=plans.track.position_m[0, : step + 1],
                )
                break
            assert plans.obstacle is not None, "there are no plans"
            if plans.obstacle.kind == "course":
                break


def _yields(
    scenario: Scenario, row: int, other_row: int
) -> Iterator[PossibleEncounter]:
    """The yield of an agent that moves to one that crosses its way, if it can brake."""
    agents = scenario.agents
    agent = AgentNow(scenario=scenario, row=row)
    term = YieldTo(agent_id=agents.ids[row], other_id=agents.ids[other_row])
    if agent.speed_mps < MOVING_MPS:
        return
    theirs = recorded_track(scenario, other_row).position_m
    for way in driven_paths_m(agent):
        gap = np.linalg.norm(way[:, None] - theirs, axis=-1)
        meets = gap < _MEETS_M
        if not meets.any():
            continue
        place = int(meets.any(axis=1).argmax())
        step = int(gap[place].argmin())
        mine, other = (
            line[min(at + 1, len(line) - 1)] - line[max(at - 1, 0)]
            for line, at in ((way, place), (theirs, step))
        )
        moved = np.linalg.norm(theirs[step] - theirs[0]) > _MEETS_M
        # Paths whose headings differ less merge: there no agent yields.
        along = 0.94 * np.linalg.norm(mine) * np.linalg.norm(other)
        if moved and mine @ other < along:
            if not any(yield_problems(term, Plan(scenario=scenario))):
                yield PossibleEncounter(
                    term=term,
                    at_s=step * scenario.time_axis.step_s,
                    gap_m=None,
                    way_m=way[: place + 1],
                )
            return
