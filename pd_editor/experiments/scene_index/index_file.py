"""The file of an index: Parquet, a row a scene with its facts and the list of its events."""

import hashlib
import io
import operator
import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool, Int

from pd_editor.analysis.manoeuvres.events import EVENT_KINDS
from pd_editor.analysis.manoeuvres.scene_facts import FACTS, scene_content
from pd_editor.analysis.manoeuvres.tracks import LIMITS
from pd_editor.base.errors import InputError
from pd_editor.base.plain_text import listed, one_line
from pd_editor.base.regular_file import check_path, write_whole
from pd_editor.editor.library.library import CARD_NAME, THUMBNAIL_NAME
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.work_engine.work_engine import (
    WorkEngine,
    WorkFailure,
    WorkProgress,
    run_items,
)
from pd_editor.scene.bundle import RECIPE_NAME

INDEX_NAME: Final = "scenes.index.parquet"
_BESIDE: Final = frozenset({INDEX_NAME, RECIPE_NAME, CARD_NAME, THUMBNAIL_NAME})
"""Files of which a scene's content does not depend."""
_TEXTS: Final = ("kind", "agent_id", "agent_kind", "other_id", "other_kind")
_EVENT: Final = pa.struct(
    {
        **dict.fromkeys(_TEXTS, pa.string()),
        **dict.fromkeys(("begin_s", "end_s", "value"), pa.float64()),
    }
)
SCHEMA: Final = pa.schema(
    {
        **dict.fromkeys(("path", "stamp", "scenario_id"), pa.string()),
        **{n: pa.float64() if t is float else pa.string() for n, t in FACTS.items()},
        "events": pa.list_(_EVENT),
    }
)
"""``path`` is relative to the folder of the index for scenes in it; ``stamp`` tells whether
a scene's files are those that were read."""
RULES: Final = repr((LIMITS, EVENT_KINDS, FACTS))
"""An index that was made by other rules is read anew."""
Row = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class SceneIndex:
    """An index in memory; a table of one row a scene."""

    folder: Path
    table: pa.Table

    @classmethod
    def read(cls, path: str | Path) -> "SceneIndex":
        """Read an index, or that of a folder.

        Raises:
            InputError: it is none, or cannot be read.
        """
        check_path(path)
        file = Path(os.path.abspath(os.path.expanduser(str(path))))
        file = file / INDEX_NAME if file.is_dir() else file
        if not file.exists() and file.name != INDEX_NAME:
            raise InputError(f"{path}: there is no such file or folder.")
        if not file.is_file():
            raise InputError(f"{path}: holds no index; pd-editor index makes one.")
        try:
            table = pq.read_table(file)
        except (OSError, ValueError, pa.ArrowException) as error:
            raise InputError(f"{path}: is no index that can be read.") from error
        if table.schema != SCHEMA:
            raise InputError(
                f"{path}: is no index of this version; pd-editor index makes it anew."
            )
        return cls(folder=file.parent, table=table)

    def beside(self, told: Mapping[str, Mapping[str, float | str]]) -> "SceneIndex":
        """With facts from elsewhere of scenes by the last part of their paths.

        Scenes that are not in the index get a row without content.
        """
        kinds = {name: type(one) for own in told.values() for name, one in own.items()}
        kinds = {name: one for name, one in kinds.items() if name not in SCHEMA.names}
        there = set(map(os.path.basename, self.table.column("path").to_pylist()))
        new = [one for one in told if one not in there]
        empty: dict[Any, Any] = {pa.string(): "", pa.float64(): None}
        rows = {one.name: [empty.get(one.type, [])] * len(new) for one in SCHEMA}
        more = pa.table({**rows, "path": new}, schema=SCHEMA)
        # Without new rows nothing is copied.
        table = pa.concat_tables([self.table, more]) if new else self.table
        names = map(os.path.basename, table.column("path").to_pylist())
        owns = [told.get(one, {}) for one in names]
        for name, kind in kinds.items():
            is_text = kind is str
            column = [one.get(name, "" if is_text else None) for one in owns]
            own = pa.array(column, pa.string() if is_text else pa.float64())
            table = table.append_column(name, own)
        return SceneIndex(folder=self.folder, table=table)

    def place_of(self, path: str) -> str:
        """A scene's path, as another command takes it."""
        return os.path.join(self.folder, path)


def index_place(root: Path, state: Path, *, may_write: bool = True) -> Path:
    """File of a folder's index: in it, or in the state if it is read only."""
    whole = os.path.abspath(root)
    file = Path(whole, INDEX_NAME)
    if file.exists() or (may_write and os.access(whole, os.W_OK)):
        return file
    return state / f"{hashlib.sha256(os.fsencode(whole)).hexdigest()[:32]}.{INDEX_NAME}"


def stamp_of(scene: str) -> str:
    """Sizes and times of a scene's files, with the rules by which they are read."""
    files = (
        sorted(os.scandir(scene), key=lambda one: one.name)
        if os.path.isdir(scene)
        else [Path(scene)]
    )
    told = [
        f"{one.name} {one.stat().st_size} {one.stat().st_mtime_ns}"
        for one in files
        if one.is_file() and one.name not in _BESIDE
    ]
    return hashlib.sha256("\n".join([RULES, *told]).encode()).hexdigest()[:32]


def row_of(scene: str) -> Row:
    """Read a scene and what happens in it; ``path`` is left to whoever writes.

    Raises:
        InputError: it cannot be read.
    """
    stamp = stamp_of(scene)
    opened = open_scenario(scene)
    kind_of = dict(zip(opened.agents.ids, map(str, opened.agents.kinds), strict=True))
    content = scene_content(opened)
    events = [
        {
            **asdict(one),
            "agent_kind": kind_of[one.agent_id],
            "other_kind": kind_of.get(one.other_id, ""),
        }
        for one in content.events
    ]
    told = {"stamp": stamp, "scenario_id": opened.scenario_id, "events": events}
    return {**told, **content.facts}


class IndexWriter:
    """Gathers rows, those of an earlier index that still hold among them."""

    def __init__(self, file: Path, scenes: Iterable[str]) -> None:
        """Read what is there; scenes whose files have changed are left to be read."""
        self.file = file
        self.path_of = {one: self._path(one) for one in scenes}
        self._row_of: dict[str, int] = {}
        self._new: list[Row] = []
        self._written = time.monotonic()
        self.is_broken = False
        """Whether there is a file that is no index of this version."""
        try:
            self._table = SceneIndex.read(file).table
        except InputError:
            self._table, self.is_broken = SCHEMA.empty_table(), file.exists()
        known = self._table.select(["path", "stamp"]).to_pylist()
        at = {one["path"]: row for row, one in enumerate(known)}
        for scene, path in self.path_of.items():
            row = at.get(path)
            if row is not None and known[row]["stamp"] == stamp_of(scene):
                self._row_of[scene] = row

    @property
    def done(self) -> tuple[str, ...]:
        """Scenes that need not be read."""
        return tuple(self._row_of)

    @property
    def num_missing(self) -> int:
        """Number of scenes that are not read yet."""
        return len(self.path_of) - len(self._row_of)

    def index(self) -> SceneIndex:
        """What has been gathered so far, in the order of the scenes."""
        if self._new:
            more = pa.Table.from_pylist(self._new, schema=SCHEMA)
            self._table, self._new = pa.concat_tables([self._table, more]), []
        rows = [self._row_of[one] for one in self.path_of if one in self._row_of]
        table = self._table.take(pa.array(rows, pa.int64()))
        return SceneIndex(folder=self.file.parent, table=table)

    def add(self, scene: str, row: Mapping[str, Any]) -> None:
        """Take the row of a scene; half a minute of work is never lost."""
        self._row_of[scene] = len(self._table) + len(self._new)
        self._new.append({**row, "path": self.path_of[scene]})
        if time.monotonic() - self._written > 30:
            self.write()

    def read_missing(
        self, engine: WorkEngine, on_progress: Callable[[WorkProgress], None]
    ) -> dict[str, WorkFailure]:
        """Read the scenes that are not read yet; what is read is kept however it ends.

        Raises:
            ExportError: the file cannot be written.
        """
        if not self.num_missing and len(self._row_of) == len(self._table):
            return {}
        # That it cannot be written is told before the work.
        self.write()
        try:
            return run_items(
                engine,
                row_of,
                {one: one for one in self.path_of},
                on_value=self.add,
                on_progress=on_progress,
                done=self.done,
            )
        finally:
            self.write()

    def write(self) -> None:
        """Replace the file in one step.

        Raises:
            ExportError: it cannot be written.
        """
        sink = io.BytesIO()
        pq.write_table(self.index().table, sink)
        write_whole(self.file, sink.getvalue())
        self._written = time.monotonic()

    def _path(self, scene: str) -> str:
        whole = os.path.abspath(os.path.expanduser(scene))
        near = os.path.relpath(whole, self.file.parent)
        return whole if near.startswith("..") else near


COMPARISONS: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class EventTable:
    """Columns of S scenes, and of their E events in one sequence."""

    table: pa.Table
    event: dict[str, pa.Array]
    scene: Int[np.ndarray, "E"]

    @classmethod
    def of(cls, table: pa.Table) -> "EventTable":
        """Columns of an index."""
        lists = table.column("events").combine_chunks()
        flat = lists.flatten()
        return cls(
            table=table,
            event={one.name: flat.field(one.name) for one in flat.type},
            scene=lists.value_parent_indices().to_numpy(),
        )

    @cached_property
    def facts(self) -> Mapping[str, type[float] | type[str]]:
        """Facts of scenes by name: those of every index, and those told beside it."""
        told = self.table.schema.names[len(SCHEMA) :]
        kinds = {one: self.table.schema.field(one).type for one in told}
        return {
            **FACTS,
            **{
                name: str if one == pa.string() else float
                for name, one in kinds.items()
            },
        }

    @property
    def is_read(self) -> Bool[np.ndarray, "S"]:
        """Scenes of which the content is known."""
        return np.asarray(self.table.column("stamp").to_numpy() != "", bool)

    def having(self, fact: str, sign: str, value: float | str) -> Bool[np.ndarray, "S"]:
        """Scenes with a fact that compares so."""
        column = self.table.column(fact)
        if isinstance(value, float):
            own = column.to_numpy()
            return np.asarray(COMPARISONS[sign](own, value), bool) & ~np.isnan(own)
        return _is_in(column.combine_chunks(), (str(value),)) == (sign == "=")

    def told_missing(self, fact: str, text: str) -> str:
        """Which texts of a fact there are, for a text that no scene has."""
        there = sorted(filter(None, self.table.column(fact).unique().to_pylist()))
        have = f"there are {listed(there, 10)}" if there else "none of them has one"
        return f"No scene has {fact} = {one_line(text, 60)}; {one_line(have)}."

    def events(
        self, kinds: tuple[str, ...], by: str, towards: str
    ) -> Bool[np.ndarray, "E"]:
        """Events of some kinds between kinds of agents; empty ones are any."""
        mask = _is_in(self.event["kind"], kinds)
        for column, kind in (("agent_kind", by), ("other_kind", towards)):
            mask &= _is_in(self.event[column], (kind,)) if kind else True
        return mask

    def valued(self, sign: str, number: float) -> Bool[np.ndarray, "E"]:
        """Events with a value that compares so."""
        value = self.event["value"].to_numpy(zero_copy_only=False)
        return np.asarray(COMPARISONS[sign](value, number)) & ~np.isnan(value)

    def with_any(self, events: Bool[np.ndarray, "E"]) -> Bool[np.ndarray, "S"]:
        """Scenes with any of some events."""
        return np.bincount(self.scene[events], minlength=len(self.table)) > 0


def _is_in(column: pa.Array, words: tuple[str, ...]) -> Bool[np.ndarray, "N"]:
    """Which texts are among some words, which are in small letters."""
    coded = column.dictionary_encode()
    texts = coded.dictionary.to_pylist()
    codes = [code for code, one in enumerate(texts) if (one or "").lower() in words]
    return np.isin(coded.indices.to_numpy(), codes)
