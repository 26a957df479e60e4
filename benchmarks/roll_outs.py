"""Closed loop for 30 s: time, seams, density, speeds, collisions and answers.

Scenes of a split of PD_EDITOR_AV2. Rates are per minute of a vehicle's presence, by thirds
of the roll-out; the recorded future beside them is 6 s long. Traffic alone, then the
fastest vehicle brakes at 4 m/s2: how many of its followers hit it, and how many do when
all others drive as recorded. Goals: up to three vehicles of a scene are to be, at a time
beyond a window's horizon, where another seed's roll-out had them.
"""

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from pd_editor.analysis.guidance.guidance_kind import OBEYED
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.metrics.box_overlaps import first_overlap
from pd_editor.analysis.metrics.road import departures
from pd_editor.editor.commands import SampleSignals
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.closed_loop.roll_out import RollOut, RollOutRequest, roll_out
from pd_editor.generation.generators import SHIPPED_MODEL, make_generator
from pd_editor.scene.agent_kind import (
    LANE_FOLLOWER_KINDS,
    MOTOR_VEHICLE_KINDS,
    AgentKind,
)
from pd_editor.scene.junction_phases import junctions
from pd_editor.scene.policy import Controls
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import SignalState, stop_lines
from pd_editor.scene.thresholds import STANDING_MPS

THIRDS = 3
LEAST_WAY_M = 5.0
LINE_M = 2.0
HEAD_M = 6.0
START_S = 10.0


class Brakes:
    name = "brakes"

    def reset(self, scene, ego_id, route_m, seed):
        pass

    def plan(self, observation):
        return Controls(acceleration_mps2=np.full(30, -4.0), curvature_1pm=np.zeros(30))


def run(request: RollOutRequest, generator) -> tuple[RollOut, float, list[float]]:
    """The roll-out, its processor time, and that of each window."""
    steps, began, marks = roll_out(request, generator), time.process_time(), []
    last, message = began, ""
    while True:
        try:
            shown = next(steps)
        except StopIteration as stop:
            return stop.value, time.process_time() - began, marks
        if shown.message != message:
            now, message = time.process_time(), shown.message
            marks.append(now - last)
            last = now


def rates(scenario: Scenario, first: int, last: int) -> dict[str, float]:
    """Of vehicles between two steps."""
    rows = np.flatnonzero(scenario.agents.kind_mask(LANE_FOLLOWER_KINDS))
    agents = scenario.agents.taken(rows)
    steps = np.arange(first, last)
    there = agents.is_valid[:, steps]
    people = scenario.agents.kind_mask([AgentKind.PEDESTRIAN, AgentKind.CYCLIST])
    minutes = there.sum() * scenario.time_axis.step_s / 60
    _, at = first_overlap(agents, steps)
    speed = agents.speed_mps()[:, steps][there]
    off = departures(scenario, agents).is_off_road[:, steps]
    return {
        "vehicles": there.sum() / len(steps),
        "people": scenario.agents.is_valid[people][:, steps].sum() / len(steps),
        "collisions": (at > first).sum() / max(minutes, 1e-9),
        "off_road": off.sum() / max(there.sum(), 1),
        "speed": speed.mean() if len(speed) else np.nan,
        "standing": (speed < 0.3).mean() if len(speed) else np.nan,
    }


def seams(scenario: Scenario, replan: int) -> np.ndarray:
    """Changes of velocity (m/s) and heading (degrees) at each replan.

    How much more they change in its step than in the one before.
    """
    agents, now = scenario.agents, scenario.current_step
    at = np.arange(now + replan, agents.num_steps - 1, replan)
    lasts = np.all([agents.is_valid[:, at + step] for step in (-1, 0, 1)], axis=0)
    velocity = np.diff(agents.velocity_mps, axis=1)
    jump = np.linalg.norm(velocity[:, at] - velocity[:, at - 1], axis=-1)
    turn = np.angle(np.exp(1j * np.diff(agents.heading_rad, axis=1)))
    bend = np.degrees(np.abs(turn[:, at] - turn[:, at - 1]))
    return np.stack([jump[lasts], bend[lasts]])


def hits(scenario: Scenario, name: str) -> int:
    """Vehicles that hit an agent from behind."""
    agents, now = scenario.agents, scenario.current_step
    row = agents.row_of[name]
    pairs, at = first_overlap(agents, np.arange(now, agents.num_steps))
    count = 0
    for (one, other), step in zip(pairs.tolist(), at.tolist(), strict=True):
        if row in (one, other) and step > now:
            gap = (
                agents.position_m[one + other - row, step]
                - agents.position_m[row, step]
            )
            heading = agents.heading_rad[row, step]
            count += gap @ (np.cos(heading), np.sin(heading)) < 0
    return count


def obedience(scenario: Scenario) -> tuple[int, int, int, int]:
    """Fronts over stop lines against red, and all; starts on green, and all who waited.

    Those who stand in front of a line that turns green are to cross it within
    ``START_S``. Lanes that begin together have one line, red while all of them are.
    """
    rows = np.flatnonzero(scenario.agents.kind_mask(MOTOR_VEHICLE_KINDS))
    agents, now = scenario.agents.taken(rows), scenario.current_step
    lines = stop_lines(scenario.signals, scenario.road_map)
    states = [one.states for one in scenario.signals for _ in one.lane_ids]
    groups: dict[tuple[int, ...], list[int]] = {}
    for number, line in enumerate(lines):
        groups.setdefault(tuple(line[1].round().astype(int)), []).append(number)
    found, later = np.zeros(4, int), round(START_S / scenario.time_axis.step_s)
    for rows_of in groups.values():
        left, middle, right = lines[rows_of[0]]
        red = (np.array([states[row] for row in rows_of]) == SignalState.STOP).all(0)
        way = (right - left)[::-1] * (-1, 1) / np.linalg.norm(right - left)
        offset = agents.position_m - middle
        aside = np.abs(offset @ (right - left)) / np.linalg.norm(right - left) < LINE_M
        ahead = offset @ way + agents.size_m[:, :1] / 2
        there = agents.is_valid & aside
        crosses = (
            there[:, :-1] & there[:, 1:] & (ahead[:, :-1] < 0) & (ahead[:, 1:] >= 0)
        )
        crosses[:, :now] = False
        found[:2] += crosses[:, red[1:]].sum(), crosses.sum()
        for turn in np.flatnonzero(red[:-1] & ~red[1:]):
            if (
                turn < now
                or red[turn + 1 : turn + later].any()
                or turn + later > len(red)
            ):
                continue
            waits = there[:, turn] & (ahead[:, turn] < 0) & (ahead[:, turn] > -HEAD_M)
            waits &= agents.speed_mps()[:, turn] < STANDING_MPS
            found[2:] += (
                crosses[waits, turn : turn + later].any(axis=1).sum(),
                waits.sum(),
            )
    return tuple(found.tolist())


def goals(other: Scenario, scenario: Scenario, at_s: float) -> tuple[GoalPoint, ...]:
    """Places of up to three vehicles that have moved in another roll-out."""
    agents, now = other.agents, scenario.current_step
    at = now + round(at_s / scenario.time_axis.step_s)
    moved = np.linalg.norm(agents.position_m[:, at] - agents.position_m[:, now], axis=1)
    fits = agents.is_valid[:, now : at + 1].all(axis=1) & (moved > LEAST_WAY_M)
    rows = np.flatnonzero(fits & agents.kind_mask(MOTOR_VEHICLE_KINDS))
    return tuple(
        GoalPoint(
            agent_id=agents.ids[row],
            point_m=(
                float(agents.position_m[row, at, 0]),
                float(agents.position_m[row, at, 1]),
            ),
            at_s=at_s,
        )
        for row in np.random.default_rng(0).permutation(rows)[:3]
    )


def misses(scenario: Scenario, terms: tuple[GoalPoint, ...]) -> list[float]:
    """Distances to goals at their times; infinite of those that have left."""
    agents, found = scenario.agents, []
    for one in terms:
        row = agents.row_of[one.agent_id]
        assert one.at_s is not None
        at = scenario.current_step + round(one.at_s / scenario.time_axis.step_s)
        gap = np.linalg.norm(agents.position_m[row, at] - one.point_m)
        found.append(float(gap) if agents.is_valid[row, at] else np.inf)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="val")
    parser.add_argument("--data", type=Path, nargs="+", help="scenes, not of a split")
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--signals", action="store_true", help="sample phases")
    parser.add_argument("--model", default=SHIPPED_MODEL)
    parser.add_argument("--goals-at", type=float, default=15.0, help="s")
    options = parser.parse_args()
    options.goals_at = min(options.goals_at, options.seconds)
    split = Path(os.environ["PD_EDITOR_AV2"]) / options.split
    generator = make_generator(options.model)
    parts: list[list[dict[str, float]]] = [[] for _ in range(THIRDS + 1)]
    joints, times, windows, answered, logged = [], [], [], 0, 0
    missed: list[list[float]] = [[], []]
    obeyed = np.zeros(4, int)
    for folder in options.data or sorted(split.glob("*/"))[: options.scenes]:
        scenario = open_scenario(folder)
        if options.signals and junctions(scenario.road_map):
            scenario = SampleSignals(seed=0).apply(scenario)
        now = scenario.current_step
        request = RollOutRequest(scenario=scenario, duration_s=options.seconds)
        found, took, marks = run(request, generator)
        times.append(took)
        windows += marks[1:]
        one = found.scenario
        joints.append(seams(one, 10))
        obeyed += obedience(one)
        bounds = np.linspace(now, one.time_axis.num_steps, THIRDS + 1).astype(int)
        parts[0].append(rates(scenario, now, scenario.time_axis.num_steps))
        for third, part in enumerate(parts[1:]):
            part.append(rates(one, bounds[third], bounds[third + 1]))
        asked = {"duration_s": min(options.goals_at + 1.0, options.seconds)}
        other, *_ = run(RollOutRequest(scenario=scenario, seed=1, **asked), generator)
        terms = goals(other.scenario, scenario, options.goals_at)
        guided = replace(scenario, guidance=terms)
        guided, *_ = run(RollOutRequest(scenario=guided, **asked), generator)
        for gaps, rolled in zip(missed, (guided.scenario, one), strict=True):
            gaps.extend(misses(rolled, terms))
        agents = scenario.agents
        goes = agents.is_valid[:, now:].all(axis=1)
        speed = np.where(goes, agents.speed_mps()[:, now], 0.0)
        speed *= agents.kind_mask(LANE_FOLLOWER_KINDS)
        name = agents.ids[int(speed.argmax())]
        braking = {"duration_s": 6.0, "policies": {name: Brakes()}}
        driven, *_ = run(RollOutRequest(scenario=scenario, **braking), generator)
        answered += hits(driven.scenario, name)
        row, there = agents.row_of[name], driven.scenario.agents
        own = there.taken([there.row_of[name]])
        steps = slice(now, min(agents.num_steps, own.num_steps))
        position = agents.position_m.copy()
        position[row, steps] = own.position_m[0, steps]
        heading = agents.heading_rad.copy()
        heading[row, steps] = own.heading_rad[0, steps]
        moved = agents.with_rows(
            np.array([row]), position_m=position[[row]], heading_rad=heading[[row]]
        )
        logged += hits(scenario.with_agents(moved), name)
        print(
            f"{folder.name[:8]}: {took:.1f} s, {found.num_entered} entered", flush=True
        )
    for name, part in zip(("recorded 6 s", "1st", "2nd", "3rd"), parts, strict=True):
        means = {key: np.nanmean([one[key] for one in part]) for key in part[0]}
        print(
            f"{name:13} vehicles {means['vehicles']:.1f}, people "
            f"{means['people']:.2f}, collisions "
            f"{means['collisions']:.2f} /min, off the road {100 * means['off_road']:.1f} %, "
            f"speed {means['speed']:.2f} m/s, standing {100 * means['standing']:.0f} %"
        )
    (speed, turn) = np.concatenate(joints, axis=1)
    print(
        f"Seams, p99: {np.quantile(speed, 0.99):.2f} m/s, {np.quantile(turn, 0.99):.2f} "
        f"degrees. Processor time of {options.seconds:g} s: {np.median(times):.1f} s "
        f"(quartiles {np.quantile(times, 0.25):.1f}, {np.quantile(times, 0.75):.1f}); "
        f"a window, p95 {1e3 * np.quantile(windows, 0.95):.0f} ms."
    )
    print(
        f"Hit from behind while braking: {answered}; all others as recorded: {logged}."
    )
    if options.signals:
        print(
            f"Against red: {obeyed[0]} of {obeyed[1]} crossings of stop lines. Crossed "
            f"within {START_S:g} s of green: {obeyed[2]} of {obeyed[3]} that waited first."
        )
    for words, gaps in zip(("guided", "unguided"), np.array(missed), strict=True):
        print(
            f"Goals at {options.goals_at:g} s, {words}: {(gaps <= OBEYED.goal_m).sum()} of "
            f"{len(gaps)} within {OBEYED.goal_m:g} m, median {np.median(gaps):.2f} m, p90 "
            f"{np.quantile(gaps, 0.9, method='higher'):.1f} m."
        )


if __name__ == "__main__":
    main()
