import io
import stat
import struct
import zipfile
from collections.abc import Mapping
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import ArchiveError, InputError
from pd_editor.scene.av2_io import upload
from pd_editor.scene.av2_io.upload import (
    scenario_from_upload,
    scenario_of_upload,
    scenarios_in_upload,
)
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import zip_folders
from tests.scene.av2_io.small_files import MAP, SCENARIO, TRACKS

ID = SCENARIO.scenario_id
TRACKS_NAME, MAP_NAME = f"scenario_{ID}.parquet", f"log_map_archive_{ID}.json"
FILES = scenario_files(SCENARIO)
ZIP = zip_folders({ID: {**FILES, "recipe.json": b"{}"}})


def zipped(files: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", method) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return sink.getvalue()


def refused(files: Mapping[str, bytes], message: str) -> None:
    with pytest.raises(ArchiveError, match=message) as refusal:
        scenario_from_upload(files)
    text = str(refusal.value)
    assert text.endswith(".")
    assert text.isprintable()


@pytest.mark.parametrize(
    "files",
    [
        {"x.zip": ZIP},
        {"without ending": ZIP},
        {"flat.zip": zipped(FILES)},
        {"stored.zip": zipped(FILES, zipfile.ZIP_STORED)},
        {"deep.zip": zipped({f"a/b/{name}": data for name, data in FILES.items()})},
        {"more.zip": zipped({**FILES, "x/nested.zip": ZIP, "a.png": b"", "d/": b""})},
        {"mac.zip": zipped({**FILES, f"__MACOSX/._{TRACKS_NAME}": b"x"})},
        {TRACKS_NAME: TRACKS, MAP_NAME: MAP},
        {"my tracks.PARQUET": TRACKS, "map (1).json": MAP},
        {TRACKS_NAME: TRACKS, MAP_NAME: MAP, "recipe.json": b"{}"},
        {"two.zip": zipped({**FILES, "predictions.parquet": b"x"})},
        {TRACKS_NAME: TRACKS, MAP_NAME: MAP, "predictions.parquet": b"x"},
        {f"scenario_{ID} (1).parquet": TRACKS, MAP_NAME: MAP},
        {TRACKS_NAME: TRACKS, f"log_map_archive_{ID} (1).json": MAP},
        {"scenario_copy.parquet": TRACKS, MAP_NAME: MAP},
        {"C:\\data\\" + TRACKS_NAME: TRACKS, "../" + MAP_NAME: MAP},
    ],
)
def test_uploads_that_hold_one_scenario(files: Mapping[str, bytes]) -> None:
    found = scenario_from_upload(files)
    assert found.scenario_id == ID
    assert found.agents.ids == SCENARIO.agents.ids
    assert found.provenance.source == ""


@pytest.mark.parametrize(
    "name",
    [
        "/etc/passwd",
        "../x",
        "a/../../x",
        "C:/x",
        "C:x",
        "a\\b",
        "\\\\host\\x",
        "line\nbreak",
        "bell\x07",
    ],
)
def test_odd_paths(name: str) -> None:
    refused({"x.zip": zipped({**FILES, name: b""})}, "holds a file with the odd path")


def test_links() -> None:
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w") as archive:
        link = zipfile.ZipInfo(TRACKS_NAME)
        link.create_system = 3
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(link, "/etc/passwd")
    refused({"x.zip": sink.getvalue()}, f"x.zip: holds a link, {TRACKS_NAME}")


def with_central_field(archive: bytes, offset: int, value: bytes) -> bytes:
    """The archive with bytes of its first directory entry replaced."""
    start = archive.index(b"PK\x01\x02") + offset
    return archive[:start] + value + archive[start + len(value) :]


def test_encryption() -> None:
    data = with_central_field(zipped(FILES), 8, struct.pack("<H", 1))
    refused({"x.zip": data}, "is encrypted; expected a zip without password")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_unusual_methods(method: int) -> None:
    refused({"x.zip": zipped(FILES, method)}, "unusual method")


@pytest.mark.parametrize("claimed", [None, 0, 1000, 2**31])
def test_a_bomb_is_not_unpacked_whatever_its_header_claims(claimed: int | None) -> None:
    data = zipped({MAP_NAME: b" " * 30 * 2**20, TRACKS_NAME: TRACKS})
    if claimed is not None:
        data = with_central_field(data, 24, struct.pack("<I", claimed))
    refused({"x.zip": data}, "zip bomb|not a readable zip")


def test_the_unpacked_size_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(upload, "MAX_UNPACKED_BYTES", len(TRACKS) + len(MAP) - 1)
    refused({"x.zip": ZIP}, f"{MAP_NAME} unpacks to more than")


def test_the_upload_size_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(upload, "MAX_UPLOAD_BYTES", len(ZIP) - 1)
    refused({"x.zip": ZIP}, "The upload has 0 MiB; at most")


def test_the_number_of_members_is_limited() -> None:
    many = {f"{number}": b"" for number in range(upload.MAX_MEMBERS + 1)}
    refused({"x.zip": zipped(many)}, "holds more than 1000 files")


def test_more_than_one_scenario() -> None:
    many = {f"{n}/scenario_s{n}.parquet": TRACKS for n in range(5)}
    refused(
        {"x.zip": zipped({**many, MAP_NAME: MAP})},
        r"5 files .* scenario_s0.parquet, scenario_s1.parquet, scenario_s2.parquet "
        "and 2 more; expected exactly one scenario",
    )
    refused(
        {TRACKS_NAME: TRACKS, MAP_NAME: MAP, "log_map_archive_b.json": MAP},
        "holds 2 files that could be the map",
    )


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, "holds no track file .*; found nothing"),
        ({TRACKS_NAME: TRACKS}, rf"holds no map \(.json\); found {TRACKS_NAME}"),
        ({MAP_NAME: MAP}, "holds no track file"),
        ({TRACKS_NAME: TRACKS, "recipe.json": b"{}"}, "holds no map"),
        ({"x.zip": ZIP, TRACKS_NAME: TRACKS}, "a zip and other files"),
        ({"x.zip": zipped({})}, "x.zip: holds no track file .*; found nothing"),
        ({"x.zip": zipped({"inner.zip": ZIP})}, "found inner.zip"),
        ({"x.zip": b"no zip"}, "x.zip: this is not a readable zip"),
        ({"x\n<b>.zip": b""}, r"x\?<b>.zip: this is not a readable zip"),
        (
            {TRACKS_NAME: TRACKS, "log_map_archive_other.json": MAP},
            "log_map_archive_other.json belongs to another scenario than",
        ),
    ],
)
def test_uploads_that_hold_no_scenario(files: dict[str, bytes], message: str) -> None:
    refused(files, message)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, len(ZIP) - 1))
def test_a_cut_off_zip_is_refused(length: int) -> None:
    with pytest.raises(InputError):
        scenario_from_upload({"x.zip": ZIP[:length]})


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, len(ZIP) - 1), st.integers(0, 255)), min_size=1)
)
def test_a_damaged_zip_is_refused_or_readable(changes: list[tuple[int, int]]) -> None:
    damaged = bytearray(ZIP)
    for position, value in changes:
        damaged[position] = value
    try:
        found = scenario_from_upload({"x.zip": bytes(damaged)})
    except InputError:
        return
    assert found.agents.ids == SCENARIO.agents.ids


def zip_of(files: Mapping[str, bytes]) -> dict[str, bytes]:
    return {"several.zip": zipped(files, zipfile.ZIP_STORED)}


def files_of(name: str) -> dict[str, bytes]:
    return dict(scenario_files(replace(SCENARIO, scenario_id=name)))


def in_folders(names: str) -> dict[str, bytes]:
    return {
        f"{name}/{file}": content
        for name in names
        for file, content in files_of(name).items()
    }


@pytest.mark.parametrize(
    "files",
    [
        pytest.param({**in_folders("abc"), "index.csv": b"id"}, id="folders"),
        pytest.param(
            {f"set/{name}": data for name, data in in_folders("abc").items()},
            id="one folder deeper",
        ),
        pytest.param(
            {**files_of("a"), **files_of("b"), **files_of("c")}, id="side by side"
        ),
        pytest.param(
            {**in_folders("abc"), "d/only.parquet": b"", "__MACOSX/a/._x.parquet": b""},
            id="with parts of others",
        ),
    ],
)
def test_each_scenario_of_a_zip_can_be_opened(files: dict[str, bytes]) -> None:
    """A zip of several could not be opened, that of the editor's library included."""
    uploaded = zip_of(files)
    assert scenarios_in_upload(uploaded) == ("a", "b", "c")
    for name in "abc":
        chosen = scenario_of_upload(uploaded, name)
        assert scenario_from_upload(chosen).scenario_id == name


def test_scenarios_of_one_name_are_told_apart() -> None:
    files = {
        f"{split}/{name}": data
        for split in "xy"
        for name, data in in_folders("a").items()
    }
    names = scenarios_in_upload(zip_of(files))
    assert names == ("a", "y/a")
    for name in names:
        assert scenario_of_upload(zip_of(files), name)


@pytest.mark.parametrize("files", [{}, in_folders("a"), {"x.txt": b""}])
def test_other_uploads_have_no_choice(files: dict[str, bytes]) -> None:
    assert scenarios_in_upload(zip_of(files)) == ()
    assert scenarios_in_upload(files_of("a")) == ()


@pytest.mark.parametrize("name", ["../a/x.parquet", "/x.parquet", "a\\x.parquet"])
def test_a_choice_of_unsafe_members_is_refused(name: str) -> None:
    with pytest.raises(ArchiveError, match="odd path"):
        scenarios_in_upload(zip_of({**in_folders("ab"), name: b""}))


def test_a_damaged_member_is_told_when_it_is_chosen() -> None:
    ((name, data),) = zip_of(in_folders("ab")).items()
    at = data.index(b"PAR1") + 100
    damaged = {name: data[:at] + b"????" + data[at + 4 :]}
    assert scenarios_in_upload(damaged) == ("a", "b")
    with pytest.raises(ArchiveError, match="cut off or damaged"):
        scenario_of_upload(damaged, "a")
