"""``pd-editor index``: read what happens in many scenes into one file."""

import glob
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.base.errors import InputError
from pd_editor.base.plain_text import number_of, one_line
from pd_editor.base.regular_file import user_path
from pd_editor.cli.many_scenes import EngineOptions, all_scenes
from pd_editor.cli.options import several, shown, taking
from pd_editor.cli.output import work_shown
from pd_editor.experiments.scene_index.index_file import INDEX_NAME, IndexWriter
from pd_editor.experiments.work_engine.work_engine import WorkFailure


@dataclass(frozen=True, kw_only=True)
class Indexed:
    """What an indexing did."""

    file: Path
    num_scenes: int
    num_read: int
    failures: Mapping[str, WorkFailure] = field(default_factory=dict)

    def __str__(self) -> str:
        """The file, and what was read for it."""
        scenes = number_of(self.num_scenes, "scene")
        return f"{self.file}\n{scenes}, {self.num_read} of them read now."


@dataclass(frozen=True, kw_only=True)
class IndexOptions(EngineOptions):
    """Options of ``pd-editor index``.

    Args:
        root: Folders of scenes of any format that is read, scenes, or patterns.
        out: Parquet file of the index.
        workers: Scenes at a time, each in a process of its own.
    """

    root: Annotated[
        str | Path | tuple[str | Path, ...],
        tyro.conf.Positional,
        shown("ROOT [...]", "(required)"),
    ] = field(kw_only=False)
    out: Annotated[
        str | Path | None, shown("FILE", f"(default: ROOT/{INDEX_NAME})")
    ] = None


@taking(IndexOptions)
def index(options: IndexOptions) -> Indexed:
    """Read manoeuvres, interactions and facts of scenes into a file for pd-editor find.

    Only new and changed scenes are read again; an interrupted run goes on where it was.
    """
    roots = several(options.root)
    if not roots:
        raise InputError("Missing ROOT; see pd-editor index --help.")
    file, choice = _file(roots, options.out), options.choice
    writer = IndexWriter(file, all_scenes(roots, file))
    earlier = len(writer.done)
    with choice.engine() as runner:
        failures = writer.read_missing(runner, work_shown("scenes"))
    count = len(writer.done)
    return Indexed(
        file=file, num_scenes=count, num_read=count - earlier, failures=failures
    )


def _file(roots: tuple[str | Path, ...], out: str | Path | None) -> Path:
    if out is not None:
        file = user_path(str(out)).absolute()
        return file / INDEX_NAME if file.is_dir() else file
    first = user_path(str(roots[0])).absolute()
    if len(roots) == 1 and not first.exists() and not glob.has_magic(str(first)):
        raise InputError(f"{one_line(str(roots[0]))}: there is no such file or folder.")
    if len(roots) > 1 or not first.is_dir():
        raise InputError("--out FILE is needed unless ROOT is one folder.")
    return first / INDEX_NAME
