"""On-disk store of encoded scenes, with random access.

A store is a folder of parts. Each part holds five arrays: scenes, lane pieces, boundary
pieces, agents and candidates; a scene has the offsets of its rows in the other arrays.
Parts are written atomically, so that an interrupted preparation can be resumed.
"""

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Int
from numpy.typing import DTypeLike

from pd_editor.base.errors import TrainingError
from pd_editor.base.regular_file import unwritable, write_whole
from pd_editor.generation.features.scene_features import NUM_CANDIDATES, PackedScene
from pd_editor.generation.features.scene_fields import LATENT_SIZE, SCENE_FIELDS

FORMAT_VERSION: Final = 6
"""Version of the file format and of the features' definitions."""
_INDEX_NAME: Final = "store.json"
_PART_PREFIX: Final = "part-"
_MOST_HALF: Final = 6e4
"""Approximate largest number of float16."""

_SCENE: Final = np.dtype(
    [
        ("piece", np.int64),
        ("boundary", np.int64),
        ("agent", np.int64),
        ("candidate", np.int64),
        ("root", np.int16),
        ("group", "U48"),
    ]
)
"""Offsets and origin of a scene; one additional row holds the final offsets."""
_TABLES: Final = {"piece": "pieces", "boundary": "boundary", "agent": "agents"}
"""Names of the arrays with the rows of each axis."""
_ARRAYS: Final = ("scenes", *_TABLES.values(), "candidates")


@dataclass(frozen=True, kw_only=True)
class StoreIndex:
    """Identity of a store's data and settings; stores that differ must not be mixed."""

    fingerprint: str
    """Hash of data and settings."""
    roots: tuple[str, ...]
    settings: str
    """Readable description of the settings."""
    version: int = FORMAT_VERSION


def open_for_writing(folder: Path, index: StoreIndex) -> frozenset[str]:
    """Create or resume a store; returns the names of the existing parts.

    Raises:
        TrainingError: the folder holds something else, or cannot be written.
    """
    path = folder / _INDEX_NAME
    try:
        if os.path.exists(path):
            found = _read_index(folder)
            if found.fingerprint != index.fingerprint:
                raise TrainingError(
                    f"{folder}: holds features of other data or settings; expected "
                    "another folder, or this one emptied."
                )
        else:
            write_whole(
                path, json.dumps(asdict(index), indent=2).encode(), TrainingError
            )
    except OSError as error:
        raise unwritable(folder, error, TrainingError) from error
    return frozenset(name.removeprefix(_PART_PREFIX) for name in _part_names(folder))


def write_part(
    folder: Path,
    name: str,
    scenes: Sequence[PackedScene],
    groups: Sequence[str],
    root: int,
) -> None:
    """Add scenes of a root to a store; ``groups`` are their networks or cities.

    Nothing is written if another process has just added a part of this name.
    """
    whole = folder / f"{_PART_PREFIX}{name}"
    beside = folder / f".{name}-{os.getpid()}"
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir()
    for title, array in zip(_ARRAYS, _tables(scenes, groups, root), strict=True):
        np.save(beside / f"{title}.npy", array)
    try:
        beside.rename(whole)
    except OSError:
        if not os.path.isdir(whole):
            raise
        shutil.rmtree(beside, ignore_errors=True)


class FeatureStore:
    """Encoded scenes of a folder, in the order of the parts' names."""

    def __init__(self, folder: Path) -> None:
        """Open a store; arrays are memory-mapped.

        Raises:
            TrainingError: there is no store, or one of another version.
        """
        self.folder = Path(folder)
        self.index = _read_index(self.folder)
        self._parts = [_Part(self.folder / name) for name in _part_names(self.folder)]
        counts = [len(part.scenes) - 1 for part in self._parts]
        self._first = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])

    def __len__(self) -> int:
        return int(self._first[-1])

    @property
    def root(self) -> Int[np.ndarray, "N"]:
        """Index of the root of each scene."""
        return self._column("root").astype(np.int64)

    @property
    def group(self) -> np.ndarray:
        """Network or city of each scene, as text [N], unique across roots."""
        return self._column("group")

    @property
    def num_agents(self) -> Int[np.ndarray, "N"]:
        """Number of agents of each scene."""
        return self._counts("agent")

    @property
    def num_pieces(self) -> Int[np.ndarray, "N"]:
        """Number of lane pieces of each scene."""
        return self._counts("piece")

    def __getitem__(self, index: int) -> PackedScene:
        if not 0 <= index < len(self):
            raise IndexError(index)
        part = int(np.searchsorted(self._first, index, side="right")) - 1
        return self._parts[part].scene(index - int(self._first[part]))

    def _column(self, name: str) -> np.ndarray:
        columns = [part.scenes[name][:-1] for part in self._parts]
        return np.concatenate(columns) if columns else np.zeros(0, _SCENE[name])

    def _counts(self, name: str) -> Int[np.ndarray, "N"]:
        counts = [np.diff(part.scenes[name]) for part in self._parts]
        return np.concatenate([np.zeros(0, np.int64), *counts])


class _Part:
    def __init__(self, folder: Path) -> None:
        self._arrays: dict[str, np.ndarray] = {}
        for title in _ARRAYS:
            path = folder / f"{title}.npy"
            try:
                values = np.load(path, mmap_mode="r", allow_pickle=False)
            except (OSError, ValueError) as error:
                raise TrainingError(
                    f"{path}: is missing or damaged; expected the part as it was "
                    "written, or none of it."
                ) from error
            self._arrays[title] = np.asarray(values)
        self.scenes = self._arrays["scenes"]

    def _rows(self, axis: str, index: int) -> np.ndarray:
        first, end = self.scenes[axis][index : index + 2]
        return self._arrays[_TABLES.get(axis, "candidates")][first:end]

    def scene(self, index: int) -> PackedScene:
        rows = {axis: self._rows(axis, index) for axis in _TABLES}
        num_candidates = rows["agent"]["num_candidates"]
        has_candidate = np.arange(NUM_CANDIDATES) < num_candidates[:, None]
        candidates = np.zeros((*has_candidate.shape, LATENT_SIZE), np.float32)
        candidates[has_candidate] = self._rows("candidate", index)
        return PackedScene(
            **{
                one.name: one.in_memory(rows[one.axis][one.column])
                for one in SCENE_FIELDS
            },
            candidates=candidates,
            has_candidate=has_candidate,
        )


def _tables(
    scenes: Sequence[PackedScene], groups: Sequence[str], root: int
) -> tuple[np.ndarray, ...]:
    """Arrays of scenes, lane pieces, boundary pieces, agents and candidates."""
    numbers = {
        "piece": [len(one.piece_pose) for one in scenes],
        "boundary": [len(one.boundary_pose) for one in scenes],
        "agent": [len(one.agent_pose) for one in scenes],
        "candidate": [int(one.has_candidate.sum()) for one in scenes],
    }
    table = np.zeros(len(scenes) + 1, _SCENE)
    for name, count in numbers.items():
        table[name][1:] = np.cumsum(count)
    table["root"] = root
    table["group"][:-1] = groups
    rows = {axis: np.zeros(sum(numbers[axis]), _columns(axis)) for axis in _TABLES}
    latents = np.zeros((sum(numbers["candidate"]), LATENT_SIZE), np.float16)
    if scenes:
        for one in SCENE_FIELDS:
            values = np.concatenate([getattr(scene, one.name) for scene in scenes])
            rows[one.axis][one.column] = _storable(values, one.stored)
        found = [scene.has_candidate.sum(1) for scene in scenes]
        rows["agent"]["num_candidates"] = np.concatenate(found)
        found = [scene.candidates[scene.has_candidate] for scene in scenes]
        latents[:] = _storable(np.concatenate(found), np.float16)
    return table, *rows.values(), latents


def _columns(axis: str) -> np.dtype:
    columns = [
        (one.column, one.stored, one.shape) for one in SCENE_FIELDS if one.axis == axis
    ]
    return np.dtype(columns + [("num_candidates", np.int8)] * (axis == "agent"))


def _storable(values: np.ndarray, kind: DTypeLike) -> np.ndarray:
    if kind == np.float16:
        values = np.clip(values, -_MOST_HALF, _MOST_HALF)
    return values.astype(kind)


def _part_names(folder: Path) -> list[str]:
    return sorted(
        entry.name for entry in folder.iterdir() if entry.name.startswith(_PART_PREFIX)
    )


def _read_index(folder: Path) -> StoreIndex:
    path = folder / _INDEX_NAME
    try:
        values = json.loads(path.read_text())
        index = StoreIndex(
            fingerprint=str(values["fingerprint"]),
            roots=tuple(map(str, values["roots"])),
            settings=str(values["settings"]),
            version=int(values["version"]),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise TrainingError(
            f"{folder}: is no feature store; expected a folder with {_INDEX_NAME}."
        ) from error
    if index.version != FORMAT_VERSION:
        raise TrainingError(
            f"{folder}: holds features of format {index.version}; expected "
            f"{FORMAT_VERSION}, so prepare them again."
        )
    return index
