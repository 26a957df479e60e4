"""What viser leaves open: foreign origins, the public share tunnel, its banner."""

import contextlib
import functools
import http
import io
from collections.abc import Awaitable, Callable, Iterator
from typing import Any
from unittest import mock
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server
from viser import _messages
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

LOOPBACK_HOSTS = frozenset({"127.0.0.1", "localhost", "::1"})


def is_origin_allowed(origin: str | None, host_header: str, bound_host: str) -> bool:
    """Whether a page from ``origin`` may open a connection.

    A browser always sends the origin. It must be the page that this server itself
    served; bound to loopback, it must also be a loopback name, so that a foreign name
    which resolves to this machine (DNS rebinding) is refused. Programs that are no
    browser send none and are let in.
    """
    if origin is None:
        return True
    page = urlsplit(origin)
    if page.netloc.lower() != host_header.lower():
        return False
    return bound_host not in LOOPBACK_HOSTS or page.hostname in LOOPBACK_HOSTS


def guarded_server(host: str, port: int) -> viser.ViserServer:
    """A viser server that refuses foreign origins and cannot be shared publicly."""
    with _origin_check(host), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, verbose=False)
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    server._websock_server.unregister_handler(_messages.ShareUrlRequest)
    return server


def limit_uploads(
    client: viser.ClientHandle,
    max_bytes: int,
    on_refused: Callable[[str, int], None],
) -> None:
    """Refuse uploads of more than ``max_bytes`` before they are taken in.

    What a browser announces is checked at the start, what it really sends on the way.

    Args:
        client: the browser.
        max_bytes: largest size of one file.
        on_refused: told the name and size of a refused file.
    """
    connection, accept = (
        client._websock_connection,
        client.gui._handle_file_transfer_start,
    )

    states = client.gui._current_file_upload_states
    take_part = client.gui._handle_file_transfer_part

    def guarded_part(client_id: Any, message: _messages.FileTransferPart) -> None:
        state = states.get(message.transfer_uuid)
        if state is not None and (
            state["transferred_bytes"] + len(message.content) > max_bytes
        ):
            states.pop(message.transfer_uuid)
            on_refused(state["filename"], max_bytes + 1)
            return
        take_part(client_id, message)

    def guarded(client_id: Any, message: _messages.FileTransferStartUpload) -> None:
        if message.size_bytes > max_bytes:
            on_refused(message.filename, message.size_bytes)
        else:
            accept(client_id, message)

    connection.unregister_handler(_messages.FileTransferStartUpload, accept)
    connection.register_handler(_messages.FileTransferStartUpload, guarded)
    connection.unregister_handler(_messages.FileTransferPart, take_part)
    connection.register_handler(_messages.FileTransferPart, guarded_part)


@contextlib.contextmanager
def _origin_check(bound_host: str) -> Iterator[None]:
    """Add the check to the websocket server that viser is about to start."""
    serve = websockets.asyncio.server.serve

    def serve_guarded(*args: Any, process_request: Any = None, **options: Any) -> Any:
        return serve(
            *args,
            process_request=functools.partial(
                _refuse_foreign, bound_host, process_request
            ),
            **options,
        )

    with mock.patch.object(websockets.asyncio.server, "serve", serve_guarded):
        yield


async def _refuse_foreign(
    bound_host: str,
    inner: Callable[[ServerConnection, Request], Awaitable[Response | None]] | None,
    connection: ServerConnection,
    request: Request,
) -> Response | None:
    origin = request.headers.get("Origin")
    host = request.headers.get("Host", "")
    if not is_origin_allowed(origin, host, bound_host):
        return connection.respond(
            http.HTTPStatus.FORBIDDEN, "This origin may not use the editor.\n"
        )
    answer = None if inner is None else inner(connection, request)
    return await answer if isinstance(answer, Awaitable) else answer
