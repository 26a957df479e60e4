"""Eight samples of 32 agents, alone and beside busy processes, by wall time.

``python -m benchmarks.busy [--rounds 3] [--busy 0 2] [--set NAME=VALUE ...]``. A process
with the default settings of threads alternates with one in which threads spin while they
wait, as they do by default in torch, and with one for each ``--set``. Reads full scenes
under PD_EDITOR_AV2.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.figures import load_in_words
from benchmarks.interleaved import crowd
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.generation import GenerationRequest, run_to_end

NUM_SAMPLES = 8
RUNS_EACH = 7
SPINNING = {"GOMP_SPINCOUNT": "300000", "KMP_BLOCKTIME": "200"}
BUSY = "while True: pass"


@contextlib.contextmanager
def busy_processes(number: int) -> Iterator[None]:
    """So many processes that never wait, within the context."""
    running = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(number)]
    try:
        yield
    finally:
        for one in running:
            one.kill()
            one.wait()


def run_times() -> list[float]:
    """Wall milliseconds of requests, each with another seed."""
    scenario = crowd()
    generator = make_generator(DEFAULT_GENERATOR)
    times = []
    for seed in range(RUNS_EACH + 1):
        request = GenerationRequest(
            scenario=scenario,
            agent_ids=scenario.agents.ids,
            num_samples=NUM_SAMPLES,
            seed=seed,
        )
        began = time.perf_counter()
        run_to_end(generator.generate(request))
        times.append(1000 * (time.perf_counter() - began))
    return times[1:]


def main() -> None:
    """Print a line for each load and setting."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--busy", type=int, nargs="+", default=[0, 2])
    parser.add_argument("--set", nargs="+", default=[])
    parser.add_argument("--child", action="store_true")
    options = parser.parse_args()
    if options.child:
        print(json.dumps(run_times()))
        return
    settings = {"default": {}, "spinning": SPINNING}
    settings |= {one: dict([one.split("=")]) for one in options.set}
    print(load_in_words())
    for number in options.busy:
        times: dict[str, list[float]] = {name: [] for name in settings}
        with busy_processes(number):
            for _ in range(options.rounds):
                for name, values in settings.items():
                    done = subprocess.run(
                        [sys.executable, "-m", "benchmarks.busy", "--child"],
                        env={**os.environ, **values},
                        capture_output=True,
                        check=True,
                        text=True,
                    )
                    times[name] += json.loads(done.stdout)
        for name, values in times.items():
            low, middle, high = np.percentile(values, [25, 50, 75])
            print(
                f"beside {number} busy: {name:24s} {middle:6.0f} ms "
                f"({low:.0f} to {high:.0f})",
                flush=True,
            )


if __name__ == "__main__":
    main()
