"""Pickles of arrays and plain containers; whatever else they name is refused, not run."""

import collections
import io
import pickle
from pathlib import Path
from typing import Any, Final

import numpy as np

from pd_editor.base.errors import FormatError
from pd_editor.base.regular_file import read_regular

MAX_PICKLE_BYTES: Final = 256 * 2**20


def _empty_array(cls: object, shape: object, dtype: object) -> np.ndarray:
    """An array of no size, which the pickle then fills with the bytes that it holds."""
    del cls, shape, dtype
    return np.ndarray.__new__(np.ndarray, (0,), "b")


def _dtype(code: object, *rest: object) -> np.dtype:
    """A plain element type."""
    del rest
    if not isinstance(code, str) or len(code) > 16:
        raise pickle.UnpicklingError("an element type that is no short text")
    return np.dtype(code).newbyteorder("=")


def _scalar(dtype: np.dtype, data: bytes) -> Any:
    """A number of an array's element type."""
    if dtype.hasobject or len(data) != dtype.itemsize:
        raise pickle.UnpicklingError("a number that is none")
    return np.frombuffer(data, dtype)[0]


def _default_dict(*factory: object) -> dict[Any, Any]:
    """A plain dictionary; the factory of missing values is left out."""
    del factory
    return {}


_NUMPY: Final = {"_reconstruct": _empty_array, "scalar": _scalar}
_KNOWN: Final[dict[str, dict[str, Any]]] = {
    "numpy": {"ndarray": None, "dtype": _dtype},
    "numpy.core.multiarray": _NUMPY,
    "numpy._core.multiarray": _NUMPY,
    "collections": {
        "OrderedDict": collections.OrderedDict,
        "defaultdict": _default_dict,
    },
    "builtins": {
        "set": set,
        "frozenset": frozenset,
        "int": None,
        "float": None,
        "list": None,
        "dict": None,
    },
}
"""What a pickle may name: what stands for it here; None where it is not called."""


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str, /) -> Any:
        names = _KNOWN.get(module, {})
        if name not in names:
            raise pickle.UnpicklingError(f"{module}.{name}")
        return names[name]

    def persistent_load(self, pid: object, /) -> Any:
        del pid
        raise pickle.UnpicklingError("an object that lies elsewhere")


def read_plain_pickle(path: Path) -> tuple[Any, bytes]:
    """The value in a pickle, and the file's bytes; nothing that it names is called.

    Raises:
        FormatError: it names something other than arrays and plain containers, or is
            damaged.
    """
    data = read_regular(path, max_bytes=MAX_PICKLE_BYTES, error=FormatError)
    try:
        return _Unpickler(io.BytesIO(data)).load(), data
    except pickle.UnpicklingError as error:
        raise FormatError(
            f"{path}: holds {error}; expected arrays, texts, numbers and containers only."
        ) from error
    except Exception as error:
        # A damaged pickle can raise anything.
        raise FormatError(
            f"{path}: is no readable pickle ({type(error).__name__})."
        ) from error
