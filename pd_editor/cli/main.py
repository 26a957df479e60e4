"""The shell command ``pd-editor``: one subcommand per operation."""

import logging
import sys
from collections.abc import Sequence

import tyro

from pd_editor.cli.edit import edit
from pd_editor.cli.evaluate import evaluate
from pd_editor.cli.export import export
from pd_editor.cli.generate import generate
from pd_editor.cli.model import model
from pd_editor.cli.replay import replay
from pd_editor.cli.synth import synth
from pd_editor.cli.train import train
from pd_editor.cli.warp import warp
from pd_editor.errors import PdEditorError
from pd_editor.installed_files import demo_names

_COMMANDS = {
    "edit": edit,
    "warp": warp,
    "generate": generate,
    "export": export,
    "replay": replay,
    "evaluate": evaluate,
    "synth": synth,
    "train": train,
    "model": model,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand and print what it made.

    Returns:
        The exit code: 0 done, 2 the user's input was wrong (said on stderr). A bug
        raises, and so exits with 1 and a traceback.
    """
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    try:
        outcome = tyro.extras.subcommand_cli_from_dict(
            _COMMANDS,
            prog="pd-editor",
            description="Edit traffic scenarios on real and perturbed roads. "
            "SCENARIO is an Argoverse 2 scenario folder or the name of a demo: "
            f"{', '.join(demo_names())}.",
            args=None if arguments is None else list(arguments),
        )
    except PdEditorError as error:
        sys.stderr.write(f"pd-editor: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("pd-editor: Interrupted.\n")
        return 130
    except SystemExit as stop:
        # This is how the argument parser ends: 0 after --help, 2 after an error.
        return stop.code if isinstance(stop.code, int) else 0
    if outcome is not None:
        sys.stdout.write(f"{outcome}\n")
    return 0
