"""Sizes of a parquet file's pages, from the headers by which they are unpacked.

The totals in a file's footer are its author's word; the reader allocates what the page
headers say (https://parquet.apache.org/docs/file-format/data-pages/, Thrift's compact
protocol).
"""

from collections.abc import Collection
from typing import Final

import pyarrow.parquet as pq

MAX_PAGES: Final = 20_000
_UNPACKED_SIZE, _PACKED_SIZE = 2, 3
"""Fields of a page header."""
_STRUCT_END, _DOUBLE, _BINARY, _STRUCT = 0, 7, 8, 12
_FLAGS, _BYTE, _INTEGERS = (1, 2), 3, (4, 5, 6)
_MAX_DEPTH: Final = 4


def unpacked_bytes(
    data: bytes, metadata: pq.FileMetaData, columns: Collection[str]
) -> int:
    """Number of bytes that the pages of some flat columns unpack to.

    Raises:
        ValueError: a header is damaged, a column's parts have other numbers of rows than
            the file says, or there are too many pages.
    """
    total = num_pages = num_rows = 0
    for group_index in range(metadata.num_row_groups):
        group = metadata.row_group(group_index)
        num_rows += group.num_rows
        for index in range(group.num_columns):
            part = group.column(index)
            if part.path_in_schema not in columns:
                continue
            if part.num_values != group.num_rows:
                raise ValueError("a column has more or fewer values than rows")
            starts = part.dictionary_page_offset or 0, part.data_page_offset
            # Without rows there is a dictionary alone. A file begins with a mark.
            at = min((one for one in starts if one > 0), default=len(data))
            end = at + part.total_compressed_size
            while at < end:
                header, at = _fields(memoryview(data), at, 0)
                packed, unpacked = header[_PACKED_SIZE], header[_UNPACKED_SIZE]
                num_pages += 1
                if min(packed, unpacked) < 0 or num_pages > MAX_PAGES:
                    raise ValueError("its pages have impossible sizes")
                at += packed
                total += unpacked
    if num_rows != metadata.num_rows:
        raise ValueError("its parts have more or fewer rows than the file")
    return total


def _fields(data: memoryview, at: int, depth: int) -> tuple[dict[int, int], int]:
    """Integers in a struct by their field numbers, and where it ends."""
    found: dict[int, int] = {}
    field = 0
    while (head := data[at]) != _STRUCT_END:
        at, kind = at + 1, head & 15
        if head >> 4:
            field += head >> 4
        else:
            field, at = _integer(data, at)
        found[field], at = _value(data, at, kind, depth)
    return found, at + 1


def _value(data: memoryview, at: int, kind: int, depth: int) -> tuple[int, int]:
    """An integer, or 0 for what is no integer; and where it ends."""
    if kind in _FLAGS:
        return 0, at
    if kind in _INTEGERS:
        return _integer(data, at)
    if kind in (_BYTE, _DOUBLE):
        return 0, at + (1 if kind == _BYTE else 8)
    if kind == _BINARY:
        length, at = _number(data, at)
        return 0, at + length
    if kind == _STRUCT and depth < _MAX_DEPTH:
        return 0, _fields(data, at, depth + 1)[1]
    # No page header has lists; a later version may.
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
