"""Writes files in memory as a zip, or as a new folder on disk."""

import contextlib
import ctypes
import io
import os
import re
import secrets
import shutil
import sys
import time
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Final

from pd_editor.base.errors import ExportError, FolderInUseError
from pd_editor.base.regular_file import unwritable

RECIPE_NAME: Final = "recipe.json"
"""Name of the recipe, which every export contains."""
LEFT_OVER_S: Final = 600.0
"""Hidden folders older than this were left behind by a killed process."""
_NEW: Final = ".new"
_OLD: Final = ".old"
_ZIP_TIME: Final = (1980, 1, 1, 0, 0, 0)
_FILE_MODE: Final = 0o644 << 16
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,199}")
_EXCHANGE: Final = 2
"""RENAME_EXCHANGE of Linux, and RENAME_SWAP of macOS."""
_AT_WORKING_FOLDER: Final = -100


def zip_folders(
    folders: Mapping[str, Mapping[str, bytes]],
    beside: Mapping[str, bytes] | None = None,
) -> bytes:
    """Pack folders and files beside them into a zip; equal files give equal bytes.

    Raises:
        ExportError: a name is not fit for a file.
    """
    beside = beside or {}
    _check_names([*folders, *beside])
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in beside.items():
            _add(archive, name, data)
        for folder, files in folders.items():
            _check_names(list(files))
            for name, data in files.items():
                _add(archive, f"{folder}/{name}", data)
    return sink.getvalue()


def _add(archive: zipfile.ZipFile, path: str, data: bytes) -> None:
    member = zipfile.ZipInfo(path, _ZIP_TIME)
    member.compress_type = zipfile.ZIP_DEFLATED
    member.external_attr = _FILE_MODE
    archive.writestr(member, data)


def write_files(
    files: Mapping[str, bytes],
    out: Path,
    *,
    forbidden: Path | None,
    overwrite: bool = False,
) -> None:
    """Write the files as the folder ``out``, either all of them or none.

    ``overwrite`` replaces a folder that holds just the files of an earlier export:
    the same names, the recipe among them. A dataset's own folder has no recipe.
    ``forbidden`` is the folder that was read, which is never written to.

    Raises:
        ExportError: the place is taken, forbidden, or cannot be written to.
    """
    check_place(out, tuple(files), forbidden=forbidden, overwrite=overwrite)
    target = Path(out).resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _clear_left_overs(target)
    except OSError as error:
        raise unwritable(out, error) from error
    replace_folder(files, target)


def check_place(
    out: Path,
    names: Collection[str],
    *,
    forbidden: Path | None,
    overwrite: bool = False,
) -> None:
    """Raise if ``write_files`` could not write files of these names to ``out``.

    Raises:
        ExportError: ``out`` is taken, forbidden, or not a valid path.
    """
    _check_names(list(names))
    try:
        _check_target(names, Path(out).resolve(), forbidden, overwrite)
    except OSError as error:
        raise unwritable(out, error) from error
    # Path.resolve raises for a cycle of links, or a NUL in the name.
    except (RuntimeError, ValueError) as error:
        raise ExportError(f"{str(out)!r}: is no place for a folder.") from error


def _check_names(names: list[str]) -> None:
    for name in names:
        if _NAME.fullmatch(name) is None:
            raise ExportError(
                f"{name[:60]!r} cannot be a file's name; expected letters, digits, "
                "dots, dashes and underscores."
            )


def _check_target(
    names: Collection[str], target: Path, forbidden: Path | None, overwrite: bool
) -> None:
    if forbidden is not None:
        source = Path(forbidden).resolve()
        if target == source or source in target.parents:
            raise ExportError(
                f"{target}: is the folder that was opened; the input is never "
                "written to, so choose another one."
            )
    if not target.exists():
        return
    if not target.is_dir():
        raise ExportError(f"{target}: is a file; expected a new folder's name.")
    present = sorted(os.listdir(target))
    if not present:
        return
    if not overwrite:
        raise FolderInUseError(
            f"{target}: already holds files; choose a new folder, or add --overwrite."
        )
    if RECIPE_NAME not in present:
        raise ExportError(
            f"{target}: was not written by the editor (it holds no {RECIPE_NAME}); "
            "choose a new folder."
        )
    strange = [name for name in present if name not in names]
    if strange or any((target / name).is_dir() for name in present):
        raise ExportError(
            f"{target}: holds {(strange or present)[0]!r}, which is not of this "
            "export; choose a new folder."
        )


def replace_folder(files: Mapping[str, bytes | Path], target: Path) -> None:
    """Write to a hidden folder beside the target, then swap both atomically.

    Files that are given by their paths are linked, or copied where there are no links.

    A reader sees the complete old or the complete new folder. Where the system cannot
    swap folders, the old one is renamed first, and there is a short time without any.

    Raises:
        ExportError: it cannot be written.
    """
    try:
        _replace_folder(files, target)
    except OSError as error:
        raise unwritable(target, error) from error


def _replace_folder(files: Mapping[str, bytes | Path], target: Path) -> None:
    token = secrets.token_hex(4)
    new = target.parent / f".{target.name}.{token}{_NEW}"
    old = target.parent / f".{target.name}.{token}{_OLD}"
    new.mkdir()
    try:
        for name, data in files.items():
            if isinstance(data, bytes):
                (new / name).write_bytes(data)
                continue
            try:
                os.link(data, new / name)
            except OSError:
                shutil.copy2(data, new / name)
        if not target.exists():
            new.rename(target)
        elif not exchange(new, target):
            target.rename(old)
            try:
                new.rename(target)
            except OSError:
                old.rename(target)
                raise
    finally:
        shutil.rmtree(new, ignore_errors=True)
    shutil.rmtree(old, ignore_errors=True)


def _clear_left_overs(target: Path) -> None:
    """Remove old hidden folders of this target that a killed process left behind."""
    with os.scandir(target.parent) as entries:
        found = [
            entry
            for entry in entries
            if entry.name.startswith(f".{target.name}.")
            and entry.name.endswith((_NEW, _OLD))
        ]
    for entry in found:
        with contextlib.suppress(OSError):
            if entry.name.endswith(_OLD) and not target.exists():
                os.rename(entry.path, target)
            elif time.time() - entry.stat().st_mtime > LEFT_OVER_S:
                shutil.rmtree(entry.path, ignore_errors=True)


def exchange(one: Path, other: Path) -> bool:
    """Swap two folders of the same disk; return False where the system cannot."""
    paths = os.fsencode(one), os.fsencode(other)
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "linux":
            done = library.renameat2(
                _AT_WORKING_FOLDER, paths[0], _AT_WORKING_FOLDER, paths[1], _EXCHANGE
            )
        elif sys.platform == "darwin":
            done = library.renamex_np(*paths, _EXCHANGE)
        else:
            return False
    # Old C libraries lack the function, and Windows lacks the library.
    except (AttributeError, OSError, TypeError):
        return False
    return done == 0
