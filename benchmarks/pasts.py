"""Made-up pasts of sampled agents beside recorded ones: seen, smooth, free, on the road.

Lateral acceleration is speed by yaw rate, or that of the velocities, whichever is more;
recorded tracks are noisy, so theirs is not shown.

Scenes of PD_EDITOR_AV2's ``train`` and ``val``; all road users resampled, and as many as
fit. ``--out`` keeps the scenes for other programs, such as a classifier of each step.
"""

import argparse
import os
import time
from pathlib import Path

import numpy as np

import pd_editor
from pd_editor.analysis.metrics.box_overlaps import first_overlap
from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.analysis.repair.back_casting import made_up_past
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, ROAD_USER_KINDS
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

COLUMNS = (
    "agents",
    "seen at the last observed step, %",
    "with the whole past, %",
    "overlap somebody in the past, %",
    "vehicles that move: past off the road, %",
    "jump of acceleration, p99, m/s2",
    "drivers above 4; 6; 9 m/s2 sideways in the past, %; most, m/s2",
)


def generated(folder: Path, placement: str, out: Path) -> Scenario:
    """One scene, all resampled or as many as fit."""
    target = out / placement / folder.name
    if not target.exists():
        scenario = read_scenario(folder)
        agents, now = scenario.agents, scenario.current_step
        rows = agents.is_valid[:, now] & agents.kind_mask(ROAD_USER_KINDS)
        asked = {"num_agents": "fit", "replace_ego_and_focal": True}
        if placement == "resampled":
            ids = tuple(agents.ids[row] for row in np.flatnonzero(rows))
            asked = {"agents": ids, "resample_states": True}
        pd_editor.generate(folder, out=target.parent, name=folder.name, **asked)
    return read_scenario(target)


def figures(scenario: Scenario, rows: np.ndarray) -> list[np.ndarray]:
    """Values of each agent at ``rows`` for each column but the first."""
    agents, now = scenario.agents, scenario.current_step
    pairs, _ = first_overlap(agents, np.arange(now))
    past = agents.is_valid[rows, :now]
    moves = agents.speed_mps()[rows, now] >= MOVING_MPS
    drives = rows[moves & agents.kind_mask(LANE_FOLLOWER_KINDS)[rows]]
    off = is_off_road(scenario, agents.position_m[drives, :now])
    velocity = agents.velocity_mps[rows, now - 1 : now + 2]
    jump = np.linalg.norm(np.diff(velocity, n=2, axis=1), axis=-1)[:, 0]
    known = agents.is_valid[rows, now - 1 : now + 2].all(axis=1)
    return [
        np.asarray(agents.observed[rows, now]),
        np.asarray(past.all(axis=1)),
        np.isin(rows, pairs),
        off[agents.is_valid[drives, :now]],
        jump[known] / scenario.time_axis.step_s,
        sideways_mps2(scenario, rows[agents.kind_mask(LANE_FOLLOWER_KINDS)[rows]]),
    ]


def sideways_mps2(scenario: Scenario, rows: np.ndarray) -> np.ndarray:
    """Largest lateral acceleration of each agent at ``rows`` before t = 0."""
    agents, now = scenario.agents, scenario.current_step
    valid = agents.is_valid[rows, : now + 1]
    velocity = agents.velocity_mps[rows, : now + 1]
    heading = np.unwrap(agents.heading_rad[rows, : now + 1], axis=1)
    middle = (velocity[:, 1:] + velocity[:, :-1]) / 2
    gained = np.diff(velocity, axis=1) / scenario.time_axis.step_s
    speed = np.hypot(middle[..., 0], middle[..., 1])
    cross = middle[..., 0] * gained[..., 1] - middle[..., 1] * gained[..., 0]
    turned = speed * np.diff(heading, axis=1) / scenario.time_axis.step_s
    most = np.maximum(np.abs(cross) / np.maximum(speed, 0.3), np.abs(turned))
    return np.max(most * (valid[:, 1:] & valid[:, :-1]), axis=1, initial=0.0)


def line(name: str, found: list[list[np.ndarray]]) -> str:
    """One row of the table."""
    seen, whole, overlap, off, jump, sideways = (
        np.concatenate(one) for one in zip(*found, strict=True)
    )
    shares = [100 * one.mean() for one in (seen, whole, overlap, off)]
    cells = [
        f"{len(seen)}",
        *(f"{one:.1f}" for one in shares),
        f"{np.quantile(jump, 0.99):.2f}",
    ]
    if name != "recorded":
        above = "; ".join(f"{100 * (sideways > one).mean():.1f}" for one in (4, 6, 9))
        cells.append(f"{above}; {sideways.max():.1f}")
    else:
        cells.append("")
    return f"| {name} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table and the time that pasts take."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--splits", nargs="+", default=["train", "val"])
    parser.add_argument("--limit", type=int, default=None)
    parser.add_argument("--out", type=Path, default=Path("build/pasts"))
    options = parser.parse_args()
    root = Path(os.environ["PD_EDITOR_AV2"])
    folders = [
        folder
        for split in options.splits
        for folder in sorted((root / split).glob("*/"))
    ][: options.limit]
    print(f"| {len(folders)} scenes | {' | '.join(COLUMNS)} |")
    print("|" + " --- |" * (len(COLUMNS) + 1))
    recorded = []
    for scenario in map(read_scenario, folders):
        users = scenario.agents.kind_mask(ROAD_USER_KINDS)
        present = scenario.agents.is_valid[:, scenario.current_step]
        recorded.append(figures(scenario, np.flatnonzero(users & present)))
    print(line("recorded", recorded))
    times: list[tuple[int, float]] = []
    for placement in ("resampled", "fit"):
        found = []
        for folder in folders:
            scenario = generated(folder, placement, options.out)
            rows = np.flatnonzero(scenario.agents.has_made_up_past)
            found.append(figures(scenario, rows))
            # The first time, what the scene keeps is computed.
            made_up_past(scenario, rows, 0)
            began = time.process_time()
            made_up_past(scenario, rows, 0)
            times.append((len(rows), 1e3 * (time.process_time() - began)))
        print(line(placement, found))
    count, spent = np.array(times).T
    middle = np.median(spent[(count >= 24) & (count <= 40)])
    print(f"A past for 24 to 40 agents: {middle:.1f} ms of processor time (median).")


if __name__ == "__main__":
    main()
