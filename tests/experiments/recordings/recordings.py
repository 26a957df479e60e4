"""Small recordings for tests."""

import numpy as np

from pd_editor.experiments.recordings.recording import Recording
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal
from tests.builders import LANE_WIDTH_M, two_lane_road


def drive(
    num_agents: int = 12, *, num_steps: int = 400, seed: int = 0, name: str = "drive-1"
) -> Recording:
    """Cars that come one after the other on two lanes; the last one is parked."""
    random = np.random.default_rng(seed)
    first_step = random.integers(0, num_steps // 3, num_agents)
    counts = np.minimum(random.integers(180, 380, num_agents), num_steps - first_step)
    rows = [
        _one_drive(random, int(count), row == num_agents - 1)
        for row, count in enumerate(counts)
    ]
    table = np.concatenate(rows)
    kinds = [AgentKind.VEHICLE, AgentKind.VEHICLE, AgentKind.BUS, AgentKind.VEHICLE]
    return Recording(
        name=name,
        road_map=two_lane_road(),
        city="drive",
        origin_city_m=np.array([100.0, -50.0]),
        step_s=0.1,
        num_steps=num_steps,
        ids=tuple(f"car{row}" for row in range(num_agents)),
        kinds=tuple(kinds[row % len(kinds)] for row in range(num_agents)),
        size_m=random.uniform([4, 1.6], [6, 2.2], (num_agents, 2)),
        is_parked=np.arange(num_agents) == num_agents - 1,
        first_step=first_step,
        first_row=np.concatenate([[0], np.cumsum(counts)]),
        position_m=table[:, :2].copy(),
        heading_rad=table[:, 2].copy(),
        velocity_mps=table[:, 3:].copy(),
        signals=(
            Signal(
                signal_id="one",
                lane_ids=(1, 3),
                stop_share=np.array([1.0, 0.25]),
                states=np.sort(random.integers(0, 4, num_steps)).astype(np.int8),
            ),
        ),
    )


def _one_drive(random: np.random.Generator, count: int, is_parked: bool) -> np.ndarray:
    """Rows x, y, heading, velocity of a car that slows down and speeds up."""
    time = np.arange(count) * 0.1
    rate = 0.0 if is_parked else random.uniform(3, 9)
    wave, period = rate * 0.9, random.uniform(15, 40)
    speed = rate + wave * np.cos(2 * np.pi * time / period)
    along = rate * time + wave * period / (2 * np.pi) * np.sin(
        2 * np.pi * time / period
    )
    lane = random.integers(2) * LANE_WIDTH_M
    side = 0.3 * np.sin(0.1 * time) * (not is_parked)
    heading = np.arctan2(0.03 * np.cos(0.1 * time), np.maximum(speed, 3.0))
    heading = heading * (not is_parked)
    return np.column_stack(
        [
            random.uniform(-90, 0) + along,
            lane + side,
            heading,
            speed * np.cos(heading),
            speed * np.sin(heading),
        ]
    )


def recording_of(scenario: Scenario) -> Recording:
    """A scenario as a recording; each track without gaps."""
    agents = scenario.agents
    row, step = np.nonzero(agents.is_valid)
    counts = agents.is_valid.sum(axis=1)
    first_row = np.concatenate([[0], np.cumsum(counts)])
    return Recording(
        name=scenario.scenario_id,
        road_map=scenario.road_map,
        city=scenario.city,
        origin_city_m=scenario.origin_city_m,
        step_s=scenario.time_axis.step_s,
        num_steps=agents.num_steps,
        ids=agents.ids,
        kinds=agents.kinds,
        size_m=agents.size_m,
        is_parked=np.zeros(len(agents), bool),
        first_step=agents.is_valid.argmax(axis=1),
        first_row=first_row,
        position_m=agents.position_m[row, step],
        heading_rad=agents.heading_rad[row, step],
        velocity_mps=agents.velocity_mps[row, step],
    )
