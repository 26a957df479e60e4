"""A scene at the editor's limits, step by step: seconds, and the most memory so far.

Nearly 2,000 lanes and 500 agents over 400 steps, since tracks times steps are at most
200,000: a real scene side by side, its tracks slowed down. ``python -m benchmarks.limits``.
Reads val under PD_EDITOR_AV2.
"""

import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmarks.growth import base, three_terms
from benchmarks.tiled import tiled
from pd_editor.analysis.findings.scorecard import scorecard
from pd_editor.editor.commands import SetRoadWarp
from pd_editor.editor.edit_findings import edit_findings
from pd_editor.editor.session import EditorSession
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_limits import MAX_AGENTS, MAX_LANES, MAX_STATES
from pd_editor.scene.time_axis import TimeAxis

Result = TypeVar("Result")


def at_limits() -> Scenario:
    """The scene; agents exist around the current step."""
    scene = base()
    num_tiles = MAX_LANES // len(scene.road_map.lanes)
    wide = tiled(scene, num_tiles, MAX_AGENTS)
    former, agents = wide.time_axis, wide.agents
    num_steps = MAX_STATES // MAX_AGENTS
    axis = TimeAxis(num_steps=num_steps, current_step=num_steps // 2)
    slow = former.num_steps / num_steps
    moment = former.current_step + slow * (np.arange(num_steps) - axis.current_step)
    source = np.clip(np.rint(moment).astype(int), 0, former.num_steps - 1)
    tracks = replace(
        agents,
        position_m=agents.position_m[:, source],
        heading_rad=agents.heading_rad[:, source],
        velocity_mps=agents.velocity_mps[:, source] * slow,
        is_valid=agents.is_valid[:, source],
        observed=agents.is_valid[:, source] & axis.is_past,
    )
    return replace(wide, time_axis=axis, agents=tracks)


def timed(what: str, work: Callable[[], Result]) -> Result:
    """The result of a step; prints its time and the memory."""
    began = time.perf_counter()
    found = work()
    spent = time.perf_counter() - began
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{what:44s} {spent:8.2f} s {memory:8.0f} MiB", flush=True)
    return found


def main() -> None:
    """Print a row per step."""
    scene = at_limits()
    agents = scene.agents
    print(
        f"{len(scene.road_map.lanes)} lanes, {len(agents)} agents, "
        f"{scene.time_axis.num_steps} steps, {int(agents.is_valid.sum())} states"
    )
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / scene.scenario_id
        files = timed("files of the scene", lambda: scenario_files(scene))
        timed("written", lambda: write_files(files, folder, forbidden=None))
        opened = timed("opened", lambda: read_scenario(folder))
        session = EditorSession(opened)
        timed("first findings", lambda: edit_findings(opened, opened, ()))
        timed("first scorecard", lambda: scorecard(opened))
        warp = SetRoadWarp(warp=three_terms(opened, 4.0))
        timed("warped", lambda: session.apply(warp))
        slow = SetRoadWarp(warp=three_terms(opened, 5.0), friction_coefficient=0.7)
        timed("warped with friction", lambda: session.apply(slow))
        bent, done = session.scenario, session.commands_in_force
        timed("findings of the warp", lambda: edit_findings(bent, opened, done))
        generator = make_generator(DEFAULT_GENERATOR)
        ids = drivable_agent_ids(bent)
        for number in (10, len(ids)):
            asked = GenerationRequest(scenario=bent, agent_ids=ids[:number])
            timed(
                f"trajectories of {number} agents",
                lambda one=asked: run_to_end(generator.generate(one)),
            )
        files = timed("files of the export", lambda: scenario_files(bent))
        timed(
            "written",
            lambda: write_files(files, Path(place) / "export", forbidden=None),
        )


if __name__ == "__main__":
    main()
