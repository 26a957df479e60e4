"""Shards: compact files of recordings and their windows, for training.

A shard is a zip archive. ``index.json`` has the format's version and the windows;
``N/about.json`` describes recording N and its map, ``N/rows.bin`` has its states and
``N/points.bin`` the map's points, both as integers (see ``recording``). Positions
are rounded to 1 cm, headings to 1 mrad, velocities to 2 cm/s, the map to 1 mm. Equal
contents give equal bytes.
"""

import io
import json
import lzma
import os
import zipfile
import zlib
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import InputError
from pd_editor.experiments.recordings.clip import (
    FUTURE_STEPS,
    PAST_STEPS,
    TrackingNoise,
    cut_scenario,
    has_focal_agent,
)
from pd_editor.experiments.recordings.recording import (
    Recording,
    Window,
    coded_recording,
    decoded_recording,
)
from pd_editor.scene.scenario import Scenario

SHARD_SUFFIX: Final = ".shard"
FORMAT_VERSION: Final = 1
MAX_MEMBER_BYTES: Final = 256 * 2**20
_CHUNK_BYTES: Final = 4096
_INDEX_NAME: Final = "index.json"
_PART_NAMES: Final = ("about.json", "rows.bin", "points.bin")
_DATE: Final = (1980, 1, 1, 0, 0, 0)
_DAMAGE: Final = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    KeyError,
    IndexError,
    TypeError,
    ValueError,
    AttributeError,
    AssertionError,
    NotImplementedError,
    RuntimeError,
    OverflowError,
)
"""Exceptions of the standard library and NumPy for damaged files."""


def shard_bytes(recordings: Iterable[tuple[Recording, Sequence[Window]]]) -> bytes:
    """Encode recordings and their windows as the bytes of a shard."""
    sink = io.BytesIO()
    entries = []
    with zipfile.ZipFile(sink, "w") as archive:
        for number, (recording, windows) in enumerate(recordings):
            about, rows, points = coded_recording(recording)
            parts = (_json_bytes(about), rows, points)
            for name, data in zip(_PART_NAMES, parts, strict=True):
                _store(archive, f"{number}/{name}", data)
            entries.append(
                {
                    "name": recording.name,
                    "num_steps": recording.num_steps,
                    "windows": [
                        [one.current_step, *one.center_m, one.focal_id, one.seed]
                        for one in windows
                    ],
                }
            )
        index = {"version": FORMAT_VERSION, "recordings": entries}
        _store(archive, _INDEX_NAME, _json_bytes(index))
    return sink.getvalue()


def _store(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    info = zipfile.ZipInfo(name, _DATE)
    info.compress_type = zipfile.ZIP_LZMA
    archive.writestr(info, data)


def _json_bytes(value: Any) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode()


class ShardReader:
    """Reader of a shard, or of all shards in a folder in the order of their names.

    Recordings are decoded on demand and cached, so that neighbouring windows are
    cheap. Readers can be pickled; no file is kept open.
    """

    def __init__(
        self, path: Path | str, *, num_kept: int = 8, skips_damaged: bool = False
    ) -> None:
        """Read the index of windows; ``num_kept`` decoded recordings are cached.

        Raises:
            InputError: there is no shard, or one, or each that could be skipped, is
                damaged.
        """
        path = Path(path)
        files = sorted(path.glob(f"*{SHARD_SUFFIX}")) if os.path.isdir(path) else [path]
        self.num_kept = num_kept
        self.files: list[Path] = []
        self.recordings: list[tuple[Path, int]] = []
        """File, and index within the file, of each recording."""
        self.windows: list[tuple[int, Window]] = []
        """Index into ``recordings``, and window."""
        error = InputError(f"{path}: there is no shard (*{SHARD_SUFFIX}) in it.")
        for file in files:
            try:
                self._add(file)
            except InputError as caught:
                if not skips_damaged:
                    raise
                error = caught
        if not self.files:
            raise error
        self.num_damaged = len(files) - len(self.files)
        self._kept: OrderedDict[int, Recording] = OrderedDict()

    def _add(self, file: Path) -> None:
        for number, entry in enumerate(_read_index(file)):
            self.windows += [(len(self.recordings), one) for one in entry]
            self.recordings.append((file, number))
        self.files.append(file)

    def __len__(self) -> int:
        return len(self.windows)

    def recording(self, place: int) -> Recording:
        """Decode a recording, given its index into ``recordings``.

        Raises:
            InputError: the file is damaged or gone.
        """
        found = self._kept.pop(place, None)
        if found is None:
            found = _read_recording(*self.recordings[place])
            while len(self._kept) >= self.num_kept:
                self._kept.popitem(last=False)
        self._kept[place] = found
        return found

    def window(self, index: int, *, noise: TrackingNoise | None = None) -> Scenario:
        """Extract the scenario of a window; see ``cut_scenario``.

        Raises:
            InputError: the file is damaged or gone.
        """
        place, window = self.windows[index]
        recording = self.recording(place)
        if not has_focal_agent(recording, window):
            raise _damaged(self.recordings[place][0], "a window has no focal agent")
        return cut_scenario(recording, window, noise=noise)


def _read_index(file: Path) -> list[list[Window]]:
    data = _members(file, [_INDEX_NAME])[0]
    try:
        index = json.loads(data)
        version = index["version"]
        if version != FORMAT_VERSION:
            raise InputError(
                f"{file}: is a shard of version {version}; this program reads version "
                f"{FORMAT_VERSION}."
            )
        return [
            [_window(values, entry["num_steps"]) for values in entry["windows"]]
            for entry in index["recordings"]
        ]
    except _DAMAGE as error:
        raise _damaged(file, str(error)) from error


def _window(values: list[Any], num_steps: int) -> Window:
    step, x, y, focal_id, seed = values
    if not PAST_STEPS <= step < num_steps - FUTURE_STEPS:
        raise ValueError(f"a window is at step {step} of {num_steps}")
    return Window(
        current_step=step,
        center_m=(float(x), float(y)),
        focal_id=str(focal_id),
        seed=int(seed),
    )


def _read_recording(file: Path, number: int) -> Recording:
    names = [f"{number}/{name}" for name in _PART_NAMES]
    about, rows, points = _members(file, names)
    try:
        return decoded_recording(json.loads(about), rows, points)
    except _DAMAGE as error:
        raise _damaged(file, str(error)) from error


def _members(file: Path, names: list[str]) -> list[bytes]:
    try:
        with zipfile.ZipFile(file) as archive:
            return [_member(archive, name) for name in names]
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}).") from error
    except _DAMAGE as error:
        raise _damaged(file, str(error)) from error


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    """Content of a member, read in chunks because its header may lie about the size."""
    content = bytearray()
    with archive.open(name) as stream:
        while piece := stream.read(_CHUNK_BYTES):
            content += piece
            if len(content) > MAX_MEMBER_BYTES:
                raise ValueError(
                    f"{name} unpacks to more than {MAX_MEMBER_BYTES} bytes"
                )
    return bytes(content)


def _damaged(file: Path, reason: str) -> InputError:
    return InputError(f"{file}: is damaged or not a shard ({reason}).")
