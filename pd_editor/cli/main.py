"""The shell command ``pd-editor``: one subcommand per operation."""

import logging
import sys
from collections.abc import Sequence

import tyro

from pd_editor.cli.edit import edit
from pd_editor.cli.export import export
from pd_editor.cli.generate import generate
from pd_editor.cli.replay import replay
from pd_editor.cli.warp import warp
from pd_editor.errors import PdEditorError

_COMMANDS = {
    "edit": edit,
    "warp": warp,
    "generate": generate,
    "export": export,
    "replay": replay,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand.

    Returns:
        The exit code: 0 done, 2 the user's input was wrong (one line on stderr). A bug
        raises, and so exits with 1 and a traceback.
    """
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    try:
        tyro.extras.subcommand_cli_from_dict(
            _COMMANDS,
            prog="pd-editor",
            description="Traffic scenarios on real and perturbed roads.",
            args=None if arguments is None else list(arguments),
        )
    except PdEditorError as error:
        sys.stderr.write(f"pd-editor: {error}\n")
        return 2
    except KeyboardInterrupt:
        return 130
    return 0
