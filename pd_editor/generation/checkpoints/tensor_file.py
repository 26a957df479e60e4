"""Files of named tensors: written atomically, read without executing code."""

import hashlib
import json
from collections.abc import Mapping, Set
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, Literal, TypeVar, get_args, get_origin

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from pd_editor.base.errors import ModelError
from pd_editor.base.regular_file import check_regular, write_whole
from pd_editor.generation.defaults import MAX_FILE_BYTES

FORMAT: Final = "pd-editor-tensors-1"
_METADATA_KEY: Final = "pd-editor"
_Config = TypeVar("_Config")


@dataclass(frozen=True, kw_only=True, eq=False)
class TensorFile:
    """Contents of a file of tensors."""

    about: Mapping[str, Any]
    """Plain JSON values."""
    tensors: Mapping[str, Tensor]
    sha256: str


def write_tensors(
    path: Path, kind: str, tensors: Mapping[str, Tensor], about: Mapping[str, Any]
) -> str:
    """Write tensors with their metadata; equal input gives equal bytes.

    A reader expects a certain kind, such as ``traj``.

    Returns:
        The file's SHA-256.

    Raises:
        ModelError: the file cannot be written.
    """
    metadata_values = {"format": FORMAT, "kind": kind, "about": about}
    # One entry, because the library writes several in arbitrary order.
    metadata = {_METADATA_KEY: json.dumps(metadata_values, sort_keys=True)}
    plain = {name: one.detach().cpu().contiguous() for name, one in tensors.items()}
    data = save(plain, metadata)
    write_whole(path, data, ModelError)
    return hashlib.sha256(data).hexdigest()


def read_tensors(path: Path, kind: str) -> TensorFile:
    """Read a file of tensors onto the CPU without executing code.

    Raises:
        ModelError: the file is missing, damaged, foreign, or of another kind.
    """
    check_regular(path, max_bytes=MAX_FILE_BYTES, error=ModelError)
    try:
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        with safe_open(path, framework="pt", device="cpu") as opened:
            metadata = opened.metadata() or {}
            metadata_values = json.loads(metadata.get(_METADATA_KEY, "{}"))
            tensors = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118
    except OSError as error:
        raise ModelError(
            f"{path}: cannot be read ({error.strerror or error})."
        ) from error
    except (SafetensorError, ValueError, RecursionError, MemoryError) as error:
        raise ModelError(
            f"{path}: is damaged or no safetensors file ({error})."
        ) from error
    if not isinstance(metadata_values, dict) or metadata_values.get("format") != FORMAT:
        raise ModelError(
            f"{path}: was written by another program or version; expected format "
            f"{FORMAT}."
        )
    if metadata_values.get("kind") != kind:
        raise ModelError(
            f"{path}: holds {metadata_values.get('kind')!r}; expected {kind!r}."
        )
    about = metadata_values.get("about")
    if not isinstance(about, dict):
        raise ModelError(f"{path}: does not say what its tensors are about.")
    return TensorFile(about=about, tensors=tensors, sha256=sha256)


def load_into(
    model: nn.Module,
    tensors: Mapping[str, Tensor],
    source: object,
    optional: Set[str] = frozenset(),
) -> None:
    """Load tensors that fit a model exactly, in the model's precision.

    Args:
        model: The model; not changed if anything does not fit.
        tensors: As of ``model.state_dict()``, in any floating-point precision.
        source: Origin of the tensors, for messages.
        optional: Names of tensors that may be missing, and are then not changed.

    Raises:
        ModelError: names, shapes or values do not fit.
    """
    check_fit(model, tensors, source, optional)
    for name, given in tensors.items():
        if not torch.isfinite(given).all():
            raise ModelError(f"{source}: {name} holds NaN or infinity.")
    model.load_state_dict({**model.state_dict(), **tensors})


def check_fit(
    model: nn.Module,
    tensors: Mapping[str, Tensor],
    source: object,
    optional: Set[str] = frozenset(),
) -> None:
    """Raise for tensors with other names, shapes or types than a model's.

    The model may be on the device ``meta``, where it takes no memory; ``optional`` names
    tensors that may be missing.

    Raises:
        ModelError: something does not fit.
    """
    wanted = model.state_dict()
    missing = sorted(wanted.keys() - tensors.keys() - optional)
    foreign = sorted(tensors.keys() - wanted)
    if missing or foreign:
        raise ModelError(
            f"{source}: does not fit the model ({len(missing)} tensors missing, "
            f"{len(foreign)} unknown, such as {(missing or foreign)[0]!r}); another "
            "version of this program may have trained it."
        )
    for name, given in tensors.items():
        one = wanted[name]
        if given.shape != one.shape:
            raise ModelError(
                f"{source}: {name} has the shape {tuple(given.shape)}; expected "
                f"{tuple(one.shape)}."
            )
        if given.is_floating_point() != one.is_floating_point():
            raise ModelError(
                f"{source}: {name} holds {given.dtype}; expected {one.dtype}."
            )


def in_half_precision(model: nn.Module) -> dict[str, Tensor]:
    """Tensors of a model for shipping: weights in float16, all others unchanged."""
    weights = {name for name, _ in model.named_parameters()}
    return {
        name: one.half() if name in weights and one.is_floating_point() else one
        for name, one in model.state_dict().items()
    }


def config_from_json(
    config_type: type[_Config], values: Mapping[str, Any], source: object
) -> _Config:
    """Convert JSON values to a model's flat configuration.

    Raises:
        ModelError: fields are missing, unknown, or hold something else.
    """
    known = fields(config_type)  # type: ignore[arg-type]
    kinds = {one.name: one.type for one in known}
    for name in sorted(kinds.keys() ^ values.keys()):
        what = "lacks the" if name in kinds else "has an unknown"
        raise ModelError(f"{source}: {what} field {name!r}.")
    plain = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in values.items()
    }
    for name, value in plain.items():
        if not _fits(value, kinds[name]):
            raise ModelError(
                f"{source}: {name} is {_short(value)}, which it cannot be."
            )
    try:
        return config_type(**plain)
    except ModelError as error:
        raise ModelError(f"{source}: {error}") from error
    except (TypeError, ValueError, AssertionError) as error:
        raise ModelError(f"{source}: holds an impossible model ({error}).") from error


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _fits(value: Any, kind: Any) -> bool:
    """Whether a JSON value is valid for a field of a plain type or a ``Literal``."""
    if get_origin(kind) is Literal:
        return value in get_args(kind)
    if not isinstance(kind, type):
        return True
    return type(value) is kind or (kind is float and type(value) is int)
