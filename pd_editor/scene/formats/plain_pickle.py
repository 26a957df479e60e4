"""Pickles of arrays and plain containers; whatever else they name is refused, not run."""

import collections
import io
import pickle
import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from pd_editor.base.errors import FormatError
from pd_editor.scene.formats.packed_file import read_unpacked

_CODE: Final = re.compile(r"[biufSU]\d{1,6}|O8|b1|bool")


class _RefusedError(Exception):
    """A pickle holds what is not read."""


class _ElementType:
    """An element type of arrays: a number, a truth value or a text, of some byte order."""

    def __init__(self, code: object, *rest: object) -> None:
        del rest
        if not isinstance(code, str) or not _CODE.fullmatch(code):
            raise _RefusedError(f"arrays of {str(code)[:20]!r}")
        self.code, self.order = code, "="

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        if state[1] in ("<", ">"):
            self.order = state[1]

    def values(self, raw: object) -> np.ndarray:
        """The numbers in some bytes; objects come as a list."""
        if self.code.startswith("O") and isinstance(raw, list):
            return np.array([None, *raw], object)[1:]
        if not isinstance(raw, bytes) or self.code.startswith("O"):
            raise _RefusedError("an array without its values")
        return np.frombuffer(raw, np.dtype(self.order + self.code))


class _Array:
    """An array, of which the pickle tells shape, element type and bytes afterwards."""

    def __init__(self, *rest: object) -> None:
        del rest
        self.found: np.ndarray = np.zeros(0)

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, shape, element, is_fortran, raw = state
        order: Any = "F" if is_fortran else "C"
        self.found = element.values(raw).reshape(shape, order=order)


def _scalar(element: _ElementType, data: bytes) -> Any:
    """A number of an array's element type."""
    (value,) = element.values(data).tolist()
    return value


def _default_dict(*factory: object) -> dict[Any, Any]:
    """A plain dictionary; the factory of missing values is left out."""
    del factory
    return {}


def _bytes(text: str, codec: str) -> bytes:
    """Bytes, which older pickles hold as a text."""
    if codec != "latin1":
        raise _RefusedError(f"a text in {codec[:20]!r}")
    return text.encode("latin1")


def _array_of(raw: object, element: _ElementType, shape: Any, order: Any) -> np.ndarray:
    """An array in a pickle of protocol 5."""
    return element.values(bytes(raw) if isinstance(raw, bytearray) else raw).reshape(
        shape, order=order
    )


_NUMPY: Final = {"_reconstruct": _Array, "scalar": _scalar}
_NUMERIC: Final = {"_frombuffer": _array_of}
_BUILTINS: Final[dict[str, Any]] = {
    "set": set,
    "frozenset": frozenset,
    "int": None,
    "long": None,
    "float": None,
    "list": None,
    "dict": None,
}
_KNOWN: Final[dict[str, dict[str, Any]]] = {
    "numpy": {"ndarray": None, "dtype": _ElementType},
    "numpy.core.multiarray": _NUMPY,
    "numpy._core.multiarray": _NUMPY,
    "numpy.core.numeric": _NUMERIC,
    "numpy._core.numeric": _NUMERIC,
    # Of a plain dictionary with functions.
    "metadrive.scenario.scenario_description": {"ScenarioDescription": dict},
    "collections": {
        "OrderedDict": collections.OrderedDict,
        "defaultdict": _default_dict,
    },
    "builtins": _BUILTINS,
    "__builtin__": _BUILTINS,
    "_codecs": {"encode": _bytes},
}
"""What a pickle may name: what stands for it here; None where it is not called."""


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str, /) -> Any:
        names = _KNOWN.get(module, {})
        if name not in names:
            raise _RefusedError(f"{module}.{name}")
        return names[name]

    def persistent_load(self, pid: object, /) -> Any:
        del pid
        raise _RefusedError("an object that lies elsewhere")


def _plain(value: Any, known: dict[int, tuple[Any, Any]]) -> Any:
    """A value with its arrays as such; what occurs again is converted once."""
    if id(value) in known:
        return known[id(value)][1]
    found = value
    if isinstance(value, _Array):
        found = value.found
        if found.dtype == object:
            found = _plain(found.tolist(), known)
    elif isinstance(value, dict):
        found = {_plain(key, known): _plain(one, known) for key, one in value.items()}
    elif isinstance(value, list | tuple | set | frozenset):
        found = type(value)(_plain(one, known) for one in value)
    # The value is kept, so that its id stays its own.
    known[id(value)] = value, found
    return found


def read_plain_pickle(path: Path) -> tuple[Any, bytes]:
    """The value in a pickle, and the file's bytes; nothing that it names is called.

    Raises:
        FormatError: it names something other than arrays and plain containers, or is
            damaged.
    """
    content, data = read_unpacked(path)
    try:
        return _plain(_Unpickler(io.BytesIO(content)).load(), {}), data
    except _RefusedError as error:
        raise FormatError(
            f"{path}: holds {error}; expected arrays, texts, numbers and containers only."
        ) from error
    except Exception as error:
        # A damaged pickle can raise anything.
        raise FormatError(
            f"{path}: is no readable pickle; it is damaged, not whole, or of another kind."
        ) from error
