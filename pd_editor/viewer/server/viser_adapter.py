"""viser's server with guards where it has no options for them.

viser makes its websocket server itself and reads messages of browsers without checks. The
classes here run viser's own code with some names bound to guarded versions; viser's
modules are not changed. They support the versions in ``KNOWN_VERSIONS`` only.
"""

import asyncio
import contextlib
import functools
import gzip
import http
import io
import logging
import types
import warnings
from collections.abc import Awaitable, Callable
from importlib.resources import files
from typing import Any, Final

import viser
import websockets.asyncio.server
import websockets.datastructures
import websockets.exceptions
from viser import _viser
from viser.infra import Message, WebsockServer
from viser.infra import _infra as infra_module
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

KNOWN_VERSIONS: Final = ("1.1.",)
MAX_FRAME_BYTES: Final = 8 * 2**20
"""Largest message of a browser; parts of uploads have 1 MiB."""
SILENCE_S: Final = 60.0
"""Time after which a connection that has never said anything is closed."""
SECURITY_HEADERS: Final = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    # The address has the token in it.
    "Referrer-Policy": "no-referrer",
}

Admission = Callable[[Request], str | None]
"""Returns the reason why a request is refused, in a sentence; None admits it."""

_LOG: Final = logging.getLogger(__name__)
_HANDSHAKE_NOISE: Final = ("opening handshake failed", "connection rejected")


class GuardedServer(viser.ViserServer):
    """A viser server that admits requests by a rule and drops invalid messages."""

    def __init__(
        self, *, host: str, port: int, admission: Admission, max_connections: int
    ) -> None:
        """Start it; requests that come earlier wait until it is complete.

        Raises:
            RuntimeError: viser is of a version that this module does not know.
        """
        if not viser.__version__.startswith(KNOWN_VERSIONS):
            raise RuntimeError(
                f"viser {viser.__version__} is not known to the server's guards; "
                f"expected {', '.join(f'{one}x' for one in KNOWN_VERSIONS)}."
            )

        def guarded(*args: Any, **options: Any) -> "_GuardedWebsockServer":
            return _GuardedWebsockServer(
                *args, admission=admission, max_connections=max_connections, **options
            )

        infra = types.SimpleNamespace(
            **{**vars(_viser.infra), "WebsockServer": guarded}
        )
        # A page may leave at any time, also while it is drawn: nothing is wrong then.
        warnings.filterwarnings("ignore", r"Queued a \w+ on a closed connection")
        start = _with_names(viser.ViserServer.__init__, infra=infra)
        with contextlib.redirect_stdout(io.StringIO()):
            start(self, host=host, port=port, verbose=False)
        assert isinstance(self._websock_server, _GuardedWebsockServer)
        self._websock_server.is_ready = True


class _GuardedConnection(infra_module.WebsockClientConnection):
    async def _handle_incoming_message(self, client_id: Any, message: Message) -> None:
        await _quietly(super()._handle_incoming_message(client_id, message), message)


class _GuardedWebsockServer(WebsockServer):
    def __init__(
        self, *args: Any, admission: Admission, max_connections: int, **options: Any
    ) -> None:
        super().__init__(*args, **options)
        self._admission = admission
        self._max_connections = max_connections
        self.is_ready = False
        """Whether viser's server, which a connection needs, is complete."""

    async def _handle_incoming_message(self, client_id: Any, message: Message) -> None:
        await _quietly(super()._handle_incoming_message(client_id, message), message)

    def _background_worker(self, ready_sem: Any) -> None:
        def serve(handler: Any, *args: Any, **options: Any) -> Any:
            inner = options.pop("process_request", None)
            return websockets.asyncio.server.serve(
                handler,
                *args,
                **{
                    **options,
                    "process_request": self._answering(inner),
                    "process_response": _with_security_headers,
                    "max_size": MAX_FRAME_BYTES,
                    "logger": _connection_log(),
                },
            )

        server = types.SimpleNamespace(
            **{**vars(websockets.asyncio.server), "serve": serve}
        )
        names = types.SimpleNamespace(
            asyncio=types.SimpleNamespace(server=server),
            exceptions=websockets.exceptions,
            datastructures=websockets.datastructures,
        )
        work = _with_names(
            WebsockServer._background_worker,
            websockets=names,
            WebsockClientConnection=_GuardedConnection,
            _message_consumer=_consume,
        )
        work(self, ready_sem)

    def _answering(
        self, inner: Callable[[ServerConnection, Request], Any] | None
    ) -> Callable[[ServerConnection, Request], Awaitable[Response | None]]:
        """Answers requests; what is admitted goes to viser's own handler."""

        async def answer(
            connection: ServerConnection, request: Request
        ) -> Response | None:
            while not self.is_ready:
                await asyncio.sleep(0.05)
            refusal = self._admission(request)
            if refusal is not None:
                return connection.respond(http.HTTPStatus.FORBIDDEN, f"{refusal}\n")
            if len(self._live_connections) >= self._max_connections:
                return connection.respond(
                    http.HTTPStatus.SERVICE_UNAVAILABLE,
                    f"The editor serves {self._max_connections} pages already, which is "
                    "the most; close some, and load this page again.\n",
                )
            try:
                found = None if inner is None else inner(connection, request)
                found = await found if isinstance(found, Awaitable) else found
            # A path with NUL, for example: there is no file at any such address.
            except (OSError, ValueError):
                return connection.respond(http.HTTPStatus.NOT_FOUND, "NOT FOUND\n")
            return found if found is None else _with_own_script(found)

        return answer


def _with_names(function: Any, **names: Any) -> Callable[..., Any]:
    """Copy of a function in which some global names have other values."""
    assert isinstance(function, types.FunctionType)
    missing = names.keys() - function.__globals__.keys()
    assert not missing, f"viser has no {missing} any more"
    same = types.FunctionType(
        function.__code__,
        {**function.__globals__, **names},
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    same.__kwdefaults__ = function.__kwdefaults__
    return same


async def _with_security_headers(
    _connection: ServerConnection, _request: Request, response: Response
) -> None:
    for name, value in SECURITY_HEADERS.items():
        response.headers[name] = value


def _with_own_script(response: Response) -> Response:
    """A page of viser with our script before its own ones; other files as they are."""
    if not response.headers.get("Content-Type", "").startswith("text/html"):
        return response
    is_packed = response.headers.get("Content-Encoding") == "gzip"
    body = _with_script_in_head(bytes(response.body or b""), is_packed)
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(body))
    response.body = body
    return response


@functools.lru_cache(maxsize=4)
def _with_script_in_head(page: bytes, is_packed: bool) -> bytes:
    script = files("pd_editor.viewer.server").joinpath("address.js").read_bytes()
    text = gzip.decompress(page) if is_packed else page
    text = text.replace(b"<head>", b"<head><script>" + script + b"</script>", 1)
    return gzip.compress(text) if is_packed else text


async def _consume(
    connection: ServerConnection,
    handle_message: Callable[[Message], None],
    message_class: type[Message],
) -> None:
    """Pass on each message of a connection; invalid messages are dropped."""
    patience_s: float | None = SILENCE_S
    while True:
        try:
            async with asyncio.timeout(patience_s):
                raw = await connection.recv()
        except TimeoutError:
            await connection.close(1008, "The page said nothing.")
            continue
        patience_s = None
        if not isinstance(raw, bytes):
            _LOG.info("A text frame was dropped.")
            continue
        try:
            message = message_class.deserialize(raw)
        # viser names no errors for bytes that are no message of its own.
        except Exception as error:  # noqa: BLE001
            _LOG.info("A frame that is no message was dropped: %r", error)
            continue
        handle_message(message)


async def _quietly(handling: Awaitable[None], message: Message) -> None:
    """Drop a message on which a handler of viser fails."""
    try:
        await handling
    # Our handlers only post to a queue, so errors are due to the message's contents.
    except Exception as error:  # noqa: BLE001
        _LOG.info("A %s was dropped: %r", type(message).__name__, error)


def _connection_log() -> logging.Logger:
    """A log without the tracebacks of handshakes that are none."""
    log = logging.getLogger(f"{__name__}.connections")
    if not log.filters:
        log.addFilter(
            lambda record: not record.getMessage().startswith(_HANDSHAKE_NOISE)
        )
    return log
