"""Processor seconds of whole processes of the shell, start included.

``python -m benchmarks.shell [--rounds 5] [--other ../former]``; a second checkout is
timed in turns, scene by scene where it takes one scene only. Reads the train folder
under PD_EDITOR_AV2.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.figures import load_in_words

HERE = Path(__file__).resolve().parents[1]
NUM_SCENES = 25


def seconds(checkout: Path, *words: object) -> tuple[float, float]:
    """Processor and wall seconds of a command in a process of its own."""
    before, began = os.times(), time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "pd_editor", *map(str, words)],
        cwd=checkout,
        env={**os.environ, "PYTHONPATH": str(checkout)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        check=True,
    )
    after = os.times()
    spent = after.children_user + after.children_system
    return (
        spent - before.children_user - before.children_system,
        time.perf_counter() - began,
    )


def main() -> None:
    """Print a line for each command and checkout."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--other", type=Path)
    options = parser.parse_args()
    root = Path(os.environ["PD_EDITOR_AV2"]) / "train"
    scenes = sorted(one.parent for one in root.glob("*/scenario_*.parquet"))[
        :NUM_SCENES
    ]
    checkouts = {"here": HERE}
    if options.other:
        checkouts["other"] = options.other.resolve()
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    print(load_in_words())
    for number in range(options.rounds):
        for name, checkout in checkouts.items():
            with tempfile.TemporaryDirectory() as out:
                runs: dict[str, Sequence[tuple[object, ...]]] = {
                    "--help": [("--help",)],
                    "generate --help": [("generate", "--help")],
                    "generate, 1 scene": [("generate", scenes[0], "--out", f"{out}/1")],
                }
                if not number:
                    each = [("generate", one, "--out", f"{out}/25") for one in scenes]
                    all_at_once = [("generate", *scenes, "--out", f"{out}/25")]
                    runs[f"generate, {len(scenes)} scenes"] = (
                        all_at_once if name == "here" else each
                    )
                for what, commands in runs.items():
                    spent = [seconds(checkout, *words) for words in commands]
                    total = sum(one for one, _ in spent), sum(one for _, one in spent)
                    found.setdefault((what, name), []).append(total)
    for (what, name), times in found.items():
        low, middle, high = np.percentile(times, [25, 50, 75], axis=0)
        print(
            f"{what:22s} {name:6s} {middle[0]:7.2f} s of processor "
            f"({low[0]:.2f} to {high[0]:.2f}), {middle[1]:6.2f} s of wall"
        )


if __name__ == "__main__":
    main()
