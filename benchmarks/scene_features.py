"""Scene features of real scenarios: time with and without candidates; store reading.

Reads the train and val folders under PD_EDITOR_AV2.
"""

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.candidates import crowd, full_scenarios, movers_now
from pd_editor.experiments.training.augmentation import (
    DEFAULT_AUGMENTATION,
    augmented,
)
from pd_editor.experiments.training.feature_preparation import (
    fit_basis,
    prepare_features,
)
from pd_editor.generation.features.scene_features import scene_features
from pd_editor.scene.scenario import Scenario

REPEATS = 60


def spent_ms(call: Callable[[], object]) -> tuple[float, float]:
    """Median and least time of a call."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        call()
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times)), min(times)


def fresh(scenario: Scenario) -> Scenario:
    """The same scenario on a map that nothing is known of."""
    return replace(scenario, road_map=replace(scenario.road_map))


def print_times(scenarios: list[Scenario]) -> None:
    """Time on the busiest scene and on the largest map."""
    busiest = max(scenarios, key=lambda one: len(movers_now(one, 0.5)))
    largest = max(
        (one for one in scenarios if len(movers_now(one, 0.5)) >= 8),
        key=lambda one: len(one.road_map.lanes),
    )
    print("scene    lanes  agents  pieces  what                 median ms  min ms")
    for name, scenario in (("busiest", busiest), ("largest", largest)):
        for count in (8, 32, 64):
            scene = crowd(scenario, count)
            found = scene_features(scene)
            head = f"{name:8s} {len(scene.road_map.lanes):5d}  {count:6d}  "
            head += f"{len(found.piece_pose):6d}  "
            calls: dict[str, Callable[[], object]] = {
                "with candidates": lambda scene=scene: scene_features(scene),
                "without": lambda scene=scene: scene_features(
                    scene, with_candidates=False
                ),
                "with, map unknown": lambda scene=scene: scene_features(fresh(scene)),
            }
            for what, call in calls.items():
                median, least = spent_ms(call)
                print(f"{head}{what:20s} {median:9.2f}  {least:6.2f}")


def print_preparation(scenarios: list[Scenario]) -> None:
    """Processor time of augmented features, and the store of the train folder."""
    random = np.random.default_rng(0)
    start = time.process_time()
    for _ in range(4):
        for scenario in scenarios:
            scene_features(
                augmented(scenario, DEFAULT_AUGMENTATION, random, hides_agents=True)
            )
    each = (time.process_time() - start) / (4 * len(scenarios))
    print(f"augmented and featurised: {1e3 * each:.1f} ms of processor time a scenario")
    root = Path(os.environ["PD_EDITOR_AV2"]) / "train"
    with tempfile.TemporaryDirectory() as folder:
        basis = fit_basis([root], workers=1)
        store = prepare_features([root], Path(folder) / "store", basis, workers=1)
        size = sum(file.stat().st_size for file in Path(folder).glob("store/*/*"))
        reads = []
        for place in np.resize(np.arange(len(store)), 500):
            begin = time.perf_counter()
            store[int(place)]
            reads.append(1e3 * (time.perf_counter() - begin))
    print(
        f"store: {size / len(store):.0f} bytes a scenario, read in "
        f"{np.median(reads):.3f} ms (90 %: {np.quantile(reads, 0.9):.3f})"
    )


def main() -> None:
    """Print all tables."""
    scenarios = full_scenarios()
    print_times(scenarios)
    print_preparation(scenarios)


if __name__ == "__main__":
    main()
