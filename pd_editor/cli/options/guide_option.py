"""``--guide``: guidance terms as texts of the shell, or as a JSON file.

A text is KIND:FIELD=VALUE,FIELD=VALUE, such as ``goal-point:agent=12,point=3.5/10``. Points
are X/Y in metres of the scene frame; several values are joined by +.
"""

import json
import types
import typing
from collections.abc import Sequence
from dataclasses import MISSING, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.base.errors import InputError, PdEditorError
from pd_editor.base.plain_text import one_line
from pd_editor.base.regular_file import read_regular
from pd_editor.editor.commands.json_values import from_json
from pd_editor.scene.guidance_terms import MAX_TERMS, GuidanceTerm, PairGuidance

MAX_FILE_BYTES: Final = 2**20
_UNITS: Final = ("_mps2", "_mps", "_m", "_s", "_id")
_OWN_NAMES: Final = {"agent_ids": "agents", "lane_ids": "lanes"}
_NOTHING: Final = "-"
"""Stands for a value that is not given, among several."""
_HIDDEN: Final = {"is_on"}


def guidance_terms_of(texts: Sequence[str]) -> tuple[GuidanceTerm, ...]:
    """Terms of texts, or of JSON files with a list of terms.

    Raises:
        InputError: a text cannot be read; the sentence names the nearest valid name.
    """
    terms: list[GuidanceTerm] = []
    for text in texts:
        terms += _of_file(Path(text)) if text.endswith(".json") else [_of_text(text)]
    if len(terms) > MAX_TERMS:
        raise InputError(f"--guide: {len(terms)} terms; at most {MAX_TERMS} are taken.")
    return tuple(terms)


def text_of(term: PairGuidance) -> str:
    """The text of a term on two agents; values by default are left out."""
    told = [
        f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}"
        for name, one in field_names(term.kind).items()
        if (value := getattr(term, one.name)) != one.default
    ]
    return f"{term.kind}:{','.join(told)}"


def field_names(kind: str) -> dict[str, Any]:
    """Fields of a kind by their names on the shell."""
    found: dict[str, Any] = {}
    for one in fields(KINDS[kind].value):
        if one.name not in _HIDDEN:
            name = _OWN_NAMES.get(one.name, one.name)
            for unit in _UNITS:
                name = name.removesuffix(unit)
            found[name.replace("_", "-")] = one
    return found


def _of_file(path: Path) -> list[GuidanceTerm]:
    where = f"--guide {one_line(str(path))}"
    raw = read_regular(path, max_bytes=MAX_FILE_BYTES, error=InputError)
    try:
        data = json.loads(raw)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: is not valid JSON.") from error
    listed = data if isinstance(data, list) else [data]
    return [
        _built(item, f"{where}, term {number}")
        for number, item in enumerate(listed, start=1)
    ]


def _of_text(text: str) -> GuidanceTerm:
    kind, _, rest = text.partition(":")
    if kind not in KINDS:
        raise InputError(
            f"--guide: there is no kind {one_line(kind)!r}; "
            f"{_nearest(kind, list(KINDS))}."
        )
    names = field_names(kind)
    hints = typing.get_type_hints(KINDS[kind].value)
    data: dict[str, Any] = {"kind": kind}
    for part in rest.split(",") if rest else ():
        name, equals, value = part.partition("=")
        if name not in names:
            raise InputError(
                f"--guide {kind}: there is no field {one_line(name)!r}; "
                f"{_nearest(name, list(names))}."
            )
        field = names[name]
        if not equals or not value:
            raise InputError(
                f"--guide {kind}: {name} lacks its value; expected {_form(name, hints[field.name])}."
            )
        if field.name in data:
            raise InputError(
                f"--guide {kind}: {name} is given twice; join several values by +."
            )
        data[field.name] = _value(hints[field.name], value, f"--guide {kind}: {name}")
    for name, field in names.items():
        is_needed = field.default is MISSING and field.default_factory is MISSING
        if is_needed and field.name not in data:
            raise InputError(
                f"--guide {kind}: give {_form(name, hints[field.name])} as well."
            )
    return _built(data, f"--guide {kind}")


def _built(data: Any, where: str) -> GuidanceTerm:
    try:
        return from_json(GuidanceTerm, data, where)
    except PdEditorError as error:
        raise InputError(str(error)) from error


def _value(hint: Any, text: str, where: str) -> Any:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        (inner,) = (arg for arg in args if arg is not type(None))
        return None if text == _NOTHING else _value(inner, text, where)
    if hint is float:
        return _number(text, where)
    if hint is int:
        if not text.removeprefix("-").isdecimal():
            raise InputError(f"{where} is {one_line(text)!r}; expected a whole number.")
        return int(text)
    if origin is tuple:
        if args == (float, float):
            parts = text.split("/")
            if len(parts) != 2:
                raise InputError(
                    f"{where} is {one_line(text)!r}; expected X/Y in metres."
                )
            return [_number(part, where) for part in parts]
        parts = text.split("+")
        if Ellipsis not in args and len(parts) != len(args):
            raise InputError(
                f"{where} is {one_line(text)!r}; expected {len(args)} points, X/Y+X/Y."
            )
        return [_value(args[0], part, where) for part in parts]
    return text


def _number(text: str, where: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(
            f"{where} is {one_line(text)!r}; expected a number."
        ) from error


def _nearest(name: str, names: list[str]) -> str:
    close = get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean {close[0]}"
    return f"expected one of {', '.join(names)}"


def _form(name: str, hint: Any) -> str:
    """How a field is written."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _form(name, args[0])
    if origin is typing.Literal:
        return f"{name}={' or '.join(args)}"
    if origin is not tuple:
        return f"{name}={'ID' if hint is str else 'NUMBER'}"
    if args == (float, float):
        return f"{name}=X/Y"
    one = "X/Y" if typing.get_origin(args[0]) is tuple else "ID"
    return f"{name}={one}+{one}"
