"""All fields that a variant can set: defaults, values, and what they mean."""

import ast
import inspect
from dataclasses import asdict, dataclass
from textwrap import dedent
from typing import Any, get_type_hints

from pd_editor.base.markdown import markdown_table
from pd_editor.experiments.training.config.presets import PRESETS
from pd_editor.experiments.training.config.run_request import StageName
from pd_editor.experiments.training.config.settings import SECTIONS, in_words


@dataclass(frozen=True, kw_only=True)
class SettableField:
    """A field of a section of a stage."""

    section: str
    name: str
    default: str
    """As TOML writes it."""
    values: str
    """What values it may have, in words."""
    meaning: str
    """The first sentence of its docstring."""


def settable_fields(stage: StageName) -> tuple[SettableField, ...]:
    """The fields of a stage, in the order of its sections."""
    preset = PRESETS[stage]["default"]
    usual = {
        "model": dict(preset.model),
        "optimisation": asdict(preset.optimisation),
    }
    found: list[SettableField] = []
    for section, kind in SECTIONS[stage].items():
        meanings, hints = _docstrings(kind), get_type_hints(kind)
        for name, default in (asdict(kind()) | usual.get(section, {})).items():
            found.append(
                SettableField(
                    section=section,
                    name=name,
                    default=_as_toml(default),
                    values=in_words(hints[name]),
                    meaning=_first_sentence(meanings.get(name, "")),
                )
            )
    return tuple(found)


def fields_table(stage: StageName) -> str:
    """The fields of a stage as a table in Markdown."""
    header = ("field", "default", "values", "meaning")
    rows = [
        (f"`{stage}.{one.section}.{one.name}`", one.default, one.values, one.meaning)
        for one in settable_fields(stage)
    ]
    return markdown_table(header, rows)


def _docstrings(kind: type[Any]) -> dict[str, str]:
    """Docstrings under the fields of a class, by name."""
    (tree,) = ast.parse(dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    found = {}
    for line, after in zip(tree.body, tree.body[1:], strict=False):
        if (
            isinstance(line, ast.AnnAssign)
            and isinstance(line.target, ast.Name)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
        ):
            found[line.target.id] = inspect.cleandoc(str(after.value.value))
    return found


def _first_sentence(text: str) -> str:
    words = " ".join(text.split())
    head, dot, _ = words.partition(". ")
    return head + "." * bool(dot)


def _as_toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return str(list(value))
    return f'"{value}"' if isinstance(value, str) else str(value)
