"""Sizes that keep modules readable, and rules that no linter knows."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAX_MODULE_LINES = 400
MAX_FUNCTION_LINES = 60
PACKAGE = sorted((ROOT / "pd_editor").rglob("*.py"))
OTHERS = sorted([*(ROOT / "tests").rglob("*.py"), *(ROOT / "assets").rglob("*.py")])
FORBIDDEN_NAMES = {"utils", "helpers", "common", "base", "manager", "misc"}


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def test_there_is_something_to_look_at():
    assert len(PACKAGE) > 50


@pytest.mark.parametrize("path", [*PACKAGE, *OTHERS], ids=name_of)
def test_modules_are_short_and_imports_absolute(path: Path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MAX_MODULE_LINES
    relative = [
        node.lineno
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.ImportFrom) and node.level
    ]
    assert relative == []


@pytest.mark.parametrize("path", PACKAGE, ids=name_of)
def test_modules_are_documented_and_functions_short(path: Path):
    tree = tree_of(path)
    assert ast.get_docstring(tree)
    assert path.stem not in FORBIDDEN_NAMES
    functions = [
        node
        for node in ast.walk(tree)
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
    ]
    for node in functions:
        assert node.end_lineno is not None
        lines = node.end_lineno - node.lineno + 1
        assert lines <= MAX_FUNCTION_LINES, f"{node.name} has {lines} lines"
