"""Findings on agents that are on a collision course with little time left."""

import numpy as np

from pd_editor.analysis.findings.finding import Finding, finding_of_agent
from pd_editor.analysis.metrics.collisions.safety import CRITICAL_S, least_times_s
from pd_editor.analysis.metrics.traffic_view import TrafficView


def short_times(view: TrafficView) -> list[Finding]:
    """Find agents whose shortest time to collision is critical, at its step."""
    scenario, found = view.scenario, []
    least, at = least_times_s(view)
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
