"""Reads regular files up to a size limit, and writes files atomically."""

import contextlib
import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import ExportError, InputError, PdEditorError
from pd_editor.base.plain_text import is_plain

MAX_PATH_BYTES: Final = 4096
MAX_NAME_BYTES: Final = 255
"""Longest file name of common file systems."""


def check_path(path: str | Path, error: type[PdEditorError] = InputError) -> None:
    """Raise for paths that are not valid on any file system or cannot be encoded.

    Raises:
        PdEditorError: of the type ``error``.
    """
    text = str(path)
    if not is_plain(text, len(text)):
        raise error(
            f"{text}: is no usable path; expected characters in UTF-8, without control "
            "characters and line breaks."
        )
    size = len(text.encode())
    parts = text.replace("\\", "/").split("/") if size > MAX_NAME_BYTES else ()
    if size > MAX_PATH_BYTES or any(len(p.encode()) > MAX_NAME_BYTES for p in parts):
        raise error(
            f"{text}: the path is too long; expected names of at most "
            f"{MAX_NAME_BYTES} bytes, {MAX_PATH_BYTES} bytes in all."
        )


def user_path(text: str) -> Path:
    """Path that a user typed, in which a home folder may be ~ or ~name.

    Raises:
        InputError: it is no path, or there is no such user.
    """
    check_path(text)
    # Unlike pathlib's, this does not raise for an unknown user.
    path = os.path.expanduser(text)
    if path == text and text.startswith("~"):
        raise InputError(f"{text}: there is no home folder of this name.")
    return Path(path)


def folders_below(folder: Path) -> Iterator[tuple[str, list[str], list[str]]]:
    """``os.walk`` that follows links, into each folder once: by its own name if it can."""
    seen: set[str] = set()
    for place, folders, files in os.walk(folder, followlinks=True):
        own = os.path.realpath(place)
        if own in seen:
            folders.clear()
            continue
        seen.add(own)
        folders.sort(key=lambda one: (os.path.islink(os.path.join(place, one)), one))
        yield place, folders, files


def read_regular(
    path: Path, *, max_bytes: int, error: type[PdEditorError] = InputError
) -> bytes:
    """Read a regular file of at most ``max_bytes``.

    Devices, pipes and sockets raise without blocking.

    Raises:
        PdEditorError: of the type ``error``: the path is invalid or names no regular
            file, or the file is too large or cannot be read.
    """
    check_path(path, error)
    try:
        # Opening a pipe would wait for a writer.
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(number, "rb") as file:
            status = os.fstat(number)
            if not stat.S_ISREG(status.st_mode):
                raise error(f"{path}: is not a regular file.")
            if status.st_size > max_bytes:
                raise _too_large(path, max_bytes, error)
            data = file.read(status.st_size + 1)
            # The reported size may be wrong, as under /proc.
            if len(data) > status.st_size:
                data += file.read(max_bytes + 1 - len(data))
    except OSError as failure:
        reason = failure.strerror or str(failure)
        raise error(f"{path}: cannot be read ({reason}).") from failure
    if len(data) > max_bytes:
        raise _too_large(path, max_bytes, error)
    return data


def check_regular(
    path: Path, *, max_bytes: int, error: type[PdEditorError] = InputError
) -> None:
    """Raise for a file that ``read_regular`` would not read, without reading it.

    Raises:
        PdEditorError: of the type ``error``.
    """
    check_path(path, error)
    try:
        status = os.stat(path)
    except OSError as failure:
        reason = failure.strerror or str(failure)
        raise error(f"{path}: cannot be read ({reason}).") from failure
    if not stat.S_ISREG(status.st_mode):
        raise error(f"{path}: is not a regular file.")
    if status.st_size > max_bytes:
        raise _too_large(path, max_bytes, error)


def json_value(data: str | bytes) -> Any:
    """Parse a JSON text, which may begin with a byte-order mark.

    Raises:
        ValueError: it is not JSON, or nested too deeply.
    """
    try:
        text = (
            data if isinstance(data, str) else data.decode(json.detect_encoding(data))
        )
        return json.loads(text.removeprefix("\ufeff"))
    except (RecursionError, MemoryError) as error:
        raise ValueError("it is nested too deeply") from error


def write_whole(
    path: Path, data: bytes, error: type[PdEditorError] = ExportError
) -> None:
    """Replace a file in one step, so that a kill leaves the old one or the new one.

    Its folder is made if needed.

    Raises:
        PdEditorError: of the type ``error``: it cannot be written.
    """
    fresh = path.with_name(f".{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with fresh.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
    except OSError as failure:
        with contextlib.suppress(OSError):
            fresh.unlink()
        raise unwritable(path, failure, error) from failure


def unwritable(
    path: Path, failure: Exception, error: type[PdEditorError] = ExportError
) -> PdEditorError:
    """The error of a path that cannot be written."""
    reason = getattr(failure, "strerror", None) or str(failure)
    return error(f"{path}: cannot be written ({reason}).")


def _too_large(path: Path, max_bytes: int, error: type[PdEditorError]) -> PdEditorError:
    limit = f"{max_bytes >> 20} MiB" if max_bytes >= 2**20 else f"{max_bytes >> 10} KiB"
    return error(f"{path}: is larger than {limit}, the most that is read.")


def state_folder() -> Path:
    """Folder of the editor's own files (XDG base directories)."""
    state = os.environ.get("XDG_STATE_HOME")
    return (Path(state) if state else Path.home() / ".local" / "state") / "pd-editor"
