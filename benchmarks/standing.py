"""Vehicles that stand on free road: in recordings, and over time in roll-outs.

A vehicle's road is free if, on its natural path, nobody is within ``AHEAD_M`` or comes
there within ``COMES_S``, people have room beside it, and no signal is closed. Parked ones
are left out. Told by parts of 10 s, of all vehicles that are not parked: how many stand,
do so on free road, and have done so for ``LONG_S``; and of those that do so, how many
start within a second. Recordings show no signals: there some wait for one. Sensor logs
last 15 s, scenes of the split of PD_EDITOR_AV2 11 s.
"""

import argparse
import os
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
import shapely.ops

from benchmarks.roll_outs import run
from benchmarks.speeds_over_time import WORDS, placed
from pd_editor.analysis.manoeuvres.scene_facts import scene_content
from pd_editor.editor.commands import SampleSignals
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.closed_loop.roll_out import RollOutRequest
from pd_editor.generation.generators import SHIPPED_MODEL, make_generator
from pd_editor.scene.agent_kind import (
    MOTOR_VEHICLE_KINDS,
    AgentCategory,
    AgentKind,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.av2_io.map_file import read_map
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.junction_phases import junctions
from pd_editor.scene.paths.candidate_grid import Role, Start, plan_paths
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import closed_lines
from pd_editor.scene.thresholds import MOVING_MPS, STANDING_MPS
from pd_editor.scene.time_axis import TimeAxis

AHEAD_M = 15.0
COMES_S = 4.0
BESIDE_M = 0.3
ROOM_M = 1.5
PART_S = 10
LONG_S = 8


@dataclass
class Counts:
    """By parts: vehicles not parked, that stand, on free road, for long, that start."""

    parts: dict[int, np.ndarray] = field(
        default_factory=lambda: defaultdict(lambda: np.zeros(5, int))
    )

    def add(self, scenario: Scenario, first: int) -> None:
        """Count each second of a scenario from a step on."""
        agents, second = scenario.agents, round(1 / scenario.time_axis.step_s)
        events = scene_content(scenario).events
        parked = {one.agent_id for one in events if one.kind == "parked"}
        counts = agents.kind_mask(MOTOR_VEHICLE_KINDS)
        counts &= [name not in parked for name in agents.ids]
        speed, stood_s = agents.speed_mps(), np.zeros(len(agents), int)
        for step in range(first, agents.num_steps - second, second):
            later = step + second
            there = counts & agents.is_valid[:, step] & agents.is_valid[:, later]
            stands = there & (speed[:, step] < STANDING_MPS)
            free = free_rows(scenario, np.flatnonzero(stands), step)
            stood_s = np.where(np.isin(np.arange(len(agents)), free), stood_s + 1, 0)
            self.parts[(step - first) // (PART_S * second)] += (
                there.sum(),
                stands.sum(),
                len(free),
                (stood_s >= LONG_S).sum(),
                (speed[free, later] > MOVING_MPS).sum(),
            )

    def tell(self, name: str) -> None:
        """Print it."""
        words = []
        for every, *some, goes in self.parts.values():
            shares = " / ".join(f"{100 * one / max(every, 1):.1f}" for one in some)
            words.append(f"{shares} %, {100 * goes / max(some[1], 1):.1f} % start")
        print(f"{name}: {'; '.join(words)}", flush=True)


def free_rows(scenario: Scenario, rows: np.ndarray, step: int) -> np.ndarray:
    """Those of some standing vehicles that have free road."""
    agents = scenario.agents
    if not len(rows):
        return rows
    plans = plan_paths(scenario.road_map, Start.at(agents, step, rows), 4.0)
    main = np.flatnonzero(plans.role == Role.MAIN)
    others = np.flatnonzero(agents.is_valid[:, step])
    boxes = shapely.polygons(
        box_corners(
            agents.position_m[others, step],
            agents.heading_rad[others, step],
            agents.size_m[others],
        )
    )
    room = np.where(
        agents.kind_mask([AgentKind.PEDESTRIAN, AgentKind.CYCLIST])[others],
        ROOM_M,
        BESIDE_M,
    )
    end = min(step + round(COMES_S / scenario.time_axis.step_s), agents.num_steps - 1)
    ways = []
    for row in others.tolist():
        steps = step + np.flatnonzero(agents.is_valid[row, step : end + 1])
        points = agents.position_m[row, steps]
        ways.append(shapely.LineString(points if len(points) > 1 else [points[0]] * 2))
    ways, aside = np.array(ways), agents.size_m[others, 1] / 2
    lines = np.zeros(0)
    if scenario.signals:
        ends, is_closed = closed_lines(scenario.signals, scenario.road_map)
        lines = shapely.linestrings(ends[is_closed[:, step]][:, [0, 2]])
    found = []
    for path in main.tolist():
        row = rows[plans.agent[path]]
        line = shapely.LineString(plans.paths.points_m[path])
        length, width = agents.size_m[row]
        lane = shapely.ops.substring(line, length / 2, length / 2 + AHEAD_M)
        gap = width / 2 + room
        blocked = (shapely.distance(lane, boxes) < gap) | (
            shapely.distance(lane, ways) < gap + aside
        )
        blocked &= others != row
        shut = shapely.intersects(lane, lines)
        if not blocked.any() and not np.any(shut):
            found.append(row)
    return np.array(found, int)


def sensor_log(folder: Path) -> Scenario:
    """A sensor log as a scenario; what is no vehicle is a pedestrian."""
    boxes, place, heading = placed(folder)
    names, track = np.unique(boxes["track_uuid"], return_inverse=True)
    times, step = np.unique(boxes["timestamp_ns"], return_inverse=True)
    shape = len(names), len(times)
    position, turn, valid = (
        np.zeros((*shape, 2)),
        np.zeros(shape),
        np.zeros(shape, bool),
    )
    origin = place.mean(axis=0)
    position[track, step], turn[track, step] = place - origin, heading
    valid[track, step] = True
    # Over half a second: boxes jitter.
    early, late = (np.clip(np.arange(shape[1]) + by, 0, shape[1] - 1) for by in (-2, 3))
    seconds = (times[late] - times[early]) / 1e9
    both = valid[:, early] & valid[:, late]
    velocity = (position[:, late] - position[:, early]) / seconds[:, None]
    first = np.unique(track, return_index=True)[1]
    kinds = [
        AgentKind.VEHICLE if any(w in one for w in WORDS) else AgentKind.PEDESTRIAN
        for one in boxes["category"][first]
    ]
    (file,) = (folder / "map").glob("*.json")
    agents = AgentTracks(
        ids=tuple(map(str, names)),
        kinds=tuple(kinds),
        categories=(AgentCategory.UNSCORED,) * len(names),
        size_m=np.stack([boxes["length_m"], boxes["width_m"]], axis=-1)[first],
        has_known_size=np.ones(len(names), bool),
        position_m=position,
        heading_rad=turn,
        velocity_mps=velocity * both[..., None],
        is_valid=valid & both,
        observed=valid,
    )
    return Scenario(
        scenario_id=folder.name,
        city="",
        origin_city_m=origin,
        road_map=read_map(file.read_bytes(), file.name, origin),
        agents=agents,
        time_axis=TimeAxis(num_steps=shape[1], current_step=0),
        focal_id=agents.ids[0],
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="train")
    parser.add_argument("--scenes", type=int, default=35)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--signals", action="store_true", help="sample phases")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--model", default=SHIPPED_MODEL)
    options = parser.parse_args()
    root = Path(os.environ["PD_EDITOR_AV2"])
    logs, recorded, rolled = Counts(), Counts(), Counts()
    for folder in sorted((root / "sensor_logs").iterdir()):
        logs.add(sensor_log(folder), 0)
    logs.tell("sensor logs")
    generator = make_generator(options.model)
    for folder in sorted((root / options.split).glob("*/"))[: options.scenes]:
        scenario = open_scenario(folder)
        recorded.add(scenario, 0)
        if options.signals and junctions(scenario.road_map):
            scenario = SampleSignals(seed=0).apply(scenario)
        request = RollOutRequest(
            scenario=scenario, duration_s=options.seconds, seed=options.seed
        )
        rolled.add(run(request, generator)[0].scenario, scenario.current_step)
    recorded.tell("recorded")
    rolled.tell("roll-outs")


if __name__ == "__main__":
    main()
