"""Times that a user waits for, in one table: the first run, then quartiles of others.

Milliseconds of the processor on one thread; of the clock in rows with ``wall``, which are of
whole processes, of several threads or beside a load. A first request is of a scene that no
request was of; a repeated one has the task of the last one. ``python -m benchmarks.table
[--runs 9] [--only TEXT ...]``. Reads train and val under PD_EDITOR_AV2; the row of the first
picture is left out where there is no browser.
"""

import argparse
import os
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import cycle
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks import growth, interleaved, live
from benchmarks.busy import NUM_SAMPLES, busy_processes
from benchmarks.chromium import chromium_path, opened_chromium
from benchmarks.figures import load_in_words
from benchmarks.shell import HERE, seconds
from benchmarks.startup import one_run
from benchmarks.tiled import tiled
from benchmarks.warp_scenario import largest_scenario
from pd_editor.analysis.findings.scorecard import scorecard
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import GenerationRequest, Region, run_to_end
from pd_editor.scene.palette import LIGHT
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.scene.map_view import MapView

Work = Callable[[], object]
HALF_SIDE_M = 62.0
NUM_AGENTS = 32
GOALS_MS = {
    "agent dragged": "40",
    "bend swept": "40",
    "goal dragged": "40",
    "all resampled, 128 agents": "600",
    "all resampled, 256 agents": "1,500",
    "all resampled, 500 agents": "4,000",
}


@dataclass(frozen=True, kw_only=True)
class Row:
    """A time of the table."""

    name: str
    goal: str
    runs: Callable[[], Iterator[Work]]
    is_wall: bool = False


@cache
def root() -> Path:
    """Where the scenes are."""
    return Path(os.environ["PD_EDITOR_AV2"])


@cache
def generator() -> PathDiffuser:
    """The default one, loaded."""
    found = make_generator(DEFAULT_GENERATOR)
    assert isinstance(found, PathDiffuser)
    found.warm_up()
    return found


@cache
def busy_scenes() -> tuple[Scenario, ...]:
    """Scenes of ``val`` with about 32 agents or more."""
    scenes = map(read_scenario, sorted((root() / "val").glob("*/")))
    return tuple(one for one in scenes if len(drivable_agent_ids(one)) >= 25)


def around_focal(scenario: Scenario) -> tuple[tuple[str, ...], Region]:
    """The 32 agents nearest to the focal one, and the square around it."""
    agents, now = scenario.agents, scenario.current_step
    ids = drivable_agent_ids(scenario)
    middle = agents.position_m[agents.row_of[scenario.focal_id], now]
    gap = np.hypot(*(agents.position_m[agents.rows(ids), now] - middle).T)
    near = np.sort(gap.argsort(kind="stable")[:NUM_AGENTS])
    square = Region(center_m=tuple(middle.tolist()), half_side_m=HALF_SIDE_M)
    return tuple(ids[index] for index in near), square


def sampled(request: GenerationRequest) -> Work:
    """The request as work; the model is loaded before."""
    diffuser = generator()
    return lambda: run_to_end(diffuser.generate(request))


def first_requests(kind: str) -> Iterator[Work]:
    """Requests of one scene after another, each a scene of its own."""
    for seed, scene in enumerate(cycle(busy_scenes())):
        ids, square = around_focal(scene)
        asked = {"scenario": replace(scene), "agent_ids": ids, "seed": seed}
        if kind == "resampled":
            asked["resampled_state_ids"] = ids
        if kind == "bare":
            asked["scenario"] = scene.without_agents(scene.agents.ids)
            new = {AgentKind.VEHICLE: NUM_AGENTS}
            asked |= {"agent_ids": (), "num_new_agents": new, "region": square}
        yield sampled(GenerationRequest(**asked))


def repeated() -> Iterator[Work]:
    """One request again and again."""
    scene = busy_scenes()[0]
    ids, _ = around_focal(scene)
    yield from cycle([sampled(GenerationRequest(scenario=scene, agent_ids=ids))])


def eight_samples(num_busy: int) -> Iterator[Work]:
    """Several samples beside processes that never wait."""
    scene = interleaved.crowd()
    with busy_processes(num_busy):
        for seed in range(1_000):
            yield sampled(
                GenerationRequest(
                    scenario=scene,
                    agent_ids=scene.agents.ids,
                    num_samples=NUM_SAMPLES,
                    seed=seed,
                )
            )


def frames(name: str) -> Iterator[Work]:
    """Frames of a live edit of 32 agents, of one scene after another."""
    for scene in cycle(busy_scenes()):
        driven = live.with_traffic(scene, generator())
        agent_id = live.mover(driven)
        if agent_id is None:
            continue
        edits = live.gesture(name, driven, agent_id, 6)
        if name == "goal dragged":
            (first, *_) = edits
            assert isinstance(first, live.ChangeGuidance)
            driven = live.AddGuidance(term=first.term).apply(driven)
        found = live.frames_of(driven, edits, generator(), 3)
        next(found)
        yield from [partial(next, found)] * (len(edits) - 1)


def bends() -> Iterator[Work]:
    """The largest map bent and drawn."""
    scene = largest_scenario(root())
    view = MapView(mock.MagicMock(), LIGHT)
    view.show(scene)
    for number in range(1_000):
        warp = growth.three_terms(scene, 3.0 + number % 50 / 10)
        yield lambda warp=warp: view.show(warp_scenario(scene, warp))


def pictures() -> Iterator[Work]:
    """From the start of the editor to the first picture in a browser."""
    with opened_chromium() as browser:
        yield from cycle([lambda: one_run(browser)])


def rows() -> Iterator[Row]:
    """All rows, in order."""
    scene = growth.base()
    tile = partial(tiled, scene, 10)
    shell = partial(seconds, HERE)
    if chromium_path() is not None:
        yield Row(name="first picture", goal="5,000", runs=pictures, is_wall=True)
    yield Row(name="largest map bent, three terms, drawn", goal="20", runs=bends)
    yield Row(
        name="trajectories of 32 agents, first request",
        goal="35",
        runs=partial(first_requests, "driven"),
    )
    yield Row(name="the same, repeated", goal="25", runs=repeated)
    yield Row(
        name="both stages, bare map, first request",
        goal="100",
        runs=partial(first_requests, "bare"),
    )
    yield Row(
        name="resampled among traffic, first request",
        goal="180",
        runs=partial(first_requests, "resampled"),
    )
    for name in live.GESTURES:
        yield Row(name=name, goal=GOALS_MS[name], runs=partial(frames, name))
    works = cache(interleaved.workloads)
    for name, goal in (
        (interleaved.STEP, "1.5"),
        (interleaved.STATES, "40"),
        (interleaved.DRAGGED, "40"),
        (interleaved.DRAGGED_TO_GOAL, "40"),
    ):
        yield Row(name=name, goal=goal, runs=lambda name=name: cycle([works()[name]]))
    for count in (128, 256, 500):
        name = f"all resampled, {count} agents"
        runs = partial(growth.generated, tile(count), True)
        yield Row(name=name, goal=GOALS_MS[name], runs=runs)
    for number, goal in ((10, "200"), (19, "400")):
        large = tiled(scene, number, 48)
        name = f"first road, {len(large.road_map.lanes):,} lanes"
        yield Row(name=name, goal=goal, runs=partial(growth.first_shown, large, 0.0))
    yield Row(
        name="bend with friction, three terms",
        goal="20",
        runs=partial(growth.dragged, scene, 0.7),
    )
    crowd = tile(500)
    yield Row(
        name="scorecard, 500 agents",
        goal="150",
        runs=lambda: cycle([lambda: scorecard(replace(crowd))]),  # nothing kept
    )
    for num_busy, goal in ((0, "140"), (2, "350")):
        yield Row(
            name=f"8 samples of 32, beside {num_busy} busy",
            goal=goal,
            runs=partial(eight_samples, num_busy),
            is_wall=True,
        )
    yield Row(
        name="pd-editor --help, a process",
        goal="250",
        runs=lambda: cycle([lambda: shell("--help")]),
        is_wall=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--only", nargs="*", default=[""], metavar="TEXT")
    options = parser.parse_args()
    print(load_in_words())
    heads = ("goal", "first", "quarter", "median", "three")
    print(f"{'ms':44s}" + "".join(f"{one:>10s}" for one in heads) + f"{'load':>7s}")
    for row in rows():
        if not any(text in row.name for text in options.only):
            continue
        clock = time.perf_counter if row.is_wall else time.process_time
        spent: list[float] = []
        runs = row.runs()
        for _, run in zip(range(options.runs + 1), runs, strict=False):
            began = clock()
            run()
            spent.append(1e3 * (clock() - began))
        if isinstance(runs, Generator):
            runs.close()  # processes beside it, and browsers
        cells = [spent[0], *np.percentile(spent[1:], [25, 50, 75])]
        name = row.name + ", wall" * row.is_wall
        print(
            f"{name:44s}{row.goal:>10s}"
            + "".join(f"{one:10,.1f}" for one in cells)
            + f"{os.getloadavg()[0]:7.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
