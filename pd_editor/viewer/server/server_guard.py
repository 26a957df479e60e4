"""Admission of requests, and removal of unwanted parts of viser.

Foreign origins and hosts are refused; the public share tunnel and the banner are removed.
"""

import functools
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import viser
from viser import _messages
from websockets.http11 import Request

from pd_editor.viewer.server.viser_adapter import GuardedServer

LOOPBACK_HOSTS = frozenset({"127.0.0.1", "localhost", "::1"})


def is_host_allowed(host_header: str | None, bound_host: str) -> bool:
    """Whether a request with this host header is meant for this server.

    Bound to loopback, only loopback names are: a foreign name that resolves to this
    machine (DNS rebinding) is refused, for pages and connections alike.
    """
    if bound_host not in LOOPBACK_HOSTS:
        return True
    return host_header is not None and _host_name(f"//{host_header}") in LOOPBACK_HOSTS


def is_origin_allowed(origin: str | None, host_header: str, bound_host: str) -> bool:
    """Whether a page from ``origin`` may open a connection.

    A browser always sends the origin. It must be a page of this server; bound to loopback,
    it must also be a loopback name. Other programs send none and are admitted.
    """
    if origin is None:
        return True
    try:
        place = urlsplit(origin).netloc
    except ValueError:
        return False
    if place.lower() != host_header.lower():
        return False
    return bound_host not in LOOPBACK_HOSTS or _host_name(origin) in LOOPBACK_HOSTS


def guarded_server(host: str, port: int) -> viser.ViserServer:
    """A viser server that refuses foreign origins and cannot be shared publicly."""
    server = GuardedServer(
        host=host, port=port, admission=functools.partial(_refusal, host)
    )
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    server._websock_server.unregister_handler(_messages.ShareUrlRequest)
    return server


def _refusal(bound_host: str, request: Request) -> str | None:
    """Reason why a request is refused; None if it is admitted."""
    hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
    if len(hosts) > 1 or len(origins) > 1:
        return "A request names one host and one origin."
    host = hosts[0] if hosts else None
    if not is_host_allowed(host, bound_host):
        return "This host name is not the editor's."
    if not is_origin_allowed(origins[0] if origins else None, host or "", bound_host):
        return "This origin may not use the editor."
    return None


def _host_name(address: str) -> str | None:
    """The host in an address; None where there is none."""
    try:
        return urlsplit(address).hostname
    except ValueError:
        return None


def limit_uploads(
    client: viser.ClientHandle,
    max_bytes: int,
    on_refused: Callable[[str, int], None],
) -> None:
    """Refuse uploads of more than ``max_bytes`` before they are stored.

    The announced size is checked at the start, the actual size during the upload.
    ``on_refused`` is called with the name and size of a refused file.
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
