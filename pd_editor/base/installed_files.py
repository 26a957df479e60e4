"""Finds the files that come with the package: demos and weights."""

import json
import os
from pathlib import Path
from typing import Final

from pd_editor.base.errors import InputError

DEMO_PREFIX: Final = "demo:"
"""May precede the name of a demo."""
ALL_DEMOS: Final = "demos"
"""Name of all demos together."""
SENTENCES_NAME: Final = "sentences.json"
"""File beside the demos with a description of each."""
_PACKAGE = Path(__file__).resolve().parents[1]


def _folder(name: str) -> Path:
    """Folder of installed files: inside the package in a wheel, beside it in a checkout."""
    inside = _PACKAGE / name
    return inside if os.path.isdir(inside) else _PACKAGE.parent / name


def demo_names() -> tuple[str, ...]:
    """Names of all demo scenarios."""
    demos = _folder("assets") / "demos"
    return tuple(
        sorted(path.parent.name for path in demos.glob("*/scenario_*.parquet"))
    )


def demo_folder(name: str) -> Path:
    """Folder of a demo scenario.

    Raises:
        InputError: there is no such demo.
    """
    if name not in demo_names():
        raise InputError(
            f"There is no demo {name!r}; choose one of {', '.join(demo_names())}."
        )
    return _folder("assets") / "demos" / name


def data_root(reference: Path) -> Path:
    """Folder to search for scenarios: of all demos for "demos", of one for its name.

    Other references, and names of folders that exist, are returned as they are.
    """
    # os.path, unlike pathlib, does not raise for paths that are too long or forbidden.
    if os.path.isdir(reference):
        return reference
    name = str(reference).removeprefix(DEMO_PREFIX)
    if name == ALL_DEMOS:
        return _folder("assets") / "demos"
    return demo_folder(name) if name in demo_names() else reference


def demo_sentence(name: str) -> str:
    """Description of a demo; empty without one."""
    path = _folder("assets") / "demos" / SENTENCES_NAME
    if not os.path.isfile(path):
        return ""
    return json.loads(path.read_text(encoding="utf-8")).get(name, "")


def models_folder() -> Path:
    """Folder of the shipped weights."""
    return _folder("models")
