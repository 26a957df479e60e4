"""``pd-editor edit``: start the browser editor."""

import contextlib
import os
import socket
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from pd_editor.base.errors import InputError
from pd_editor.cli.options import (
    OptionalFolder,
    OptionalFolders,
    PartOptions,
    Switch,
    several,
    shown,
    taking,
)

if TYPE_CHECKING:
    from pd_editor.viewer.viewer_app import ViewerApp


@dataclass(frozen=True, kw_only=True)
class EditOptions(PartOptions):
    """Options of ``pd-editor edit``.

    Args:
        scenario: A demo's name, an Argoverse 2 scenario folder, a file of another format, or a zip; the list of all scenarios if not given.
        host: Address to listen on; 0.0.0.0 lets other machines in. Folders of this machine are closed to them.
        port: Port to listen on; the next free one if it is taken.
        around: Metres in the file's frame, about which a square of its map is used; the browser can choose it, too.
        data: Root of a dataset to browse: Argoverse 2, or files of other formats.
        library: Folder of kept scenarios, shared by all who are let in; each visitor has an own one if not given.
        state: Folder for unfinished work; ~/.local/state/pd-editor if not given.
        models: Folders of trained models to offer beside the shipped one, folders of such folders, and generators of your own as package.module:attribute.
        token: Serve only those who open the printed address with its token, also on this machine: for proxies, and machines that others use as well.
        no_token: Ask for no token although other machines can reach the editor.
        debug: Offer viser's own settings and scene tree in the page.
    """

    scenario: Annotated[
        str | Path | None, tyro.conf.Positional, shown("[SCENARIO]", "(optional)")
    ] = field(default=None, kw_only=False)
    host: Annotated[str, shown("ADDRESS")] = "127.0.0.1"
    port: Annotated[int, shown("PORT")] = 8080
    data: OptionalFolder = None
    library: OptionalFolder = None
    state: OptionalFolder = None
    models: OptionalFolders = ()
    token: Switch = False
    no_token: Switch = False
    debug: Switch = False


@taking(EditOptions)
def edit(options: EditOptions) -> None:
    """Start the browser editor, print its address, and serve until interrupted."""
    if options.token and options.no_token:
        raise InputError("--token and --no-token exclude each other.")
    check_address(options.host, options.port)
    for folder in (options.library, options.state):
        if folder is not None and os.path.exists(folder) and not os.path.isdir(folder):
            raise InputError(f"{folder}: is a file; expected a folder.")
    sys.stdout.write("Starting...\n")
    sys.stdout.flush()
    # Imported late, so that the first output appears at once.
    from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions

    app = ViewerApp(
        ViewerOptions(
            reference=None if options.scenario is None else str(options.scenario),
            cut=options.cut,
            host=options.host,
            port=options.port,
            data_root=options.data,
            library=options.library,
            state=options.state,
            models=several(options.models),
            debug=options.debug,
            token=True if options.token else False if options.no_token else None,
        )
    )
    # Interrupting is the normal end, not a failure, from the moment it serves.
    with contextlib.suppress(KeyboardInterrupt):
        try:
            _tell_address(app, options)
            app.run_forever()
        finally:
            app.stop()


def _tell_address(app: "ViewerApp", options: EditOptions) -> None:
    """Print the address, and warn if other machines reach it."""
    from pd_editor.viewer.server.server_guard import is_loopback

    host = options.host
    sys.stdout.write(f"Path Diffuser Editor is at {app.address}\n")
    sys.stdout.flush()
    if not is_loopback(host):
        name = socket.gethostname() if host in ("0.0.0.0", "::", "") else host
        who = "everybody who reaches it" if options.no_token else "whoever knows it"
        sys.stderr.write(
            f"Warning: other machines reach the editor at {app.address_at(name)}"
            f" ; {who} can use it. The connection is not encrypted.\n"
        )


def check_address(host: str, port: int) -> None:
    """Raise for an address that this machine cannot listen on."""
    if not 1 <= port <= 65535:
        raise InputError(f"Port {port} is outside 1..65535.")
    try:
        for address, number in ((host, 0), (host, port)):
            _bind(address, number)
    except PermissionError:
        raise InputError(
            f"Port {port} needs rights that you lack; choose one above 1023."
        ) from None
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or "not an address"
        raise InputError(
            f"{host}: cannot be listened on ({reason}); expected an address of this "
            "machine, such as 127.0.0.1 or 0.0.0.0."
        ) from error


def _bind(host: str, port: int) -> None:
    """Bind an address and release it; an address in use is not an error."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    family, kind, protocol, _, address = found[0]
    with socket.socket(family, kind, protocol) as probe:
        try:
            probe.bind(address)
        except OSError as error:
            if port == 0 or isinstance(error, PermissionError):
                raise
