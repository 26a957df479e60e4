"""The one list of findings of a scenario, and which of them edits have caused."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pd_editor.analysis.findings.collisions import collisions, near_passes, short_times
from pd_editor.analysis.findings.finding import Finding
from pd_editor.analysis.findings.friction import friction_problems
from pd_editor.analysis.findings.motion import (
    against_traffic,
    made_up_motion,
    motion_findings,
    without_past,
)
from pd_editor.analysis.findings.road import road_departures, road_problems
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.scene.perturbation.warp_scenario import untouched_agent_ids
from pd_editor.scene.scenario import Scenario

_CAN_WORSEN: Final = frozenset(
    {"friction", "harsh-motion", "impossible-motion", "near-pass", "short-time"}
)
"""A warp can turn a slight recorded excess into a large one; but who is off the road stays
beside it, with other metres where the plane is stretched."""


@dataclass(frozen=True, kw_only=True)
class SceneCheck:
    """Findings of a scenario: those caused by edits, and recorded ones."""

    new: tuple[Finding, ...] = ()
    recorded: tuple[Finding, ...] = ()

    @property
    def all(self) -> tuple[Finding, ...]:
        """The whole list."""
        return self.new + self.recorded

    @property
    def problems(self) -> tuple[Finding, ...]:
        """Problems that edits have caused."""
        return tuple(one for one in self.new if one.is_problem)


def scene_findings(
    scenario: Scenario, *, with_future: bool = True
) -> tuple[Finding, ...]:
    """Find all that is noticed from the current step on, in the order of time.

    Before it, made-up motion is. Without the future only the rest is checked.
    """
    now = scenario.current_step
    end = scenario.time_axis.num_steps if with_future else now + 1
    steps = np.arange(now, end)
    found = [
        *road_problems(scenario),
        *collisions(scenario, steps),
        *road_departures(scenario, steps),
        *without_past(scenario),
        *made_up_motion(scenario),
    ]
    if with_future:
        view = recorded_traffic(scenario)
        too_fast = friction_problems(scenario)
        told = {one.agent_ids for one in too_fast}
        found += too_fast
        found += near_passes(scenario)
        found += short_times(view, found)
        found += against_traffic(view)
        found += [
            one
            for one in motion_findings(view)
            # The limit of friction tells it with the speed that would do.
            if one.kind == "harsh-motion" or one.agent_ids not in told
        ]
    return tuple(sorted(found, key=lambda one: (one.first_step, one.kind)))


def scene_problems(
    scenario: Scenario, *, with_future: bool = True
) -> tuple[Finding, ...]:
    """Those of the findings that are problems."""
    found = scene_findings(scenario, with_future=with_future)
    return tuple(one for one in found if one.is_problem)


def checked(
    scenario: Scenario,
    base: Scenario,
    recorded: Iterable[Finding],
    *,
    with_future: bool = True,
) -> SceneCheck:
    """Check a scenario that was made from ``base`` by edits.

    ``recorded`` are the findings of ``base``, which a session stores. If ``base`` is an
    earlier export, findings that its edits have caused count as caused by edits.
    """
    provenance, now = base.provenance, scenario.current_step
    keys = provenance.caused_findings
    return split(
        scene_findings(scenario, with_future=with_future),
        [
            one
            for one in recorded
            if (
                provenance.is_recorded(one.agent_ids)
                if keys is None
                else one.key not in keys
            )
        ],
        unmoved=untouched_agent_ids(scenario, base, slice(now, now + 1)),
        untouched=untouched_agent_ids(scenario, base),
    )


def split(
    findings: Iterable[Finding],
    recorded: Iterable[Finding],
    *,
    unmoved: Collection[str],
    untouched: Collection[str],
) -> SceneCheck:
    """Split findings into those caused by edits and recorded ones.

    A recorded finding that edits made clearly worse is caused by edits.

    Args:
        findings: findings of the edited scenario.
        recorded: findings of the recording.
        unmoved: agents whose state at the current step is as recorded. A recorded
            finding at that step stays a recorded one if it involves only these.
        untouched: agents whose whole trajectory is as recorded; likewise for
            findings at later steps.
    """
    known = {one.key: one for one in recorded}
    same_now, same_later = frozenset(unmoved), frozenset(untouched)

    def is_recorded(one: Finding) -> bool:
        was = known.get(one.key)
        if was is None:
            return False
        # Ratio above which a recorded finding that reads differently is caused by
        # edits.
        is_worse = one.ratio > 1.05 * was.ratio and one.headline != was.headline
        if one.kind in _CAN_WORSEN and is_worse:
            return False
        same = same_now if one.is_now else same_later
        return same.issuperset(one.agent_ids)

    new: list[Finding] = []
    own: list[Finding] = []
    for one in findings:
        if is_recorded(one):
            own.append(replace(one, source="recorded"))
        else:
            new.append(one)
    return SceneCheck(new=tuple(new), recorded=tuple(own))
