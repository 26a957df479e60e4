"""Times of both stages in this checkout, and as ratios to those in another one.

Machines differ by a factor of two from hour to hour, and other programs take their share:
checkouts sample in turns, each in a process of its own, and the thread's processor time
counts. ``git worktree add ../former 3b06ae4``, then
``python -m benchmarks.interleaved [--other ../former] [--rounds 12]``.
Reads full scenes under PD_EDITOR_AV2.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from pd_editor.av2_io.read import read_scenario
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario

HERE: Final = Path(__file__).resolve().parents[1]
NUM_AGENTS: Final = 32
RUNS_EACH: Final = 3
HALF_SIDE_M: Final = 62.0
NAMES: Final = (
    "states and trajectories, one square",
    "states to trajectories, 4 steps",
    "states to trajectories, 10 steps",
    "without yielding, 4 steps",
    "without yielding, 10 steps",
    "six samples of trajectories",
)


def workloads() -> dict[str, Callable[[], object]]:
    """What is timed; only what checkouts have had in common for long is used."""
    from pd_editor.generation import (
        AVOIDANCE,
        GenerationRequest,
        GuidanceSetting,
        Region,
        run_to_end,
    )
    from pd_editor.generators import DEFAULT_GENERATOR, make_generator

    scenario = crowd()
    diffuser, ids = make_generator(DEFAULT_GENERATOR), scenario.agents.ids
    middle = scenario.agents.position_m[0, scenario.current_step]
    square = Region(center_m=tuple(middle.tolist()), half_side_m=HALF_SIDE_M)

    plain = (GuidanceSetting(name=AVOIDANCE, parameters={"tries": 0.0}),)

    def run(**settings: object) -> object:
        request = GenerationRequest(scenario=scenario, agent_ids=ids, **settings)  # type: ignore[arg-type]
        return run_to_end(diffuser.generate(request))

    works = (
        lambda: run(resampled_state_ids=ids, region=square),
        lambda: run(num_denoising_steps=4),
        lambda: run(num_denoising_steps=10),
        lambda: run(num_denoising_steps=4, guidance=plain),
        lambda: run(num_denoising_steps=10, guidance=plain),
        lambda: run(num_samples=6),
    )
    return dict(zip(NAMES, works, strict=True))


def crowd() -> Scenario:
    """The moving vehicles of the busiest scene, again and again with a little jitter."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    folders = sorted(one.parent for one in (root / "train").glob("*/scenario_*"))
    scenes = [(one, moving_vehicles(one)) for one in map(read_scenario, folders)]
    scenario, rows = max(scenes, key=lambda pair: len(pair[1]))
    rows = np.resize(rows, NUM_AGENTS)
    values: dict[str, Any] = {}
    for one in fields(AgentTracks):
        value = getattr(scenario.agents, one.name)
        is_array = isinstance(value, np.ndarray)
        values[one.name] = value[rows] if is_array else tuple(value[r] for r in rows)
    jitter = np.random.default_rng(0).normal(0, 0.3, (NUM_AGENTS, 1, 2))
    values["ids"] = tuple(str(index) for index in range(NUM_AGENTS))
    values["position_m"] = values["position_m"] + jitter
    return replace(scenario, agents=AgentTracks(**values), focal_id="0")


def moving_vehicles(scenario: Scenario) -> np.ndarray:
    """Rows of those that drive at the current step."""
    agents, step = scenario.agents, scenario.current_step
    is_vehicle = np.array([kind.value == "vehicle" for kind in agents.kinds], bool)
    moves = agents.speed_mps()[:, step] >= 0.5
    return np.flatnonzero(is_vehicle & agents.is_valid[:, step] & moves)


def work() -> None:
    """Time what is asked for, line by line, until the input ends."""
    works = workloads()
    print("ready", flush=True)
    for line in sys.stdin:
        run, spent = works[line.strip()], []
        for _ in range(RUNS_EACH):
            began = time.thread_time()
            run()
            spent.append(1e3 * (time.thread_time() - began))
        print(json.dumps(spent), flush=True)


@dataclass(kw_only=True, eq=False)
class Checkout:
    """A process that samples with the code of a checkout."""

    folder: Path
    spent: dict[str, list[float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # The package of the checkout comes before that of this one.
        paths = os.pathsep.join([str(self.folder.resolve()), str(HERE)])
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).resolve()), "--work"],
            env={**os.environ, "PYTHONPATH": paths},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._answer() == "ready", "the worker could not start"

    def time(self, name: str) -> None:
        """Run something a few times."""
        assert self._process.stdin is not None
        print(name, file=self._process.stdin, flush=True)
        self.spent.setdefault(name, []).extend(json.loads(self._answer()))

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()


def main() -> None:
    """Print a table of milliseconds."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--other", type=Path)
    parser.add_argument("--rounds", type=int, default=12)
    options = parser.parse_args()
    folders = [HERE] if options.other is None else [HERE, options.other]
    checkouts = [Checkout(folder=folder) for folder in folders]
    for checkout in checkouts:
        for name in NAMES:
            checkout.time(name)
        checkout.spent.clear()
    for _ in range(options.rounds):
        for name in NAMES:
            for checkout in checkouts:
                checkout.time(name)
    print(f"{'milliseconds of the processor':36s}   least  median   ratios")
    for name in NAMES:
        values = [one.spent[name] for one in checkouts]
        least, middle = map(min, values), map(statistics.median, values)
        (low, *former), (half, *former_half) = least, middle
        line = f"{name:36s} {low:7.1f} {half:7.1f}"
        if former:
            line += f"   {low / former[0]:.2f} {half / former_half[0]:.2f}"
        print(line)
    for checkout in checkouts:
        checkout.close()


if __name__ == "__main__":
    if "--work" in sys.argv:
        work()
    else:
        main()
