"""Scenes that a visitor has rejected: lists leave them out."""

import contextlib
import json
from pathlib import Path
from typing import Final

from filelock import FileLock

from pd_editor.base.errors import InputError
from pd_editor.base.regular_file import json_value, read_regular, write_whole

REJECTED_NAME: Final = "rejected.json"
_MAX_BYTES: Final = 16 << 20


class Rejected:
    """Places of rejected scenes, in a file that tabs and programs share."""

    def __init__(self, folder: Path) -> None:
        """Use the file in a folder, which is made when needed."""
        self._path = folder / REJECTED_NAME
        self._known: tuple[int, frozenset[str]] = -1, frozenset()

    def stamp(self) -> int:
        """A number that changes with the file."""
        try:
            return self._path.stat().st_mtime_ns
        except OSError:
            return 0

    def places(self) -> frozenset[str]:
        """Places of all of them; none of a file that is none of ours."""
        stamp = self.stamp()
        if stamp != self._known[0]:
            found: object = None
            with contextlib.suppress(InputError, ValueError):
                found = json_value(read_regular(self._path, max_bytes=_MAX_BYTES))
            listed = found if isinstance(found, list) else []
            places = frozenset(one for one in listed if isinstance(one, str))
            self._known = stamp, places
        return self._known[1]

    def toggle(self, place: str) -> bool:
        """Reject a scene, or take that back; returns whether it is rejected now.

        Raises:
            ExportError: the file cannot be written.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(self._path.with_suffix(".lock")):
            self._known = -1, frozenset()
            places = self.places() ^ {place}
            write_whole(self._path, json.dumps(sorted(places)).encode())
        return place in places
