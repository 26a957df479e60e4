"""Scenarios of several data roots: Argoverse 2 datasets and synthetic shards alike."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

import numpy as np

from pd_editor.av2_io.dataset import DatasetIndex
from pd_editor.av2_io.read import read_scenario
from pd_editor.errors import InputError, TrainingError
from pd_editor.scene.scenario import Scenario
from pd_editor.windows.shards import SHARD_SUFFIX, ShardReader
from pd_editor.windows.tracking_noise import TrackingNoise

BLUR_ONLY: Final = TrackingNoise(range_m=np.inf, occlusions_per_s=0.0)
"""Tracks of simulated agents are blurred, but not broken off: futures stay whole."""


@runtime_checkable
class ScenarioRoot(Protocol):
    """Scenarios by number."""

    @property
    def fingerprint(self) -> str:
        """Differs where the scenarios do."""
        ...

    def __len__(self) -> int: ...

    def scenario(self, index: int) -> Scenario:
        """A scenario; equal each time.

        Raises:
            InputError: it is damaged.
        """
        ...

    def group(self, index: int) -> str:
        """The network or city it is from, asked for after the scenario."""
        ...


class ShardRoot:
    """The windows of a folder of shards, as a tracker would see them."""

    def __init__(self, path: Path, noise: TrackingNoise | None = BLUR_ONLY) -> None:
        """Read which windows there are.

        Raises:
            InputError: there is no shard, or one is damaged.
        """
        self._path = path
        self._reader = ShardReader(path)
        self._noise = noise

    @property
    def fingerprint(self) -> str:
        """Of the names and sizes of the shards, and of the noise."""
        files = sorted(self._path.glob(f"*{SHARD_SUFFIX}"))
        files = files or [self._path]
        sizes = [(file.name, file.stat().st_size) for file in files]
        return _digest([*sizes, self._noise])

    def __len__(self) -> int:
        return len(self._reader)

    def scenario(self, index: int) -> Scenario:
        """The scenario of a window."""
        return self._reader.window(index, noise=self._noise)

    def group(self, index: int) -> str:
        """Name of the recording, which is that of its network."""
        place, _ = self._reader.windows[index]
        return self._reader.recording(place).name


class Av2Root:
    """The scenarios below a folder of an Argoverse 2 dataset."""

    def __init__(self, path: Path) -> None:
        """List the scenarios' folders.

        Raises:
            InputError: there is no such folder, or no scenario in it.
        """
        index = DatasetIndex(path)
        index.scan()
        self._root = path
        self._folders = index.folders()
        self._city: tuple[int, str] = (-1, "")
        if not self._folders:
            raise InputError(
                f"{path}: holds neither Argoverse 2 scenarios nor shards "
                f"(*{SHARD_SUFFIX})."
            )

    @property
    def fingerprint(self) -> str:
        """Of the names of the folders."""
        return _digest([one.relative_to(self._root) for one in self._folders])

    def __len__(self) -> int:
        return len(self._folders)

    def scenario(self, index: int) -> Scenario:
        """The scenario of a folder."""
        found = read_scenario(self._folders[index])
        self._city = (index, found.city)
        return found

    def group(self, index: int) -> str:
        """The city."""
        if self._city[0] != index:
            self.scenario(index)
        return self._city[1]


def open_root(path: Path) -> ScenarioRoot:
    """A folder of shards, or an Argoverse 2 dataset.

    Raises:
        InputError: it is neither, or damaged.
    """
    is_shards = path.suffix == SHARD_SUFFIX or any(path.glob(f"*{SHARD_SUFFIX}"))
    return ShardRoot(path) if is_shards else Av2Root(path)


class ScenarioSource:
    """The scenarios of several roots, one after the other."""

    def __init__(self, roots: Sequence[ScenarioRoot]) -> None:
        """Args are the roots; there is at least one."""
        self.roots = tuple(roots)
        self._first = np.cumsum([0, *map(len, self.roots)])

    def __len__(self) -> int:
        return int(self._first[-1])

    def place(self, index: int) -> tuple[int, int]:
        """Root, and number within it, of a scenario."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        root = int(np.searchsorted(self._first, index, side="right")) - 1
        return root, index - int(self._first[root])

    def __getitem__(self, index: int) -> Scenario:
        root, number = self.place(index)
        return self.roots[root].scenario(number)


def open_roots(paths: Sequence[Path]) -> ScenarioSource:
    """The scenarios of all roots.

    Raises:
        InputError: one is neither a dataset nor shards, or damaged.
        TrainingError: no root was given.
    """
    if not paths:
        raise TrainingError("No data root was given; expected at least one.")
    return ScenarioSource([open_root(Path(path)) for path in paths])


def _digest(values: Sequence[object]) -> str:
    text = "\n".join(map(str, values))
    return hashlib.sha256(text.encode()).hexdigest()
