"""Training and validation scenes, prepared once for all runs on the same data, in batches."""

import functools
import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
import torch
from filelock import FileLock
from jaxtyping import Int

from pd_editor.base.errors import TrainingError
from pd_editor.base.regular_file import unwritable
from pd_editor.experiments.training.augmentation import DEFAULT_AUGMENTATION
from pd_editor.experiments.training.feature_preparation import (
    Preparation,
    fit_basis,
    open_roots,
    prepare_features,
)
from pd_editor.experiments.training.run_config import Augmentation, Budget
from pd_editor.experiments.work_engine.work_engine import WorkProgress
from pd_editor.generation.checkpoints.tensor_file import read_tensors, write_tensors
from pd_editor.generation.features.feature_store import FORMAT_VERSION, FeatureStore
from pd_editor.generation.features.scene_features import PackedScene
from pd_editor.generation.inputs import (
    SceneTensors,
    TrajectoryBasis,
    batch_of,
)


@runtime_checkable
class Batch(Protocol):
    """Interface of batches of scenes."""

    def to(self, device: torch.device, /) -> "Batch":
        """Move the batch to a device."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingData:
    """N scenes: training and validation rows, and functions that batch them."""

    training_rows: tuple[Int[np.ndarray, "_"], ...]
    held_out_rows: Int[np.ndarray, "_"]
    size: Int[np.ndarray, "N"]
    """Size of each scene; scenes of similar size share batches."""
    batch: Callable[[Int[np.ndarray, "_"]], Batch]
    augment: Callable[[Any, torch.Generator], Batch]
    """Augments a batch by symmetries of the data."""


def augmented_scenes(scene: SceneTensors, random: torch.Generator) -> SceneTensors:
    """Rotate scenes at random, and mirror half of them."""
    turn = torch.rand(scene.num_scenes, generator=random) * 2 * torch.pi
    if torch.rand((), generator=random) < 0.5:
        scene = scene.mirrored()
    return scene.rotated(turn.to(scene.agent_pose, non_blocking=True))


_BASIS_NAME: Final = "basis.safetensors"
_BASIS_KIND: Final = "trajectory-basis"
_STORE_NAME: Final = "scenes"
_LEAST_SCENES: Final = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedData:
    """Encoded scenes of some roots, and their trajectory basis."""

    store: FeatureStore
    basis: TrajectoryBasis
    num_left_out: int
    """Number of unusable scenarios of the roots and of damaged shards."""
    validation: FeatureStore | None = None
    """Scenes to validate on; None: some of the store are held out."""


def default_cache() -> Path:
    """Default folder of prepared scenes."""
    beside = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(beside) / "pd-editor" / "scenes"


def prepared_data(
    roots: Sequence[Path],
    cache: Path,
    *,
    basis: TrajectoryBasis | None = None,
    copies: int = 1,
    windows: int = 1,
    augmentation: Augmentation | None = DEFAULT_AUGMENTATION,
    workers: int | None = None,
    on_progress: Callable[[WorkProgress], None] | None = None,
) -> PreparedData:
    """Prepare the scenes of the roots, or load those of an earlier run.

    Of several concurrent runs one prepares and the others wait. An interrupted
    preparation is resumed. Without a basis, one is fitted to the data; ``copies`` of
    each scenario are augmented independently.

    Raises:
        InputError: a root is neither a dataset nor shards.
        TrainingError: no scenario can be used, or the cache cannot be written.
    """
    opened = open_roots(roots, windows)
    prints = [root.fingerprint for root in opened]
    names = [os.path.realpath(root) for root in roots]
    parts = [*names, *prints, str(FORMAT_VERSION), str(copies), str(augmentation)]
    if basis is not None:
        parts += [repr(one.tolist()) for one in basis.arrays().values()]
    key = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
    folder = cache / key
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder / ".lock"):
            if basis is None:
                basis = _basis(roots, folder / _BASIS_NAME, workers)
            store = prepare_features(
                roots,
                folder / _STORE_NAME,
                basis,
                preparation=Preparation(
                    augmentation=augmentation, copies=copies, windows=windows
                ),
                workers=workers,
                on_progress=on_progress,
            )
    except OSError as error:
        raise unwritable(folder, error, TrainingError) from error
    num_scenarios = sum(len(root) + root.num_damaged for root in opened)
    left_out = num_scenarios - len(store) // copies
    return PreparedData(store=store, basis=basis, num_left_out=left_out)


def read_basis(path: Path) -> TrajectoryBasis:
    """Read a trajectory basis from a file.

    Raises:
        ModelError: the file holds none.
    """
    arrays = read_tensors(path, _BASIS_KIND).tensors
    return TrajectoryBasis.of_arrays(
        {name: one.numpy() for name, one in arrays.items()}
    )


def write_basis(path: Path, basis: TrajectoryBasis) -> None:
    """Write a trajectory basis for ``read_basis``."""
    arrays = {
        name: torch.from_numpy(np.asarray(one)) for name, one in basis.arrays().items()
    }
    write_tensors(path, _BASIS_KIND, arrays, {})


def _basis(roots: Sequence[Path], path: Path, workers: int | None) -> TrajectoryBasis:
    if os.path.exists(path):
        return read_basis(path)
    basis = fit_basis(roots, workers=workers)
    write_basis(path, basis)
    return basis


def training_data(
    store: FeatureStore,
    budget: Budget,
    seed: int,
    validation: FeatureStore | None = None,
) -> TrainingData:
    """Make training and validation scenes; hold some out without the latter.

    Raises:
        TrainingError: a root has too few scenes.
    """
    share = budget.held_out_share if validation is None else 0.0
    held_out = held_out_scenes(store.group, share, seed)
    rows = np.arange(len(store))
    training = tuple(
        rows[(store.root == root) & ~held_out] for root in range(len(store.index.roots))
    )
    for name, part in zip(store.index.roots, training, strict=True):
        if len(part) < _LEAST_SCENES:
            raise TrainingError(
                f"{name}: has {len(part)} scenarios to train on that can be used; "
                f"expected {_LEAST_SCENES} or more."
            )
    checked = rows[held_out]
    if validation is not None:
        checked = len(store) + np.arange(len(validation))
    step = -(-len(checked) // max(budget.held_out_scenes, 1))

    def batch(chosen: Int[np.ndarray, "_"]) -> SceneTensors:
        return batch_of([scene(int(row)) for row in chosen])

    def scene(row: int) -> PackedScene:
        if row < len(store) or validation is None:
            return store[row]
        return validation[row - len(store)]

    stores = [store] if validation is None else [store, validation]

    return TrainingData(
        training_rows=training,
        held_out_rows=checked[:: max(step, 1)],
        size=np.concatenate([one.num_agents + one.num_pieces // 16 for one in stores]),
        batch=batch,
        augment=augmented_scenes,
    )


def held_out_scenes(group: np.ndarray, share: float, seed: int) -> np.ndarray:
    """Sample the held-out scenes [N]: whole networks or cities.

    Single scenes are sampled if no network or city is small enough.
    """
    room = share * len(group)
    held_out = np.zeros(len(group), bool)
    names, place, counts = np.unique(group, return_inverse=True, return_counts=True)
    random = np.random.default_rng([seed, 5])
    for index in random.permutation(len(names)):
        if counts[index] <= room:
            held_out |= place == index
            room -= counts[index]
    if not held_out.any():
        held_out[random.permutation(len(group))[: int(share * len(group))]] = True
    return held_out


_BATCHES_SORTED_TOGETHER = 16


class BatchSampler:
    """Samples scenes of each of R roots without replacement within an epoch.

    Scenes of similar size share a batch, since a batch is padded to its largest scene:
    the scenes of several batches are sampled, sorted by size, and their batches shuffled.
    There is no state between steps, so that a run can be resumed at any step.
    """

    def __init__(
        self,
        rows_of_root: Sequence[Int[np.ndarray, "_"]],
        size: Int[np.ndarray, "N"],
        *,
        shares: Sequence[float],
        batch_size: int,
        seed: int,
    ) -> None:
        """Make a sampler of batches, in which each root has its share.

        Raises:
            TrainingError: the batch is too small for the number of roots.
        """
        self._rows = [np.asarray(rows) for rows in rows_of_root]
        self._size = size
        self._seed = seed
        self._per_root = _whole_parts(batch_size, shares)
        self._batch_size = batch_size
        self._batches_of_block = functools.lru_cache(maxsize=2)(self._batches)

    def rows(self, step: int) -> Int[np.ndarray, "B"]:
        """Rows of the scenes of a step's batch."""
        block, index = divmod(step, _BATCHES_SORTED_TOGETHER)
        return self._batches_of_block(block)[index]

    def _batches(self, block: int) -> Int[np.ndarray, "K B"]:
        """Rows of the batches of a block, whose scenes are sorted together."""
        sampled = np.concatenate(
            [
                self._sampled(
                    root,
                    block * _BATCHES_SORTED_TOGETHER * per_batch,
                    _BATCHES_SORTED_TOGETHER * per_batch,
                )
                for root, per_batch in enumerate(self._per_root)
            ]
        )
        random = np.random.default_rng([self._seed, 1, block])
        sampled = sampled[random.permutation(len(sampled))]
        by_size = sampled[np.argsort(self._size[sampled], kind="stable")]
        batches = by_size.reshape(_BATCHES_SORTED_TOGETHER, self._batch_size)
        return batches[random.permutation(_BATCHES_SORTED_TOGETHER)]

    def _sampled(self, root: int, first: int, count: int) -> Int[np.ndarray, "_"]:
        """``count`` rows from position ``first`` of a root's sequence of shuffled epochs."""
        rows, parts = self._rows[root], []
        while count:
            epoch, offset = divmod(first, len(rows))
            random = np.random.default_rng([self._seed, 0, root, epoch])
            part = rows[random.permutation(len(rows))[offset : offset + count]]
            parts.append(part)
            first, count = first + len(part), count - len(part)
        return np.concatenate(parts) if parts else rows[:0]


def _whole_parts(total: int, shares: Sequence[float]) -> list[int]:
    """Divide ``total`` into positive integers nearest to the shares."""
    if total < len(shares):
        raise TrainingError(
            f"A batch of {total} scenes cannot hold some of each of {len(shares)} data "
            "roots; expected a larger batch or fewer roots."
        )
    exact = np.asarray(shares, dtype=np.float64) / np.sum(shares) * total
    parts = np.maximum(1, np.floor(exact).astype(np.int64))
    while parts.sum() < total:
        parts[np.argmax(exact - parts)] += 1
    while parts.sum() > total:
        parts[np.argmax(np.where(parts > 1, parts - exact, -np.inf))] -= 1
    return parts.tolist()
