"""Speeds of vehicles over time: in sensor logs of 15 s, and in roll-outs.

Sensor logs and scenes of a split of PD_EDITOR_AV2, by parts of 5 s: of all vehicles, of
those that were there at first, and of those that came later.
"""

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow.feather as feather
from scipy.spatial.transform import Rotation

from benchmarks.roll_outs import run
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.closed_loop.roll_out import RollOutRequest
from pd_editor.generation.generators import SHIPPED_MODEL, make_generator
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

PART_S = 5
APART = 5
"""Rows of a track between two places of which a speed is made."""
WORDS = ("VEHICLE", "TRUCK", "BUS", "MOTORCYCLE", "TRAILER")
FIRST_S = 0.5


def columns(file: Path) -> dict[str, np.ndarray]:
    return {
        name: np.array(one)
        for name, one in feather.read_table(file).to_pydict().items()
    }


def placed(folder: Path) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Boxes of a sensor log, and their places and headings in the city."""
    own = folder / "annotations_with_ego.feather"
    boxes = columns(own if own.exists() else folder / "annotations.feather")
    ego = columns(folder / "city_SE3_egovehicle.feather")
    at = np.searchsorted(ego["timestamp_ns"], boxes["timestamp_ns"])
    at = np.minimum(at, len(ego["timestamp_ns"]) - 1)
    turn = Rotation.from_quat(
        np.stack([ego[name][at] for name in ("qx", "qy", "qz", "qw")], axis=-1)
    )
    own = np.stack([boxes[name] for name in ("tx_m", "ty_m", "tz_m")], axis=-1)
    place = turn.apply(own)[:, :2] + np.stack([ego["tx_m"], ego["ty_m"]], axis=-1)[at]
    box = Rotation.from_quat(
        np.stack([boxes[name] for name in ("qx", "qy", "qz", "qw")], axis=-1)
    )
    return boxes, place, (turn * box).as_euler("ZYX")[:, 0]


def logged(folder: Path) -> Iterator[tuple[bool, np.ndarray, np.ndarray]]:
    """Of each vehicle, whether it is there at first, and its speeds and their times."""
    boxes, place, _ = placed(folder)
    time = (boxes["timestamp_ns"] - boxes["timestamp_ns"].min()) / 1e9
    is_vehicle = np.array(
        [any(word in one for word in WORDS) for one in boxes["category"]]
    )
    for name in np.unique(boxes["track_uuid"][is_vehicle]):
        rows = np.flatnonzero(boxes["track_uuid"] == name)
        rows = rows[np.argsort(time[rows])]
        one, other = rows[:-APART], rows[APART:]
        way = np.linalg.norm(place[other] - place[one], axis=-1)
        middle = (time[other] + time[one]) / 2
        yield time[rows[0]] < FIRST_S, way / (time[other] - time[one]), middle


def rolled(scenario: Scenario) -> Iterator[tuple[bool, np.ndarray, np.ndarray]]:
    """The same of a scenario from its current step on."""
    agents, now = scenario.agents, scenario.current_step
    speed, times = agents.speed_mps(), scenario.time_axis.times_s()
    for row in np.flatnonzero(agents.kind_mask(LANE_FOLLOWER_KINDS)):
        steps = now + np.flatnonzero(agents.is_valid[row, now:])
        yield bool(agents.is_valid[row, now]), speed[row, steps], times[steps]


def told(
    name: str, tracks: list[tuple[bool, np.ndarray, np.ndarray]], end_s: float
) -> None:
    """Print the mean speed and share standing of each part."""
    for who, wanted in (
        ("all", (True, False)),
        ("at first", (True,)),
        ("later", (False,)),
    ):
        parts = []
        for first in range(0, round(end_s), PART_S):
            own = [
                speed[(first <= time) & (time < first + PART_S)]
                for begins, speed, time in tracks
                if begins in wanted
            ]
            speeds = np.concatenate([np.zeros(0), *own])
            standing = 100 * (speeds < STANDING_MPS).mean()
            parts.append(f"{speeds.mean():.2f} ({standing:.0f} %)")
        print(f"{name}, {who}: m/s (standing) {', '.join(parts)}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="val")
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=30.0)
    options = parser.parse_args()
    root = Path(os.environ["PD_EDITOR_AV2"])
    logs = [
        one
        for folder in sorted((root / "sensor_logs").iterdir())
        for one in logged(folder)
    ]
    told("sensor logs", logs, 15.0)
    generator = make_generator(SHIPPED_MODEL)
    found: list[tuple[bool, np.ndarray, np.ndarray]] = []
    for folder in sorted((root / options.split).glob("*/"))[: options.scenes]:
        request = RollOutRequest(
            scenario=open_scenario(folder), duration_s=options.seconds
        )
        found += rolled(run(request, generator)[0].scenario)
    told("roll-outs", found, options.seconds)


if __name__ == "__main__":
    main()
