"""Live regeneration on real scenarios: time of an edit, and change between frames.

A frame is everything between an edit and arrays that are ready to be sent: the edit, the
regenerated trajectories of 32 agents, both applied, and the meshes of the trajectories.
Edits are an agent dragged 10 m ahead and 3 m aside, the power of a bend swept, and a goal
dragged over 10 m. Wall time and processor time of the thread are reported; on a busy
machine only the latter means something. Reads train and val under PD_EDITOR_AV2.
``python -m benchmarks.live [--scenes 6] [--frames 24] [--steps 3]``
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.candidates import full_scenarios
from benchmarks.figures import load_in_words, spread
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.editor.commands import (
    AddGuidance,
    ChangeGuidance,
    Command,
    RegeneratedEdit,
    SetRoadWarp,
    TransformAgents,
    traffic_command,
)
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import (
    GenerationRequest,
    Region,
    ScenarioGenerator,
    guidance_settings,
    run_to_end,
)
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.palette import LIGHT
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.meshes.flat_mesh import glb_of
from pd_editor.viewer.scene.ribbons_view import ribbon_primitives

NUM_AGENTS = 32
HALF_SIDE_M = 62.0
FAR_M = 30.0
"""Agents at least this far from the dragged one are far from the edit."""
GESTURES = ("agent dragged", "bend swept", "goal dragged")


@dataclass
class Times:
    """Milliseconds of the frames of one kind of gesture."""

    first: list[float] = field(default_factory=list)
    """Of first frames, which invert the sampler."""
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    far_m: list[float] = field(default_factory=list)
    """Mean change of the agents far from the edit, of each pair of frames."""
    near_m: list[float] = field(default_factory=list)


def with_traffic(scenario: Scenario, generator: ScenarioGenerator) -> Scenario:
    """A scenario with generated trajectories of up to 32 agents."""
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=drivable_agent_ids(scenario)[:NUM_AGENTS],
        num_denoising_steps=4,
        guidance=guidance_settings(None, 4),
    )
    return traffic_command(request, run_to_end(generator.generate(request))).apply(
        scenario
    )


def mover(scenario: Scenario) -> str | None:
    """The moving agent in the middle of the list; None if all stand."""
    agents, now = scenario.agents, scenario.current_step
    rows = agents.rows(drivable_agent_ids(scenario)[:NUM_AGENTS])
    rows = rows[agents.speed_mps()[rows, now] > 2]
    return agents.ids[rows[len(rows) // 2]] if len(rows) else None


def gesture(name: str, scenario: Scenario, agent_id: str, frames: int) -> list[Command]:
    """Edits of a gesture on a scenario."""
    agents, now = scenario.agents, scenario.current_step
    row = agents.row_of[agent_id]
    ahead = unit_vector(agents.heading_rad[row, now])
    left = np.array([-ahead[1], ahead[0]])
    shares = np.linspace(0, 1, frames + 1)[1:]
    if name == "agent dragged":
        ways = shares[:, None] * (10 * ahead + 3 * left)
        return [
            TransformAgents(agent_ids=(agent_id,), dx_m=float(x), dy_m=float(y))
            for x, y in ways
        ]
    if name == "bend swept":
        anchor = pose_of_anchor(scenario, "focal")
        return [
            SetRoadWarp(
                warp=RoadWarp(
                    anchor=anchor,
                    terms=(
                        WarpTerm(
                            kind="smooth-turn", power=float(8 * share), length_m=30.0
                        ),
                    ),
                ),
                friction_coefficient=None,
            )
            for share in shares
        ]
    end = agents.position_m[row, -1]
    return [
        ChangeGuidance(
            index=0,
            term=GoalPoint(
                agent_id=agent_id, point_m=tuple((end + 10 * share * ahead).tolist())
            ),
        )
        for share in shares
    ]


def frames_of(
    start: Scenario, edits: list[Command], generator: ScenarioGenerator, steps: int
) -> Iterator[tuple[float, float, np.ndarray]]:
    """Wall and processor time of each frame in ms, and the own trajectories [A S 2]."""
    ids = drivable_agent_ids(start)[:NUM_AGENTS]
    usual = GenerationRequest(
        scenario=start,
        agent_ids=ids,
        num_denoising_steps=steps,
        guidance=guidance_settings(None, 0),
        before_edit=start,
    )
    for edit in edits:
        wall, cpu = time.perf_counter(), time.thread_time()
        request = replace(usual, scenario=edit.apply(start))
        traffic = run_to_end(generator.generate(request))
        command = RegeneratedEdit(edit=edit, traffic=traffic_command(request, traffic))
        after = command.apply(start)
        glb_of(ribbon_primitives(after, LIGHT))
        wall, cpu = time.perf_counter() - wall, time.thread_time() - cpu
        rows = after.agents.rows(ids)
        path = after.agents.position_m[rows, after.current_step :]
        yield 1e3 * wall, 1e3 * cpu, path - path[:, :1]


def add_gesture(
    times: Times,
    name: str,
    scenario: Scenario,
    generator: ScenarioGenerator,
    num_frames: int,
    steps: int,
) -> None:
    """Time one gesture on one scenario."""
    agent_id = mover(scenario)
    if agent_id is None:
        return
    edits = gesture(name, scenario, agent_id, num_frames)
    if name == "goal dragged":
        first = edits[0]
        assert isinstance(first, ChangeGuidance)
        scenario = AddGuidance(term=first.term).apply(scenario)
    agents, now = scenario.agents, scenario.current_step
    rows = agents.rows(drivable_agent_ids(scenario)[:NUM_AGENTS])
    gap = agents.position_m[rows, now] - agents.position_m[agents.row_of[agent_id], now]
    is_far = np.hypot(gap[:, 0], gap[:, 1]) > FAR_M
    if name == "bend swept":
        is_far[:] = True
    frames = list(frames_of(scenario, edits, generator, steps))
    times.first.append(frames[0][0])
    times.wall += [one[0] for one in frames[1:]]
    times.cpu += [one[1] for one in frames[1:]]
    paths = np.stack([one[2] for one in frames])
    change = np.linalg.norm(np.diff(paths, axis=0), axis=-1).mean(axis=-1)
    times.far_m += change[:, is_far].mean(axis=1).tolist() if is_far.any() else []
    times.near_m += change[:, ~is_far].mean(axis=1).tolist() if (~is_far).any() else []


def print_bare_map(
    generator: ScenarioGenerator, scenarios: list[Scenario], repeats: int
) -> None:
    """Both stages from a bare map, 32 agents in one square, fast setting."""
    wall: list[float] = []
    cpu: list[float] = []
    for scenario in scenarios:
        agents, now = scenario.agents, scenario.current_step
        middle = agents.position_m[agents.row_of[scenario.focal_id], now]
        square = Region(center_m=tuple(middle.tolist()), half_side_m=HALF_SIDE_M)
        bare = scenario.without_agents(agents.ids)
        for seed in range(repeats + 1):
            request = GenerationRequest(
                scenario=bare,
                agent_ids=(),
                num_new_agents={AgentKind.VEHICLE: NUM_AGENTS},
                region=square,
                num_denoising_steps=3,
                guidance=guidance_settings(None, 0),
                seed=seed,
            )
            began, worked = time.perf_counter(), time.thread_time()
            run_to_end(generator.generate(request))
            if seed:
                wall.append(1e3 * (time.perf_counter() - began))
                cpu.append(1e3 * (time.thread_time() - worked))
    print(f"both stages, bare map   wall ms  {spread(wall)}")
    print(f"{'':24s}cpu ms   {spread(cpu)}")


def main() -> None:
    """Print times and changes of each gesture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=6)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--steps", type=int, default=3)
    asked = parser.parse_args()
    generator = make_generator(DEFAULT_GENERATOR)

    def size(scenario: Scenario) -> int:
        return len(drivable_agent_ids(scenario))

    # The largest scenes have more agents, which are context.
    scenarios = [one for one in full_scenarios() if mover(one) is not None]
    scenarios.sort(key=lambda one: abs(size(one) - NUM_AGENTS))
    scenarios = scenarios[: asked.scenes]
    print(load_in_words())
    print(f"agents in the scenes: {[size(one) for one in scenarios]}")
    driven = [with_traffic(one, generator) for one in scenarios]
    for name in GESTURES:
        times = Times()
        for scenario in driven:
            add_gesture(times, name, scenario, generator, asked.frames, asked.steps)
        print(f"{name:24s}wall ms  {spread(times.wall)}")
        print(f"{'':24s}cpu ms   {spread(times.cpu)}")
        print(f"{'':24s}first frame, wall ms  {spread(times.first)}")
        print(f"{'':24s}change between frames, far agents, m  {spread(times.far_m, 3)}")
        print(f"{'':24s}change between frames, others, m  {spread(times.near_m, 3)}")
    print_bare_map(generator, scenarios, 3)


if __name__ == "__main__":
    main()
