"""The shell command ``pd-editor``: one subcommand per operation."""

import ast
import contextlib
import errno
import functools
import importlib
import io
import logging
import os
import re
import sys
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final

import tyro

from pd_editor.base.errors import InputError, PdEditorError, WorkDone
from pd_editor.base.installed_files import demo_names
from pd_editor.base.plain_text import one_line

_PLACE_ERRORS: Final = frozenset(
    {
        errno.EACCES,
        errno.EDQUOT,
        errno.ELOOP,
        errno.ENAMETOOLONG,
        errno.ENOSPC,
        errno.EPERM,
        errno.EROFS,
    }
)
"""What is due to the user's disk, wherever it is met."""
FORMATS: Final = "--formats"
_COMMANDS: Final = (
    "edit",
    "warp",
    "generate",
    "threats",
    "export",
    "convert",
    "render",
    "replay",
    "family",
    "drive",
    "evaluate",
    "study",
    "index",
    "find",
    "library",
    "synth",
    "train",
    "model",
    "doctor",
)
"""Each is a module and, in it, a function; or several, if it has actions."""
_ACTIONS: Final = {
    "library": ("add", "list", "find", "tag", "metrics", "export", "check")
}
_EDGES: Final = "╭╮╰╯│─+|- "
"""Characters of box borders; the second half where the output is not in UTF-8."""
_REWORDED: Final = (
    (r"invalid literal for int\(\) with base 10: (.*)", r"\1 is not a whole number"),
    (r"could not convert string to float: (.*)", r"\1 is not a number"),
    (r"no type matching .* could be instantiated from \[(.*)\]", r"\1 does not fit"),
    (r"Exceeds the limit .*", "the number has too many digits"),
    (r"Error parsing (\S+?): ", r"\1: "),
    (
        r"invalid choice (.*) for argument '(\S+)'\. Expected",
        r"\2: \1 is no choice; expected",
    ),
    (r"(?<=one of )\('(.*)',?\)", r"\1"),
    (r"(?<=\w)', '(?=\w)", ", "),
    (r"Missing value for argument '(\S+)'\. Expected.*", r"\1 lacks its value"),
    (r"Unrecognized options: ", "unknown arguments: "),
    (r"Expected one of \{(.*)\}", r"a command is missing; choose among \1"),
)


def _functions(words: list[str]) -> dict[str, Callable[..., object]]:
    """Functions of all commands, of which only the one that is called for is imported."""
    first = next(iter(words), "")
    if first not in _COMMANDS:
        return {name: _outline(name) for name in _COMMANDS}
    functions = dict.fromkeys(_COMMANDS, lambda: None)
    module = importlib.import_module(f"{__package__}.{first}")
    if first in _ACTIONS:
        return {name: getattr(module, name) for name in _ACTIONS[first]}
    return {**functions, first: getattr(module, first)}


def _outline(name: str) -> Callable[[], None]:
    """Function with the documentation of a command, for the overview.

    A syntax tree gives it a hundred times as fast as an import.
    """

    def outline() -> None: ...

    tree = ast.parse((Path(__file__).parent / f"{name}.py").read_text("utf-8"))
    found = (
        one
        for one in tree.body
        if isinstance(one, ast.FunctionDef) and one.name == name
    )
    outline.__doc__ = ast.get_docstring(next(found, tree))
    return outline


def _without_formats(words: list[str]) -> list[str]:
    """Add the formats that any command may name; the words without them."""
    if FORMATS not in words:
        return words
    # Imported late: without it, some commands begin at once.
    from pd_editor.base.foreign_code import is_reference
    from pd_editor.scene.formats.registry import add_formats

    first = words.index(FORMATS)
    # The first one is meant as a format whatever it is.
    last = first + 2
    while last < len(words) and is_reference(words[last]):
        last += 1
    add_formats(*(words[first + 1 : last] or ("",)))
    return words[:first] + words[last:]


def _run(words: list[str]) -> object:
    """Run a command and return its result."""
    message = io.StringIO()
    has_begun = False
    group = words[:1] if words[:1] and words[0] in _ACTIONS else []
    functions = _functions(words)

    def begun(command: Callable[..., object]) -> Callable[..., object]:
        @functools.wraps(command)
        def run(*values: Any, **options: Any) -> object:
            nonlocal has_begun
            has_begun = True
            quiet.close()
            return command(*values, **options)

        return run

    def parsed(args: list[str]) -> object:
        return tyro.extras.subcommand_cli_from_dict(
            {name: begun(one) for name, one in functions.items()},
            prog=" ".join(["pd-editor", *group]),
            description=_outline(group[0]).__doc__
            if group
            else "Edit traffic scenarios on real and perturbed roads. "
            "SCENARIO is an Argoverse 2 scenario folder, a file of another format, "
            "or the name of a demo: "
            f"{', '.join(demo_names())}. Each command takes {FORMATS} "
            "package.module:attribute, which adds formats of your own.",
            args=args,
        )

    args = words[len(group) :]
    with contextlib.ExitStack() as quiet:
        quiet.enter_context(contextlib.redirect_stderr(message))
        try:
            return parsed(args)
        except SystemExit as stop:
            if has_begun and not isinstance(stop, WorkDone):
                # No command ends like this, only code of others that it runs.
                raise PdEditorError("The command ended before its work.") from stop
            if not stop.code:
                raise
    told = io.StringIO()
    if "Unrecognized options" in message.getvalue() and args[0] in functions:
        with contextlib.redirect_stdout(told), contextlib.suppress(SystemExit):
            parsed([args[0], "--help"])
    known = re.findall(r"(?<!\S)--([a-z][a-z-]+)", told.getvalue())
    raise InputError(
        usage_error(message.getvalue(), args, tuple(functions), *group, options=known)
    )


class _Steady:
    """A stream that goes on if nobody reads it or its disk is full, so that work is done."""

    def __init__(self, stream: Any) -> None:
        """Wrap a stream; None is one that was closed before the program began."""
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
        self._stream = stream or io.StringIO()
        self.failure: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write unless it has failed before."""
        if self.failure is None:
            try:
                return self._stream.write(text)
            except OSError as error:
                self.failure = error
        return len(text)

    def flush(self) -> None:
        """Flush unless it has failed before."""
        try:
            if self.failure is None:
                self._stream.flush()
        except OSError as error:
            self.failure = error
        if self.failure is not None:
            # Python writes what is left once more at its end.
            with contextlib.suppress(OSError), open(os.devnull, "w") as nowhere:
                os.dup2(nowhere.fileno(), self._stream.fileno())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand and print its result.

    Returns:
        The exit code: 0 done, 2 the user's input was wrong (message on stderr), 130
        interrupted. A bug raises, and so exits with 1 and a traceback.
    """
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    out, err = _Steady(sys.stdout), _Steady(sys.stderr)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):  # type: ignore[type-var]
        code = _answered(sys.argv[1:] if arguments is None else list(arguments))
        out.flush()
        # A reader that has had enough, such as head, is no failure.
        if out.failure is not None and not isinstance(out.failure, BrokenPipeError):
            reason = out.failure.strerror
            err.write(f"pd-editor: The output cannot be written ({reason}).\n")
            code = code or 2
        err.flush()
    return code


def _answered(words: list[str]) -> int:
    """Run a subcommand, print its result or what was wrong; returns the exit code."""
    if words == ["--version"]:
        # It reads e-mail headers, for which half of the start would be spent.
        from importlib.metadata import version

        sys.stdout.write(f"pd-editor {version('pd-editor')}\n")
        return 0
    try:
        # Shells leave the home folder to the command in --out=~/here.
        told = [re.match(r"(--[\w-]+=)(~(?:/.*)?)$", one, re.DOTALL) for one in words]
        words = [
            one if path is None else path[1] + os.path.expanduser(path[2])
            for one, path in zip(words, told, strict=True)
        ]
        outcome = _run(_without_formats(words))
    except PdEditorError as error:
        sys.stderr.write(f"pd-editor: {error}\n")
        return 2
    except OSError as error:
        if error.errno not in _PLACE_ERRORS:
            raise
        place = "The disk" if error.filename is None else one_line(str(error.filename))
        sys.stderr.write(f"pd-editor: {place}: cannot be used ({error.strerror}).\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("pd-editor: Interrupted.\n")
        return 130
    except SystemExit as stop:
        # The argument parser exits this way after --help.
        return stop.code if isinstance(stop.code, int) else 0
    if outcome is not None and str(outcome):
        sys.stdout.write(f"{outcome}\n")
    failures = getattr(outcome, "failures", {})
    for scene, failure in failures.items():
        place = "" if failure.reason.startswith(scene) else f"{scene}: "
        if not failure.is_users:
            sys.stderr.write(failure.traceback)
        sys.stderr.write(f"pd-editor: {place}{failure.reason}\n")
    if getattr(outcome, "is_stopped", False):
        return 130
    is_bug = any(not failure.is_users for failure in failures.values())
    return 1 if is_bug else 2 * bool(failures)


def usage_error(
    box: str,
    arguments: Sequence[str],
    commands: Sequence[str],
    *group: str,
    options: Sequence[str],
) -> str:
    """Convert the parser's output to one sentence.

    Args:
        box: Output of the parser.
        arguments: The command line.
        commands: All subcommands.
        group: The command that they are actions of.
        options: All options of the command.
    """
    body: list[str] = []
    for line in box.splitlines()[1:]:
        inside = re.sub(r"^[│|]|[│|]$", "", line)
        if inside.strip(_EDGES):
            body.append(inside)
        elif body:
            break
    missing = [line.split()[0] for line in body[1:] if re.match(r" {4,6}\S", line)]
    if body and body[0].strip().startswith("Missing from") and missing:
        sentence = f"missing {', '.join(missing)}"
    else:
        sentence = " ".join(" ".join(body).split())
        for pattern, words in _REWORDED:
            sentence = re.sub(pattern, words, sentence)
    sentence = sentence.rstrip(". ") or "the arguments cannot be read"
    unknown = re.search(r"Unrecognized options:\W*?--([\w-]+)", box)
    if unknown:
        near = [one for one in options if one.startswith(unknown[1])]
        if near := near or get_close_matches(unknown[1], options, n=1):
            sentence = f"there is no --{unknown[1]}; the nearest is --{near[0]}"
    if arguments and arguments[0] not in commands and not arguments[0].startswith("-"):
        sentence = f"there is no command {arguments[0]!r}; choose among "
        sentence += ", ".join(commands)
    known = [one for one in arguments[:1] if one in commands]
    help_of = " ".join(["pd-editor", *group, *known, "--help"])
    return f"{sentence[0].upper()}{sentence[1:]}; see {help_of}."
