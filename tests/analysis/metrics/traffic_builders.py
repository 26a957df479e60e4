"""Views of hand-made traffic on the two-lane road."""

import numpy as np

from pd_editor.analysis.metrics.traffic_view import (
    TrafficView,
    generated_traffic,
    recorded_traffic,
)
from pd_editor.scene.agent_kind import AgentKind, default_sizes_m
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers


def recorded(
    states: list[tuple[float, float, float, float]],
    kinds: tuple[AgentKind, ...] | None = None,
) -> TrafficView:
    """Recorded agents (x, y, heading, speed) at constant velocity."""
    return recorded_traffic(scenario_with(straight_drivers(states, kinds=kinds)))


def sample_of(
    ids: tuple[str, ...],
    position_m: np.ndarray,
    kinds: tuple[AgentKind, ...] | None = None,
    step_s: float = 0.1,
) -> TrafficSample:
    """A sample along paths [G S 2]; headings and velocities follow them."""
    kinds = kinds or (AgentKind.VEHICLE,) * len(ids)
    velocity = np.gradient(position_m, step_s, axis=1)
    return TrafficSample(
        ids=ids,
        kinds=kinds,
        size_m=default_sizes_m(kinds),
        position_m=position_m,
        heading_rad=np.arctan2(velocity[..., 1], velocity[..., 0]),
        velocity_mps=velocity,
    )


def generated(
    scenario: Scenario, ids: tuple[str, ...], position_m: np.ndarray
) -> TrafficView:
    """Generated paths among the scenario's other agents."""
    return generated_traffic(scenario, sample_of(ids, position_m))
