"""Scenarios of data roots: Argoverse 2 datasets and synthetic shards."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.base.errors import InputError, TrainingError
from pd_editor.experiments.recordings.shards import SHARD_SUFFIX, ShardReader
from pd_editor.experiments.recordings.tracking_noise import TrackingNoise
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.formats.dataset import DatasetIndex
from pd_editor.scene.scenario import Scenario

BLUR_ONLY: Final = TrackingNoise(range_m=np.inf, occlusions_per_s=0.0)
"""Noise of simulated tracks; it does not break off tracks, so trajectories are complete."""
FIRST_STEP: Final = 10
"""Earliest current step of a window of an Argoverse 2 scenario."""


class ShardRoot:
    """Windows of a folder of shards, with a tracker's noise."""

    is_simulated = True
    """Every agent is in the scenarios, not only those that a tracker saw."""

    def __init__(self, path: Path, noise: TrackingNoise | None = BLUR_ONLY) -> None:
        """Read the index of windows; damaged shards are left out.

        Raises:
            InputError: there is no shard that can be read.
        """
        self._shards = ShardReader(path, skips_damaged=True)
        self.num_damaged = self._shards.num_damaged
        self._noise = noise

    @property
    def fingerprint(self) -> str:
        """Hash of the names and sizes of the shards, and of the noise."""
        sizes = [(file.name, file.stat().st_size) for file in self._shards.files]
        return _digest([*sizes, self._noise])

    def __len__(self) -> int:
        return len(self._shards)

    def scenario(self, index: int) -> Scenario:
        """The scenario of a window; equal each time.

        Raises:
            InputError: it is damaged.
        """
        return self._shards.window(index, noise=self._noise)

    def group(self, index: int) -> str:
        """Name of the recording, which is the name of its network."""
        place, _ = self._shards.windows[index]
        return self._shards.recording(place).name


class Av2Root:
    """Scenarios below a folder of an Argoverse 2 dataset."""

    is_simulated = False

    def __init__(self, path: Path, windows: int = 1) -> None:
        """List the scenarios' folders, each used at several current steps.

        Earlier steps are possible because the networks use no history.

        Raises:
            InputError: there is no such folder, or no scenario in it.
        """
        self._windows = windows
        index = DatasetIndex(path)
        index.scan()
        self._root = path
        self._folders = index.folders()
        self.num_damaged = index.num_skipped
        self._city: tuple[int, str] = (-1, "")
        if not self._folders:
            raise InputError(
                f"{path}: holds neither Argoverse 2 scenarios nor shards "
                f"(*{SHARD_SUFFIX})."
            )

    @property
    def fingerprint(self) -> str:
        """Hash of the names of the folders and the number of windows."""
        names = [one.relative_to(self._root) for one in self._folders]
        return _digest([*names, self._windows])

    def __len__(self) -> int:
        return len(self._folders) * self._windows

    def scenario(self, index: int) -> Scenario:
        """The scenario of a folder, at the current step of the window.

        Raises:
            InputError: it is damaged.
        """
        folder, window = divmod(index, self._windows)
        found = read_scenario(self._folders[folder])
        self._city = (index, found.city)
        axis = found.time_axis
        steps = np.linspace(axis.current_step, FIRST_STEP, self._windows).round()
        return replace(
            found, time_axis=replace(axis, current_step=max(int(steps[window]), 0))
        )

    def group(self, index: int) -> str:
        """The city; fast right after its scenario."""
        if self._city[0] != index:
            self.scenario(index)
        return self._city[1]


ScenarioRoot = ShardRoot | Av2Root


def open_root(path: Path, windows: int = 1) -> ScenarioRoot:
    """Open a folder of shards, or an Argoverse 2 dataset.

    Raises:
        InputError: it is neither, or damaged.
    """
    return ShardRoot(path) if not is_recorded(path) else Av2Root(path, windows)


def is_recorded(path: Path) -> bool:
    """Whether a root is a dataset of recordings, not of simulated shards."""
    return path.suffix != SHARD_SUFFIX and not any(path.glob(f"*{SHARD_SUFFIX}"))


class ScenarioSource:
    """Scenarios of several roots, concatenated."""

    def __init__(self, roots: Sequence[ScenarioRoot]) -> None:
        """Concatenate at least one root."""
        self.roots = tuple(roots)
        self._first = np.cumsum([0, *map(len, self.roots)])

    def __len__(self) -> int:
        return int(self._first[-1])

    @property
    def num_damaged(self) -> int:
        """Number of damaged files or folders."""
        return sum(root.num_damaged for root in self.roots)

    def place(self, index: int) -> tuple[int, int]:
        """Index of the root, and index within it, of a scenario."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        root = int(np.searchsorted(self._first, index, side="right")) - 1
        return root, index - int(self._first[root])

    def __getitem__(self, index: int) -> Scenario:
        root, number = self.place(index)
        return self.roots[root].scenario(number)


def open_roots(paths: Sequence[Path], windows: int = 1) -> ScenarioSource:
    """Open all roots; scenarios of Argoverse 2 have ``windows`` windows each.

    Raises:
        InputError: one is neither a dataset nor shards, or damaged.
        TrainingError: no root was given.
    """
    if not paths:
        raise TrainingError("No data root was given; expected at least one.")
    return ScenarioSource([open_root(Path(path), windows) for path in paths])


def _digest(values: Sequence[object]) -> str:
    text = "\n".join(map(str, values))
    return hashlib.sha256(text.encode()).hexdigest()
