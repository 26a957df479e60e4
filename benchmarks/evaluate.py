"""The baselines' table: 47 scenes on plain and nine perturbed roads, five methods.

Reads the train and val folders under PD_EDITOR_AV2; goal: 3 minutes on 2 cores.
``python -m benchmarks.evaluate [OUT]`` keeps the report in OUT.
"""

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.figures import load_in_words
from pd_editor.cli.evaluate import Evaluation, evaluate

NUM_CORES = 2
GROUPS = ("movers", "movers on their way")
SHOWN = (
    "lateral_deviation_final",
    "new_overlap",
    "path_length",
    "ade",
    "min_ade",
    "end_spread",
)


def cpu_s() -> float:
    """User and system time of this process and of its workers that have ended."""
    use = [
        resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    ]
    return sum(one.ru_utime + one.ru_stime for one in use)


def print_table(found: Evaluation) -> None:
    """Means of movers, plain and perturbed."""
    summary = found.summary
    for group in GROUPS:
        for road in ("none", "perturbed"):
            w, g = summary.roads.index(road), summary.groups.index(group)
            print(f"\n{group}, {road}: {', '.join(SHOWN)}, median lateral deviation")
            for m, method in enumerate(summary.methods):
                means = [
                    float(summary.statistics[name].mean.value[m, w, g])
                    for name in SHOWN
                ]
                means.append(float(summary.median_final.value[m, w, g]))
                print(f"  {method:18s}", *(f"{value:8.3f}" for value in means))


def main() -> None:
    """Run it and print times and means."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    with tempfile.TemporaryDirectory() as folder:
        out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder) / "out"
        print(f"before: {load_in_words()}")
        began, used = time.perf_counter(), cpu_s()
        found = evaluate(
            data=(root / "train", root / "val"),
            out=out,
            warps=("all",),
            workers=NUM_CORES,
        )
        wall, cpu = time.perf_counter() - began, cpu_s() - used
        print(f"after:  {load_in_words()}")
        record = found.record
        print(
            f"{record.num_scenes} scenes, {record.num_items} with roads, "
            f"{len(record.failures)} failures: wall {wall:.0f} s, CPU {cpu:.0f} s, so "
            f"{cpu / NUM_CORES:.0f} s on {NUM_CORES} idle cores (goal 180 s)"
        )
        print_table(found)


if __name__ == "__main__":
    main()
