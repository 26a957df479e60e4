"""The library: kept scenarios, each a folder with its files, recipe, card and picture."""

import contextlib
import fnmatch
import json
import logging
import math
import os
import secrets
import shutil
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from filelock import FileLock, Timeout

from pd_editor.analysis.findings.scorecard import ROWS, scorecard
from pd_editor.base.errors import (
    ExportError,
    FolderInUseError,
    InputError,
    PdEditorError,
)
from pd_editor.base.plain_text import nearest_or_all, one_line
from pd_editor.base.regular_file import json_value, read_regular, unwritable
from pd_editor.editor.commands.json_values import from_json, to_json
from pd_editor.editor.library.index_table import (
    INDEX_NAME,
    IndexRow,
    index_csv,
    index_row,
)
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.recipe import MAX_RECIPE_BYTES, Recipe, checked_base, replay
from pd_editor.editor.scenario_store import (
    exported_files,
    has_same_content,
    open_base,
    open_scenario,
    recipe_of_export,
)
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import ExportMark, Variant, fit_name, free_name
from pd_editor.editor.varied_numbers import varied_values
from pd_editor.scene.bundle import (
    RECIPE_NAME,
    replace_folder,
    write_files,
    zip_folders,
)
from pd_editor.scene.formats.argoverse2 import ARGOVERSE2
from pd_editor.scene.scenario import Scenario

LIBRARY_NAME: Final = "library"
"""Folder of a library among the editor's own files."""
CARD_NAME: Final = "card.json"
THUMBNAIL_NAME: Final = "thumbnail.svg"
"""With the card, the files of a folder that are not part of the scenario."""
KEPT_S: Final = 86_400.0
"""Time for which a removed scenario can be put back."""
PATIENCE_S: Final = 30.0
"""Time for which a writer waits for another one."""
_MAX_CARD_BYTES: Final = 1 << 20
_LOCK_NAME: Final = ".lock"
_REMOVED: Final = ".removed"
_logger: Final = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class LibraryCard:
    """What lists tell of a scenario; tags, note and name are copies of its recipe's."""

    row: IndexRow
    saved_at: float = field(default_factory=time.time)
    """Time at which it was kept, in seconds since 1970."""
    author: str = ""
    format: str = ""
    """Title of the format of the files that it comes from."""
    attribution: str = ""
    """Who made these, and under which licence; empty: they do not tell."""
    num_agents: int = 0
    metrics: Mapping[str, float] = field(default_factory=dict)
    """Values of its scorecard by name, once ``Library.measure`` has computed them."""

    @property
    def name(self) -> str:
        """Id of the scenario, and name of its folder."""
        return self.row.scenario_id

    @cached_property
    def text(self) -> str:
        """All words by which it is found, in small letters."""
        row = self.row
        told = (self.name, row.base_id, row.city, *row.edits, *row.problems, *row.tags)
        more = row.note, row.lineage, self.author, self.format
        return "\n".join((*told, *more)).lower()

    @property
    def facts(self) -> dict[str, float | str]:
        """What queries ask of it besides what happens in it."""
        row = self.row
        return {
            **self.metrics,
            **row.values,
            "name": self.name,
            "base": row.base_id,
            "parent": row.parent,
            "author": self.author,
            "problems": row.num_problems,
        }

    def has(self, words: Collection[str]) -> bool:
        """Whether each of some words is in its texts."""
        return all(one.lower() in self.text for one in words)


SORTS: Final[Mapping[str, Callable[[LibraryCard], Any]]] = {
    "date": lambda card: -card.saved_at,
    "name": lambda card: card.name.lower(),
    "base": lambda card: card.row.base_id.lower(),
    "city": lambda card: card.row.city.lower(),
    "problems": lambda card: -card.row.num_problems,
    "agents": lambda card: -card.num_agents,
    **{
        name: lambda card, name=name: -card.metrics.get(name, -math.inf)
        for name in ROWS
    },
}
"""Orders of lists; numbers and dates begin with the greatest, unmeasured ones are last."""


def card_of(
    scenario: Scenario, base: Scenario, recipe: Recipe, author: str = ""
) -> LibraryCard:
    """Card of a scenario that a recipe makes from ``base``."""
    origin = base.provenance
    return LibraryCard(
        row=index_row(scenario, base, recipe),
        author=author,
        format=origin.file_format or ARGOVERSE2.title,
        attribution=origin.attribution or "",
        num_agents=len(scenario.agents),
    )


class Library:
    """A folder with one folder per kept scenario; a name is never taken twice.

    Tabs and processes may share it: folders are replaced as a whole, by one writer at a
    time. ``root`` is the folder.
    """

    def __init__(self, root: Path) -> None:
        """Use a folder, which is created when needed."""
        self.root = root
        self._reading = threading.Lock()
        self._known: dict[str, tuple[tuple[int, ...], LibraryCard | None]] = {}
        """Cards that were read, with what tells whether their files are still the same."""
        self._listed: tuple[int, list[LibraryCard]] | None = None
        self.unread: tuple[str, ...] = ()
        """Folders without a card that can be read, when cards were looked at last."""
        self._forget_removed()

    def has(self, name: str) -> bool:
        """Whether the name is taken."""
        return os.path.exists(self.root / name)

    def scenes(self) -> list[Path]:
        """Folders of all scenarios."""
        return [self.root / name for name in sorted(one.name for one in self.cards())]

    def folders(self) -> list[str]:
        """Names of all folders in it, whatever they hold.

        Raises:
            InputError: the library cannot be read.
        """
        try:
            with os.scandir(self.root) as found:
                return sorted(
                    one.name for one in found if one.name[0] != "." and one.is_dir()
                )
        except OSError as error:
            raise InputError(
                f"{self.root}: is no library that can be read ({error.strerror})."
            ) from error

    def is_other(self) -> bool:
        """Whether the folder holds something, but is no library and never was one."""
        names = set(os.listdir(self.root))
        return bool(names) and _LOCK_NAME not in names and not self.cards()

    def card(self, name: str) -> LibraryCard | None:
        """Card of a scenario; None if it is not in the library, or cannot be read."""
        try:
            # Not a Path, which would take as long as the system's answer.
            status = os.stat(f"{self.root}/{name}/{CARD_NAME}")
            stamp = status.st_mtime_ns, status.st_ino, status.st_size
        except (OSError, ValueError):
            self._known.pop(name, None)
            return None
        known = self._known.get(name)
        if known is None or known[0] != stamp:
            try:
                card = self._read_card(name)
            except PdEditorError as error:
                _logger.warning("%s in the library cannot be read: %s", name, error)
                card = None
            known = self._known[name] = stamp, card
        return known[1]

    def marked(self, mark: ExportMark) -> LibraryCard | None:
        """Card of what was saved then, which may have been put back under another name."""
        if mark.saved_at is None:
            return None
        named = self.card(mark.name)
        if named is not None and named.saved_at == mark.saved_at:
            return named
        return next(
            (one for one in self.cards() if one.saved_at == mark.saved_at), None
        )

    def thumbnail(self, name: str) -> str:
        """Small picture of a scenario as SVG; empty without one."""
        path = self.root / name / THUMBNAIL_NAME
        try:
            return read_regular(path, max_bytes=_MAX_CARD_BYTES).decode()
        except (InputError, ValueError):
            return ""

    def stamp(self) -> int:
        """A number that changes when another tab or process changes the library."""
        try:
            return self.root.stat().st_mtime_ns
        except OSError:
            return 0

    def cards(self) -> list[LibraryCard]:
        """Cards of all scenarios, the oldest first; read once while nothing changes."""
        # Looked at first: a change in between then counts as one that follows.
        now, stamp = time.time_ns(), self.stamp()
        with self._reading:
            if self._listed is not None and self._listed[0] == stamp:
                return list(self._listed[1])
            names: list[str] = []
            with contextlib.suppress(InputError):
                names = self.folders()
            cards = {one: self.card(one) for one in names}
            self.unread = tuple(one for one, card in cards.items() if card is None)
            found = [card for card in cards.values() if card is not None]
            found.sort(key=lambda card: (card.saved_at, card.name))
            # Age at which the time of a folder tells all changes: clocks of disks tick.
            self._listed = (stamp, found) if now - stamp > 100_000_000 else None
            return list(found)

    def named(self, patterns: Collection[str]) -> tuple[str, ...]:
        """Names of scenarios that fit names or patterns such as ``cut-in-*``.

        Raises:
            InputError: one fits nothing.
        """
        names = [card.name for card in self.cards()]
        found: list[str] = []
        for pattern in patterns:
            fitting = fnmatch.filter(names, pattern)
            if not fitting:
                hint = nearest_or_all(pattern, names) if names else "it is empty"
                raise InputError(
                    f"{self.root}: holds no scenario {one_line(pattern, 60)!r};"
                    f" {one_line(hint, 200)}."
                )
            found += fitting
        return tuple(dict.fromkeys(found))

    def add(
        self,
        card: LibraryCard,
        files: Mapping[str, bytes],
        picture: str = "",
        *,
        replaces: str | None = None,
    ) -> None:
        """Add an exported scenario, in place of the one named ``replaces`` if any.

        Raises:
            FolderInUseError: the name is taken.
            ExportError: the files cannot be written.
        """
        beside = {CARD_NAME: card_content(card), THUMBNAIL_NAME: picture.encode()}
        with self._writing():
            write_files(
                {**files, **beside},
                self.root / card.name,
                forbidden=None,
                overwrite=card.name == replaces,
            )
            if replaces not in (None, card.name):
                shutil.rmtree(self._set_aside(replaces), ignore_errors=True)

    def describe(
        self, names: Sequence[str], change: Callable[[Variant], Variant]
    ) -> int:
        """Change tags and notes; returns of how many scenarios.

        None is changed unless all can be; each changes in one step.

        Raises:
            ExportError: one cannot be written.
            PdEditorError: a description does not fit, or a recipe cannot be read.
        """
        with self._writing():
            changed: dict[str, Variant] = {}
            for name in names:
                before = self._recipe(name).variant
                after = replace(change(before), name=before.name)
                if after != before:
                    changed[name] = after
            for name, variant in changed.items():
                card, recipe = self._read_card(name), self._recipe(name)
                row = replace(card.row, tags=variant.tags, note=variant.note)
                content = replace(recipe, variant=variant).to_text().encode()
                self._tell(replace(card, row=row), {RECIPE_NAME: content})
        return len(changed)

    def measure(self, name: str) -> None:
        """Compute the scorecard of a scenario, and keep its values in the card.

        Raises:
            ExportError: the card cannot be written.
            InputError: the scenario cannot be read, or was changed meanwhile.
        """
        before = self._read_card(name)
        rows = scorecard(open_scenario(self.root / name))
        values = {one.name: one.value for one in rows if not math.isnan(one.value)}
        with self._writing():
            card = self._read_card(name)
            if card.saved_at != before.saved_at:
                raise InputError(f"{name}: was saved anew meanwhile; measure it again.")
            self._tell(replace(card, metrics=values))

    def remove(self, name: str) -> None:
        """Remove a scenario atomically; ``put_back`` restores it for a day.

        Raises:
            ExportError: the folder cannot be removed.
        """
        self._forget_removed()
        if self.card(name) is not None:
            with self._writing():
                self._set_aside(name)

    def put_back(self, name: str) -> str:
        """Restore the scenario that was removed last under a name; returns its name by now.

        Where another one has that name, it gets a number.

        Raises:
            ExportError: it is gone, or cannot be moved.
            PdEditorError: it needs another name, and cannot be read.
        """
        found = [one for one in self._removed() if one.name.startswith(f".{name}.")]
        if not found:
            raise ExportError(f"{name}: was removed for good.")
        aside = max(found, key=_moment)
        with self._writing():
            if not self.has(name):
                try:
                    aside.rename(self.root / name)
                except OSError as error:
                    raise ExportError(
                        f"{self.root / name}: cannot be put back ({error.strerror})."
                    ) from error
                return name
        # Its name is in its files, too.
        free = free_name(name, self.has)
        recipe, card = self._recipe(aside.name), self._read_card(aside.name, name)
        recipe = replace(recipe, variant=replace(recipe.variant, name=free))
        card = replace(card, row=replace(card.row, scenario_id=free))
        files = exported_files(open_scenario(aside), recipe)
        self.add(card, files, self.thumbnail(aside.name))
        shutil.rmtree(aside, ignore_errors=True)
        return free

    def files(self, name: str, format_name: str = ARGOVERSE2.name) -> dict[str, bytes]:
        """Files of a scenario in some format, with its recipe.

        Raises:
            InputError: they cannot be read.
            ExportError: the format cannot say it.
        """
        if format_name == ARGOVERSE2.name:
            return {
                one: read_regular(path, max_bytes=MAX_RECIPE_BYTES)
                for one, path in self._paths(name).items()
                if one not in (CARD_NAME, THUMBNAIL_NAME)
            }
        scenario = open_scenario(self.root / name)
        return exported_files(scenario, self._recipe(name), format_name=format_name)

    def holds(self, name: str, files: Mapping[str, bytes]) -> bool:
        """Whether a scenario of these files is there, whatever is said of it."""
        try:
            there = self.files(name)
        except InputError:
            return False
        return {**there, RECIPE_NAME: b""} == {**files, RECIPE_NAME: b""}

    def zipped(
        self, names: Collection[str], format_name: str = ARGOVERSE2.name
    ) -> bytes:
        """Pack scenarios in some format, and a table of them, into one zip.

        Raises:
            InputError: none of them is in the library, or one cannot be read.
            ExportError: the format cannot say one.
        """
        there = [one.name for one in self.cards() if one.name in names]
        if not there:
            raise InputError("The library holds none of these; save a scenario first.")
        folders = {one: self.files(one, format_name) for one in there}
        return zip_folders(folders, {INDEX_NAME: self.table(there)})

    def facts(self) -> dict[str, dict[str, float | str]]:
        """What queries ask of each scenario besides what happens in it."""
        return {one.name: one.facts for one in self.cards()}

    def table(self, names: Collection[str]) -> bytes:
        """CSV table of some scenarios, the oldest first."""
        cards = [one for one in self.cards() if one.name in names]
        metrics = {one.name: one.metrics for one in cards}
        return index_csv([one.row for one in cards], metrics)

    def check(self, name: str) -> None:
        """Raise unless a folder holds what its card and its recipe say.

        The recipe is replayed if its base is at hand.

        Raises:
            InputError: it is broken, or not of a library.
            RecipeError: its card or recipe cannot be read.
        """
        place = self.root / name
        if not os.path.exists(place / CARD_NAME):
            raise InputError(
                f"holds no {CARD_NAME}; 'pd-editor library add' takes in scenes of other"
                " folders."
            )
        card, recipe = self._read_card(name), self._recipe(name)
        scenario, row, about = open_scenario(place), card.row, recipe.variant
        if (recipe.result_id, scenario.scenario_id) != (name, name):
            raise InputError(f"its files are of {one_line(scenario.scenario_id, 80)}.")
        told = row.tags, row.note, row.edits, row.base_id, row.values, card.num_agents
        if told != (
            about.tags,
            about.note,
            tuple(command.label for command in recipe.commands),
            recipe.base.root.scenario_id,
            varied_values(recipe),
            len(scenario.agents),
        ):
            raise InputError(f"its {CARD_NAME} tells other things than its files.")
        try:
            base = checked_base(recipe.base, open_base(recipe.base))
        except PdEditorError:
            return
        if not has_same_content(replay(recipe, base), scenario):
            raise InputError("its recipe makes another scenario than its files hold.")

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Hold the lock of who changes the library; the system releases that of the dead."""
        lock = FileLock(self.root / _LOCK_NAME, timeout=PATIENCE_S)
        try:
            self.root.mkdir(parents=True, exist_ok=True)
            lock.acquire()
        except Timeout as error:
            raise ExportError(
                f"{self.root}: another program has been writing to it for"
                f" {PATIENCE_S:g} s; try again."
            ) from error
        except OSError as error:
            raise unwritable(self.root, error) from error
        try:
            yield
        finally:
            lock.release()

    def _read_card(self, name: str, named: str = "") -> LibraryCard:
        """Read the card in a folder, which has the folder's name unless it is ``named``.

        Raises:
            InputError: it cannot be read, or is that of another folder.
            RecipeError: it is none.
        """
        path = Path(f"{self.root}/{name}/{CARD_NAME}")
        try:
            content = json_value(read_regular(path, max_bytes=_MAX_CARD_BYTES))
        except ValueError as error:
            raise InputError(f"{path}: is no JSON.") from error
        card = from_json(LibraryCard, content, f"{path}: The card")
        if card.name != (named or name):
            raise InputError(
                f"{path}: is the card of {one_line(card.name, 80)}; give the folder that"
                " name, or move it out and take it in by 'pd-editor library add'."
            )
        return card

    def _tell(
        self, card: LibraryCard, changed: Mapping[str, bytes] | None = None
    ) -> None:
        """Replace a card, and files beside it, in one step."""
        files = {**self._paths(card.name), **(changed or {})}
        files[CARD_NAME] = card_content(card)
        replace_folder(files, self.root / card.name)

    def _recipe(self, name: str) -> Recipe:
        path = self.root / name / RECIPE_NAME
        return Recipe.from_text(read_regular(path, max_bytes=MAX_RECIPE_BYTES))

    def _paths(self, name: str) -> dict[str, Path]:
        try:
            return {one.name: one for one in sorted((self.root / name).iterdir())}
        except OSError as error:
            raise InputError(f"{name}: cannot be read ({error.strerror}).") from error

    def _set_aside(self, name: str) -> Path:
        """Move a folder to a hidden one, whose time is the moment of removal."""
        gone = self.root / f".{name}.{secrets.token_hex(4)}{_REMOVED}"
        try:
            os.utime(self.root / name)
            (self.root / name).rename(gone)
        except OSError as error:
            raise ExportError(
                f"{self.root / name}: cannot be removed ({error.strerror})."
            ) from error
        return gone

    def _removed(self) -> list[Path]:
        return list(self.root.glob(f".*{_REMOVED}"))

    def _forget_removed(self) -> None:
        """Delete what was removed, or left behind by a kill, more than a day ago."""
        for folder in (*self._removed(), *self.root.glob(".*.new")):
            if time.time() - _moment(folder) > KEPT_S:
                shutil.rmtree(folder, ignore_errors=True)


def card_content(card: LibraryCard) -> bytes:
    """File of a card."""
    return json.dumps(to_json(card), indent=1).encode()


def _moment(folder: Path) -> float:
    """Time of a folder; that of one that is just being deleted is long ago."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return 0.0


def take_in(
    library: Library,
    session: EditorSession,
    reference: str = "",
    *,
    made_by_recipe: Recipe | None = None,
    tags: Sequence[str] = (),
    note: str = "",
    author: str = "",
) -> str:
    """Take what a session shows into a library; returns its name, or none if it is there.

    An export that was opened by a ``reference``, or with the recipe it was
    ``made_by_recipe``, keeps its recipe, whether or not its base is at hand. A name that
    is taken gets a number.

    Raises:
        ExportError: the files cannot be written.
    """
    scenario, base = session.scenario, session.base
    judge: Scenario | None = base
    recipe = replace(session.recipe(), created_at="")
    own = made_by_recipe
    if reference and not session.entries:
        own = recipe_of_export(Path(reference))
    if own is not None and own.result_id == scenario.scenario_id:
        recipe, judge = own, None
    about = recipe.variant.tagged(tuple(tags), (), recipe.variant.note or note)
    wanted, tried = fit_name(recipe.result_id), set[str]()
    while True:
        name = free_name(wanted, tried.__contains__)
        recipe = replace(recipe, variant=replace(about, name=name))
        files = exported_files(scenario, recipe, judge)
        if library.holds(name, files):
            return ""
        try:
            card = card_of(scenario, base, recipe, author)
            library.add(card, files, thumbnail(scenario))
        except FolderInUseError:
            tried.add(name)
        else:
            return name
