"""What documents name exists, and the documentation builds with the reference."""

import functools
import importlib
import os
import re
import runpy
import subprocess
import sys
import tomllib
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
import tyro.extras

import pd_editor
from pd_editor.editor.commands import COMMANDS

ROOT = Path(__file__).parents[1]
PAGES: list[Path] = runpy.run_path(str(ROOT / ".ci" / "ratchet.py"))["documents"]()
WINGS = (
    "",
    "pd_editor/",
    *(f"pd_editor/{one.name}/" for one in ROOT.glob("pd_editor/*")),
)
ENDINGS = (".py", ".toml", ".js", ".ts", ".css", ".jinja")
CODE_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)


@functools.cache
def repository_paths() -> frozenset[str]:
    """Files and folders of the repository."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    files = [Path(line) for line in listed if (ROOT / line).exists()]
    folders = {folder for path in files for folder in path.parents}
    return frozenset(path.as_posix() for path in (*files, *folders))


def prose_of(text: str) -> str:
    return CODE_BLOCK.sub("", text)


def missing_paths(text: str) -> list[str]:
    """Paths in backticks of which no file or folder is meant.

    Python files may be abbreviated: some path has to end so. Other paths are looked at
    if they begin with a folder of the repository or of the package.
    """
    known = repository_paths()
    ends = tuple(f"/{path}" for path in known)
    missing = []
    for name in re.findall(r"`([\w.-]+(?:/[\w.-]+)*/?)`", prose_of(text)):
        path = name.rstrip("/")
        first = path.split("/")[0]
        is_ours = path.endswith(ENDINGS) or (
            "/" in name and any(f"{wing}{first}" in known for wing in WINGS)
        )
        if is_ours and not any(end.endswith(f"/{path}") for end in ends):
            missing.append(name)
    return missing


def missing_modules(text: str) -> list[str]:
    """Modules and dotted names of the repository that do not exist."""
    found = re.findall(
        r"-m\s+((?:benchmarks|reproduction|assets|examples)[\w.]*)", text
    )
    found += re.findall(r"(?<!\")\b(pd_editor(?:\.\w+)+)", text)
    return [name for name in found if not exists(name.strip("."))]


def exists(name: str) -> bool:
    """Whether a dotted name is a module, or a name that its last module holds."""
    parts = name.split(".")
    for num in range(len(parts), 0, -1):
        place = "/".join(parts[:num])
        if {place, f"{place}.py"} & repository_paths():
            rest = parts[num:]
            return not rest or hasattr(
                importlib.import_module(".".join(parts[:num])), rest[0]
            )
    return False


@functools.cache
def options_of(command: str, first: str) -> frozenset[str]:
    """Options of a command of the shell, or of its action, by its own parser."""
    module = importlib.import_module(f"pd_editor.cli.{command}")
    function = getattr(module, command, None) or getattr(module, first)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        parser = tyro.extras.get_parser(function)
    lines = re.findall(r"^\W*(--.*?)(?:\s{2}|$)", parser.format_help(), re.MULTILINE)
    return frozenset(re.findall(r"--[\w-]+", " ".join(lines)))


def shell_lines(text: str) -> Iterator[list[str]]:
    """Words of the lines of shell blocks, without comments."""
    for language, block in CODE_BLOCK.findall(text):
        if language in ("", "sh", "bash", "console"):
            for line in block.replace("\\\n", " ").splitlines():
                yield re.sub(r"(^|\s)#.*", "", line).split()


def unknown_options(text: str) -> list[str]:
    """Commands and options that the shell does not have."""
    commands = {path.stem for path in (ROOT / "pd_editor" / "cli").glob("[a-z]*.py")}
    unknown = []
    for words in shell_lines(text):
        if "pd-editor" not in words:
            continue
        command, *given = words[words.index("pd-editor") + 1 :]
        if command not in commands:
            unknown.append(command)
            continue
        options = {word.partition("=")[0] for word in given if word.startswith("--")}
        known = options_of(command, next(iter(given), ""))
        unknown += [f"{command} {one}" for one in sorted(options - known)]
    return unknown


@functools.cache
def anchors_of(page: Path) -> frozenset[str]:
    headings = re.findall(r"^#+ (.*)$", prose_of(page.read_text()), re.MULTILINE)
    words = (re.sub(r"[^\w\s-]", "", heading).strip().lower() for heading in headings)
    return frozenset(re.sub(r"\s", "-", one) for one in words)


def broken_links(text: str, page: Path) -> list[str]:
    """Relative links of a page whose file or heading does not exist."""
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", prose_of(text)):
        if re.match(r"\w+:", link):
            continue
        place, _, anchor = link.partition("#")
        target = (page.parent / place).resolve() if place else page
        if not target.exists() or (anchor and anchor not in anchors_of(target)):
            broken.append(link)
    return broken


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_document_names_exists(page: Path):
    text = page.read_text()
    assert not missing_paths(text)
    assert not missing_modules(text)
    assert not unknown_options(text)
    assert not broken_links(text, page)


def test_errors_in_a_document_are_found():
    text = """# A title
`editor/session.py`, `initial_state/none.py`, `viewer/nothing/`, `session.py`, `out/a.csv`
[here](#a-title) [there](#b-title) [file](LICENSE) [none](docs/none.md)
```
pd-editor warp x --kind y \\
  --kinds z   # --nothing
pd-editor wrap x
```
`python -m benchmarks.nothing`, `pd_editor.EditorSession`, `pd_editor.scene.nothing`
"""
    page = ROOT / "README.md"
    assert missing_paths(text) == ["initial_state/none.py", "viewer/nothing/"]
    assert missing_modules(text) == ["benchmarks.nothing", "pd_editor.scene.nothing"]
    assert unknown_options(text) == ["warp --kinds", "wrap"]
    assert broken_links(text.replace("A title", "Start"), page) == [
        "#a-title",
        "#b-title",
        "docs/none.md",
    ]


def test_commands_of_benchmarks_exist():
    text = (ROOT / "docs" / "benchmarks.md").read_text()
    commands = re.findall(
        r"\| `(?!make|python)(\w+)(?: [^`|]*)?`[^|]*\|$", text, re.MULTILINE
    )
    assert len(commands) > 30
    assert {name for name in commands if not exists(f"benchmarks.{name}")} == set()


def test_documents_stay_short():
    """All of them are read in about an hour; ``.ci/ratchet.toml`` has the number."""
    numbers = tomllib.loads((ROOT / ".ci" / "ratchet.toml").read_text())
    words = sum(len(page.read_text().split()) for page in PAGES)
    assert words <= numbers["document_words"]


NUMBER = re.compile(r"(?<![\w-])\d+(?:\.\d+)?(?![\w-])")
TUTORIALS = re.split(
    r"^## ", (ROOT / "docs" / "tutorials.md").read_text(), flags=re.MULTILINE
)[1:]


def says(printed: str, told: str) -> bool:
    """Whether a command printed what a tutorial tells; its numbers may differ by a fifth.

    Dots stand for anything, spaces between columns for any number of them.
    """
    pattern = re.escape(" ".join(NUMBER.sub("#", told).split()))
    words = " ".join(NUMBER.sub("#", printed).split())
    if not re.fullmatch(pattern.replace(re.escape("..."), ".*"), words):
        return False
    pairs = zip(NUMBER.findall(printed), NUMBER.findall(told), strict=False)
    return "..." in told or all(
        float(one) == pytest.approx(float(other), rel=0.2, abs=1.0)
        for one, other in pairs
    )


@pytest.mark.slow
@pytest.mark.parametrize("tutorial", TUTORIALS, ids=lambda text: text.split("\n")[0])
def test_tutorials_print_what_they_tell(tutorial: str, tmp_path: Path):
    """Every block of code is run in its order, in an empty folder."""
    paths = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for language, block in CODE_BLOCK.findall(tutorial):
        if language == "python":
            (tmp_path / block.split()[1]).write_text(block)
            continue
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, told = part.split("\n", 1)
            done = subprocess.run(
                command,
                shell=True,
                cwd=tmp_path,
                env={**os.environ, "PATH": paths},
                capture_output=True,  # A slow machine is told of progress beside it.
                text=True,
                check=False,
            )
            assert done.returncode == 0, (command, done.stdout, done.stderr)
            assert says(done.stdout, told), (command, done.stdout)


def test_a_tutorial_that_tells_something_else_is_found():
    printed = "kept/a-2\nradius 8.3 m\n"
    assert says(printed, "kept/a-2\nradius  8 m\n")
    assert says(printed, "...\nradius 8 m\n")
    assert not says(printed, "kept/a-2\nradius 20 m\n")
    assert not says(printed, "kept/a-2\nwidth 8.3 m\n")
    assert not says(printed, "kept/a-3\nradius 8.3 m\n")


def test_the_reference_has_every_public_name_and_command():
    """``drive``, ``find`` and commands of guidance were missing, others twice."""
    pages = ROOT / "docs" / "reference"
    named = re.findall(r"^::: (\S+)$", (pages / "python.md").read_text(), re.MULTILINE)
    parents = {"pd_editor.base.errors", "pd_editor.cli.library"}
    for name in set(pd_editor.__all__) - {"commands", "library", "PdEditorError"}:
        found = getattr(pd_editor, name)
        assert f"{found.__module__}.{found.__qualname__}" in named, name
    assert parents <= set(named)
    listed = re.findall(
        r"^::: (\S+)$", (pages / "commands.md").read_text(), re.MULTILINE
    )
    assert len(set(listed)) == len(listed)
    assert {one.__module__ for one in COMMANDS.values()} <= set(listed)


@pytest.mark.slow
def test_the_documentation_builds_without_a_warning(tmp_path: Path):
    command = ["-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path]
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    pages = {path.name: path.read_text() for path in tmp_path.rglob("*.html")}
    assert "Path Diffuser Editor" in pages["index.html"]
    for page, name in (
        ("python.html", "pd_editor.editor.session.EditorSession"),
        ("commands.html", "pd_editor.editor.commands.road.SetRoadWarp"),
        ("generation.html", "pd_editor.scene.generation.ScenarioGenerator"),
        ("metrics.html", "min_ade"),
    ):
        assert name in pages[page]
