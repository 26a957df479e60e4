"""JSON form of the values of commands, based on their type annotations."""

import base64
import binascii
import math
import types
import typing
import zlib
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from functools import cache, partial
from typing import Any, Final

import numpy as np

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.base.errors import PdEditorError, RecipeError
from pd_editor.base.plain_text import MAX_TEXT_CHARACTERS, is_note
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scene_limits import MAX_STATES

_MAX_ARRAY_VALUES: Final = 2 * MAX_STATES
"""Limit of stored arrays, so that a small file cannot fill the memory."""
_MAX_INTEGER: Final = 2**63 - 1
OMIT_NONE: Final = "omit_none"
"""Metadata of a dataclass field that is written only if it is not None."""
_TAG: Final = "kind"
"""Class variable and JSON field that tell the dataclasses of a union apart."""
_ARRAY_KEYS: Final = {"dtype", "shape", "zlib"}


def to_json(value: Any) -> Any:
    """Convert a value to JSON values, exactly reversible by ``from_json``.

    Arrays become float32, little-endian, zlib-compressed, base64. A dataclass with a
    class variable ``kind`` is one of several in a union, and is stored with its kind.
    """
    if isinstance(value, Enum):
        return value.value
    if is_dataclass(value) and not isinstance(value, type):
        tag = {_TAG: _kind(type(value))} if _kind(type(value)) else {}
        return tag | {
            item.name: to_json(getattr(value, item.name))
            for item in fields(value)
            if OMIT_NONE not in item.metadata or getattr(value, item.name) is not None
        }
    if isinstance(value, np.ndarray):
        packed = zlib.compress(np.ascontiguousarray(value, "<f4").tobytes())
        text = base64.b64encode(packed).decode("ascii")
        return {"dtype": "float32", "shape": list(value.shape), "zlib": text}
    if isinstance(value, Mapping):
        return {str(to_json(key)): to_json(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [to_json(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


def from_json(hint: Any, data: Any, where: str) -> Any:
    """Convert JSON values to a value of type ``hint``.

    Raises:
        RecipeError: ``data`` does not fit; the sentence starts with ``where``.
    """
    return _reader(hint)(data, where)


@cache
def _reader(hint: Any) -> Callable[[Any, str], Any]:
    """What converts values to a type, found once: lists have thousands of cards."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType) or hint is GuidanceTerm:
        return partial(_union_from_json, args or (hint,))
    if origin is typing.Literal:
        return partial(_literal_from_json, args)
    if origin is tuple:
        return partial(_tuple_from_json, args)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return partial(_mapping_from_json, args)
    if getattr(hint, "array_type", None) is np.ndarray:
        return partial(_array_from_json, hint)
    if isinstance(hint, type) and is_dataclass(hint):
        return partial(_dataclass_from_json, hint)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return partial(_enum_from_json, hint)
    return partial(_scalar_from_json, hint)


def _literal_from_json(args: tuple[Any, ...], data: Any, where: str) -> Any:
    if not any(type(data) is type(arg) and data == arg for arg in args):
        raise _misfit(where, f"one of {', '.join(map(str, args))}", data)
    return data


def _mapping_from_json(args: tuple[Any, ...], data: Any, where: str) -> Any:
    if not isinstance(data, dict):
        raise _misfit(where, "an object", data)
    return {
        from_json(args[0], key, where): from_json(args[1], item, f"{where}.{key}")
        for key, item in data.items()
    }


def _enum_from_json(hint: type[Enum], data: Any, where: str) -> Enum:
    try:
        return hint(data)
    except (ValueError, TypeError) as error:
        names = ", ".join(str(member.value) for member in hint)
        raise _misfit(where, f"one of {names}", data) from error


def _misfit(where: str, expected: str, data: Any) -> RecipeError:
    shown = repr(data)
    shown = shown if len(shown) <= 40 else shown[:37] + "..."
    return RecipeError(f"{where} must be {expected}, not {shown}.")


def _union_from_json(args: tuple[Any, ...], data: Any, where: str) -> Any:
    """A value of one of several types: dataclasses with kinds, None, at most one other."""
    if data is None and type(None) in args:
        return None
    by_kind = {_kind(arg): arg for arg in args if _kind(arg)}
    if GuidanceTerm in args:
        by_kind |= {name: one.value for name, one in KINDS.items()}
    known = (type(None), GuidanceTerm, *by_kind.values())
    others = [arg for arg in args if arg not in known]
    tag = data.get(_TAG) if isinstance(data, dict) else None
    if others and not (by_kind and tag is not None):
        return from_json(others[0], data, where)
    if tag is None:
        raise _misfit(where, "an object that names its kind", data)
    if not isinstance(tag, str) or tag not in by_kind:
        raise _misfit(f"{where}.{_TAG}", f"one of {', '.join(by_kind)}", tag)
    return _dataclass_from_json(by_kind[tag], data, where)


@cache
def _kind(hint: Any) -> str:
    """Kind of a dataclass in a union; empty: it has none."""
    is_class = isinstance(hint, type) and is_dataclass(hint)
    kind = getattr(hint, _TAG, "") if is_class else ""
    return kind if isinstance(kind, str) else ""


def _tuple_from_json(args: tuple[Any, ...], data: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(data, list):
        raise _misfit(where, "a list", data)
    if not data and args[1:] == (Ellipsis,):
        return ()
    if len(args) == 2 and args[1] is Ellipsis:
        args = (args[0],) * len(data)
    if len(args) != len(data):
        raise _misfit(where, f"a list of {len(args)}", data)
    return tuple(
        from_json(arg, item, f"{where}[{index}]")
        for index, (arg, item) in enumerate(zip(args, data, strict=True))
    )


def _scalar_from_json(hint: type, data: Any, where: str) -> Any:
    if hint is str is type(data) and is_note(data):
        return data
    is_bool = isinstance(data, bool)
    if hint is float:
        if is_bool or not isinstance(data, int | float):
            raise _misfit(where, "a number", data)
        try:
            value = float(data)
        except OverflowError as error:
            raise _misfit(where, "a finite number", data) from error
        if not math.isfinite(value):
            raise _misfit(where, "a finite number", data)
        return value
    assert hint in (str, int, bool), hint
    name = {str: "a text", int: "a whole number", bool: "true or false"}[hint]
    if not isinstance(data, hint) or is_bool != (hint is bool):
        raise _misfit(where, name, data)
    if isinstance(data, int) and abs(data) > _MAX_INTEGER:
        raise _misfit(where, f"a whole number up to {_MAX_INTEGER}", data)
    if isinstance(data, str) and not is_note(data):
        raise _misfit(
            where,
            f"a text without control characters of at most {MAX_TEXT_CHARACTERS}"
            " characters",
            data,
        )
    return data


@cache
def _fields(cls: type) -> dict[str, tuple[Any, Callable[[Any, str], Any], bool]]:
    """Type, reader, and whether it must be there, of each field of a dataclass."""
    hints = typing.get_type_hints(cls)
    return {
        one.name: (
            hints[one.name],
            _reader(hints[one.name]),
            one.default is MISSING and one.default_factory is MISSING,
        )
        for one in fields(cls)
    }


def _dataclass_from_json(cls: Any, data: Any, where: str) -> Any:
    if not isinstance(data, dict):
        raise _misfit(where, "an object", data)
    known = _fields(cls)
    if _kind(cls) and data.get(_TAG, _kind(cls)) == _kind(cls):
        data = {name: item for name, item in data.items() if name != _TAG}
    for name in data:
        if name not in known:
            raise RecipeError(f"{where} has an unknown field {name!r}.")
    values: dict[str, Any] = {}
    sizes: dict[str, int] = {}
    for name, (hint, read, is_needed) in known.items():
        if name in data:
            value = values[name] = read(data[name], f"{where}.{name}")
            if isinstance(value, np.ndarray):
                _check_axes(hint, value, sizes, f"{where}.{name}")
        elif is_needed:
            raise RecipeError(f"{where} lacks the field {name!r}.")
    return _built(cls, values, where)


def _built(cls: Callable[..., Any], values: dict[str, Any], where: str) -> Any:
    try:
        return cls(**values)
    except PdEditorError as error:
        raise RecipeError(f"{where}: {error}") from error


def _check_axes(
    hint: Any, value: np.ndarray, sizes: dict[str, int], where: str
) -> None:
    """Raise for arrays of one value whose common axes have different lengths.

    ``sizes`` collects the lengths of axes by name.
    """
    for axis, size in zip(hint.dim_str.split(), value.shape, strict=True):
        if not axis.isdigit() and sizes.setdefault(axis, size) != size:
            raise RecipeError(
                f"{where} has the shape {list(value.shape)}; expected"
                f" [{hint.dim_str}] with {axis} = {sizes[axis]} as before."
            )


def _array_from_json(hint: Any, data: Any, where: str) -> np.ndarray:
    if not isinstance(data, dict) or set(data) != _ARRAY_KEYS:
        raise _misfit(where, "an array of dtype, shape and zlib", data)
    shape = from_json(tuple[int, ...], data["shape"], f"{where}.shape")
    axes = hint.dim_str.split()
    fits = axes == ["..."] or (
        len(axes) == len(shape)
        and all(
            not axis.isdigit() or int(axis) == size
            for axis, size in zip(axes, shape, strict=True)
        )
    )
    if not fits:
        raise RecipeError(
            f"{where} has the shape {list(shape)[:8]}; expected [{hint.dim_str}]."
        )
    if data["dtype"] != "float32" or not isinstance(data["zlib"], str):
        raise RecipeError(f"{where} must hold float32 values as text.")
    if min(shape, default=0) < 0 or math.prod(shape) > _MAX_ARRAY_VALUES:
        raise RecipeError(
            f"{where} has the impossible shape {list(shape)}; expected at most "
            f"{_MAX_ARRAY_VALUES} values."
        )
    num_bytes = 4 * math.prod(shape)
    try:
        packed = base64.b64decode(data["zlib"], validate=True)
        raw = zlib.decompressobj().decompress(packed, num_bytes + 1)
    except (binascii.Error, ValueError, zlib.error) as error:
        raise RecipeError(f"{where} holds a damaged array.") from error
    if len(raw) != num_bytes:
        raise RecipeError(f"{where} holds more or fewer values than its shape says.")
    return np.frombuffer(raw, "<f4").reshape(shape).astype(np.float32)
