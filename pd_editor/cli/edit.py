"""``pd-editor edit``: start the browser editor."""

import sys
from pathlib import Path
from typing import Annotated

import tyro

DEFAULT_DEMO = "signalised-junction"


def edit(
    scenario: Annotated[str, tyro.conf.Positional] = DEFAULT_DEMO,
    /,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    data: Path | None = None,
    library: Path | None = None,
) -> None:
    """Start the browser editor and print its address.

    Args:
        scenario: A demo's name or an Argoverse 2 scenario folder.
        host: Address to listen on; 0.0.0.0 lets other machines in.
        port: Port to listen on; the next free one if it is taken.
        data: Root of an Argoverse 2 dataset to browse.
        library: Folder for the editor's own files, such as autosaves.
    """
    from pd_editor.viewer.viewer_app import ViewerApp

    app = ViewerApp(
        reference=scenario, host=host, port=port, data_root=data, library=library
    )
    sys.stdout.write(f"Path Diffuser Editor is at {app.address}\n")
    sys.stdout.flush()
    app.run_forever()
