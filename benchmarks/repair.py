"""Repairs of real scenes: what they mend, and how long they take.

Reads the train and val folders under PD_EDITOR_AV2. Scenes are the recorded ones, and
the same with movers shifted at random (2 m) and all lane followers at constant
velocity, which is worse than what a model samples. No agent is kept.
"""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.candidates import crowd, full_scenarios, movers_now
from pd_editor.analysis.metrics.box_overlaps import overlapping_pairs
from pd_editor.analysis.repair.current_states import States, counted
from pd_editor.analysis.repair.retimed_trajectories import (
    Trajectories,
    yield_to_others,
)
from pd_editor.analysis.repair.state_repairs import (
    MAX_OFFSET_M,
    project_to_lanes,
    separate_overlaps,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, MOTOR_VEHICLE_KINDS
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

REPEATS = 30


def shaken(scenario: Scenario, seed: int, spread_m: float = 2.0) -> Scenario:
    """Movers shifted at random, their whole tracks with them."""
    agents = scenario.agents
    rows = np.flatnonzero(agents.kind_mask(MOTOR_VEHICLE_KINDS))
    shift = np.random.default_rng(seed).normal(0, spread_m, (len(agents), 1, 2))
    moved = (agents.position_m + shift)[rows] * agents.is_valid[rows][..., None]
    return scenario.with_agents(agents.with_rows(rows, position_m=moved))


def at_constant_velocity(scenario: Scenario) -> Scenario:
    """Lane followers that go straight on from now."""
    agents, step = scenario.agents, scenario.current_step
    there = agents.is_valid[:, step] & agents.kind_mask(LANE_FOLLOWER_KINDS)
    rows = np.flatnonzero(there)
    arrays = {
        name: getattr(agents, name)[rows].copy()
        for name in ("position_m", "heading_rad", "velocity_mps", "is_valid")
    }
    for values in arrays.values():
        values[:, step:] = values[:, step : step + 1]
    time_s = scenario.time_axis.times_s()[step:, None]
    arrays["position_m"][:, step:] += time_s * arrays["velocity_mps"][:, step:]
    return scenario.with_agents(agents.with_rows(rows, **arrays))


def num_overlaps(scenario: Scenario) -> int:
    """Overlaps of lane followers at the current step."""
    pairs = overlapping_pairs(scenario.agents, scenario.current_step)
    return int(counted(scenario.agents, pairs).sum())


def num_conflicts(scenario: Scenario) -> int:
    """Pairs that run into each other later."""
    everybody = np.ones(len(scenario.agents), bool)
    return len(Trajectories(scenario=scenario, may_change=everybody).conflicts())


def num_off_lanes(scenario: Scenario) -> int:
    """Moving lane followers that are further from every lane than a repair allows."""
    agents, now = scenario.agents, scenario.current_step
    moves = agents.kind_mask(LANE_FOLLOWER_KINDS) & agents.is_valid[:, now]
    rows = np.flatnonzero(moves & (agents.speed_mps()[:, now] >= MOVING_MPS))
    found = States.of(scenario).lanes(rows, reach_m=15.0)
    return int((found.distance_m > MAX_OFFSET_M).sum())


def num_changed(before: Scenario, after: Scenario) -> int:
    """Agents whose trajectory differs."""
    differs = before.agents.position_m != after.agents.position_m
    return int(differs.any(axis=(1, 2)).sum())


def without_collisions(scenario: Scenario) -> Scenario:
    """The scenario after yielding."""
    return yield_to_others(scenario)[0]


def print_effects(scenarios: list[Scenario]) -> None:
    """Sums over all scenes, and the time for each scene."""
    print("scenes    repair             found  left  changed  median ms  max ms")
    rough = [
        at_constant_velocity(shaken(one, seed)) for seed, one in enumerate(scenarios)
    ]
    for name, given in (("recorded", scenarios), ("rough", rough)):
        scenes = given
        for repair, count in (
            (project_to_lanes, num_off_lanes),
            (separate_overlaps, num_overlaps),
            (without_collisions, num_conflicts),
        ):
            spent, after = [], []
            for scene in scenes:
                start = time.perf_counter()
                after.append(repair(scene))
                spent.append(1e3 * (time.perf_counter() - start))
            found, left = sum(map(count, scenes)), sum(map(count, after))
            changed = sum(map(num_changed, scenes, after))
            print(
                f"{name:9s} {repair.__name__:18s} {found:5d} {left:5d}  {changed:7d}  "
                f"{np.median(spent):9.1f}  {max(spent):6.0f}"
            )
            scenes = after


def print_times(scenarios: list[Scenario]) -> None:
    """State repairs of 64 moving agents shifted by 2 m, in a very crowded scene."""
    busiest = max(scenarios, key=lambda one: len(movers_now(one, 0.5)))
    scene = shaken(crowd(busiest, 64), 0)
    on_lanes = project_to_lanes(scene)
    print("\n64 agents          changed  median ms  min ms")
    cases: list[tuple[Callable, Scenario]] = [
        (project_to_lanes, scene),
        (separate_overlaps, on_lanes),
    ]
    for repair, given in cases:
        spent, repaired = [], given
        for _ in range(REPEATS):
            # A new scenario value, so that nothing cached by its identity helps.
            fresh = replace(given)
            start = time.perf_counter()
            repaired = repair(fresh)
            spent.append(1e3 * (time.perf_counter() - start))
        print(
            f"{repair.__name__:18s} {num_changed(given, repaired):7d}  "
            f"{np.median(spent):9.1f}  {min(spent):6.1f}"
        )


def main() -> None:
    scenarios = full_scenarios()
    print_effects(scenarios)
    print_times(scenarios)


if __name__ == "__main__":
    main()
