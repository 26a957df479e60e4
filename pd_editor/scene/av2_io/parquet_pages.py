"""Sizes of a parquet file's pages, from the headers by which they are unpacked.

The totals in a file's footer are its author's word; the reader allocates what the page
headers say (https://parquet.apache.org/docs/file-format/data-pages/, Thrift's compact
protocol). The footer is read here as well: pyarrow's own view of a damaged part of a
column ends the process.
"""

from collections.abc import Collection
from typing import Any, Final, TypeVar

import pyarrow.parquet as pq

MAX_PAGES: Final = 20_000
_UNPACKED_SIZE, _PACKED_SIZE = 2, 3
"""Fields of a page header."""
_MAX_FOOTER_BYTES: Final = 4_000_000
_GROUPS, _COLUMNS, _GROUP_ROWS, _ABOUT = 4, 1, 3, 3
"""Fields of the footer, of a group of rows, and of a part of a column."""
_PATH, _VALUES, _SIZE, _DATA_AT, _DICTIONARY_AT = 3, 5, 7, 9, 11
"""Fields of what is said about it."""
_STRUCT_END, _DOUBLE, _BINARY, _LISTS, _STRUCT = 0, 7, 8, (9, 10), 12
_FLAGS, _BYTE, _INTEGERS = (1, 2), 3, (4, 5, 6)
_MAX_DEPTH: Final = 10
_Kind = TypeVar("_Kind")


def unpacked_bytes(
    data: bytes, metadata: pq.FileMetaData, columns: Collection[str]
) -> int:
    """Number of bytes that the pages of some flat columns unpack to.

    Raises:
        ValueError: a header is damaged, a column's parts have other numbers of rows than
            the file says, or there are too many pages.
    """
    view = memoryview(data)
    length = int.from_bytes(data[-8:-4], "little")
    if length > _MAX_FOOTER_BYTES:
        raise ValueError("its footer is too long")
    paths = [[name.encode()] for name in columns]
    footer, _ = _fields(view, len(data) - 8 - length, 0)
    total = num_pages = num_rows = 0
    for group in _of(footer, _GROUPS, list):
        rows = _of(group, _GROUP_ROWS, int)
        num_rows += rows
        for column in _of(group, _COLUMNS, list):
            part = _of(column, _ABOUT, dict)
            if _of(part, _PATH, list) not in paths:
                continue
            if _of(part, _VALUES, int) != rows:
                raise ValueError("a column has more or fewer values than rows")
            starts = (
                _of({_DICTIONARY_AT: 0, **part}, _DICTIONARY_AT, int),
                _of(part, _DATA_AT, int),
            )
            # Without rows there is a dictionary alone. A file begins with a mark.
            at = min((one for one in starts if one > 0), default=len(data))
            end = at + _of(part, _SIZE, int)
            while at < end:
                header, at = _fields(view, at, 0)
                packed = _of(header, _PACKED_SIZE, int)
                unpacked = _of(header, _UNPACKED_SIZE, int)
                num_pages += 1
                if min(packed, unpacked) < 0 or num_pages > MAX_PAGES:
                    raise ValueError("its pages have impossible sizes")
                at += packed
                total += unpacked
    if num_rows != metadata.num_rows:
        raise ValueError("its parts have more or fewer rows than the file")
    return total


def _of(struct: Any, field: int, kind: type[_Kind]) -> _Kind:
    """A field of a struct."""
    value = struct.get(field) if isinstance(struct, dict) else None
    if isinstance(value, kind):
        return value
    raise ValueError(f"field {field} of a header is missing or of another kind")


def _fields(data: memoryview, at: int, depth: int) -> tuple[dict[int, Any], int]:
    """Values in a struct by their field numbers, and where it ends."""
    found: dict[int, Any] = {}
    field = 0
    while (head := data[at]) != _STRUCT_END:
        at, kind = at + 1, head & 15
        if head >> 4:
            field += head >> 4
        else:
            field, at = _integer(data, at)
        found[field], at = _value(data, at, kind, depth)
    return found, at + 1


def _value(data: memoryview, at: int, kind: int, depth: int) -> tuple[Any, int]:
    """An integer, text, list or struct, or 0 for what is none of these; where it ends."""
    if kind in _FLAGS:
        return 0, at
    if kind in _INTEGERS:
        return _integer(data, at)
    if kind in (_BYTE, _DOUBLE):
        return 0, at + (1 if kind == _BYTE else 8)
    if kind == _BINARY:
        length, at = _number(data, at)
        return bytes(data[at : at + length]), at + length
    if kind == _STRUCT and depth < _MAX_DEPTH:
        return _fields(data, at, depth + 1)
    if kind in _LISTS and depth < _MAX_DEPTH:
        count, of = data[at] >> 4, data[at] & 15
        at, found = at + 1, []
        if count == 15:
            count, at = _number(data, at)
        if count > len(data) - at:
            raise ValueError("a list in a header is longer than the file")
        for _ in range(count):
            # A flag in a list takes a byte of its own.
            one, at = _value(data, at, _BYTE if of in _FLAGS else of, depth + 1)
            found.append(one)
        return found, at
    raise ValueError(f"a page header has a value of the kind {kind}")


def _integer(data: memoryview, at: int) -> tuple[int, int]:
    number, at = _number(data, at)
    return (number >> 1) ^ -(number & 1), at


def _number(data: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
        shift += 7
        if shift > 63:
            raise ValueError("a page header has a number of more than 64 bits")
