"""Sizes of a parquet file's pages, from the headers by which they are unpacked.

The totals in a file's footer are its author's word; the reader allocates what the page
headers say (https://parquet.apache.org/docs/file-format/data-pages/, Thrift's compact
protocol). The footer is read here as well: pyarrow's own view of a damaged part of a
column ends the process.
"""

from collections.abc import Collection
from typing import Any, Final

import pyarrow.parquet as pq

MAX_PAGES: Final = 20_000
_MAX_FOOTER_BYTES: Final = 4_000_000
_MAX_DEPTH: Final = 10
_STRUCT_END, _DOUBLE, _BINARY, _LIST, _SET, _STRUCT = 0, 7, 8, 9, 10, 12
_FLAGS, _BYTE, _INTEGERS = (1, 2), 3, (4, 5, 6)
_I32, _I64 = 5, 6
_UNPACKED_SIZE, _PACKED_SIZE = (2, _I32), (3, _I32)
"""Fields of a page header, with their kinds: others of these numbers are not read."""
_GROUPS, _GROUP_ROWS, _COLUMNS = (4, _LIST), (3, _I64), (1, _LIST)
"""Fields of the footer and of a group of rows."""
_ABOUT, _VALUES, _SIZE = (3, _STRUCT), (5, _I64), (7, _I64)
_DATA_AT, _DICTIONARY_AT = (9, _I64), (11, _I64)
"""Fields of a part of a column."""
_Struct = dict[tuple[int, int], Any]


def unpacked_bytes(
    data: bytes, metadata: pq.FileMetaData, columns: Collection[str]
) -> int:
    """Number of bytes that the pages of some flat columns unpack to.

    Raises:
        ValueError: a header is damaged, a column's parts have other numbers of rows than
            the file says, or there are too many pages.
        LookupError: a header is damaged.
    """
    view = memoryview(data)
    length = int.from_bytes(data[-8:-4], "little")
    if length > _MAX_FOOTER_BYTES:
        raise ValueError("its footer is too long")
    # The reader takes parts of columns in the order of the schema, by no name.
    paths = [metadata.schema.column(n).path for n in range(metadata.num_columns)]
    footer, _ = _fields(view, len(data) - 8 - length, 0)
    total = num_pages = num_rows = 0
    for group in footer[_GROUPS]:
        rows = group[_GROUP_ROWS]
        num_rows += rows
        for path, column in zip(paths, group[_COLUMNS], strict=True):
            part = column[_ABOUT]
            if path not in columns:
                continue
            if part[_VALUES] != rows:
                raise ValueError("a column has more or fewer values than rows")
            starts = part.get(_DICTIONARY_AT, 0), part[_DATA_AT]
            # Without rows there is a dictionary alone. A file begins with a mark.
            at = min((one for one in starts if one > 0), default=len(data))
            end = at + part[_SIZE]
            while at < end:
                header, at = _fields(view, at, 0)
                packed, unpacked = header[_PACKED_SIZE], header[_UNPACKED_SIZE]
                num_pages += 1
                if min(packed, unpacked) < 0 or num_pages > MAX_PAGES:
                    raise ValueError("its pages have impossible sizes")
                at += packed
                total += unpacked
    if num_rows != metadata.num_rows:
        raise ValueError("its parts have more or fewer rows than the file")
    return total


def _fields(data: memoryview, at: int, depth: int) -> tuple[_Struct, int]:
    """Values in a struct by number and kind of their fields, and where it ends."""
    found: _Struct = {}
    field = 0
    while (head := data[at]) != _STRUCT_END:
        at, kind = at + 1, head & 15
        if head >> 4:
            field += head >> 4
        else:
            field, at = _integer(data, at)
        if (field, kind) in found:
            raise ValueError("a field of a header stands twice")
        found[field, kind], at = _value(data, at, kind, depth)
    return found, at + 1


def _value(data: memoryview, at: int, kind: int, depth: int) -> tuple[Any, int]:
    """An integer, a struct, the structs of a list, or None for all else; its end."""
    if kind in _FLAGS:
        return None, at
    if kind in _INTEGERS:
        return _integer(data, at)
    if kind in (_BYTE, _DOUBLE):
        return None, at + (1 if kind == _BYTE else 8)
    if kind == _BINARY:
        length, at = _number(data, at)
        return None, at + length
    if kind == _STRUCT and depth < _MAX_DEPTH:
        return _fields(data, at, depth + 1)
    if kind in (_LIST, _SET) and depth < _MAX_DEPTH:
        count, of = data[at] >> 4, data[at] & 15
        at += 1
        if count == 15:
            count, at = _number(data, at)
        if count > len(data) - at:
            raise ValueError("a list in a header is longer than the file")
        found: list[Any] = []
        for _ in range(count):
            # A flag in a list takes a byte of its own.
            one, at = _value(data, at, _BYTE if of in _FLAGS else of, depth + 1)
            found.append(one)
        return found if of == _STRUCT else [], at
    raise ValueError(f"a header has a value of the kind {kind}")


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
            raise ValueError("a header has a number of more than 64 bits")
