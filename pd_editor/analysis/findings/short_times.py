"""Findings on agents that are on a collision course with little time left."""

from collections.abc import Iterable

import numpy as np

from pd_editor.analysis.findings.finding import Finding, finding_of_agent
from pd_editor.analysis.metrics.collisions.safety import CRITICAL_S, least_times_s
from pd_editor.analysis.metrics.traffic_view import TrafficView


def short_times(view: TrafficView, others: Iterable[Finding]) -> list[Finding]:
    """Find agents whose shortest time to collision is critical, at its step.

    Pairs that collide, as the other findings tell, are left out.
    """
    scenario, found = view.scenario, []
    row_of = view.everyone.row_of
    told = np.zeros((len(row_of), len(row_of)), bool)
    for one in others:
        if one.kind in ("collision", "later-collision"):
            pair = [row_of[name] for name in one.agent_ids if name in row_of]
            told[pair, pair[::-1]] = True
    least, at = least_times_s(view, told)
    for row in np.flatnonzero(least < CRITICAL_S).tolist():
        step = scenario.current_step + int(at[row])
        words = f"time to collision {least[row]:.1f} s"
        found.append(
            finding_of_agent(
                scenario,
                "short-time",
                scenario.agents.row_of[view.agents.ids[row]],
                np.array([step]),
                value=float(least[row]),
                limit=CRITICAL_S,
                words=f" {words}",
                message=f"would hit another agent at constant speed: {words}.",
            )
        )
    return found
