"""Throughput of studies, search against grid, Ray, and coordination of many workers.

Reads the train and val folders under PD_EDITOR_AV2. ``python -m benchmarks.studies PART``
runs one part: ``throughput``, ``search``, ``ray`` or ``coordination``; without PART all.
"""

import heapq
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmarks.figures import load_in_words
from pd_editor.experiments.evaluation.evaluation import Scene, scenes_of
from pd_editor.experiments.evaluation.method import Method
from pd_editor.experiments.studies.outcomes import (
    SearchItem,
    SearchSettings,
    grid_worst_cases,
    search_scene,
)
from pd_editor.experiments.studies.study_plan import (
    StudyPlan,
    grid_conditions,
    study_items,
    study_scene,
)
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.experiments.work_engine.ray_cluster import RayCluster
from pd_editor.experiments.work_engine.work_engine import (
    WorkEngine,
    WorkResult,
    run_items,
)
from pd_editor.generation.generators import make_generator

Item = TypeVar("Item")
Value = TypeVar("Value")

SEEDS_OF_A_LONG_STUDY = (0, 1, 2)
"""One seed takes one worker about 30 s."""


def plan_of(*methods: str, seeds: tuple[int, ...] = (0,)) -> StudyPlan:
    """Scene-Attack's grid on ``val``."""
    return StudyPlan(
        data=(Path(os.environ["PD_EDITOR_AV2"]) / "val",),
        methods=tuple(
            Method(name=name, make_generator=make_generator) for name in methods
        ),
        conditions=grid_conditions(),
        seeds=seeds,
    )


def scenes() -> tuple[Scene, ...]:
    """Scenes of ``val``."""
    return scenes_of(plan_of("lane-follower").data).scenes


def timed(plan: StudyPlan, engine: WorkEngine) -> tuple[float, float, bytes]:
    """Seconds in all, seconds after the first item, and the rows' file."""
    with tempfile.TemporaryDirectory() as folder:
        out = plan.folder(Path(folder) / "out", resume=False)
        items = study_items(plan, scenes())
        began = time.perf_counter()
        first: list[float] = []

        def tell(progress: object) -> None:
            if getattr(progress, "num_done", 0) >= 1 and not first:
                first.append(time.perf_counter())

        record = out.run(study_scene, items, engine, on_progress=tell)
        ended = time.perf_counter()
        assert not record.failures, record.failures
        rows = (out.path / "variants.parquet").read_bytes()
        return ended - began, ended - first[0], rows


def throughput() -> None:
    """Scenario variants a second on two processes, their start included."""
    print(load_in_words())
    for name in ("lane-follower", "path-diffuser:tries=1"):
        plan = plan_of(name)
        took, _, _ = timed(plan, LocalProcesses(num_workers=2))
        count = plan.num_variants(len(scenes()))
        print(f"{name}: {count} variants in {took:.1f} s, {count / took:.1f} a second")


def search() -> None:
    """Share of the scenes of ``val`` where the search is at least as bad as the grid."""
    settings = SearchSettings()
    for name in ("constant-velocity", "lane-follower"):
        plan = plan_of(name)
        items = study_items(plan, scenes())
        with tempfile.TemporaryDirectory() as folder:
            out = plan.folder(Path(folder) / "out", resume=False)
            record = out.run(study_scene, items, LocalProcesses(num_workers=2))
            cases = grid_worst_cases(record.rows, settings)
        grid = {one.scenario: one for one in cases}
        found = {}
        run_items(
            LocalProcesses(num_workers=2),
            search_scene,
            {
                key: SearchItem(variant=item, settings=settings)
                for key, item in items.items()
                if key.endswith("-c0")
            },
            on_value=found.__setitem__,
        )
        pairs = [(one, grid.get(one.scenario)) for one in found.values()]
        both = [(one, other) for one, other in pairs if other is not None]
        as_bad = [one.value >= other.value - 1e-12 for one, other in both]
        gain = np.mean([one.value - other.value for one, other in both])
        print(
            f"{name}: as bad in {sum(as_bad)} of {len(both)} scenes, {gain:+.4f} "
            f"{settings.metric} on average, {settings.num_trials} trials each"
        )


def ray() -> None:
    """Ray with one and two workers in turn, on a study of over a minute of one worker."""
    print(load_in_words())
    plan = plan_of("lane-follower", seeds=SEEDS_OF_A_LONG_STUDY)
    times: dict[int, list[float]] = {1: [], 2: []}
    first = b""
    for workers in (1, 2, 2, 1):
        took, after, rows = timed(plan, RayCluster(num_workers=workers))
        first = first or rows
        assert rows == first, "the rows do not depend on the number of workers"
        times[workers].append(after)
        print(
            f"Ray, {workers} workers: {took:.1f} s, {after:.1f} s after the first item"
        )
    _, here, rows = timed(plan, LocalProcesses(num_workers=2))
    assert first == rows, "Ray's rows are those of processes"
    means = {workers: float(np.mean(found)) for workers, found in times.items()}
    print(
        f"{plan.num_variants(len(scenes()))} variants: ratio "
        f"{means[1] / means[2]:.2f} ({means[1]:.1f}; {means[2]:.1f} s); two processes "
        f"{here:.1f} s; {load_in_words()}"
    )


@dataclass(frozen=True, kw_only=True)
class MockWorkers:
    """A work engine that simulates workers on a clock of its own."""

    num_workers: int
    item_s: float
    spread: float = 0.3
    """Relative spread of the time of an item."""
    busy_s: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """After a run: when the last worker ends, and how long the caller was busy."""

    def run(
        self,
        function: Callable[[Item], Value],
        items: Mapping[str, Item],
        *,
        on_result: Callable[[WorkResult[Value]], None],
        on_wait: Callable[[], None] = lambda: None,
    ) -> None:
        """Give each item to the worker that is free first; the caller's time is real."""
        random = np.random.default_rng(0)
        free = [(0.0, number) for number in range(self.num_workers)]
        caller = 0.0
        for key, item in items.items():
            at, number = heapq.heappop(free)
            took = self.item_s * max(random.normal(1.0, self.spread), 0.1)
            began = time.perf_counter()
            on_result(WorkResult(key=key, value=function(item)))
            caller += time.perf_counter() - began
            # The caller hands out and takes back one item at a time.
            start = max(at, caller)
            heapq.heappush(free, (start + took, number))
        self.busy_s[:] = [max(at for at, _ in free), caller]


def coordination() -> None:
    """A simulated run of 10,000 items on 64 mock workers: the cost of coordination."""
    plan = plan_of("lane-follower")
    item = next(iter(study_items(plan, scenes()).values()))
    began = time.perf_counter()
    rows = study_scene(item)
    item_s = time.perf_counter() - began
    num_items, num_workers = 10_000, 64
    with tempfile.TemporaryDirectory() as folder:
        out = plan.folder(Path(folder) / "out", resume=False)
        engine = MockWorkers(num_workers=num_workers, item_s=item_s)
        items = {f"val/scene-{n}/m0-s0-c0": n for n in range(num_items)}
        run_items(engine, lambda _: rows, items, on_value=out.store)
        size = sum(one.stat().st_size for one in out.path.rglob("*.parquet"))
    total, caller = engine.busy_s
    ideal = num_items * item_s / num_workers
    print(
        f"{num_items} items of {len(item.conditions)} variants and {item_s:.2f} s on "
        f"{num_workers} workers: {total:.0f} s, ideal {ideal:.0f} s (efficiency "
        f"{ideal / total:.2f}); the caller is busy {caller:.1f} s, "
        f"{caller / num_items * 1e3:.2f} ms an item; {size / num_items / 1e3:.1f} kB each"
    )
    variants, per_item = 200_000 * 54, len(item.conditions)
    print(
        f"200,000 scenarios x 54 conditions: {variants / per_item * item_s / 3600:.0f} "
        f"core hours, {variants / per_item * size / num_items / 1e9:.1f} GB, caller "
        f"{variants / per_item * caller / num_items / 3600:.1f} h"
    )


PARTS: dict[str, Callable[[], None]] = {
    "throughput": throughput,
    "search": search,
    "ray": ray,
    "coordination": coordination,
}


def main() -> None:
    """Run the parts that are named, or all."""
    for name in sys.argv[1:] or PARTS:
        PARTS[name]()


if __name__ == "__main__":
    main()
