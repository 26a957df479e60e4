"""One edit applied, and undone, on 100 agents of a real scenario, per command.

Run with ``python -m benchmarks.edit``; PD_EDITOR_AV2 names the data.
"""

import gc
import os
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from pd_editor.editor.commands import (
    AdoptTrajectory,
    Command,
    DeleteAgents,
    DuplicateAgents,
    PlaceAgent,
    ReplaceTraffic,
    RequestSummary,
    SetAgentHeading,
    SetAgentKind,
    SetAgentPosition,
    SetAgentSize,
    SetAgentSpeed,
    SetFocalAgent,
    SetRoadWarp,
    SnapToLane,
    TransformAgents,
    new_agent_ids,
)
from pd_editor.editor.commands.edit_limits import present_rows
from pd_editor.editor.commands.poses import MAX_SNAP_M
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import Journal
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.paths.motion_primitives import candidates
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario

NUM_AGENTS = 100
REPEATS = 60
SCENARIO_ID = "000b25a9-8f75-46eb-90f5-a75c985f6ae2"


def scenario_with_many() -> Scenario:
    """The scenario of 144 tracks, with enough of them there now and near a lane."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    scenario = read_scenario(root / "train" / SCENARIO_ID)
    agents, now = scenario.agents, scenario.current_step
    there = np.flatnonzero(agents.is_valid[:, now])
    match = nearest_lanes(scenario.road_map, agents.position_m[there, now])
    near = there[match.distance_m < MAX_SNAP_M - 5]
    near = near[near != agents.row_of[scenario.focal_id]]
    missing = max(NUM_AGENTS - len(near), 0)
    for start in range(0, missing, len(near)):
        rows = near[: missing - start]
        copy = DuplicateAgents(
            agent_ids=tuple(agents.ids[row] for row in rows),
            new_ids=new_agent_ids(scenario, len(rows), "copy"),
            dx_m=1.0,
        )
        scenario = copy.apply(scenario)
    print(
        f"{len(agents)} tracks read, {len(there)} of them there now;"
        f" {len(scenario.agents)} with copies; {len(scenario.road_map.lanes)} lanes"
    )
    return scenario


def edited_ids(scenario: Scenario) -> tuple[str, ...]:
    """The agents that are edited together."""
    agents, now = scenario.agents, scenario.current_step
    there = np.flatnonzero(agents.is_valid[:, now])
    match = nearest_lanes(scenario.road_map, agents.position_m[there, now])
    near = there[match.distance_m < MAX_SNAP_M - 1]
    ids = [agents.ids[row] for row in near if agents.ids[row] != scenario.focal_id]
    assert len(ids) >= NUM_AGENTS
    return tuple(ids[:NUM_AGENTS])


def traffic(scenario: Scenario, ids: tuple[str, ...]) -> ReplaceTraffic:
    rows = present_rows(scenario, ids)
    found = candidates(scenario, rows)
    sample = TrafficSample(
        ids=ids,
        kinds=tuple(scenario.agents.kinds[row] for row in rows),
        size_m=scenario.agents.size_m[rows],
        position_m=found.position_m[:, 0],
        heading_rad=found.heading_rad[:, 0],
        velocity_mps=found.velocity_mps[:, 0],
    )
    request = RequestSummary(agent_ids=ids)
    return ReplaceTraffic(sample=sample, generator="benchmark", request=request)


def commands(scenario: Scenario, ids: tuple[str, ...]) -> list[Command]:
    rows, now = present_rows(scenario, ids), scenario.current_step
    x, y = (float(value) for value in scenario.agents.position_m[rows[0], now])
    heading = float(scenario.agents.heading_rad[rows[0], now])
    found = candidates(scenario, rows[:1])
    anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=heading)
    term = WarpTerm(kind="smooth-turn", power=5.0, length_m=10.0)
    warp = RoadWarp(anchor=anchor, terms=(term,))
    place = {
        "kind": AgentKind.VEHICLE,
        "x_m": x,
        "y_m": y,
        "heading_rad": heading,
        "speed_mps": 9.0,
    }
    return [
        TransformAgents(agent_ids=ids, dx_m=1.0, rotation_rad=0.1),
        SetAgentSpeed(agent_ids=ids, speed_mps=7.0),
        SetAgentHeading(agent_ids=ids, heading_rad=0.3),
        SetAgentPosition(agent_id=ids[0], x_m=x + 1, y_m=y),
        SnapToLane(agent_ids=ids),
        SetAgentKind(agent_ids=ids, kind=AgentKind.MOTORCYCLIST),
        SetAgentSize(agent_ids=ids, length_m=5.0, width_m=2.0),
        PlaceAgent(agent_id="new", **place),
        PlaceAgent(agent_id="new", back_cast=True, **place),
        DuplicateAgents(
            agent_ids=ids, new_ids=new_agent_ids(scenario, len(ids), "twin"), dx_m=3.0
        ),
        DeleteAgents(agent_ids=ids),
        SetFocalAgent(agent_id=ids[0]),
        AdoptTrajectory.of_arrays(
            agent_id=ids[0],
            position_m=found.position_m[0, 0],
            heading_rad=found.heading_rad[0, 0],
            velocity_mps=found.velocity_mps[0, 0],
        ),
        traffic(scenario, ids),
        SetRoadWarp(warp=warp),
        SetRoadWarp(warp=warp, friction_coefficient=0.7),
    ]


def milliseconds(session: EditorSession, command: Command) -> tuple[list, list]:
    """Times of applying and of undoing, with listeners and journal in place."""
    applied, undone = [], []
    for repeat in range(REPEATS + 3):
        start = time.perf_counter()
        session.apply(command)
        middle = time.perf_counter()
        session.undo()
        end = time.perf_counter()
        if repeat >= 3:
            applied.append(1e3 * (middle - start))
            undone.append(1e3 * (end - middle))
    return applied, undone


def in_words(times: list[float]) -> str:
    low, _, high = statistics.quantiles(times, n=4)
    return (
        f"{statistics.median(times):7.2f} {min(times):7.2f}"
        f" {low:7.2f}..{high:<7.2f} {max(times):7.2f}"
    )


def main() -> None:
    scenario = scenario_with_many()
    ids = edited_ids(scenario)
    columns = "median     min  quartiles           max"
    print(f"{NUM_AGENTS} agents, {REPEATS} repeats, with journal; times in ms")
    print(f"{'command':<46} apply: {columns}   undo: {columns}")
    gc.collect()
    with tempfile.TemporaryDirectory() as folder:
        session = EditorSession(scenario, journal=Journal(Path(folder)))
        session.select(ids)
        for command in commands(scenario, ids):
            applied, undone = milliseconds(session, command)
            name = f"{type(command).__name__}: {command.label}"
            print(f"{name[:46]:<46} {in_words(applied)} {in_words(undone)}")
        session.close(discard=True)


if __name__ == "__main__":
    main()
