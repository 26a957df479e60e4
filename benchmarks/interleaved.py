"""Times of both stages in this checkout, and as ratios to those in another one.

Machines differ by a factor of two from hour to hour, and other programs take their share:
checkouts sample in turns, each in a process of its own, and the thread's processor time
counts, on one thread. ``git worktree add ../former COMMIT``, then
``OMP_NUM_THREADS=1 python -m benchmarks.interleaved --other ../former [--rounds 12]
[--only NAME ...]``. The last checkout is the one that others are compared with. Reads
full scenes under PD_EDITOR_AV2.
"""

import argparse
import itertools
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

from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario

HERE: Final = Path(__file__).resolve().parents[1]
NUM_AGENTS: Final = 32
RUNS_EACH: Final = 3
LEAST_MS: Final = 60.0
HALF_SIDE_M: Final = 62.0
STEP: Final = "denoising step of trajectories"
CONTEXT: Final = "context of trajectories"
STATES: Final = "initial states, 10 steps"
STATES_AND_TRAJECTORIES: Final = "states and trajectories, one square"
FOUR_STEPS: Final = "states to trajectories, 4 steps"
TEN_STEPS: Final = "states to trajectories, 10 steps"
FOUR_RAW: Final = "without yielding, 4 steps"
TEN_RAW: Final = "without yielding, 10 steps"
SIX_SAMPLES: Final = "six samples of trajectories"
EIGHT: Final = "8 of 500 agents, a first request"
DRAGGED: Final = "one of 500 agents dragged"
NEAR_DRAGGED: Final = "16 of 500 agents react to a drag"
DRAGGED_TO_GOAL: Final = "one of 500 dragged that has a goal"
NETWORK_NAMES: Final = (STEP, CONTEXT, STATES)
NAMES: Final = (
    *NETWORK_NAMES,
    FOUR_RAW,
    TEN_RAW,
    FOUR_STEPS,
    TEN_STEPS,
    STATES_AND_TRAJECTORIES,
    SIX_SAMPLES,
    EIGHT,
    DRAGGED,
    NEAR_DRAGGED,
    DRAGGED_TO_GOAL,
)


def workloads() -> dict[str, Callable[[], object]]:
    """What is timed, by name; a checkout leaves out what it does not have."""
    scenario = crowd()
    of_networks = dict(zip(NETWORK_NAMES, _network_works(scenario), strict=True))
    found = {**of_networks, **_port_works(scenario), **_large_works()}
    return {name: found[name] for name in NAMES if name in found}


def _port_works(scenario: Scenario) -> dict[str, Callable[[], object]]:
    """Through the port of generators."""
    from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
    from pd_editor.scene import generation

    diffuser, ids = make_generator(DEFAULT_GENERATOR), scenario.agents.ids
    middle = scenario.agents.position_m[0, scenario.current_step]
    square = generation.Region(center_m=tuple(middle.tolist()), half_side_m=HALF_SIDE_M)
    plain = (
        generation.GuidanceSetting(
            name=generation.AVOIDANCE, parameters={"tries": 0.0}
        ),
    )

    def run(**settings: object) -> object:
        request = generation.GenerationRequest(
            scenario=scenario,
            agent_ids=ids,
            **settings,  # type: ignore[arg-type]
        )
        return generation.run_to_end(diffuser.generate(request))

    return {
        STATES_AND_TRAJECTORIES: lambda: run(resampled_state_ids=ids, region=square),
        FOUR_STEPS: lambda: run(num_denoising_steps=4),
        TEN_STEPS: lambda: run(num_denoising_steps=10),
        FOUR_RAW: lambda: run(num_denoising_steps=4, guidance=plain),
        TEN_RAW: lambda: run(num_denoising_steps=10, guidance=plain),
        SIX_SAMPLES: lambda: run(num_samples=6),
    }


def _large_works() -> dict[str, Callable[[], object]]:
    """On a map of ten real ones with 500 agents."""
    from benchmarks.tiled import tiled
    from pd_editor.analysis.guidance.kinds.course import GoalPoint
    from pd_editor.editor.commands import TransformAgents, traffic_command
    from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
    from pd_editor.scene import generation
    from pd_editor.scene.roles.traffic_choice import drivable_agent_ids

    folders = (Path(os.environ["PD_EDITOR_AV2"]) / "train").glob("*/scenario_*")
    scenes = [read_scenario(one.parent) for one in sorted(folders)]
    real = min(scenes, key=lambda one: abs(len(one.road_map.lanes) - 94))
    scenario = tiled(real, num_tiles=10, num_agents=500)
    ids = drivable_agent_ids(scenario)
    diffuser = make_generator(DEFAULT_GENERATOR)

    def run(**settings: Any) -> tuple[generation.GenerationRequest, Any]:
        request = generation.GenerationRequest(**settings)
        return request, generation.run_to_end(diffuser.generate(request))

    driven = traffic_command(*run(scenario=scenario, agent_ids=ids)).apply(scenario)
    place = driven.agents.position_m[driven.agents.rows(ids), driven.current_step]
    near = np.hypot(*(place - place[0]).T).argsort()[:16]
    frames = itertools.count()

    x, y = (place[0] + 20.0).tolist()
    goal = GoalPoint(agent_id=ids[0], point_m=(x, y))

    def drag(names: tuple[str, ...], *terms: GoalPoint) -> object:
        move = 0.1 * (next(frames) % 100)
        edit = TransformAgents(agent_ids=ids[:1], dx_m=move, dy_m=move / 3)
        return run(
            scenario=edit.apply(driven),
            agent_ids=names,
            num_denoising_steps=3,
            guidance=(*generation.guidance_settings(None, 0), *terms),
            before_edit=driven,
        )

    def eight() -> object:
        first = 8 * (next(frames) % 40)
        return run(scenario=driven, agent_ids=ids[first : first + 8])

    return {
        EIGHT: eight,
        DRAGGED: lambda: drag(ids[:1]),
        NEAR_DRAGGED: lambda: drag(tuple(ids[index] for index in np.sort(near))),
        DRAGGED_TO_GOAL: lambda: drag(ids[:1], goal),
    }


def _network_works(scenario: Scenario) -> list[Callable[[], object]]:
    """Networks of this checkout, in the order of ``NETWORK_NAMES``."""
    import torch

    from pd_editor.base.installed_files import models_folder
    from pd_editor.generation.features.scene_features import packed, scene_features
    from pd_editor.generation.generators import SHIPPED_MODEL
    from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
    from pd_editor.generation.initial_state.sampler import sample_initial_states
    from pd_editor.generation.inputs import batch_of
    from pd_editor.generation.path_diffuser import PathDiffuser
    from pd_editor.generation.stages import INITIAL_STATES, TRAJECTORIES
    from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser
    from pd_editor.generation.trajectory.task import TrajectoryTask

    stages = PathDiffuser(models_folder() / SHIPPED_MODEL).model()
    states = stages.stage(INITIAL_STATES.name).model
    trajectories = stages.stage(TRAJECTORIES.name).model
    assert isinstance(states, InitialStateDenoiser)
    assert isinstance(trajectories, TrajectoryDenoiser)
    basis = trajectories.decoder.basis
    task = TrajectoryTask.of(scenario, np.arange(NUM_AGENTS), basis)
    features = scene_features(scenario, with_candidates=False)
    scene = batch_of([packed(features, basis.encode)])

    def encode() -> object:
        with torch.inference_mode():
            return trajectories.encode_context(task.scene)

    with torch.inference_mode():
        context = trajectories.encode_context(task.scene)
        level = trajectories.encode_level(torch.full((1, 1, 1), 0.5))
        noisy = torch.randn(1, *task.scene.future.shape)

    def step() -> object:
        with torch.inference_mode():
            return trajectories.denoise(noisy, level, context)

    def place() -> object:
        return list(
            sample_initial_states(states, scene, RandomStreams(0, "states", [0]))
        )

    return [step, encode, place]


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
        while len(spent) < RUNS_EACH or sum(spent) < LEAST_MS:
            began = time.thread_time()
            run()
            spent.append(1e3 * (time.thread_time() - began))
        print(json.dumps(spent), flush=True)


@dataclass(kw_only=True, eq=False)
class Checkout:
    """A process that samples with the code of a checkout."""

    label: str
    folder: Path
    spent: dict[str, list[float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # The package of the checkout comes before that of this one.
        paths = os.pathsep.join([str(self.folder.resolve()), str(HERE)])
        self._process = subprocess.Popen(
            [
                sys.executable,
                str(self.folder / "benchmarks" / Path(__file__).name),
                "--work",
            ],
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
    """Print a table of milliseconds, and of ratios of this checkout to the others."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--other", type=Path, nargs="*", default=())
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--only", nargs="*", default=NAMES, metavar="NAME")
    options = parser.parse_args()
    checkouts = [Checkout(label="here", folder=HERE)]
    checkouts += [Checkout(label=one.name, folder=one) for one in options.other]
    for checkout in checkouts:
        for name in options.only:
            checkout.time(name)
        checkout.spent.clear()
    for _ in range(options.rounds):
        for name in options.only:
            for checkout in checkouts:
                checkout.time(name)
    columns = "".join(f" {one.label:>16s}" for one in checkouts)
    print(f"{'milliseconds: least, quartile':36s}{columns}   ratios to the last")
    for name in options.only:
        values = [one.spent[name] for one in checkouts]
        pairs = [(min(one), statistics.quantiles(one, n=4)[0]) for one in values]
        cells = "".join(f" {low:8.2f}{quarter:8.2f}" for low, quarter in pairs)
        last = pairs[-1]
        ratios = [f"{one[0] / last[0]:.2f} {one[1] / last[1]:.2f}" for one in pairs]
        print(f"{name:36s}{cells}   {';  '.join(ratios[:-1])}", flush=True)
    for checkout in checkouts:
        checkout.close()


if __name__ == "__main__":
    if "--work" in sys.argv:
        work()
    else:
        main()
