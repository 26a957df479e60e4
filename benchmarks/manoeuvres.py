"""How well labels of manoeuvres agree with those made by eye, and what they cost.

    PD_EDITOR_AV2=/path/to/av2 python -m benchmarks.manoeuvres [--split train]

``tests/analysis/manoeuvres/labels.csv`` names agents and pairs of ``train`` with all that
they do among the kinds that were looked for; rows that were not sure count neither way.
Settings were chosen on these scenes, so the figures are those of a fit.

The 39 pairs that come nearest in time or space, whatever is found in them, were looked at in
stills for near misses. A near miss is a pair on courses that meet, one of which must act at
once, or is just lucky, so that somebody aboard would start; who passes in a lane beside,
creeps in a queue, or crosses after the other in good time is none. Tracks that jump or
overlap do not tell.

Recordings hold no near miss of somebody who stands, so some are made of them: one that
stands throughout, jitter included, is put into the way of a driver, which halts hard right
behind it, or gently, or passes beside it.
"""

import argparse
import csv
import os
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from pd_editor.analysis.manoeuvres.events import SceneEvent
from pd_editor.analysis.manoeuvres.scene_facts import scene_content
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.scenario import Scenario

LABELS = Path(__file__).parents[1] / "tests/analysis/manoeuvres/labels.csv"
LANE_CHANGES = ("lane-change-left", "lane-change-right")
ALONE = (*LANE_CHANGES, "left-turn", "right-turn", "u-turn", "straight", "stands")
TOGETHER = ("crossing", "yielding", "merge", "overtaking", "near-miss", "cut-in")
GROUPS = {
    "turns": ("left-turn", "right-turn", "u-turn"),
    "lane changes": LANE_CHANGES,
    "stops": ("stands",),
    "straight": ("straight",),
    **{one: (one,) for one in TOGETHER},
}
FAST_MPS, HARD_MPS2 = 5.0, 3.35
MOST_STANDING = 2
MEETINGS = ((6.0, 0.5, 0.0), (2.0, 0.8, 0.0), (2.0, 2.5, 0.0), (0.0, 0.0, 0.8))
"""Braking, gap that is left, and gap beside, in metres."""
MADE = "near, stands"
SPARE_S = 1.0
"""Times by eye may be wrong by this."""
NEAR = ("near-miss", "no near-miss")


def main() -> None:
    """Print precision, recall and F1 of each group, then the processor time of a scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="train")
    root = Path(os.environ["PD_EDITOR_AV2"]) / parser.parse_args().split
    asked: dict[tuple[str, frozenset[str]], list[dict[str, str]]] = defaultdict(list)
    with LABELS.open() as file:
        for row in csv.DictReader(file):
            who = frozenset(filter(None, (row["track_id"], row["other_id"])))
            asked[row["scene_id"], who].append(row)
    counts = {name: [0, 0, 0] for name in (*GROUPS, MADE)}
    events: dict[str, tuple[SceneEvent, ...]] = {}
    seconds = read = 0.0
    for folder in sorted(root.glob("*/")):
        if folder.is_dir():
            began = time.process_time()
            scenario = open_scenario(folder)
            read += time.process_time() - began
            began = time.process_time()
            events[folder.name] = scene_content(scenario).events
            seconds += time.process_time() - began
            for made, who, is_near in meetings(scenario):
                found = judged(scene_content(made).events, who)
                is_found = any(one.kind == "near-miss" for one in found)
                counts[MADE][0] += is_near and is_found
                counts[MADE][1] += is_found and not is_near
                counts[MADE][2] += is_near and not is_found
    for (scene, who), rows in asked.items():
        for name, kinds in GROUPS.items():
            count(counts[name], judged(events[scene], who), rows, kinds)
    for name, (hits, false, missed) in counts.items():
        precision, recall = hits / max(hits + false, 1), hits / max(hits + missed, 1)
        f1 = 2 * hits / max(2 * hits + false + missed, 1)
        print(
            f"{name:<13} right {hits:3}  false {false:3}  missed {missed:3}  "
            f"precision {precision:.2f}  recall {recall:.2f}  F1 {f1:.2f}"
        )
    print(
        f"{len(events)} scenes: {1000 * read / len(events):.0f} ms to read, "
        f"{1000 * seconds / len(events):.0f} ms for events and facts"
    )


def meetings(scenario: Scenario) -> Iterator[tuple[Scenario, frozenset[str], bool]]:
    """The scene with each driver that meets who stands, both, and whether that is near."""
    agents, now, step_s = scenario.agents, scenario.current_step, 0.1
    place, there = agents.position_m, agents.is_valid
    spread = np.ptp(place, axis=1).max(axis=-1)
    stands = np.flatnonzero(there.all(axis=1) & (spread < 1.0))
    fast = there[:, now - 20 :].all(axis=1) & agents.kind_mask({AgentKind.VEHICLE})
    fast &= agents.speed_mps()[:, now] > FAST_MPS
    for row, other in product(np.flatnonzero(fast), stands[:MOST_STANDING]):
        line, heading = place[row, now:], np.unwrap(agents.heading_rad[row, now:])
        way = np.append(0, np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum())
        speed = float(agents.speed_mps()[row, now])
        half = agents.size_m[[row, other]].sum(axis=0) / 2
        for braking, gap_m, aside_m in MEETINGS:
            time = np.minimum(np.arange(len(line)) * step_s, speed / (braking or 1e-3))
            goes = speed * time - braking / 2 * time**2
            meets = half[0] + (goes[-1] + gap_m if braking else way[-1] / 2)
            if max(goes[-1] if braking else 0, meets) > way[-1]:
                continue
            at = goes if braking else way
            driven = np.stack([np.interp(at, way, axis) for axis in line.T], axis=-1)
            course = np.interp(at, way, heading)
            to = np.array([np.interp(meets, way, axis) for axis in line.T])
            turned = np.interp(meets, way, heading)
            to += (
                aside_m
                * left_of(unit_vector(turned))
                * (half[1] / aside_m + 1 if aside_m else 0)
            )
            tracks = {
                name: getattr(agents, name).copy()
                for name in ("position_m", "heading_rad", "velocity_mps")
            }
            tracks["position_m"][row, now:] = driven
            tracks["heading_rad"][row, now:] = course
            tracks["velocity_mps"][row, now:] = np.gradient(driven, step_s, axis=0)
            tracks["position_m"][other] += to - place[other, now]
            tracks["heading_rad"][other] += turned - agents.heading_rad[other, now]
            who = frozenset({agents.ids[row], agents.ids[other]})
            changed = replace(scenario, agents=replace(agents, **tracks))
            yield changed, who, braking > HARD_MPS2


def judged(events: tuple[SceneEvent, ...], who: frozenset[str]) -> list[SceneEvent]:
    """Events of a labelled agent alone, or of a labelled pair."""
    kinds = ALONE if len(who) == 1 else TOGETHER
    return [
        one
        for one in events
        if one.kind in kinds
        and ({one.agent_id} if len(who) == 1 else {one.agent_id, one.other_id}) == who
    ]


def count(
    totals: list[int],
    found: list[SceneEvent],
    rows: list[dict[str, str]],
    kinds: tuple[str, ...],
) -> None:
    """Add right, false and missed ones of some kinds of an agent or a pair."""
    if any(row["kind"] == "no lane change" for row in rows) and kinds != LANE_CHANGES:
        return
    only_lanes = all(row["kind"] in LANE_CHANGES for row in rows)
    if only_lanes and len(rows) == 1 and kinds != LANE_CHANGES:
        return
    if all(row["kind"] in NEAR for row in rows) and kinds != NEAR[:1]:
        return
    unsure = {row["kind"] for row in rows if row["is_sure"] == "0"}
    found = [one for one in found if one.kind in kinds and one.kind not in unsure]
    sure = [row for row in rows if row["kind"] in kinds and row["is_sure"] == "1"]
    for row in sure:
        begin, end = float(row["begin_s"]) - SPARE_S, float(row["end_s"]) + SPARE_S
        match = next(
            (
                one
                for one in found
                if one.kind == row["kind"] and one.begin_s < end and one.end_s > begin
            ),
            None,
        )
        totals[0 if match else 2] += 1
        if match:
            found.remove(match)
    totals[1] += len(found)


if __name__ == "__main__":
    main()
