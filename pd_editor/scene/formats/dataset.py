"""Index of a folder tree of scenes, read lazily: Argoverse 2 folders, other formats' files.

Files are read on demand only, and calls are safe from any thread.
"""

import logging
import os
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import RLock
from typing import Final

from pd_editor.base.errors import InputError, LargeSceneError
from pd_editor.base.foreign_code import described
from pd_editor.base.plain_text import is_plain
from pd_editor.base.regular_file import check_path
from pd_editor.scene.av2_io.file_names import (
    TRACKS_PREFIX,
    is_map_name,
    is_scenario_id,
    is_tracks_name,
)
from pd_editor.scene.av2_io.track_table import open_track_table
from pd_editor.scene.av2_io.tracks_file import current_step_of
from pd_editor.scene.formats.registry import (
    foreign_scenes_among,
    is_foreign_scene,
    name_of_scene,
    read_scene,
)

MAX_DEPTH: Final = 4
"""Levels of folders below the root that are searched."""
_LOG: Final = logging.getLogger(__name__)
_CARD_COLUMNS: Final = (
    "track_id",
    "city",
    "timestep",
    "num_timestamps",
    "observed",
    "current_step",
    "start_timestamp",
    "end_timestamp",
)


@dataclass(frozen=True, kw_only=True)
class ScenarioCard:
    """Summary of a scenario for lists."""

    scenario_id: str
    """Its id, or the name of the file or folder of another format."""
    folder: Path
    """Its folder, or that file or folder."""
    city: str
    num_agents: int
    split: str = ""
    """Folder below the root that holds the scenario's folder; empty for the root."""
    has_future: bool = True
    """Whether there are states after the current step."""


@dataclass(frozen=True, kw_only=True)
class CardFilter:
    """Conditions on scenarios; None and the empty text accept all."""

    city: str | None = None
    min_agents: int | None = None
    max_agents: int | None = None
    split: str | None = None
    with_future: bool = False
    """Whether scenarios without a logged future are left out."""
    among: Collection[Path] | None = None
    """Folders of which it is one."""
    words: tuple[str, ...] = ()
    """Parts of its id, city and split, in small letters; one of ``among`` needs none."""
    without: Collection[Path] = ()
    """Folders of which it is none."""

    def accepts_place(self, folder: Path) -> bool:
        """Whether a folder passes the filter; reads no file."""
        is_asked = self.among is None or bool(self.words) or folder in self.among
        return is_asked and folder not in self.without

    def accepts(self, card: ScenarioCard) -> bool:
        """Whether a scenario passes the filter."""
        return (
            self.accepts_place(card.folder)
            and (self._has_words(card) or card.folder in (self.among or ()))
            and (not self.city or self.city == card.city)
            and (self.split is None or self.split == card.split)
            and (card.has_future or not self.with_future)
            and (self.min_agents is None or card.num_agents >= self.min_agents)
            and (self.max_agents is None or card.num_agents <= self.max_agents)
        )

    def _has_words(self, card: ScenarioCard) -> bool:
        text = f"{card.scenario_id} {card.city} {card.split}".lower()
        return all(one in text for one in self.words)


EVERY: Final = CardFilter()


@dataclass(frozen=True, kw_only=True)
class SearchStep:
    """Result of one step of a search."""

    cards: tuple[ScenarioCard, ...]
    next_start: int
    """Index of the folder at which the next step starts."""
    is_complete: bool
    """Whether the whole dataset was searched."""


@dataclass(frozen=True, kw_only=True)
class _Found:
    scenario_id: str
    folder: Path
    is_foreign: bool = False


class DatasetIndex:
    """The scenarios below a root, in the order of their folders' names."""

    def __init__(self, root: Path) -> None:
        """Open a dataset without listing it.

        Raises:
            InputError: there is no such folder.
        """
        check_path(root)
        self.root = Path(root)
        if not os.path.isdir(self.root):
            raise InputError(f"{root}: there is no such dataset folder.")
        self.is_complete = False
        """Whether all folders were listed."""
        self._walk = _scenario_folders(self.root, 0)
        self._found: list[_Found] = []
        self._position_of: dict[Path, int] = {}
        self._cards: dict[int, ScenarioCard | str] = {}
        """What was read of scenes, or why one could not be."""
        self._num_incomplete = 0
        self._lock = RLock()

    @property
    def num_found(self) -> int:
        """Number of scenario folders listed so far."""
        return len(self._found)

    @property
    def num_skipped(self) -> int:
        """Number of folders that lack a file and of unreadable scenarios so far."""
        with self._lock:
            return self._num_incomplete + len(self.failures())

    def failures(self) -> tuple[str, ...]:
        """Why scenes could not be read so far, in the order of the dataset."""
        with self._lock:
            found = [self._cards[position] for position in sorted(self._cards)]
        return tuple(one for one in found if isinstance(one, str))

    def folders(self) -> tuple[Path, ...]:
        """Folders of the Argoverse 2 scenarios listed so far."""
        with self._lock:
            return tuple(one.folder for one in self._found if not one.is_foreign)

    def scenes(self) -> tuple[Path, ...]:
        """Places of all scenes, also of those that were not listed yet."""
        self.scan()
        with self._lock:
            return tuple(one.folder for one in self._found)

    def cities(self) -> tuple[str, ...]:
        """Cities of the scenarios read so far, sorted."""
        return tuple(sorted({card.city for card in self._read_so_far()}))

    def splits(self) -> tuple[str, ...]:
        """Splits of the scenarios read so far, sorted."""
        return tuple(sorted({card.split for card in self._read_so_far()}))

    def _read_so_far(self) -> list[ScenarioCard]:
        with self._lock:
            cards = list(self._cards.values())
        return [card for card in cards if isinstance(card, ScenarioCard)]

    def scan(self, limit: int | None = None) -> int:
        """List up to ``limit`` more scenario folders; 0 when there are no more."""
        num_new = 0
        while limit is None or num_new < limit:
            with self._lock:
                entry = next(self._walk, None)
                if entry is None:
                    self.is_complete = True
                    break
                if isinstance(entry, Path):
                    self._num_incomplete += 1
                    continue
                self._position_of[entry.folder] = len(self._found)
                self._found.append(entry)
            num_new += 1
        return num_new

    def search(
        self, wanted: CardFilter, start: int = 0, max_folders: int = 100
    ) -> SearchStep:
        """Search the next ``max_folders`` folders for accepted scenarios."""
        missing = start + max_folders - self.num_found
        if missing > 0:
            self.scan(missing)
        end = min(start + max_folders, self.num_found)
        cards = [
            card
            for position in range(start, end)
            if (card := self._card(position, wanted)) is not None
        ]
        is_complete = self.is_complete and end == self.num_found
        return SearchStep(cards=tuple(cards), next_start=end, is_complete=is_complete)

    def filter(self, wanted: CardFilter = EVERY) -> Iterator[ScenarioCard]:
        """Yield accepted scenarios as they are found."""
        position = 0
        while self._has(position):
            card = self._card(position, wanted)
            if card is not None:
                yield card
            position += 1

    def after(self, folder: Path, wanted: CardFilter = EVERY) -> ScenarioCard | None:
        """Next accepted scenario after the one in a folder; None at the end.

        Raises:
            InputError: the folder is not in the dataset.
        """
        position = self._position(folder) + 1
        while self._has(position):
            card = self._card(position, wanted)
            if card is not None:
                return card
            position += 1
        return None

    def before(self, folder: Path, wanted: CardFilter = EVERY) -> ScenarioCard | None:
        """Last accepted scenario before the one in a folder; None at the start.

        Raises:
            InputError: the folder is not in the dataset.
        """
        for position in reversed(range(self._position(folder))):
            card = self._card(position, wanted)
            if card is not None:
                return card
        return None

    def _has(self, position: int) -> bool:
        """Whether there is a scene at a position, which another thread may list meanwhile."""
        return (
            position < self.num_found or self.scan(1) > 0 or position < self.num_found
        )

    def _position(self, folder: Path) -> int:
        while folder not in self._position_of:
            if not self.scan(1000):
                raise InputError(f"{folder}: is no scenario folder of {self.root}.")
        return self._position_of[folder]

    def _card(self, position: int, wanted: CardFilter) -> ScenarioCard | None:
        """Scenario at a position if it is accepted and readable, else None."""
        found = self._found[position]
        if not wanted.accepts_place(found.folder):
            return None
        if position not in self._cards:
            card = self._read(found)
            with self._lock:
                self._cards[position] = card
        card = self._cards[position]
        return card if isinstance(card, ScenarioCard) and wanted.accepts(card) else None

    def _read(self, found: _Found) -> ScenarioCard | str:
        """A scene's card, or why it cannot be read: it must not stop those after it."""
        place = str(found.folder)
        try:
            return _read_card(found, self.root)
        except InputError as error:
            reason = str(error)
        except Exception as error:  # noqa: BLE001  (told as the bug that it is)
            _LOG.exception("%s: a bug in the editor", place)
            reason = f"cannot be read ({described(error)})."
        reason = reason if place in reason else f"{place}: {reason}"
        return reason.replace(f"{self.root}{os.sep}", "")


def no_scenario(roots: Iterable[Path]) -> InputError:
    """The error of roots without a scenario."""
    return InputError(
        f"{' '.join(map(str, roots))}: no Argoverse 2 scenario there; expected folders "
        "with scenario_<id>.parquet and log_map_archive_<id>.json, or files of other "
        "formats."
    )


def _scenario_folders(folder: Path, depth: int) -> Iterator[_Found | Path]:
    """Yield scenario folders below a folder; plain paths where a file is missing."""
    try:
        with os.scandir(folder) as entries:
            listed = [
                (entry.name, entry.is_dir())
                for entry in entries
                if is_plain(entry.name)
            ]
    except OSError:
        yield folder
        return
    files = [name for name, is_folder in listed if not is_folder]
    # Hidden folders are exports that are being written.
    folders = sorted(
        name for name, is_folder in listed if is_folder and not name.startswith(".")
    )
    tracks = [name for name in files if is_tracks_name(name)]
    if tracks:
        scenario_id = tracks[0].removeprefix(TRACKS_PREFIX).removesuffix(".parquet")
        has_map = any(is_map_name(name) for name in files)
        is_whole = len(tracks) == 1 and has_map and is_scenario_id(scenario_id)
        yield _Found(scenario_id=scenario_id, folder=folder) if is_whole else folder
        return
    is_scene = is_foreign_scene(folder)
    inside = [folder / name for name in files]
    scenes = [folder] if is_scene else foreign_scenes_among(inside)
    for path in scenes:
        name = name_of_scene(path)
        yield _Found(scenario_id=name, folder=path, is_foreign=True)
    if is_scene or (scenes and (depth == MAX_DEPTH or not folders)):
        return
    if depth == MAX_DEPTH or not folders:
        # What else holds files, such as records beside scenes, is no broken scenario.
        if not files or any(map(is_map_name, files)):
            yield folder
    else:
        for name in folders:
            yield from _scenario_folders(folder / name, depth + 1)


def _read_card(found: _Found, root: Path) -> ScenarioCard:
    """Read what a list shows of a scene; raises InputError if that is not possible."""
    if found.is_foreign:
        try:
            scene = read_scene(found.folder)
        except LargeSceneError as error:
            # A part of it can be opened.
            city, num_agents = error.scene.city, len(error.scene.tracks)
            has_future = num_agents > 0
        else:
            city, num_agents = scene.city, len(scene.agents)
            has_future = scene.last_step > scene.current_step
    else:
        name = f"{TRACKS_PREFIX}{found.scenario_id}.parquet"
        table = open_track_table(found.folder / name, name, _CARD_COLUMNS)
        city, num_agents = table.one_text("city"), len(table.texts("track_id")[1])
        step = table.integers("timestep")
        num_steps = int(table.one_number("num_timestamps"))
        has_future = bool((step > current_step_of(table, step, num_steps)).any())
    return ScenarioCard(
        scenario_id=found.scenario_id,
        folder=found.folder,
        city=city,
        num_agents=num_agents,
        split=_split_of(found.folder, root),
        has_future=has_future,
    )


def _split_of(folder: Path, root: Path) -> str:
    """The folders between the root and a scenario's folder."""
    return "/".join(folder.relative_to(root).parts[:-1])
