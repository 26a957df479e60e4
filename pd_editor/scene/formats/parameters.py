"""Values of OpenSCENARIO's parameters and expressions, and entries of its catalogs."""

import ast
import operator
import re
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, Final

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.scene.formats.packed_file import head_of, named_by
from pd_editor.scene.formats.xml_file import Place, parse_xml

_MOST_CHARACTERS: Final = 500
_MOST_FILES: Final = 50
_OPERATIONS: Final[dict[type, Callable[..., Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {
    "round": round, "floor": np.floor, "ceil": np.ceil, "sqrt": np.sqrt,
    "pow": np.float_power, "abs": abs, "sign": np.sign, "max": max, "min": min,
}  # fmt: skip


def set_parameters(
    root: etree._Element, given: Mapping[str, str] | None = None
) -> None:
    """Give attributes the values of parameters; what cannot be computed keeps its $."""
    # Files of the first days name them with the sign.
    values = {name.lstrip("$"): value for name, value in (given or {}).items()}
    for one in root.iter("ParameterDeclaration"):
        told = _value(one.get("value") or "", values)
        values.setdefault((one.get("name") or "").lstrip("$"), told)
    for one in root.iter(etree.Element):
        for name, text in one.items():
            if "$" in text:
                one.set(name, _value(text, values))


def _value(text: str, values: Mapping[str, str]) -> str:
    if text[1:] in values and text[0] == "$":
        return values[text[1:]]
    if not (text.startswith("${") and len(text) <= _MOST_CHARACTERS):
        return text
    expression = re.sub(
        r"\$(\w+)", lambda found: f"({values.get(found[1])})", text.strip()[2:-1]
    )
    try:
        return repr(float(_computed(ast.parse(expression, mode="eval").body)))
    except (
        ArithmeticError,
        KeyError,
        SyntaxError,
        TypeError,
        ValueError,
        RecursionError,
    ):
        return text


def _computed(node: ast.AST) -> Any:
    match node:
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.UnaryOp(op=op, operand=one):
            return _OPERATIONS[type(op)](_computed(one))
        case ast.BinOp(op=op, left=one, right=two):
            return _OPERATIONS[type(op)](_computed(one), _computed(two))
        case ast.Call(func=ast.Name(id=name), args=args):
            return _FUNCTIONS[name](*map(_computed, args))
    raise ValueError


def insert_catalogs(root: Place) -> bytes:
    """Put entries of catalogs where they are referred to; bytes of the catalogs' files.

    Catalogs lie where the file says, or beside it; references to others stay.
    """
    wanted = list(root.element.iter("CatalogReference"))
    names = {one.get("catalogName") or "" for one in wanted}
    beside = root.path.absolute().parent
    folders = [
        folder
        for one in root.children("CatalogLocations/*/Directory")
        for folder in named_by(root.path, one.get("path"))
    ]
    files = [
        file for one in folders if one.is_dir() for file in sorted(one.glob("*.xosc"))
    ]
    files += [beside / f"{name}.xosc" for name in sorted(names) if "/" not in name]
    entries: dict[tuple[str | None, str | None], etree._Element] = {}
    read = b""
    for file in dict.fromkeys(files[:_MOST_FILES]) if wanted else ():
        if file.is_file() and b"<catalog" in head_of(file):
            found, data = parse_xml(file, "OpenSCENARIO")
            read += data
            for catalog in found.element.iter("Catalog"):
                for one in catalog:
                    key = catalog.get("name"), one.get("name")
                    entries.setdefault(key, one)
    for one in wanted:
        entry = entries.get((one.get("catalogName"), one.get("entryName")))
        if entry is not None:
            own = deepcopy(entry)
            assigned = one.iter("ParameterAssignment")
            set_parameters(
                own,
                {n.get("parameterRef") or "": n.get("value") or "" for n in assigned},
            )
            one.getparent().replace(one, own)
    return read
