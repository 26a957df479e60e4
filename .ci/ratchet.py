"""Numbers of the code that may only fall: ``python .ci/ratchet.py [--write]``.

Compares what is counted with ``ratchet.toml`` and fails if something has grown;
``--write`` stores what has fallen. A number may be raised by hand, with its reason beside
it.
"""

import ast
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
NUMBERS = Path(__file__).with_name("ratchet.toml")
MOST_LINES, MOST_PARAMETERS = 60, 8


def trees(folder: str) -> dict[Path, ast.Module]:
    """Parsed Python files."""
    paths = sorted((ROOT / folder).rglob("*.py"))
    return {path: ast.parse(path.read_bytes()) for path in paths}


def num_lines(*patterns: str) -> int:
    """Lines of files, blank ones and comments included."""
    paths = (path for pattern in patterns for path in ROOT.glob(pattern))
    return sum(len(path.read_bytes().splitlines()) for path in paths)


def constants(tree: ast.Module) -> Iterator[str]:
    """Names of a module in capital letters that hold numbers."""
    for node in tree.body:
        targets = (
            node.targets
            if isinstance(node, ast.Assign)
            else [node.target]
            if isinstance(node, ast.AnnAssign)
            else []
        )
        value = getattr(node, "value", None)
        names = [one.id for one in targets if isinstance(one, ast.Name)]
        parts = ast.walk(value) if value is not None else ()
        has_number = any(
            isinstance(one, ast.Constant)
            and isinstance(one.value, int | float)
            and not isinstance(one.value, bool)
            for one in parts
        )
        yield from (name for name in names if has_number and name.lstrip("_").isupper())


def functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """All functions and methods, but those that are a command of the shell."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def num_parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Parameters, without ``self`` and ``cls``."""
    given = function.args
    names = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def private_accesses(tree: ast.Module) -> int:
    """Attributes with a leading underscore of something other than ``self``."""
    return sum(
        isinstance(node, ast.Attribute)
        and re.match("_[^_]", node.attr) is not None
        and not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"))
        for node in ast.walk(tree)
    )


def num_settings() -> int:
    """Settings of the sampling that are stored with the shipped model."""
    config = json.loads((ROOT / "models/path-diffuser/config.json").read_text())
    parts = [
        part
        for stage in config["stages"].values()
        for part in stage["sampling"].values()
    ]
    return sum(map(len, parts))


def documents() -> list[Path]:
    """All pages that users read."""
    patterns = (
        "*.md",
        "docs/**/*.md",
        "models/**/*.md",
        "reproduction/*.md",
        "scene_test/*.md",
    )
    return sorted(path for pattern in patterns for path in ROOT.glob(pattern))


def counted() -> dict[str, int]:
    """What is counted, by name."""
    package = trees("pd_editor")
    every = [one for tree in package.values() for one in functions(tree)]
    return {
        "lines": num_lines("pd_editor/**/*.py", "scene_test/*.py"),
        # Without the types that are generated from Python.
        "page_lines": num_lines("client/src/**/*.*")
        - num_lines("client/src/messages.ts"),
        "modules": len(package),
        "constants": sum(len(list(constants(tree))) for tree in package.values()),
        "sampling_settings": num_settings(),
        "long_functions": sum(
            (one.end_lineno or 0) - one.lineno >= MOST_LINES for one in every
        ),
        "wide_functions": sum(num_parameters(one) > MOST_PARAMETERS for one in every),
        "private_accesses_in_tests": sum(
            map(private_accesses, trees("tests").values())
        ),
        "document_words": sum(len(page.read_text().split()) for page in documents()),
    }


def main() -> int:
    """Print what has grown; the exit code."""
    text = NUMBERS.read_text()
    allowed = tomllib.loads(text)
    found = counted()
    grown = {name: count for name, count in found.items() if count > allowed[name]}
    for name, count in grown.items():
        print(f"{name}: {count}, allowed are {allowed[name]} ({NUMBERS.name})")
    if "--write" in sys.argv:
        for name, count in found.items():
            if name not in grown:
                text = re.sub(rf"(?m)^{name} = \d+", f"{name} = {count}", text)
        NUMBERS.write_text(text)
    return int(bool(grown))


if __name__ == "__main__":
    sys.exit(main())
