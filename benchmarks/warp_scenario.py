"""Time of bending a road, slowing agents, and judging the result.

Run as ``python -m benchmarks.warp_scenario``, with PD_EDITOR_AV2 naming a
folder of Argoverse 2 scenarios.
"""

import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pd_editor.analysis.findings.check import scene_problems
from pd_editor.analysis.metrics.box_overlaps import first_overlap
from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.scene.av2_io.map_file import read_map
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M, RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario

REPEATS = 60


def largest_scenario(root: Path) -> Scenario:
    """The scenario with a future whose map has the most points."""
    folders = [p.parent for p in root.glob("*/*/scenario_*.parquet")]
    by_size = sorted(
        folders, key=lambda f: next(f.glob("log_map*")).stat().st_size, reverse=True
    )
    scenarios = (read_scenario(folder) for folder in by_size)
    return next(
        s for s in scenarios if s.agents.is_valid[:, s.current_step + 1 :].any()
    )


def busiest_scenario(root: Path) -> Scenario:
    """The scenario with the most agents at the current step, and a future."""
    scenarios = [read_scenario(p.parent) for p in root.glob("*/*/scenario_*.parquet")]
    return max(
        scenarios,
        key=lambda s: (
            s.agents.is_valid[:, s.current_step + 1 :].any(),
            s.agents.is_valid[:, s.current_step].sum(),
        ),
    )


def with_largest_map(root: Path, scenario: Scenario) -> Scenario:
    """The scenario's agents on the map with the most lanes (of a sensor log)."""
    paths = list(root.glob("sensor_logs/*/map/log_map_archive_*.json"))
    largest = max(paths, key=lambda p: len(json.loads(p.read_text())["lane_segments"]))
    road_map = read_map(largest.read_bytes(), largest.name, np.zeros(2))
    center = np.concatenate(road_map.polylines)[:, :2].mean(axis=0)
    agents = scenario.agents
    rows = np.arange(len(agents))
    moved = agents.position_m + center * agents.is_valid[..., None]
    return replace(
        scenario, road_map=road_map, agents=agents.with_rows(rows, position_m=moved)
    )


def all_terms(scenario: Scenario) -> RoadWarp:
    """A smooth turn, a double turn and a ripple ahead of the first agent present."""
    step = scenario.current_step
    row = int(scenario.agents.is_valid[:, step].argmax())
    x, y = scenario.agents.position_m[row, step].tolist()
    terms = tuple(
        WarpTerm(kind=kind, power=4.0, length_m=length)
        for kind, length in DEFAULT_LENGTH_M.items()
    )
    return RoadWarp(anchor=RigidMotion(x_m=x, y_m=y, rotation_rad=0.4), terms=terms)


def measured(name: str, run: Callable[[], object]) -> None:
    """Print median and spread of some runs."""
    run()
    took = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        run()
        took.append((time.perf_counter() - start) * 1e3)
    low, middle, high = np.percentile(took, [5, 50, 95])
    print(f"  {name:<44} {min(took):6.2f} {low:6.2f} {middle:6.2f} {high:6.2f}")


def report(title: str, scenario: Scenario) -> None:
    """Print the times of one scenario."""
    agents, step = scenario.agents, scenario.current_step
    warp = all_terms(scenario)
    warped = warp_scenario(scenario, warp)
    limited = warp_scenario(scenario, warp, friction_coefficient=0.7)
    later = np.arange(step + 1, scenario.time_axis.num_steps)
    points = sum(map(len, scenario.road_map.dense.polylines))
    print(
        f"{title}: {len(scenario.road_map.lanes)} lanes, {points} dense points, "
        f"{len(agents)} agents"
    )
    print(f"  {'milliseconds':<44} {'min':>6} {'p5':>6} {'median':>6} {'p95':>6}")
    measured("warp, three terms", lambda: warp_scenario(scenario, warp))
    measured("warp again while one is in force", lambda: warp_scenario(warped, warp))
    measured(
        "warp with friction limit",
        lambda: warp_scenario(limited, warp, friction_coefficient=0.7),
    )
    measured("take back", lambda: warp_scenario(warped, None))
    measured("first overlaps of the future", lambda: first_overlap(agents, later))
    measured(
        "off road, all future steps",
        lambda: is_off_road(warped, agents.position_m[:, later]),
    )
    measured("problems now", lambda: scene_problems(warped, with_future=False))
    measured("problems with future", lambda: scene_problems(warped))


def main() -> None:
    """Print the times on the largest scenarios."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    report("largest scenario map", largest_scenario(root))
    busiest = busiest_scenario(root)
    report("most agents", busiest)
    if any(root.glob("sensor_logs/*/map/log_map_archive_*.json")):
        report("map of a sensor log, same agents", with_largest_map(root, busiest))
    else:
        print(
            "map of a sensor log: left out, there are no sensor_logs in PD_EDITOR_AV2"
        )


if __name__ == "__main__":
    main()
