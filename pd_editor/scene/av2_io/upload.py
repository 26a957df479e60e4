"""Reader of uploaded, untrusted scenario files."""

import contextlib
import io
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import PurePosixPath
from typing import Final

from pd_editor.base.errors import ArchiveError
from pd_editor.base.plain_text import listed
from pd_editor.scene.av2_io.file_names import (
    MAP_PREFIX,
    TRACKS_PREFIX,
    is_map_name,
    is_scenario_id,
    is_tracks_name,
    map_name,
)
from pd_editor.scene.av2_io.read import read_scenario_bytes
from pd_editor.scene.scenario import Scenario

MAX_UPLOAD_BYTES: Final = 64 * 2**20
MAX_UNPACKED_BYTES: Final = 256 * 2**20
MAX_MEMBERS: Final = 1000
MAX_RATIO: Final = 200
"""Largest unpacked / packed size; map JSON reaches 20."""
FREE_BYTES: Final = 2**20
"""Unpacked size up to which the ratio is not limited."""

_CHUNK_BYTES: Final = 2**18
_CENTRAL_HEADER: Final = b"PK\x01\x02"
_ZIP_STARTS: Final = (b"PK\x03\x04", b"PK\x05\x06")
_METHODS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ZIP_ERRORS: Final = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    OSError,
    ValueError,
    RuntimeError,
)
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")


def scenario_from_upload(files: Mapping[str, bytes]) -> Scenario:
    """Read a scenario from one zip, or from a track file and a map.

    Raises:
        ArchiveError: too large, unsafe, or not exactly one scenario.
        InputError: a file in it is damaged.
    """
    total = sum(len(data) for data in files.values())
    if total > MAX_UPLOAD_BYTES:
        raise ArchiveError(
            f"The upload has {total / 2**20:.0f} MiB; "
            f"at most {MAX_UPLOAD_BYTES >> 20} MiB are taken."
        )
    zips = [name for name, data in files.items() if _is_zip(name, data)]
    if zips:
        if len(files) > 1:
            raise ArchiveError(
                "The upload has a zip and other files; expected one zip, "
                "or one track file with its map."
            )
        return _scenario_from_zip(zips[0], files[zips[0]])
    tracks, road_map = _choose(list(files), "The upload")
    return _read(tracks, files[tracks], road_map, files[road_map])


def scenarios_in_upload(files: Mapping[str, bytes]) -> tuple[str, ...]:
    """Names of the scenarios in a zip that has several; empty for other uploads.

    Raises:
        ArchiveError: unsafe, or no readable zip.
    """
    if not _is_one_zip(files):
        return ()
    ((name, data),) = files.items()
    with _opened(_shown(name), data) as archive:
        found = _scenarios(archive, _shown(name))
    return tuple(found) if len(found) > 1 else ()


def scenario_of_upload(files: Mapping[str, bytes], wanted: str) -> dict[str, bytes]:
    """Files of one of the ``scenarios_in_upload``, to be opened as an upload.

    Raises:
        ArchiveError: as above, or it is too large.
    """
    ((name, data),) = files.items()
    unpacked: dict[str, bytes] = {}
    with _opened(_shown(name), data) as archive:
        for member in _scenarios(archive, _shown(name))[wanted]:
            room = MAX_UNPACKED_BYTES - sum(map(len, unpacked.values()))
            content = _unpacked(archive, member, _shown(name), room)
            unpacked[_base(member.filename)] = content
    return unpacked


def files_in_upload(
    files: Mapping[str, bytes], wanted: Callable[[str], bool], limit: int
) -> Iterator[tuple[str, bytes]]:
    """Yield path and contents of the files of wanted names, also of those in zips.

    Raises:
        ArchiveError: those of a zip unpack to more than ``limit`` bytes, or it is damaged.
    """
    for name, data in files.items():
        if not _is_zip(name, data):
            if wanted(_base(name)) and len(data) <= limit:
                yield _base(name), data
            continue
        label, room = _shown(name), limit
        with _opened(label, data) as archive:
            for path, member in _members(archive, label).items():
                # Macs pack a hidden file beside each.
                if wanted(_base(path)) and not _base(path).startswith("."):
                    content = _unpacked(archive, member, label, room)
                    room -= len(content)
                    yield path, content


def _is_zip(name: str, data: bytes) -> bool:
    return name.lower().endswith(".zip") or data.startswith(_ZIP_STARTS)


def _is_one_zip(files: Mapping[str, bytes]) -> bool:
    return len(files) == 1 and all(
        _is_zip(name, data) and len(data) <= MAX_UPLOAD_BYTES
        for name, data in files.items()
    )


@contextlib.contextmanager
def _opened(label: str, data: bytes) -> Iterator[zipfile.ZipFile]:
    """Open a zip; what is wrong with it is told in one sentence."""
    # Counted before the directory is parsed, which may hold a million entries.
    if data.count(_CENTRAL_HEADER) > MAX_MEMBERS:
        raise ArchiveError(f"{label}: holds more than {MAX_MEMBERS} files.")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            yield archive
    except _ZIP_ERRORS as error:
        raise ArchiveError(
            f"{label}: this is not a readable zip; it may be cut off or damaged."
        ) from error


def _members(archive: zipfile.ZipFile, label: str) -> dict[str, zipfile.ZipInfo]:
    members: dict[str, zipfile.ZipInfo] = {}
    for member in archive.infolist():
        _check_member(member, label)
        if not member.is_dir():
            members[member.filename] = member
    return members


def _scenarios(
    archive: zipfile.ZipFile, label: str
) -> dict[str, tuple[zipfile.ZipInfo, ...]]:
    """Members of each scenario by its name: track file, map, other JSON files beside them.

    A map belongs to the track file of its folder that has its id, or is the only one.
    """
    members = _members(archive, label)
    shown = [name for name in members if not _base(name).startswith(".")]
    found: dict[str, tuple[zipfile.ZipInfo, ...]] = {}
    for tracks in sorted(name for name in shown if name.lower().endswith(".parquet")):
        folder = PurePosixPath(tracks).parent
        beside = [name for name in shown if PurePosixPath(name).parent == folder]
        parquets = [name for name in beside if name.lower().endswith(".parquet")]
        scenario = _base(tracks).removeprefix(TRACKS_PREFIX).removesuffix(".parquet")
        maps = [
            name
            for name in beside
            if is_map_name(_base(name))
            and (len(parquets) == 1 or _base(name) == map_name(scenario))
        ]
        if len(maps) != 1:
            continue
        is_alone = len(parquets) == 1
        name = folder.name if is_alone and folder.name else scenario
        names = [tracks, maps[0]]
        if is_alone:
            texts = [one for one in beside if one.lower().endswith(".json")]
            names += [one for one in texts if one not in names]
        if name in found:
            name = str(folder if is_alone else folder / name)
        found[name] = tuple(members[one] for one in names)
    return found


def _scenario_from_zip(name: str, data: bytes) -> Scenario:
    label = _shown(name)
    with _opened(label, data) as archive:
        members = _members(archive, label)
        tracks, road_map = _choose(list(members), label)
        parquet = _unpacked(archive, members[tracks], label, MAX_UNPACKED_BYTES)
        room = MAX_UNPACKED_BYTES - len(parquet)
        map_json = _unpacked(archive, members[road_map], label, room)
    return _read(tracks, parquet, road_map, map_json)


def _check_member(member: zipfile.ZipInfo, label: str) -> None:
    """Raise for names that leave the folder, for links, and for encrypted members."""
    name = member.orig_filename
    is_odd = (
        not name
        or name.startswith("/")
        or "\\" in name
        or ":" in name
        or ".." in name.split("/")
        or _CONTROL.search(name) is not None
    )
    if is_odd:
        raise ArchiveError(f"{label}: holds a file with the odd path {name[:60]!r}.")
    if stat.S_ISLNK(member.external_attr >> 16):
        raise ArchiveError(f"{label}: holds a link, {_shown(name)}; expected files.")
    if member.flag_bits & 1:
        raise ArchiveError(f"{label}: is encrypted; expected a zip without password.")


def _choose(names: list[str], label: str) -> tuple[str, str]:
    """Names of the only track file and the only map among files that are not hidden."""
    names = [name for name in names if not _base(name).startswith(".")]
    tables = [name for name in names if name.lower().endswith(".parquet")]
    tracks = [name for name in tables if is_tracks_name(_base(name))] or tables
    texts = [name for name in names if name.lower().endswith(".json")]
    maps = [name for name in texts if is_map_name(_base(name))] or [
        name for name in texts if _base(name) != "recipe.json"
    ]
    for found, what in ((tracks, "track file (.parquet)"), (maps, "map (.json)")):
        if len(found) == 1:
            continue
        if not found:
            held = listed([_shown(one) for one in names]) if names else "nothing"
            raise ArchiveError(f"{label}: holds no {what}; found {held}.")
        raise ArchiveError(
            f"{label}: holds {len(found)} files that could be the {what}, "
            f"{listed([_shown(one) for one in found])}; expected exactly one scenario."
        )
    return tracks[0], maps[0]


def _unpacked(
    archive: zipfile.ZipFile, member: zipfile.ZipInfo, label: str, room: int
) -> bytes:
    """Content of a member, read in chunks because its header may lie about the size."""
    if member.compress_type not in _METHODS:
        raise ArchiveError(
            f"{label}: {_shown(member.filename)} is packed with an unusual method; "
            "expected stored or deflated files."
        )
    allowed = min(room, max(FREE_BYTES, MAX_RATIO * member.compress_size))
    pieces, size = [], 0
    with archive.open(member) as stream:
        while piece := stream.read(_CHUNK_BYTES):
            pieces.append(piece)
            size += len(piece)
            if size > allowed:
                raise ArchiveError(
                    f"{label}: {_shown(member.filename)} unpacks to more than "
                    f"{allowed >> 20} MiB, which looks like a zip bomb."
                )
    return b"".join(pieces)


def _read(tracks: str, parquet: bytes, road_map: str, map_json: bytes) -> Scenario:
    tracks, road_map = _base(tracks), _base(road_map)
    name = tracks.removeprefix(TRACKS_PREFIX).removesuffix(".parquet")
    map_id = road_map.removeprefix(MAP_PREFIX).removesuffix(".json")
    label = name if is_scenario_id(name) else "upload"
    scenario = read_scenario_bytes(parquet, map_json, name=label)
    both_official = is_tracks_name(tracks) and is_map_name(road_map)
    # A file that was downloaded twice has another name; what is in it counts.
    ids = (name, scenario.scenario_id)
    if both_official and is_scenario_id(map_id) and map_id not in ids:
        raise ArchiveError(
            f"The map {_shown(road_map)} belongs to another scenario than "
            f"{_shown(tracks)}."
        )
    return scenario


def _base(name: str) -> str:
    return PurePosixPath(name.replace("\\", "/")).name


def _shown(name: str) -> str:
    """Name for a message: its last part, shortened, without control characters."""
    return _CONTROL.sub("?", _base(name))[:60] or "The upload"
