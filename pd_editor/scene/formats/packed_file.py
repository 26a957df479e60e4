"""Files of foreign formats as they are, or gzipped under a name that ends in ``.gz``."""

import gzip
import io
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Final

from pd_editor.base.errors import FormatError
from pd_editor.base.regular_file import read_regular

MAX_FILE_BYTES: Final = 256 * 2**20
_HEAD_BYTES: Final = 1 << 16
"""Comments of tools may be long."""
_MAGIC: Final = b"\x1f\x8b"
_POINTER: Final = b"version https://git-lfs"
PACKED: Final = ".gz"
_IS_CLOSED: Final = ContextVar("is_closed", default=False)


def unpacked_name(name: str) -> str:
    """A file's name without the ending of gzipped files, whose case is kept."""
    return name[: -len(PACKED)] if name.lower().endswith(PACKED) else name


def stem_of(path: Path) -> str:
    """A file's name without its ending, and without that of gzipped files."""
    return Path(unpacked_name(path.name)).stem


def ending_of(path: Path) -> str:
    """A file's last ending in lower case, of a gzipped file that of its contents."""
    return Path(unpacked_name(path.name)).suffix.lower()


def head_of(path: Path) -> bytes:
    """First bytes of a file, in lower case, without XML comments; empty if unreadable."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        if head.startswith(_MAGIC):
            head = zlib.decompressobj(wbits=31).decompress(head, _HEAD_BYTES)
    except (OSError, zlib.error):
        return b""
    # Of a text in UTF-16, every other byte is 0; comments hold options, as <osm-files>.
    return re.sub(rb"(?s)<!--.*?-->", b"", head.lower().replace(b"\0", b""))


@contextmanager
def closed_folder() -> Iterator[None]:
    """While it lasts, only what lies beside a file can be named in it, as in uploads."""
    before = _IS_CLOSED.set(True)
    try:
        yield
    finally:
        _IS_CLOSED.reset(before)


def named_by(file: Path, name: str) -> tuple[Path, ...]:
    """Where that may lie which a file names: where it says, then beside the file.

    Absolute names are those of another machine.
    """
    told = PurePosixPath(name.strip().replace("\\", "/"))
    if _IS_CLOSED.get() and told.name == "..":
        return ()
    is_elsewhere = told.is_absolute() or _IS_CLOSED.get()
    names = (told, told.name)[is_elsewhere:] if told.name else ()
    return tuple(file.absolute().parent / one for one in names)


@contextmanager
def unpacked_file(path: Path, *, is_alone: bool = False) -> Iterator[Path]:
    """A gzipped file unpacked, in a folder of its own and for the time; others as they are.

    Unless ``is_alone``, links to what lies beside the file are there as well.

    Raises:
        FormatError: it cannot be read, is damaged, or too large.
    """
    if not (path.name.lower().endswith(PACKED) and path.is_file()):
        yield path
        return
    with TemporaryDirectory() as folder:
        plain = Path(folder, unpacked_name(path.name))
        plain.write_bytes(read_unpacked(path)[0])
        beside = () if is_alone else path.absolute().parent.iterdir()
        for one in beside:
            if one.name != plain.name:
                (plain.parent / one.name).symlink_to(one)
        yield plain


def read_unpacked(path: Path) -> tuple[bytes, bytes]:
    """A file's contents, and its bytes, which may be gzipped.

    Raises:
        FormatError: it cannot be read, is damaged, or too large.
    """
    data = read_regular(path, max_bytes=MAX_FILE_BYTES, error=FormatError)
    if data.startswith(_POINTER):
        raise FormatError(f"{path}: only points to the file (git lfs pull fetches it).")
    if not data.startswith(_MAGIC):
        return data, data
    try:
        # Such a file may have several parts.
        found = gzip.GzipFile(fileobj=io.BytesIO(data)).read(MAX_FILE_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise FormatError(f"{path}: is no valid gzip ({error}).") from error
    if len(found) > MAX_FILE_BYTES:
        raise FormatError(
            f"{path}: is larger than {MAX_FILE_BYTES >> 20} MiB when unpacked."
        )
    return found, data
