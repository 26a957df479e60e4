"""Scenarios of data roots (recordings, synthetic shards) and their features on disk."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.base.errors import InputError, PdEditorError, TrainingError
from pd_editor.experiments.recordings.clip import TrackingNoise
from pd_editor.experiments.recordings.shards import SHARD_SUFFIX, ShardReader
from pd_editor.experiments.training.augmentation import (
    DEFAULT_AUGMENTATION,
    augmented,
    crawling_share,
)
from pd_editor.experiments.training.run_config import Augmentation
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.experiments.work_engine.work_engine import WorkProgress, run_items
from pd_editor.generation.features.feature_store import (
    FORMAT_VERSION,
    FeatureStore,
    StoreIndex,
    open_for_writing,
    write_part,
)
from pd_editor.generation.features.scene_features import (
    NUM_FUTURE_STEPS,
    SceneFeatures,
    packed,
    scene_center,
    scene_features,
)
from pd_editor.generation.inputs import TrajectoryBasis
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.formats.dataset import DatasetIndex
from pd_editor.scene.scenario import Scenario

BLUR_ONLY: Final = TrackingNoise(range_m=np.inf, occlusions_per_s=0.0)
"""Noise of simulated tracks; it does not break off tracks, so trajectories are complete."""


class ShardRoot:
    """Windows of a folder of shards, with a tracker's noise."""

    is_simulated = True
    """Every agent is in the scenarios, not only those that a tracker saw."""

    def __init__(self, path: Path, noise: TrackingNoise | None = BLUR_ONLY) -> None:
        """Read the index of windows; damaged shards are left out.

        Raises:
            InputError: there is no shard that can be read.
        """
        self.path = path
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
        self.path = path
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
        names = [one.relative_to(self.path) for one in self._folders]
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
        # Earliest current step of a window of an Argoverse 2 scenario.
        steps = np.linspace(axis.current_step, 10, self._windows).round()
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


def open_roots(paths: Sequence[Path], windows: int = 1) -> tuple[ScenarioRoot, ...]:
    """Open all roots; scenarios of Argoverse 2 have ``windows`` windows each.

    Raises:
        InputError: one is neither a dataset nor shards, or damaged.
        TrainingError: no root was given.
    """
    if not paths:
        raise TrainingError("No data root was given; expected at least one.")
    return tuple(open_root(Path(path), windows) for path in paths)


def _digest(values: Sequence[object]) -> str:
    text = "\n".join(map(str, values))
    return hashlib.sha256(text.encode()).hexdigest()


PART_SIZE: Final = 400
"""Scenarios per part; an interrupted preparation loses at most the running parts."""
_FIT_SIZE: Final = 100


@dataclass(frozen=True, kw_only=True)
class Preparation:
    """How scenarios become features."""

    augmentation: Augmentation | None = DEFAULT_AUGMENTATION
    seed: int = 0
    most_per_root: int | None = None
    """Number of scenarios, evenly distributed over each root; None: all."""
    copies: int = 1
    """Independently augmented copies of each scenario."""
    windows: int = 1
    """Current steps at which each scenario of Argoverse 2 is used."""

    def fingerprint(self, roots: Sequence[ScenarioRoot], basis: TrajectoryBasis) -> str:
        """Hash of the scenarios, of the basis, and of all that is set here."""
        digest = hashlib.sha256()
        for root in roots:
            digest.update(root.fingerprint.encode())
        for name, values in sorted(basis.arrays().items()):
            digest.update(name.encode() + np.ascontiguousarray(values).tobytes())
        own = (self.augmentation, self.seed, self.most_per_root, self.copies)
        digest.update(repr((*own, PART_SIZE, FORMAT_VERSION)).encode())
        return digest.hexdigest()

    def parts(self, roots: Sequence[ScenarioRoot], size: int) -> "dict[str, _PartItem]":
        """Work items by name; names sort in the order of roots and scenarios."""
        works = {}
        for place, root in enumerate(roots):
            count = min(len(root), self.most_per_root or len(root))
            chosen = np.arange(count) * len(root) // max(count, 1)
            firsts = range(0, count, size)
            for part, (copy, first) in enumerate(product(range(self.copies), firsts)):
                works[f"{place:03d}-{part:05d}"] = _PartItem(
                    root=root.path,
                    root_index=place,
                    numbers=tuple(chosen[first : first + size].tolist()),
                    preparation=self,
                    copy=copy,
                )
        return works


@dataclass(frozen=True, kw_only=True)
class _PartItem:
    """Work item: some scenarios of a root."""

    root: Path
    root_index: int
    numbers: tuple[int, ...]
    preparation: Preparation
    copy: int

    def features(self, *, with_candidates: bool) -> Iterator[tuple[str, SceneFeatures]]:
        """Yield group and features of each usable scenario."""
        root = _opened(self.root, self.preparation.windows)
        for number in self.numbers:
            random = np.random.default_rng(
                [self.preparation.seed, self.root_index, number, self.copy]
            )
            try:
                scenario = root.scenario(number)
                if root.is_simulated and self._is_left_out(scenario):
                    continue
                scenario, center = self._prepared(
                    scenario, random, hides_agents=root.is_simulated
                )
                found = scene_features(
                    scenario, with_candidates=with_candidates, center_m=center
                )
            except PdEditorError:
                # Unusable scenarios are skipped; they are counted by what is missing.
                continue
            yield root.group(number), found

    def _is_left_out(self, scenario: Scenario) -> bool:
        augmentation = self.preparation.augmentation
        if augmentation is None:
            return False
        share = crawling_share(scenario, scene_center(scenario))
        return share > augmentation.most_crawling

    def _prepared(
        self, scenario: Scenario, random: np.random.Generator, *, hides_agents: bool
    ) -> tuple[Scenario, np.ndarray]:
        center, augmentation = scene_center(scenario), self.preparation.augmentation
        if augmentation is None:
            return scenario, center
        center = center + augmentation.center_m * random.standard_normal(2)
        changed = augmented(scenario, augmentation, random, hides_agents=hides_agents)
        return changed, center


_opened: Final = lru_cache(maxsize=4)(open_root)


@dataclass(frozen=True, kw_only=True)
class _PartWriter:
    """Prepares and writes a part in a worker."""

    folder: Path
    basis: TrajectoryBasis

    def __call__(self, named: tuple[str, _PartItem]) -> int:
        name, work = named
        found = list(work.features(with_candidates=True))
        write_part(
            self.folder,
            name,
            [packed(features, self.basis.encode) for _, features in found],
            [group for group, _ in found],
            work.root_index,
        )
        return len(found)


def prepare_features(
    roots: Sequence[Path],
    folder: Path,
    basis: TrajectoryBasis,
    *,
    preparation: Preparation | None = None,
    workers: int | None = None,
    on_progress: Callable[[WorkProgress], None] | None = None,
) -> FeatureStore:
    """Create or complete the store in a folder; equal arguments give equal bytes.

    Scenarios that cannot be read are left out, so the store may have fewer scenes than
    the roots.

    Raises:
        InputError: a root is neither a dataset nor shards.
        TrainingError: the folder holds other features, or no scenario can be used.
    """
    folder, how = Path(folder), preparation or Preparation()
    opened = open_roots(roots, how.windows)
    works = how.parts(opened, PART_SIZE)
    index = StoreIndex(
        fingerprint=how.fingerprint(opened, basis),
        roots=tuple(map(str, roots)),
        settings=f"{how.augmentation}, seed {how.seed}, at most {how.most_per_root} of "
        "each root",
    )
    done = open_for_writing(folder, index)
    failures = run_items(
        LocalProcesses(num_workers=workers),
        _PartWriter(folder=folder, basis=basis),
        {name: (name, work) for name, work in works.items()},
        on_value=lambda _, __: None,
        on_progress=on_progress,
        done=done,
    )
    for failure in failures.values():
        raise TrainingError(
            f"{folder}: {len(failures)} of {len(works)} parts failed, the first with "
            f"{failure.error}: {failure.message}"
        )
    store = FeatureStore(folder)
    if not len(store):
        count = sum(map(len, opened))
        raise TrainingError(f"None of {count} scenarios can be used.")
    return store


def fit_basis(
    roots: Sequence[Path],
    *,
    count: int = 2000,
    workers: int | None = None,
    augmentation: Augmentation | None = DEFAULT_AUGMENTATION,
    seed: int = 1,
) -> TrajectoryBasis:
    """Fit the trajectory basis on about ``count`` scenarios, evenly over the roots.

    Raises:
        InputError: a root is neither a dataset nor shards.
        TrainingError: no agent has a complete trajectory, or a part could not be read.
    """
    opened = open_roots(roots)
    most = max(1, count // len(opened))
    how = Preparation(augmentation=augmentation, seed=seed, most_per_root=most)
    works = how.parts(opened, _FIT_SIZE)
    trajectories: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    failures = run_items(
        LocalProcesses(num_workers=workers),
        _trajectories_of,
        works,
        on_value=trajectories.__setitem__,
    )
    for failure in failures.values():
        raise TrainingError(
            f"{len(failures)} of {len(works)} parts of the data could not be read for the "
            f"trajectory basis, the first with {failure.error}: {failure.message}"
        )
    points = [trajectories[name][0] for name in sorted(trajectories)]
    if not sum(map(len, points)):
        raise TrainingError("No agent of the data roots has a complete trajectory.")
    speeds = np.concatenate([trajectories[name][1] for name in sorted(trajectories)])
    return TrajectoryBasis.fit(np.concatenate(points), speeds)


def _trajectories_of(work: _PartItem) -> tuple[np.ndarray, np.ndarray]:
    """Trajectories and speeds of the agents with complete trajectories."""
    found = [one for _, one in work.features(with_candidates=False)]
    points = [one.future_m[one.has_future] for one in found]
    speeds = [one.agent_speed[one.has_future] for one in found]
    if not found:
        return np.zeros((0, NUM_FUTURE_STEPS, 2)), np.zeros(0)
    return (
        np.concatenate(points).astype(float),
        np.concatenate(speeds).astype(float),
    )
