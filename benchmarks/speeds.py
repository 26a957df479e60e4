"""Speeds of vehicles around the focal agent: recorded, of a corpus, and sampled.

``python -m benchmarks.speeds [--models FOLDER ...] [--split train] [--samples 4]
[--corpus FOLDER --cache FOLDER [--most-crawling 0.5]]``. Samples are raw initial states of
recorded numbers and kinds; a corpus is that of trainings, as augmented. Needs
PD_EDITOR_AV2.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.initial_states import load_pose_model, real_scenes, sampled
from pd_editor.base.installed_files import models_folder
from pd_editor.experiments.training.augmentation import (
    CRAWLING_MPS,
    DEFAULT_AUGMENTATION,
)
from pd_editor.experiments.training.stage_objective import basis_of, starting_model
from pd_editor.experiments.training.training_data import prepared_data
from pd_editor.generation.features.scene_features import AGENT_KINDS
from pd_editor.generation.generators import SHIPPED_MODEL
from pd_editor.generation.initial_state.attributes import AttributeRequest
from pd_editor.generation.initial_state.network.state_encoding import POSITION_UNIT_M
from pd_editor.generation.initial_state.sampler import InitialStateSamplerConfig
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.thresholds import MOVING_MPS

SHARES = (0.1, 0.25, 0.5, 0.75, 0.9)
RESAMPLES = 1000


def summary(speeds: list[np.ndarray]) -> np.ndarray:
    """Percent standing, mean, mean of moving ones, percent of those that crawl, quantiles."""
    speed = np.concatenate(speeds)
    moving = speed[speed >= MOVING_MPS]
    standing, crawling = np.mean(speed < MOVING_MPS), np.mean(moving < CRAWLING_MPS)
    means = (100 * standing, speed.mean(), moving.mean(), 100 * crawling)
    return np.array([*means, *np.quantile(moving, SHARES)])


def line(name: str, speeds: list[np.ndarray]) -> str:
    """A line with intervals of 95 % over bootstrap resamples of scenes."""
    random = np.random.default_rng(0)
    found = [
        summary([speeds[row] for row in random.integers(len(speeds), size=len(speeds))])
        for _ in range(RESAMPLES)
    ]
    low, high = np.quantile(found, [0.025, 0.975], axis=0)
    cells = [
        f"{value:6.1f} [{least:4.1f}, {most:4.1f}]"
        for value, least, most in zip(summary(speeds), low, high, strict=True)
    ]
    return f"{name:24}{sum(map(len, speeds)):7d}" + "".join(cells)


def corpus_speeds(
    root: Path, cache: Path, model: Path, most_crawling: float
) -> list[np.ndarray]:
    """Of the scenes that a training would see."""
    data = prepared_data(
        [root],
        cache,
        basis=basis_of(starting_model(model)),
        augmentation=replace(DEFAULT_AUGMENTATION, most_crawling=most_crawling),
    )
    vehicle = AGENT_KINDS.index(AgentKind.VEHICLE)
    scenes = [data.store[row] for row in range(len(data.store))]
    return [
        one.agent_speed[
            (one.agent_kind == vehicle)
            & (np.abs(one.agent_pose[:, :2]).max(axis=1) <= POSITION_UNIT_M)
        ]
        for one in scenes
    ]


def main() -> None:
    """Print the table."""
    shipped = models_folder() / SHIPPED_MODEL
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", type=Path, nargs="*", default=[shipped])
    parser.add_argument("--split", default="train")
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--corpus", type=Path)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--most-crawling", type=float, nargs="+", default=[1.0])
    options = parser.parse_args()
    scenes = real_scenes(options.split, only_paper_agents=False)
    print(
        f"{'':24}{'number':>7}"
        + "".join(
            f"{name:>20}"
            for name in (
                *("standing, %", "mean, m/s", "of moving", "crawling, %"),
                *(f"{100 * share:.0f} % of moving" for share in SHARES),
            )
        )
    )
    is_vehicle = [
        np.array([kind == AgentKind.VEHICLE for kind in one.scenario.agents.kinds])
        for one in scenes
    ]
    recorded = [
        np.hypot(*one.scenario.agents.velocity_mps[rows, one.scenario.current_step].T)
        for one, rows in zip(scenes, is_vehicle, strict=True)
    ]
    print(line(f"recorded, {options.split}", recorded))
    if options.corpus:
        for most in options.most_crawling:
            found = corpus_speeds(options.corpus, options.cache, shipped, most)
            print(line(f"corpus, most {most:g}", found), flush=True)
    for folder in options.models:
        model, sampler = load_pose_model(folder), InitialStateSamplerConfig()
        speeds = [
            np.concatenate(
                [
                    np.hypot(*one.sample.velocity_mps[rows, 0].T)
                    for one in sampled(
                        model, scene, options.samples, sampler, None, AttributeRequest()
                    )
                ]
            )
            for scene, rows in zip(scenes, is_vehicle, strict=True)
        ]
        print(line(folder.name, speeds), flush=True)


if __name__ == "__main__":
    main()
