"""All metrics of real scenes: time, and what recordings score.

Reads the train and val folders under PD_EDITOR_AV2: the scenarios with a future.
"""

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pd_editor.analysis.metrics.box_overlaps import init_collision_2m
from pd_editor.analysis.metrics.distribution_distance import HISTOGRAMS, noise_floor
from pd_editor.analysis.metrics.scene_metrics import agent_values, sample_values
from pd_editor.analysis.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.analysis.metrics.values import METRICS, MetricValues
from pd_editor.experiments.evaluation.evaluation_task import (
    paper_init_agents,
    paper_trajectory_agents,
)
from pd_editor.experiments.evaluation.summary import (
    Estimate,
    mean_over_scenes,
    scene_weights,
)
from pd_editor.scene.av2_io.read import read_scenario

REPEATS = 9


def real_views() -> list[TrafficView]:
    """Recorded traffic of every full scenario; all its road users are evaluated."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    folders = [
        path.parent
        for split in ("train", "val")
        for path in sorted((root / split).glob("*/scenario_*.parquet"))
    ]
    return [recorded_traffic(read_scenario(folder)) for folder in folders]


def milliseconds(run: Callable[[], object]) -> tuple[float, float]:
    """Time of the first run, and the least of the later ones."""
    spent = []
    for _ in range(1 + REPEATS):
        start = time.perf_counter()
        run()
        spent.append(1e3 * (time.perf_counter() - start))
    return spent[0], min(spent[1:])


def print_times(views: list[TrafficView]) -> None:
    rows: dict[str, list[float]] = {
        "agent_values, first on a map": [],
        "agent_values": [],
        "sample_values, 6 samples": [],
    }
    for view in views:
        first, later = milliseconds(lambda view=view: agent_values(view))
        rows["agent_values, first on a map"].append(first)
        rows["agent_values"].append(later)
        samples = milliseconds(lambda view=view: sample_values([view] * 6))
        rows["sample_values, 6 samples"].append(samples[1])
    counts = [len(view) for view in views]
    print(
        f"{len(views)} scenes, {np.median(counts):.0f} road users (max {max(counts)})"
    )
    for name, values in rows.items():
        print(f"{name:30s} median {np.median(values):6.1f} ms  max {max(values):6.1f}")
    share = np.mean(np.array(rows["agent_values"]) <= 20)
    print(f"agent_values within 20 ms: {100 * share:.0f} % of scenes\n")


def interval_of(scenes: list[MetricValues]) -> tuple[Estimate, int]:
    """Mean over all valid values with its interval, and how many values there are."""
    sums = np.array([scene.value[scene.is_valid].sum() for scene in scenes], float)
    counts = np.array([scene.is_valid.sum() for scene in scenes], float)
    weights = scene_weights(len(scenes), seed=0)
    return mean_over_scenes(sums, counts, weights), int(counts.sum())


def percent(scenes: list[MetricValues]) -> str:
    found, count = interval_of(scenes)
    low, high = 100 * float(found.low), 100 * float(found.high)
    mean = 100 * float(found.value)
    return f"{mean:5.2f} % [{low:.2f}, {high:.2f}] of {count} agents"


def only(view: TrafficView, mask: np.ndarray) -> TrafficView:
    """Some evaluated agents, without any other agent."""
    return replace(
        view,
        agents=view.agents.taken(mask),
        context=view.context.taken(np.zeros(0, int)),
        logged=view.logged.taken(mask),
    )


def print_init_collisions(views: list[TrafficView]) -> None:
    print("recordings, another centre within 2 m at the state (paper: 0.70 %)")
    filters = {
        "paper's first stage": paper_init_agents,
        "paper's second stage": paper_trajectory_agents,
        "all movers": lambda view: view.agents.is_in("movers"),
    }
    for name, choose in filters.items():
        scenes = [init_collision_2m(only(view, choose(view))) for view in views]
        print(f"  {name:22s} {percent(scenes)}")
    print()


def print_movers(views: list[TrafficView]) -> None:
    """What recorded movers score in every metric, and what chance makes of distances."""
    table: dict[str, list[MetricValues]] = {}
    for view in views:
        movers = view.agents.is_in("movers")
        for name, values in agent_values(view).items():
            table.setdefault(name, []).append(values.taken(movers))
    print(f"{'recorded movers':28s} {'source':6s}     mean  95 % interval       values")
    for name, scenes in table.items():
        found, count = interval_of(scenes)
        print(
            f"{name:28s} {METRICS[name].source:6s} {found.value:8.4f}  "
            f"[{found.low:.4f}, {found.high:.4f}] {METRICS[name].unit:7s}{count}"
        )
    print("\nnoise floor of distances (root of the divergence) at 400 agents")
    for histogram in HISTOGRAMS:
        floor = noise_floor(
            table[histogram.metric],
            lambda a, b, histogram=histogram: histogram.distance(a, b).root,
            num_agents=400,
        )
        print(f"{histogram.metric:28s} {histogram.source:6s} {floor:.3f}")


def main() -> None:
    """Print times, the paper's collision rate of recordings, and all metrics."""
    views = real_views()
    print_times(views)
    print_init_collisions(views)
    print_movers(views)


if __name__ == "__main__":
    main()
