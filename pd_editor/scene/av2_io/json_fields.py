"""Typed access to the fields of a parsed JSON map; errors name file and entry."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, TypeVar

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import MapFileError
from pd_editor.base.regular_file import json_value
from pd_editor.scene.scene_limits import MAX_COORDINATE_M

MAX_JSON_BYTES: Final = 16 * 2**20
"""Largest map that is parsed; official ones have less than 1 MiB."""

_Choice = TypeVar("_Choice", bound=StrEnum)


@dataclass(frozen=True, kw_only=True)
class JsonObject:
    """A JSON object with its location for errors, for example ``x.json: lane 5``."""

    place: str
    fields: Mapping[str, Any]

    def error(self, what: str) -> MapFileError:
        """Error that names this object."""
        return MapFileError(f"{self.place}: {what}")

    def get(self, name: str) -> Any:
        """Value of a required field.

        Raises:
            MapFileError: the field is missing.
        """
        if name not in self.fields:
            raise self.error(f"field {name!r} is missing.")
        return self.fields[name]

    def section(self, name: str, most: int) -> list["JsonObject"]:
        """The objects in a section of the map; none if it is missing."""
        entries = self.fields.get(name, {})
        if not isinstance(entries, dict):
            raise self.error(f"section {name!r} is not a JSON object.")
        if len(entries) > most:
            raise self.error(
                f"section {name!r} has {len(entries)} entries; at most {most} are "
                "opened."
            )
        found = []
        for key, entry in entries.items():
            place = f"{self.place}: {name}, {key[:40]}"
            if not isinstance(entry, dict):
                raise MapFileError(f"{place}: expected a JSON object.")
            found.append(JsonObject(place=place, fields=entry))
        return found

    def integer(self, name: str) -> int:
        """Value of a required integer field."""
        value = self.get(name)
        if not _is_id(value):
            raise self.error(f"field {name!r} is {_short(value)}, not a whole number.")
        return value

    def optional_integer(self, name: str) -> int | None:
        """Value of an integer field; None if it is null or missing."""
        return None if self.fields.get(name) is None else self.integer(name)

    def integers(self, name: str) -> tuple[int, ...]:
        """Value of a required list of integers."""
        values = self.get(name)
        if not isinstance(values, list) or not all(_is_id(value) for value in values):
            raise self.error(f"field {name!r} is not a list of whole numbers.")
        return tuple(values)

    def flag(self, name: str) -> bool:
        """Value of a required boolean field."""
        value = self.get(name)
        if not isinstance(value, bool):
            raise self.error(f"field {name!r} is {_short(value)}, not true or false.")
        return value

    def choice(self, name: str, choices: type[_Choice]) -> _Choice:
        """Value of a required field as a member of an enumeration."""
        value = self.get(name)
        try:
            return choices(value)
        except ValueError as error:
            expected = ", ".join(choices)
            raise self.error(
                f"field {name!r} is {_short(value)}; expected one of {expected}."
            ) from error

    def points(
        self, name: str, min_points: int, origin_m: Float[np.ndarray, "2"]
    ) -> Float[np.ndarray, "N 3"]:
        """Points {x, y, z} of a required list, relative to an origin in the plane."""
        listed = self.get(name)
        try:
            flat = [
                value
                for point in listed
                for value in (point["x"], point["y"], point["z"])
            ]
            values = np.array(flat)
        except (TypeError, KeyError, ValueError, OverflowError) as error:
            raise self.error(
                f"field {name!r} is not a list of points with x, y and z."
            ) from error
        if len(values) < 3 * min_points:
            raise self.error(
                f"field {name!r} has {len(values) // 3} point(s); "
                f"expected at least {min_points}."
            )
        if values.dtype.kind not in "if" or values.ndim != 1:
            raise self.error(f"field {name!r} holds coordinates that are not numbers.")
        points = values.astype(float).reshape(-1, 3)
        # The comparison is also false for NaN.
        if not (np.abs(points) <= MAX_COORDINATE_M).all():
            raise self.error(
                f"field {name!r} holds a coordinate that is not finite, or beyond "
                f"{MAX_COORDINATE_M:g} m."
            )
        points[:, :2] -= origin_m
        return points

    def others(self, known: frozenset[str]) -> dict[str, Any]:
        """Fields whose names are not among the known ones."""
        return {name: self.fields[name] for name in self.fields if name not in known}


def parse_json_object(data: bytes, file_name: str) -> JsonObject:
    """Parse a JSON file that holds one object.

    Raises:
        MapFileError: it is no JSON object.
    """
    if len(data) > MAX_JSON_BYTES:
        raise MapFileError(
            f"{file_name}: is larger than {MAX_JSON_BYTES >> 20} MiB, the largest map "
            "that is read."
        )
    try:
        fields = json_value(data)
    except ValueError as error:
        raise MapFileError(
            f"{file_name}: this is not readable JSON; it may be cut off or damaged."
        ) from error
    if not isinstance(fields, dict):
        raise MapFileError(f"{file_name}: expected an Argoverse 2 map, a JSON object.")
    return JsonObject(place=file_name, fields=fields)


def _is_id(value: Any) -> bool:
    is_integer = isinstance(value, int) and not isinstance(value, bool)
    return is_integer and abs(value) < 2**63


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
