"""The shell command ``pd-editor``: one subcommand per operation."""

import contextlib
import functools
import io
import logging
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any

import tyro

from pd_editor.cli.edit import edit
from pd_editor.cli.evaluate import evaluate
from pd_editor.cli.export import export
from pd_editor.cli.generate import generate
from pd_editor.cli.model import model
from pd_editor.cli.output.usage_error import usage_error
from pd_editor.cli.replay import replay
from pd_editor.cli.study import study
from pd_editor.cli.synth import synth
from pd_editor.cli.threats import threats
from pd_editor.cli.train import train
from pd_editor.cli.warp import warp
from pd_editor.errors import InputError, PdEditorError
from pd_editor.installed_files import demo_names

_COMMANDS = {
    "edit": edit,
    "warp": warp,
    "generate": generate,
    "threats": threats,
    "export": export,
    "replay": replay,
    "evaluate": evaluate,
    "study": study,
    "synth": synth,
    "train": train,
    "model": model,
}


def _run(words: list[str]) -> object:
    """Run a command and return its result."""
    message = io.StringIO()
    has_begun = False

    def begun(command: Callable[..., object]) -> Callable[..., object]:
        @functools.wraps(command)
        def run(*values: Any, **options: Any) -> object:
            nonlocal has_begun
            has_begun = True
            quiet.close()
            return command(*values, **options)

        return run

    with contextlib.ExitStack() as quiet:
        quiet.enter_context(contextlib.redirect_stderr(message))
        try:
            return tyro.extras.subcommand_cli_from_dict(
                {name: begun(command) for name, command in _COMMANDS.items()},
                prog="pd-editor",
                description="Edit traffic scenarios on real and perturbed roads. "
                "SCENARIO is an Argoverse 2 scenario folder or the name of a demo: "
                f"{', '.join(demo_names())}.",
                args=words,
            )
        except SystemExit as stop:
            if has_begun or not stop.code:
                raise
    raise InputError(usage_error(message.getvalue(), words, list(_COMMANDS)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand and print its result.

    Returns:
        The exit code: 0 done, 2 the user's input was wrong (message on stderr). A bug
        raises, and so exits with 1 and a traceback.
    """
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    words = sys.argv[1:] if arguments is None else list(arguments)
    if words == ["--version"]:
        sys.stdout.write(f"pd-editor {version('pd-editor')}\n")
        return 0
    try:
        outcome = _run(words)
    except PdEditorError as error:
        sys.stderr.write(f"pd-editor: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("pd-editor: Interrupted.\n")
        return 130
    except SystemExit as stop:
        # The argument parser exits this way after --help, and so do worker processes.
        return stop.code if isinstance(stop.code, int) else 0
    if outcome is not None:
        sys.stdout.write(f"{outcome}\n")
    return 0
