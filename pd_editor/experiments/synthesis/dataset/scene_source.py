"""Scenes of a synthetic dataset, and of real datasets, for the realism report."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.experiments.recordings.shards import SHARD_SUFFIX, ShardReader
from pd_editor.experiments.recordings.tracking_noise import TrackingNoise
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.formats.dataset import DatasetIndex, no_scenario
from pd_editor.scene.formats.registry import is_foreign_scene
from pd_editor.scene.scenario import Scenario

MAX_SCENES: Final = 300
"""Limit of scenes; more improve the statistics little and take a second per twenty."""


def scenario_folders(roots: Sequence[Path]) -> list[Path]:
    """Folders of Argoverse 2 scenarios below the roots, in the order of names, without duplicates.

    Raises:
        InputError: a root is no folder, or there is no scenario.
    """
    found: dict[str, Path] = {}
    for root in roots:
        for card in DatasetIndex(root).filter():
            if not is_foreign_scene(card.folder):
                found.setdefault(card.folder.name, card.folder)
    if not found:
        raise no_scenario(roots)
    return [found[name] for name in sorted(found)]


def dataset_scenes(folder: Path) -> Iterator[Scenario]:
    """Yield at most ``MAX_SCENES`` scenes of a synthetic dataset, evenly distributed.

    Scenes of shards get a tracker's noise, as real ones have.

    Raises:
        InputError: there is no scene, or one is damaged.
    """
    if any(folder.glob(f"*{SHARD_SUFFIX}")):
        reader = ShardReader(folder)
        for index in _spread(len(reader)):
            yield reader.window(index, noise=TrackingNoise())
    else:
        folders = scenario_folders((folder,))
        for index in _spread(len(folders)):
            yield read_scenario(folders[index])


def real_scenes(root: Path) -> Iterator[Scenario]:
    """Yield at most ``MAX_SCENES`` scenes of a dataset with a future, evenly distributed.

    Raises:
        InputError: there is no scene, or one is damaged.
    """
    folders = scenario_folders((root,))
    for index in _spread(len(folders)):
        scenario = read_scenario(folders[index])
        if scenario.agents.is_valid[:, scenario.current_step + 1 :].any():
            yield scenario


def _spread(count: int) -> list[int]:
    """At most ``MAX_SCENES`` evenly spaced indices below ``count``."""
    num = min(count, MAX_SCENES)
    return np.linspace(0, count - 1, num).round().astype(int).tolist()
