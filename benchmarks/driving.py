"""How vehicles drive on from their states: recorded ones beside those of corpora.

``python -m benchmarks.driving [--corpus FOLDER ...] [--scenes 400]``. Vehicles within a
square of half side 62 m around the focal agent, by their speed: metres beyond constant
velocity after 5.9 s, and the share that stands then. Recordings at five current steps;
corpora as a training would see them, without warps. Needs PD_EDITOR_AV2.
"""

import argparse
import itertools
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.training.augmentation import (
    CRAWLING_MPS,
    DEFAULT_AUGMENTATION,
    augmented,
    crawling_share,
)
from pd_editor.experiments.training.feature_preparation import ShardRoot
from pd_editor.generation.initial_state.network.state_encoding import POSITION_UNIT_M
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

HORIZON_S = 5.9
STRIDE = 5
"""Paths are measured every half second, so that a tracker's noise adds nothing."""
STARTED_M = 2.0
EDGES_MPS = (STANDING_MPS, 3.0, 6.0, 9.0, 12.0, 20.0)
QUANTILES = (5, 25, 50, 75, 95)
RECORDED_STEPS = (5, 16, 27, 38, 49)


def driving(scenario: Scenario, step: int) -> Float[np.ndarray, "A 4"]:
    """Speed, metres beyond constant velocity, displacement and final speed of vehicles.

    NaN where a trajectory is not complete.
    """
    agents, axis = scenario.agents, scenario.time_axis
    last = step + round(HORIZON_S / axis.step_s)
    focal = agents.row_of[scenario.focal_id]
    place, speed = agents.position_m, agents.speed_mps()
    if last >= place.shape[1] or not agents.is_valid[focal, step]:
        return np.zeros((0, 4))
    reach = np.abs(place[:, step] - place[focal, step]).max(axis=1)
    rows = agents.is_valid[:, step] & agents.kind_mask({AgentKind.VEHICLE})
    rows &= reach <= POSITION_UNIT_M
    whole = agents.is_valid[rows, step : last + 1].all(axis=1)
    way = place[rows, step : last + 1 : STRIDE]
    rest = (last - step) % STRIDE * axis.step_s
    path = np.hypot(*np.diff(way, axis=1).T).sum(axis=0) + rest * speed[rows, last]
    gone = np.hypot(*(place[rows, last] - place[rows, step]).T)
    beyond = path - HORIZON_S * speed[rows, step]
    later = np.stack([beyond, gone, speed[rows, last]], axis=-1)
    later[~whole] = np.nan
    return np.column_stack([speed[rows, step], later])


def recorded(split: str) -> Iterator[Float[np.ndarray, "A 4"]]:
    """Of the recordings of a split."""
    for folder in sorted((Path(os.environ["PD_EDITOR_AV2"]) / split).glob("*/")):
        scenario = read_scenario(folder)
        yield from (driving(scenario, step) for step in RECORDED_STEPS)


def simulated(root: Path, count: int) -> Iterator[Float[np.ndarray, "A 4"]]:
    """Of random scenes of a corpus, without its jams."""
    shards = ShardRoot(root)
    settings = replace(DEFAULT_AUGMENTATION, warp_share=0.0, jitter_m=0.0)
    rows = np.random.default_rng(0).permutation(len(shards))[:count]
    for row in rows.tolist():
        scenario = shards.scenario(row)
        agents, step = scenario.agents, scenario.current_step
        center = agents.position_m[agents.row_of[scenario.focal_id], step]
        if crawling_share(scenario, center) <= 0.5:
            random = np.random.default_rng(row)
            seen = augmented(scenario, settings, random, hides_agents=True)
            yield driving(seen, step)


def show(name: str, vehicles: Float[np.ndarray, "A 4"]) -> None:
    """Print the lines of one source."""
    speed, beyond, gone, last = vehicles.T
    stands, is_whole = speed < STANDING_MPS, np.isfinite(beyond)
    starts = gone[stands & is_whole] > STARTED_M
    moving = speed[~stands]
    print(
        f"{name}: {len(vehicles)} vehicles, {stands.mean():.1%} stand, "
        f"{starts.mean():.1%} of them start, "
        f"{np.mean(moving < CRAWLING_MPS):.1%} of the moving ones crawl; speeds "
        f"{np.round(np.quantile(moving, (0.1, 0.25, 0.5, 0.75, 0.9)), 1)}; mean beyond "
        f"constant velocity {np.nanmean(np.abs(beyond[~stands])):.2f} m"
    )
    for low, high in itertools.pairwise(EDGES_MPS):
        rows = (speed >= low) & (speed < high) & is_whole
        print(
            f"  {low:4g} to {high:2g} m/s {rows.sum():6d}  quantiles "
            f"{np.round(np.percentile(beyond[rows], QUANTILES), 1)}  mean size "
            f"{np.abs(beyond[rows]).mean():5.1f}  stand then "
            f"{np.mean(last[rows] < STANDING_MPS):.0%}"
        )


def main() -> None:
    """Print recordings, then corpora."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--corpus", type=Path, nargs="*", default=[])
    parser.add_argument("--scenes", type=int, default=400)
    options = parser.parse_args()
    for split in ("train", "val"):
        show(f"recorded, {split}", np.concatenate([*recorded(split)]))
    for root in options.corpus:
        show(root.name, np.concatenate([*simulated(root, options.scenes)]))


if __name__ == "__main__":
    main()
