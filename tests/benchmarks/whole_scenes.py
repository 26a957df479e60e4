"""Whole generated scenes beside recorded ones: where vehicles stand and how they move.

Three ways: the agents of the square around the focal agent redrawn, all agents redrawn, as
many agents as fit. The folders stay in ``--out`` for other programs.
Needs PD_EDITOR_AV2.
"""

import argparse
import os
from pathlib import Path

import numpy as np

import pd_editor
from pd_editor.av2_io.read import read_scenario
from pd_editor.geometry.angles import wrap_angle
from pd_editor.metrics.off_road import is_off_road
from pd_editor.scene.activity import STANDING_SPEED_MPS
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.scenario import Scenario
from pd_editor.windows.lane_pieces import lane_pieces
from pd_editor.windows.scene_features import scene_center

HALF_SIDE_M = 62.0
WAYS = ("square", "redrawn", "fit")
COLUMNS = (
    "speed, m/s",
    "standing, %",
    "off drivable, %",
    "path, m",
    "askew to lane, %",
    "askew to nearest, %",
)


def generate(folder: Path, way: str, model: str, seed: int, out: Path) -> None:
    """One scene, one way."""
    scenario = read_scenario(folder)
    agents, step = scenario.agents, scenario.current_step
    rows = np.flatnonzero(agents.is_valid[:, step] & agents.kind_mask(ROAD_USER_KINDS))
    center = scene_center(scenario)
    options = {"model": model, "seed": seed, "name": folder.name, "out": out}
    if way == "fit":
        pd_editor.generate(folder, num_agents="fit", **options)
        return
    region = None
    if way == "square":
        away = np.abs(agents.position_m[rows, step] - center).max(axis=1)
        rows = rows[away <= HALF_SIDE_M]
        region = (float(center[0]), float(center[1]), HALF_SIDE_M)
    ids = tuple(agents.ids[row] for row in rows)
    pd_editor.generate(folder, agents=ids, redraw_states=True, region=region, **options)


def vehicle_rows(scenario: Scenario) -> np.ndarray:
    """A row for each vehicle at the current step; NaN where a column says nothing."""
    agents, step = scenario.agents, scenario.current_step
    rows = np.flatnonzero(
        agents.is_valid[:, step] & agents.kind_mask([AgentKind.VEHICLE])
    )
    place, heading = agents.position_m[rows, step], agents.heading_rad[rows, step]
    stands = agents.speed_mps()[rows, step] < STANDING_SPEED_MPS
    way = np.diff(agents.position_m[rows, step:], axis=1)
    path = np.linalg.norm(way, axis=-1).sum(axis=1)
    path[~agents.is_valid[rows, step:].all(axis=1)] = np.nan
    pieces = lane_pieces(scenario.road_map)
    lanes = pieces.pose[pieces.kind == 0]
    gap = np.linalg.norm(place[:, None] - lanes[:, :2], axis=-1)
    to_lane = folded_deg(heading - lanes[gap.argmin(axis=1), 2])
    apart = np.linalg.norm(place[:, None] - place, axis=-1)
    np.fill_diagonal(apart, np.inf)
    nearest = apart.argmin(axis=1)
    to_nearest = folded_deg(heading - heading[nearest])
    askew = np.where(stands, (to_lane > 15) & (to_lane < 75), np.nan)
    is_near = stands & (apart.min(axis=1) < 15)
    beside = np.where(is_near, to_nearest > 15, np.nan)
    off_road = is_off_road(scenario, place)
    speed = agents.speed_mps()[rows, step]
    return np.column_stack([speed, stands, off_road, path, askew, beside])


def folded_deg(angle_rad: np.ndarray) -> np.ndarray:
    """Angle between lines, 0 to 90 degrees."""
    degrees = np.abs(np.degrees(wrap_angle(angle_rad)))
    return np.minimum(degrees, 180 - degrees)


def line(folders: list[Path]) -> str:
    """Means over all vehicles of some scenes."""
    tables = [vehicle_rows(read_scenario(folder)) for folder in folders]
    means = np.nanmean(np.concatenate(tables), axis=0) * [1, 100, 100, 1, 100, 100]
    count = sum(map(len, tables)) / len(tables)
    return f"{count:12.1f}" + "".join(f"{value:20.2f}" for value in means)


def main() -> None:
    """Print a line for the recordings and one for each way, over all seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="path-diffuser")
    parser.add_argument("--split", default="val")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    root = Path(os.environ["PD_EDITOR_AV2"])
    folders = sorted(
        path.parent for path in (root / options.split).glob("*/scenario*.parquet")
    )
    print(f"{'':10}{'vehicles':>12}" + "".join(f"{name:>20}" for name in COLUMNS))
    print(f"{'recorded':10}{line(folders)}")
    for way in WAYS:
        made: list[Path] = []
        for seed in range(options.seeds):
            out = options.out / f"{way}-{seed}"
            for folder in folders:
                generate(folder, way, options.model, seed, out)
                made.append(out / folder.name)
        print(f"{way:10}{line(made)}", flush=True)


if __name__ == "__main__":
    main()
