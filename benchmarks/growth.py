"""Times of large maps and crowds: the map of one real scene in tiles, its agents over all.

Processor milliseconds on one thread: median and quartiles. ``OMP_NUM_THREADS=1 python -m
benchmarks.growth [--only TEXT ...] [--rounds 5]``. To compare with another checkout, run
this file with its folder as PYTHONPATH, in turns. Reads val under PD_EDITOR_AV2.
"""

import argparse
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Final
from unittest import mock

import numpy as np

from benchmarks.tiled import tiled
from pd_editor.analysis.findings.scorecard import scorecard
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.palette import LIGHT
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M, RoadWarp, WarpTerm
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.scene.map_view import MapView

SCENE: Final = "000e1588"
"""98 lanes, 57 agents."""
TILES: Final = (1, 2, 5, 10, 19)
AGENTS: Final = (32, 128, 256, 500)
"""On ten tiles."""
CROWDS: Final = (100, 200, 480)
"""Vehicles on the places of the scene's moving ones, each a little beside the others."""
Work = Callable[[], object]


def base() -> Scenario:
    """The scene that is repeated."""
    found = Path(os.environ["PD_EDITOR_AV2"]).glob(f"val/{SCENE}*")
    return read_scenario(next(found))


def repeated(agents: AgentTracks, rows: np.ndarray, move_m: np.ndarray) -> AgentTracks:
    """Copies of some agents, each moved as a whole."""
    values: dict[str, Any] = {}
    for one in fields(agents):
        value = getattr(agents, one.name)
        is_array = isinstance(value, np.ndarray)
        values[one.name] = value[rows] if is_array else tuple(value[r] for r in rows)
    values["ids"] = tuple(str(index) for index in range(len(rows)))
    moved = values["position_m"] + move_m[:, None]
    values["position_m"] = np.where(values["is_valid"][..., None], moved, 0.0)
    return AgentTracks(**values)


def crowd(scenario: Scenario, count: int) -> Scenario:
    """Moving vehicles only, again and again with some jitter."""
    agents, now = scenario.agents, scenario.current_step
    moving = np.flatnonzero(
        agents.is_valid[:, now]
        & (agents.speed_mps()[:, now] > 0.5)
        & np.array([kind.value == "vehicle" for kind in agents.kinds])
    )
    jitter = np.random.default_rng(0).normal(0, 3.0, (count, 2))
    tracks = repeated(agents, np.resize(moving, count), jitter)
    return replace(scenario, agents=tracks, focal_id="0")


def three_terms(scenario: Scenario, power: float) -> RoadWarp:
    """Ahead of the first agent."""
    x, y = scenario.agents.position_m[0, scenario.current_step].tolist()
    anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=0.4)
    terms = tuple(
        WarpTerm(kind=kind, power=power, length_m=length)
        for kind, length in DEFAULT_LENGTH_M.items()
    )
    return RoadWarp(anchor=anchor, terms=terms)


def dragged(scenario: Scenario, friction: float | None) -> Iterator[Work]:
    """The frames of a drag, each with another power, after a first one."""
    shown = scenario
    for number in range(1_000):
        warp = three_terms(scenario, 3.0 + number % 50 / 10)

        def frame(warp: RoadWarp = warp) -> None:
            nonlocal shown
            shown = warp_scenario(shown, warp, friction_coefficient=friction)

        if number:
            yield frame
        else:
            frame()


def first_shown(scenario: Scenario, power: float) -> Iterator[Work]:
    """The first road, or the first warped one on a road that is drawn."""
    while True:
        view = MapView(mock.MagicMock(), LIGHT)
        fresh = replace(scenario, road_map=replace(scenario.road_map))
        if not power:
            yield lambda view=view, fresh=fresh: view.show(fresh)
            continue
        view.show(fresh)
        bent = warp_scenario(fresh, three_terms(fresh, power))
        yield lambda view=view, bent=bent: view.show(bent)


def generated(scenario: Scenario, resamples: bool) -> Iterator[Work]:
    """Trajectories of all, or new states as well."""
    generator = make_generator(DEFAULT_GENERATOR)
    ids = drivable_agent_ids(scenario)
    while True:
        request = GenerationRequest(
            scenario=replace(scenario),
            agent_ids=ids,
            resampled_state_ids=ids if resamples else (),
        )
        yield lambda request=request: run_to_end(generator.generate(request))


def always(work: Work) -> Iterator[Work]:
    """The same again and again."""
    while True:
        yield work


def works() -> Iterator[tuple[str, Callable[[], Iterator[Work]]]]:
    """What is timed, by name."""
    scene = base()
    lanes = [tiled(scene, number, 48) for number in TILES]
    agents = [tiled(scene, 10, number) for number in AGENTS]
    for one in lanes:
        title = f"{len(one.road_map.lanes):5d} lanes"
        yield f"first road, {title}", lambda one=one: first_shown(one, 0.0)
        yield f"first warped road, {title}", lambda one=one: first_shown(one, 4.0)
        yield f"warp, {title}", lambda one=one: dragged(one, None)
        yield f"warp with friction, {title}", lambda one=one: dragged(one, 0.7)
    for one in agents:
        title = f"{len(one.agents):3d} agents"
        yield f"warp with friction, {title}", lambda one=one: dragged(one, 0.7)
        yield (
            f"scorecard, {title}",
            lambda one=one: always(lambda: scorecard(replace(one))),
        )
        yield f"trajectories, {title}", lambda one=one: generated(one, False)
        yield f"all resampled, {title}", lambda one=one: generated(one, True)
    for count in CROWDS:
        one = crowd(scene, count)
        yield f"trajectories, crowd of {count}", lambda one=one: generated(one, False)


def main() -> None:
    """Print a row per work."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", nargs="*", default=[""], metavar="TEXT")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    print(
        f"{'processor ms':36s} {'first':>9s} {'quarter':>9s} {'median':>9s} {'three':>9s}"
    )
    for name, runs in works():
        if not any(text in name for text in options.only):
            continue
        spent: list[float] = []
        for _, run in zip(range(options.rounds + 1), runs(), strict=False):
            began = time.process_time()
            run()
            spent.append(1e3 * (time.process_time() - began))
        low, middle, high = np.percentile(spent[1:], [25, 50, 75])
        print(
            f"{name:36s} {spent[0]:9.1f} {low:9.1f} {middle:9.1f} {high:9.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
