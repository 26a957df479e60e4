"""Typed, validated access to the columns of a track file's parquet table."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int

from pd_editor.base.errors import ScenarioFileError
from pd_editor.base.plain_text import MAX_ID_CHARACTERS, is_plain
from pd_editor.base.regular_file import read_regular
from pd_editor.scene.av2_io.parquet_pages import unpacked_bytes
from pd_editor.scene.scene_limits import MAX_COORDINATE_M, MAX_STATES

MAX_TRACKS_BYTES: Final = 64 * 2**20
MAX_UNPACKED_BYTES: Final = 64 * 2**20
MAX_COLUMNS: Final = 100
MAX_ROW_GROUPS: Final = 1_000
_MAX_VALUE_BYTES: Final = 64
"""Widest fixed-width value that is read."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackTable:
    """The rows of a track file; every method raises ScenarioFileError."""

    file_name: str
    table: pa.Table

    def __len__(self) -> int:
        return self.table.num_rows

    def error(self, what: str) -> ScenarioFileError:
        """Error that names this file."""
        return ScenarioFileError(f"{self.file_name}: {what}")

    def row_error(
        self, column: str, is_bad: Bool[np.ndarray, "R"], expected: str
    ) -> ScenarioFileError:
        """Error that names the first invalid row of a column."""
        row = int(np.argmax(is_bad))
        found = self.table[column][row].as_py()
        track = self.table["track_id"][row].as_py()
        return self.error(
            f"column {column!r}, row {row} (track {track!r}): expected {expected}, "
            f"found {_short(found)}."
        )

    def column(self, name: str, expected: str) -> pa.ChunkedArray:
        """A required column without nulls."""
        if self.table.schema.get_field_index(name) < 0:
            raise self.error(
                f"column {name!r} is missing; expected an Argoverse 2 motion "
                "forecasting file with one row per track and step."
            )
        column = self.table[name]
        if not is_readable(column.type):
            raise self.type_error(name, f"{expected} in every row")
        if column.null_count:
            is_null = np.asarray(column.is_null())
            raise self.row_error(name, is_null, expected)
        return column

    def numbers(self, name: str, expected: str = "a number") -> Float[np.ndarray, "R"]:
        """A column of finite numbers."""
        column = self.column(name, expected)
        if not _is_numeric(column.type):
            raise self.type_error(name, "numbers")
        values = _array(column, pa.float64())
        is_bad = ~np.isfinite(values)
        if is_bad.any():
            raise self.row_error(name, is_bad, f"{expected} that is finite")
        return values

    def bounded_numbers(
        self, name: str, most: float = MAX_COORDINATE_M
    ) -> Float[np.ndarray, "R"]:
        """A column of numbers between ``-most`` and ``most``."""
        values = self.numbers(name)
        is_bad = np.abs(values) > most
        if is_bad.any():
            expected = f"a value between -{most:g} and {most:g}"
            raise self.row_error(name, is_bad, expected)
        return values

    def integers(self, name: str) -> Int[np.ndarray, "R"]:
        """A column of integers; some official files store them as floats."""
        values = self.numbers(name, "a whole number")
        is_bad = (values != np.rint(values)) | (np.abs(values) > 2**53)
        if is_bad.any():
            raise self.row_error(name, is_bad, "a whole number")
        return values.astype(np.int64)

    def flags(self, name: str) -> Bool[np.ndarray, "R"]:
        """A column of booleans; some official files store them as 0.0 and 1.0."""
        column = self.column(name, "true or false")
        if pa.types.is_boolean(column.type):
            return _array(column, pa.uint8()) == 1
        values = self.numbers(name, "true or false")
        is_bad = (values != 0) & (values != 1)
        if is_bad.any():
            raise self.row_error(name, is_bad, "true or false")
        return values == 1

    def texts(self, name: str) -> tuple[Int[np.ndarray, "R"], tuple[str, ...]]:
        """Code of each row and the texts of the codes, in order of first appearance.

        Whole numbers count as texts: a CSV file in between makes them of ids.
        """
        column = self.column(name, "a text")
        if _is_numeric(column.type):
            column = pa.chunked_array([pa.array(map(str, self.integers(name)))])
        if pa.types.is_string_view(column.type):
            column = column.cast(pa.large_string())
        if not _is_text(column.type):
            raise self.type_error(name, "texts")
        encoded = column.combine_chunks()
        if isinstance(encoded, pa.ChunkedArray):
            encoded = encoded.unify_dictionaries().combine_chunks()
        if not isinstance(encoded, pa.DictionaryArray):
            encoded = encoded.dictionary_encode()
        codes = np.from_dlpack(encoded.indices)
        try:
            names = encoded.dictionary.to_pylist()
        except UnicodeDecodeError as error:
            raise self.error(
                f"column {name!r} holds text that is not UTF-8."
            ) from error
        used, first_row, codes = np.unique(
            codes, return_index=True, return_inverse=True
        )
        order = np.argsort(first_row)
        texts = tuple(names[used[index]] for index in order)
        if len(set(texts)) != len(texts):
            raise self.error(f"column {name!r} has a damaged dictionary.")
        odd = [text for text in texts if not is_plain(text)]
        if odd:
            raise self.error(
                f"column {name!r} holds {_short(odd[0])}; expected texts of one "
                f"line, at most {MAX_ID_CHARACTERS} characters."
            )
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        return rank[codes], texts

    def one_text(self, name: str) -> str:
        """The text that all rows share."""
        _, (first, *others) = self.texts(name)
        if others:
            raise self.error(
                f"column {name!r} holds both {_short(first)} and "
                f"{_short(others[0])}; expected one scenario per file."
            )
        return first

    def one_number(self, name: str) -> int | float:
        """The number that all rows share; of a column of integers it is exact."""
        values = self.numbers(name)
        is_bad = values != values[0]
        if is_bad.any():
            raise self.row_error(name, is_bad, f"{values[0]:g} as in the rows before")
        return self.table[name][0].as_py()

    def type_error(self, name: str, expected: str) -> ScenarioFileError:
        """Error that names a column's type."""
        found = self.table.schema.field(name).type
        return self.error(f"column {name!r} is of type {found}; expected {expected}.")


def open_track_table(
    source: bytes | Path, file_name: str, columns: Sequence[str] | None = None
) -> TrackTable:
    """Open the table in a parquet file, or some of its columns.

    Texts stay dictionary-encoded, so that a small file cannot unpack to gigabytes.

    Raises:
        ScenarioFileError: damaged, empty, or beyond the limits.
    """
    if isinstance(source, Path):
        source = read_regular(
            source, max_bytes=MAX_TRACKS_BYTES, error=ScenarioFileError
        )
    try:
        table = _read_within_limits(source, file_name, columns)
    except (pa.ArrowException, OSError, LookupError, ValueError, MemoryError) as error:
        raise ScenarioFileError(
            f"{file_name}: this is not a readable parquet file; "
            "it may be cut off or damaged."
        ) from error
    if table.num_rows == 0:
        raise ScenarioFileError(
            f"{file_name}: it has no rows; expected at least one track."
        )
    result = TrackTable(file_name=file_name, table=table)
    result.column("track_id", "a text")
    return result


def _read_within_limits(
    data: bytes, file_name: str, columns: Sequence[str] | None
) -> pa.Table:
    file = pq.ParquetFile(pa.BufferReader(data))
    metadata, schema = file.metadata, file.schema_arrow
    for count, limit, what in (
        (metadata.num_rows, MAX_STATES, "rows"),
        (metadata.num_columns, MAX_COLUMNS, "columns"),
        (metadata.num_row_groups, MAX_ROW_GROUPS, "row groups"),
    ):
        if count > limit:
            raise ScenarioFileError(
                f"{file_name}: it has {count} {what}; at most {limit} are read."
            )
    if len(set(schema.names)) != len(schema.names):
        raise ScenarioFileError(f"{file_name}: two columns have the same name.")
    readable = [field.name for field in schema if is_readable(field.type)]
    wanted = [name for name in readable if columns is None or name in columns]
    unpacked = unpacked_bytes(data, metadata, wanted)
    if unpacked > MAX_UNPACKED_BYTES:
        raise ScenarioFileError(
            f"{file_name}: it unpacks to {unpacked >> 20} MiB; "
            f"at most {MAX_UNPACKED_BYTES >> 20} MiB are read."
        )
    texts = [field.name for field in schema if _is_text(field.type)]
    file = pq.ParquetFile(
        pa.BufferReader(data), metadata=metadata, read_dictionary=texts
    )
    table = file.read(columns=wanted, use_threads=False)
    for name in schema.names:
        if name not in readable and columns is None:
            # Values of unlimited size are not read; the name is kept for a note.
            table = table.append_column(
                schema.field(name), pa.nulls(len(table), schema.field(name).type)
            )
    table.validate(full=True)
    return table


def _is_text(data_type: pa.DataType) -> bool:
    if pa.types.is_dictionary(data_type):
        data_type = data_type.value_type
    return (
        pa.types.is_string(data_type)
        or pa.types.is_large_string(data_type)
        or pa.types.is_string_view(data_type)
    )


def is_readable(data_type: pa.DataType) -> bool:
    """Whether values of a type have a bounded size in memory."""
    if _is_text(data_type):
        return True
    if pa.types.is_nested(data_type) or pa.types.is_dictionary(data_type):
        return False
    try:
        return data_type.bit_width <= 8 * _MAX_VALUE_BYTES
    except ValueError:
        return pa.types.is_null(data_type)


def _is_numeric(data_type: pa.DataType) -> bool:
    return pa.types.is_floating(data_type) or pa.types.is_integer(data_type)


def _array(column: pa.ChunkedArray, kind: pa.DataType) -> np.ndarray:
    """Values of a column without nulls.

    Its ``to_numpy`` would import pandas, which takes longer than all reading.
    """
    return np.from_dlpack(column.cast(kind, safe=False).combine_chunks())


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
