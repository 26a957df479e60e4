"""Small files that unpack to a lot, whatever they say of themselves."""

import io
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pd_editor.base.errors import ScenarioFileError
from pd_editor.base.installed_files import demo_folder
from pd_editor.scene.av2_io.parquet_pages import unpacked_bytes
from pd_editor.scene.av2_io.track_table import open_track_table

TRACKS = next(demo_folder("crosswalk").glob("*.parquet"))
NUM_TEXTS, TEXT_BYTES = 12, 40 * 2**20


def varint(value: int, length: int) -> bytes:
    """A Thrift integer in so many bytes."""
    number = 2 * value
    groups = [(number >> (7 * place)) & 127 | 128 for place in range(length)]
    groups[-1] &= 127
    return bytes(groups)


def written(table: pa.Table, **options: object) -> bytes:
    sink = io.BytesIO()
    pq.write_table(table, sink, **options)
    return sink.getvalue()


def with_lies(data: bytes, said: int) -> bytes:
    """A file whose footer says small sizes."""
    metadata = pq.ParquetFile(io.BytesIO(data)).metadata
    group = metadata.row_group(0)
    sizes = {group.column(i).total_uncompressed_size for i in range(group.num_columns)}
    for size in {group.total_byte_size, *sizes}:
        if size > said:
            length = -(-(2 * size).bit_length() // 7)
            assert varint(size, length) in data
            data = data.replace(varint(size, length), varint(said, length))
    group = pq.ParquetFile(io.BytesIO(data)).metadata.row_group(0)
    assert group.total_byte_size <= said
    return data


@pytest.fixture(scope="module")
def long_texts() -> pa.Array:
    return pa.array([f"{i:02d}" + "a" * TEXT_BYTES for i in range(NUM_TEXTS)])


@pytest.mark.parametrize("column", ["city", "track_id", "unknown"])
@pytest.mark.parametrize("is_listing", [False, True])
def test_a_bomb_in_a_dictionary_is_refused_before_it_is_unpacked(
    tmp_path: Path, long_texts: pa.Array, column: str, is_listing: bool
):
    """126 KiB in an upload took 3.7 GB, since the footer's word was taken."""
    table = pq.read_table(TRACKS)
    codes = pa.array(np.arange(len(table)) % NUM_TEXTS, pa.int32())
    texts = pa.DictionaryArray.from_arrays(codes, long_texts)
    if column in table.column_names:
        table = table.set_column(table.column_names.index(column), column, texts)
    else:
        table = table.append_column(column, texts)
    data = with_lies(
        written(table, compression="zstd", dictionary_pagesize_limit=2**31 - 1), 1000
    )
    assert len(data) < 2**18
    path = tmp_path / "scenario_x.parquet"
    path.write_bytes(data)
    columns = ["track_id", "city"] if is_listing else None
    if is_listing and column == "unknown":
        open_track_table(path, "x", columns)
        return
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ScenarioFileError, match=r"unpacks to 48\d MiB; at most 64 MiB"):
        open_track_table(path, "x", columns)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200 * 2**10


def test_a_bomb_under_another_name_is_refused(long_texts: pa.Array):
    """The reader takes parts of columns by their order, whatever they call themselves."""
    table = pq.read_table(TRACKS)
    codes = pa.array(np.arange(len(table)) % NUM_TEXTS, pa.int32())
    texts = pa.DictionaryArray.from_arrays(codes, long_texts)
    table = table.set_column(table.column_names.index("city"), "city", texts)
    options = {"compression": "zstd", "dictionary_pagesize_limit": 2**31 - 1}
    data = with_lies(written(table, **options), 1000)
    footer = data.rindex(b"PAR1") - 4 - int.from_bytes(data[-8:-4], "little")
    place = data.rindex(b"\x18\x04city")
    assert place > footer
    renamed = data[:place] + b"\x18\x04town" + data[place + 6 :]
    group = pq.ParquetFile(io.BytesIO(renamed)).metadata.row_group(0)
    assert "town" in {group.column(n).path_in_schema for n in range(group.num_columns)}
    with pytest.raises(ScenarioFileError, match="unpacks to 48"):
        open_track_table(renamed, "x", ["track_id", "city"])


def test_a_page_that_says_less_than_it_holds_is_damaged(long_texts: pa.Array):
    """The reader unpacks into what the page's header says."""
    table = pq.read_table(TRACKS)
    codes = pa.array(np.zeros(len(table)), pa.int32())
    texts = pa.DictionaryArray.from_arrays(codes, long_texts[:2])
    data = written(
        table.append_column("unknown", texts),
        compression="zstd",
        dictionary_pagesize_limit=2**31 - 1,
    )
    size = 2 * (TEXT_BYTES + 2 + 4)
    length = -(-(2 * size).bit_length() // 7)
    assert data.count(varint(size, length)) == 1
    lying = with_lies(data.replace(varint(size, length), varint(900, length)), 1000)
    with pytest.raises(ScenarioFileError, match="not a readable parquet file"):
        open_track_table(lying, "x")


def rows_of(metadata: pq.FileMetaData) -> list[int]:
    group = metadata.row_group(0)
    values = [group.column(index).num_values for index in range(group.num_columns)]
    return [metadata.num_rows, group.num_rows, *values]


def test_more_values_than_rows_are_damage():
    """A few bytes of runs could stand for any number of values."""
    data = TRACKS.read_bytes()
    metadata = pq.ParquetFile(io.BytesIO(data)).metadata
    rows = metadata.num_rows
    length = -(-(2 * rows).bit_length() // 7)
    footer = data.rindex(b"PAR1") - 4 - int.from_bytes(data[-8:-4], "little")
    old, new = varint(rows, length), varint(rows + 1, length)
    places = [i for i in range(footer, len(data)) if data.startswith(old, i)]
    num_changed = 0
    for place in places:
        changed = data[:place] + new + data[place + length :]
        found = pq.ParquetFile(io.BytesIO(changed)).metadata
        if rows_of(found) == rows_of(metadata):
            continue  # A size that happens to be equal.
        num_changed += 1
        with pytest.raises(ScenarioFileError, match="not a readable parquet file"):
            open_track_table(changed, "x")
    assert num_changed == 2 + metadata.num_columns


@pytest.mark.parametrize("compression", ["none", "snappy", "gzip", "zstd", "lz4"])
@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_pages_of_all_usual_kinds_are_measured_as_their_writer_counted(
    compression: str, version: str
):
    table = pq.read_table(TRACKS)[:1500]
    table = table.append_column("nested", pa.array([[1, 2]] * len(table)))
    data = written(
        table,
        compression=compression,
        data_page_version=version,
        row_group_size=700,
        data_page_size=512,
        write_page_checksum=True,
    )
    metadata = pq.ParquetFile(io.BytesIO(data)).metadata
    for name in table.column_names[:-1]:
        parts = [
            metadata.row_group(i).column(table.column_names.index(name))
            for i in range(metadata.num_row_groups)
        ]
        counted = sum(part.total_uncompressed_size for part in parts)
        found = unpacked_bytes(data, metadata, [name])
        # The writer counts the headers as well.
        assert 0 < found <= counted
    assert len(open_track_table(data, "x")) == len(table)


def test_a_row_group_may_be_empty():
    table = pq.read_table(TRACKS)
    sink = io.BytesIO()
    with pq.ParquetWriter(sink, table.schema) as writer:
        for part in (table[:0], table, table[:0]):
            writer.write_table(part)
    assert len(open_track_table(sink.getvalue(), "x")) == len(table)


def test_damaged_headers_never_hang_or_crash():
    """Random bytes in the pages; in a process of its own, as Arrow may crash."""
    script = (
        "import random, sys\n"
        "from pd_editor.scene.av2_io.track_table import open_track_table\n"
        "from pd_editor.base.errors import ScenarioFileError\n"
        "data = open(sys.argv[1], 'rb').read()\n"
        "chance = random.Random(5)\n"
        "for _ in range(300):\n"
        "    bad = bytearray(data)\n"
        "    for _ in range(chance.randint(1, 40)):\n"
        "        bad[chance.randrange(4, len(bad) - 12)] = chance.randrange(256)\n"
        "    try:\n"
        "        open_track_table(bytes(bad), 'x')\n"
        "    except ScenarioFileError:\n"
        "        pass\n"
    )
    subprocess.run([sys.executable, "-c", script, str(TRACKS)], check=True, timeout=120)
