"""The lane follower on real scenarios: overlaps, distance to lanes, displacement.

Reads the train and val folders under PD_EDITOR_AV2; settings were chosen on train.
"""

import os
from collections import defaultdict
from pathlib import Path

import numpy as np

from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.generation.lane_follower import LaneFollower
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.scenario import Scenario

NUM_SAMPLES = 6
FAR_M = 4.0
SINK_M = 0.05
"""Boxes may sink so deep into each other before they count as overlapping."""


def overlapping(
    scenario: Scenario, rows: np.ndarray, position: np.ndarray, heading: np.ndarray
) -> np.ndarray:
    """Which of the rows overlap, at some step, with a box they did not at first."""
    agents, step = scenario.agents, scenario.current_step
    all_position = agents.position_m[:, step:].copy()
    all_heading = agents.heading_rad[:, step:].copy()
    exists = agents.is_valid[:, step:].copy()
    all_position[rows], all_heading[rows], exists[rows] = position, heading, True
    boxes = Boxes(
        position_m=all_position,
        heading_rad=all_heading,
        size_m=agents.size_m[:, None] - SINK_M,
    )
    hit = boxes_touch(boxes[rows][:, None], boxes[None])
    hit &= exists[rows][:, None] & exists[None]
    hit[np.arange(len(rows)), rows] = False
    new = hit & ~hit[:, :, :1]
    return np.asarray(new.any((1, 2)))


def figures(
    scenario: Scenario, rows: np.ndarray, position: np.ndarray, heading: np.ndarray
) -> dict[str, np.ndarray]:
    """Per agent figures of one way to go on."""
    agents, step = scenario.agents, scenario.current_step
    logged, valid = agents.position_m[rows, step:], agents.is_valid[rows, step:]
    gap = np.linalg.norm(position - logged, axis=-1)[:, 1:]
    ade = (gap * valid[:, 1:]).sum(1) / np.maximum(valid[:, 1:].sum(1), 1)
    match = nearest_lanes(scenario.road_map, position.reshape(-1, 2))
    distance = match.distance_m.reshape(position.shape[:2])
    hits = overlapping(scenario, rows, position, heading)
    return {
        "ade": ade,
        "overlap": hits,
        "far": np.asarray((distance > FAR_M).any(1)),
        "end": distance[:, -1],
        "moved": np.linalg.norm(position[:, -1] - position[:, 0], axis=-1),
    }


def rows_to_drive(scenario: Scenario) -> np.ndarray:
    """Movers whose future is logged completely."""
    agents, step = scenario.agents, scenario.current_step
    whole = agents.is_valid[:, step:].all(1)
    return np.flatnonzero(agents.kind_mask(MOTOR_VEHICLE_KINDS) & whole)


def collect(split: str) -> tuple[dict[str, dict[str, np.ndarray]], list[float]]:
    """Figures of the log, constant velocity and the lane follower; seconds spent."""
    parts: dict[str, dict[str, list[np.ndarray]]] = defaultdict(
        lambda: defaultdict(list)
    )
    spent = []
    root = Path(os.environ["PD_EDITOR_AV2"]) / split
    for path in sorted(root.glob("*/scenario_*.parquet")):
        scenario = read_scenario(path.parent)
        agents, step = scenario.agents, scenario.current_step
        rows = rows_to_drive(scenario)
        if not len(rows):
            continue
        future = np.arange(agents.num_steps - step) * scenario.time_axis.step_s
        speed = agents.speed_mps()[rows, step]
        start = agents.position_m[rows, step][:, None]
        steady = start + future[:, None] * agents.velocity_mps[rows, step][:, None]
        still = np.repeat(agents.heading_rad[rows, step][:, None], len(future), 1)
        request = GenerationRequest(
            scenario=scenario,
            agent_ids=tuple(agents.ids[row] for row in rows),
            num_samples=NUM_SAMPLES,
        )
        traffic = run_to_end(LaneFollower().generate(request))
        spent.append(traffic.elapsed_s / NUM_SAMPLES)
        ways = {
            "log": [(agents.position_m[rows, step:], agents.heading_rad[rows, step:])],
            "constant velocity": [(steady, still)],
            "lane follower": [
                (sample.position_m, sample.heading_rad) for sample in traffic.samples
            ],
        }
        for name, samples in ways.items():
            found = [figures(scenario, rows, *sample) for sample in samples]
            for key in found[0]:
                parts[name][key].append(np.array([one[key] for one in found]))
            parts[name]["speed"].append(np.array([speed] * len(found)))
    table = {
        name: {key: np.concatenate(values, axis=1) for key, values in columns.items()}
        for name, columns in parts.items()
    }
    return table, spent


def main() -> None:
    """Print a table per split."""
    for split in ("train", "val"):
        table, spent = collect(split)
        some = table["log"]["speed"][0]
        moving = some > 0.5
        print(f"{split}: {len(some)} movers, {moving.sum()} of them moving")
        print(
            "                   overlap %  moving %  far from lane %  end m  "
            "ADE m  moving  minADE  starts %"
        )
        for name, column in table.items():
            standing = column["speed"] < 0.3
            starts = (column["moved"][standing] > 1).mean()
            print(
                f"{name:18s} {100 * column['overlap'].mean():9.1f} "
                f"{100 * column['overlap'][:, moving].mean():9.1f} "
                f"{100 * column['far'].mean():16.1f} {column['end'].mean():6.2f} "
                f"{column['ade'].mean():6.2f} {column['ade'][:, moving].mean():7.2f} "
                f"{column['ade'][:, moving].min(0).mean():7.2f} {100 * starts:9.1f}"
            )
        milliseconds = 1e3 * np.array(spent)
        print(
            f"time per sample: median {np.median(milliseconds):.0f} ms, "
            f"max {milliseconds.max():.0f} ms\n"
        )


if __name__ == "__main__":
    main()
