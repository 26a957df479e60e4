"""Admission of requests, and removal of unwanted parts of viser.

Foreign origins and hosts, and requests without the token, are refused; the public share
tunnel and the banner are removed.
"""

import functools
import hmac
import ipaddress
import logging
import math
import socket
from collections.abc import Callable
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

import viser
from viser import _messages
from websockets.http11 import Request

from pd_editor.viewer.server.viser_adapter import GuardedServer

TOKEN_FIELD: Final = "token"
"""Name of the token in the query of an address."""
_ROUNDING: Final = 1e-9
"""Tolerance of a slider's bounds."""
_LOG: Final = logging.getLogger(__name__)


def is_loopback(host: str) -> bool:
    """Whether only programs of this machine can reach a host of this name."""
    address = _ip_address(host)
    if address is None:
        return host.lower().rstrip(".") == "localhost"
    return (getattr(address, "ipv4_mapped", None) or address).is_loopback


def is_host_allowed(host_header: str | None, bound_host: str) -> bool:
    """Whether a request with this host header is meant for this server.

    Bound to loopback, only loopback names are; else also addresses and the names of this
    machine. A foreign name that resolves to this machine (DNS rebinding) is refused, for
    pages and connections alike.
    """
    name = None if host_header is None else _host_name(f"//{host_header}")
    if name is None:
        return False
    if is_loopback(name):
        return True
    if is_loopback(bound_host):
        return False
    own = {one.lower() for one in (bound_host, socket.gethostname(), _full_name())}
    return _ip_address(name) is not None or name.rstrip(".") in own


def is_origin_allowed(origin: str | None, host_header: str) -> bool:
    """Whether a page from ``origin`` may open a connection.

    A browser always sends the origin. It must be a page of this server. Other programs
    send none and are admitted.
    """
    if origin is None:
        return True
    try:
        place = urlsplit(origin).netloc
    except ValueError:
        return False
    return place.lower() == host_header.lower()


def guarded_server(
    host: str,
    port: int,
    token: str | None = None,
    max_connections: int = 100,
) -> viser.ViserServer:
    """A viser server that refuses foreign requests and cannot be shared publicly.

    Without the ``token`` in its address a request is refused, unless it is None.
    """
    server = GuardedServer(
        host=host,
        port=port,
        admission=functools.partial(_refusal, host, token),
        max_connections=max_connections,
    )
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    server._websock_server.unregister_handler(_messages.ShareUrlRequest)
    return server


def _refusal(bound_host: str, token: str | None, request: Request) -> str | None:
    """Reason why a request is refused; None if it is admitted."""
    hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
    if len(hosts) > 1 or len(origins) > 1:
        return "A request names one host and one origin."
    host = hosts[0] if hosts else None
    # A page of another site that resolves to this machine cannot know the token, while
    # a proxy may have any name.
    if token is None and not is_host_allowed(host, bound_host):
        return "This host name is not the editor's."
    if not is_origin_allowed(origins[0] if origins else None, host or ""):
        return "This origin may not use the editor."
    if token is not None and not _has_token(request.path, token):
        return (
            "This address lacks the editor's token. Open the whole address that the "
            f"editor printed at its start, with ?{TOKEN_FIELD}=..."
        )
    return None


def _has_token(path: str, token: str) -> bool:
    given = parse_qs(path.partition("?")[2], errors="replace").get(TOKEN_FIELD, [])
    return len(given) == 1 and hmac.compare_digest(given[0].encode(), token.encode())


def _host_name(address: str) -> str | None:
    """The host in an address, in lower case; None where there is none."""
    try:
        return urlsplit(address).hostname
    except ValueError:
        return None


def _ip_address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


@functools.cache
def _full_name() -> str:
    """The machine's name with its domain; the resolver may take a while."""
    return socket.getfqdn()


def check_values(client: viser.ClientHandle) -> None:
    """Drop values that an element of the page cannot have, before they are stored."""
    connection, gui = client._websock_connection, client.gui
    accept = gui._handle_gui_updates

    async def guarded(client_id: Any, message: _messages.GuiUpdateMessage) -> None:
        handle = gui._gui_input_handle_from_uuid.get(message.uuid)
        if handle is None:
            return
        # Other names would set attributes of viser's own objects.
        if message.updates.keys() == {"value"} and _can_have(
            handle, message.updates["value"]
        ):
            await accept(client_id, message)
        else:
            _LOG.info("A value that a page cannot send was dropped.")

    connection.unregister_handler(_messages.GuiUpdateMessage, accept)
    connection.register_handler(_messages.GuiUpdateMessage, guarded)


def _can_have(handle: Any, value: Any) -> bool:
    """Whether an element of the page can have a value: its type, options and bounds."""
    options = getattr(handle, "options", None)
    if options is not None:
        return value in options
    current = handle.value
    if isinstance(current, tuple):
        is_of_length = isinstance(value, list) and len(value) == len(current)
        # What is empty, because it differs among agents, may stay so.
        return is_of_length and all(
            _is_within(handle, one) or (one != one and was != was)
            for one, was in zip(value, current, strict=True)
        )
    if isinstance(current, bool | str):
        return type(value) is type(current)
    return isinstance(current, int | float) and _is_within(handle, value)


def _is_within(handle: Any, value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    low, high = getattr(handle, "min", None), getattr(handle, "max", None)
    return (
        math.isfinite(value)
        and (low is None or value >= low - _ROUNDING)
        and (high is None or value <= high + _ROUNDING)
    )


def limit_uploads(
    client: viser.ClientHandle, max_bytes: int, on_refused: Callable[[str, int], None]
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
