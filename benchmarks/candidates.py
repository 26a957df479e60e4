"""Frenet candidates on real scenarios: time, coverage, distance to the logged future.

Reads the train and val folders under PD_EDITOR_AV2.
"""

import os
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES
from pd_editor.scene.paths.motion_primitives import candidates
from pd_editor.scene.scenario import Scenario

REPEATS = 60


def full_scenarios(*splits: str) -> list[Scenario]:
    """Every scenario of some splits, or of train and val; these have a logged future."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    files = [
        path
        for split in splits or ("train", "val")
        for path in sorted((root / split).glob("*/scenario_*.parquet"))
    ]
    return [read_scenario(path.parent) for path in files]


def movers_now(scenario: Scenario, least_mps: float = 0.0) -> np.ndarray:
    """Rows of the movers that exist at the current step, no slower than asked."""
    agents, step = scenario.agents, scenario.current_step
    wanted = agents.kind_mask(MOTOR_VEHICLE_KINDS) & agents.is_valid[:, step]
    return np.flatnonzero(wanted & (agents.speed_mps()[:, step] >= least_mps))


def crowd(scenario: Scenario, count: int) -> Scenario:
    """Only moving movers, repeated with a little jitter until there are enough."""
    rows = np.resize(movers_now(scenario, 0.5), count)
    values = {}
    for field in fields(AgentTracks):
        value = getattr(scenario.agents, field.name)
        is_array = isinstance(value, np.ndarray)
        values[field.name] = value[rows] if is_array else tuple(value[r] for r in rows)
    jitter = np.random.default_rng(0).normal(0, 0.3, (count, 1, 2))
    values["ids"] = tuple(str(index) for index in range(count))
    values["position_m"] = values["position_m"] + jitter
    return replace(scenario, agents=AgentTracks(**values), focal_id="0")


def print_times(scenarios: list[Scenario]) -> None:
    """Time on the busiest scene and on the largest map."""
    busiest = max(scenarios, key=lambda one: len(movers_now(one, 0.5)))
    largest = max(
        (one for one in scenarios if len(movers_now(one, 0.5)) >= 8),
        key=lambda one: len(one.road_map.lanes),
    )
    print("scene      lanes  agents  median ms  min ms  candidates/agent")
    for name, scenario in (("busiest", busiest), ("largest", largest)):
        for count in (32, 64):
            scene = crowd(scenario, count)
            rows = np.arange(count)
            found = candidates(scene, rows)
            spent = []
            for _ in range(REPEATS):
                start = time.perf_counter()
                candidates(scene, rows)
                spent.append(1e3 * (time.perf_counter() - start))
            print(
                f"{name:10s} {len(scene.road_map.lanes):5d}  {count:6d}  "
                f"{np.median(spent):9.1f}  {min(spent):6.1f}  "
                f"{found.is_valid.sum(1).mean():.1f}"
            )
    road_map = largest.road_map
    spent = []
    for _ in range(20):
        fresh = replace(road_map)
        start = time.perf_counter()
        _ = lane_graph(fresh).search.heading_rad
        spent.append(1e3 * (time.perf_counter() - start))
    print(
        f"index of {len(road_map.lanes)} lanes: median {np.median(spent):.1f} ms, "
        f"min {min(spent):.1f} ms"
    )


def print_coverage(scenarios: list[Scenario]) -> None:
    """Share of movers near a lane that get a candidate which does not stand."""
    near_lane = covered = 0
    missed = []
    for scenario in scenarios:
        rows, step = movers_now(scenario), scenario.current_step
        if not len(rows):
            continue
        agents, graph = scenario.agents, lane_graph(scenario.road_map)
        near = graph.search.in_reach(
            agents.position_m[rows, step],
            agents.heading_rad[rows, step],
            np.tile(graph.allowed(DRIVING_LANES), (len(rows), 1)),
            reach_m=3.0,
        )
        found = candidates(scenario, rows)
        moved = np.linalg.norm(
            found.position_m[:, :, -1] - found.position_m[:, :, 0], axis=-1
        )
        goes = ((moved > 2.0) & ~found.is_standstill & found.is_valid).any(1)
        goes &= found.has_lane
        for index in np.unique(near.point):
            near_lane += 1
            covered += bool(goes[index])
            if not goes[index]:
                missed.append(f"{scenario.scenario_id} {agents.ids[rows[index]]}")
    share = 100 * covered / near_lane
    print(f"coverage: {covered} of {near_lane} movers near a lane = {share:.1f} %")
    for line in missed:
        print(f"  without: {line}")


def print_distances(scenarios: list[Scenario]) -> None:
    """Distance of the best candidate to the logged future, moving movers."""
    error, steady, numbers = [], [], []
    for scenario in scenarios:
        agents, step = scenario.agents, scenario.current_step
        rows = movers_now(scenario, 0.5)
        rows = rows[agents.is_valid[rows, step:].all(1)]
        if not len(rows):
            continue
        logged = agents.position_m[rows, step:]
        found = candidates(scenario, rows)
        gap = np.linalg.norm(found.position_m - logged[:, None], axis=-1)
        mean_gap = np.where(found.is_valid, gap[:, :, 1:].mean(-1), np.inf)
        error += mean_gap.min(1).tolist()
        numbers += found.is_valid.sum(1).tolist()
        times = np.arange(logged.shape[1]) * scenario.time_axis.step_s
        straight = (
            logged[:, :1] + times[:, None] * agents.velocity_mps[rows, step][:, None]
        )
        gap = np.linalg.norm(straight - logged, axis=-1)
        steady += gap[:, 1:].mean(-1).tolist()
    print(
        f"best candidate, {len(error)} moving movers: ADE mean {np.mean(error):.2f} m, "
        f"median {np.median(error):.2f} m, 90 % {np.percentile(error, 90):.2f} m, "
        f"{np.mean(numbers):.1f} candidates each"
    )
    print(
        f"constant velocity: ADE mean {np.mean(steady):.2f} m, "
        f"median {np.median(steady):.2f} m"
    )


def main() -> None:
    """Print all figures."""
    scenarios = full_scenarios()
    print(f"{len(scenarios)} scenarios")
    print_times(scenarios)
    print_coverage(scenarios)
    print_distances(scenarios)


if __name__ == "__main__":
    main()
