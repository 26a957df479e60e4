import gc
import gzip
import http.client
import socket
import threading
import time
from pathlib import Path
from typing import Any

import msgspec
import pytest
import viser
from viser import _viser
from viser.infra import _infra
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from pd_editor.viewer.server import viser_adapter
from pd_editor.viewer.server.server_guard import (
    guarded_server,
    is_host_allowed,
    is_loopback,
    is_origin_allowed,
)
from tests.viewer.fake_browser import CAMERA, connected_tab, running_app, until

PROTOCOLS: list[Any] = [f"viser-v{viser.__version__}"]


@pytest.mark.parametrize(
    ("origin", "host", "expected"),
    [
        (None, "127.0.0.1:8080", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://localhost:8080", "localhost:8080", True),
        ("http://evil.example", "127.0.0.1:8080", False),
        ("http://localhost:9999", "localhost:8080", False),
        ("http://lab.example:8080", "lab.example:8080", True),
        ("http://evil.example", "lab.example:8080", False),
        ("null", "127.0.0.1:8080", False),
        ("http://[", "[", False),
    ],
)
def test_origins(origin, host, expected):
    assert is_origin_allowed(origin, host) is expected


@pytest.fixture(scope="module")
def server():
    running = guarded_server("127.0.0.1", 0)
    yield running
    running.stop()


def status_of_upgrade(port: int, origin: str | None) -> int:
    headers = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Protocol": "viser-v1.1.1",
    }
    if origin is not None:
        headers["Origin"] = origin
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", "/", headers=headers)
    status = connection.getresponse().status
    connection.close()
    return status


def test_the_real_server_refuses_a_foreign_page(server):
    port = server.get_port()
    assert status_of_upgrade(port, "http://evil.example") == 403
    assert status_of_upgrade(port, f"http://127.0.0.1:{port}") == 101


def test_the_page_itself_is_served(server):
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=30)
    connection.request("GET", "/")
    answer = connection.getresponse()
    assert answer.status == 200
    connection.close()


def test_the_public_share_tunnel_is_gone(server):
    from viser import _messages

    handlers = server._websock_server._incoming_handlers
    assert not handlers.get(_messages.ShareUrlRequest)


@pytest.mark.parametrize(
    ("host", "bound", "expected"),
    [
        ("127.0.0.1:8080", "127.0.0.1", True),
        ("LOCALHOST:8080", "127.0.0.1", True),
        ("[::1]:8080", "::1", True),
        ("rebound.example:8080", "127.0.0.1", False),
        ("127.0.0.1.evil.example", "127.0.0.1", False),
        ("localhost@evil.example", "127.0.0.1", False),
        ("[", "127.0.0.1", False),
        (None, "127.0.0.1", False),
        ("127.0.0.1:8080", "127.0.0.2", True),
        ("127.200.3.4:8080", "127.0.0.1", True),
        ("[::ffff:127.0.0.1]:8080", "127.0.0.1", True),
        ("128.0.0.1:8080", "127.0.0.1", False),
        ("192.0.2.7:8080", "0.0.0.0", True),
        ("[2001:db8::7]:8080", "::", True),
        ("localhost:8080", "0.0.0.0", True),
        (f"{socket.gethostname()}:8080", "0.0.0.0", True),
        ("lab.example:8080", "lab.example", True),
        ("rebound.example:8080", "0.0.0.0", False),
        ("rebound.example:8080", "192.0.2.7", False),
        ("rebound.example:8080", "127.0.0.2", False),
        (None, "0.0.0.0", False),
    ],
)
def test_hosts(host, bound, expected):
    """A foreign name is refused even without an origin (fault 8)."""
    assert is_host_allowed(host, bound) is expected


def test_the_page_is_not_served_under_a_foreign_name(server):
    """DNS rebinding cannot even load the page (fault 8)."""
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=30)
    connection.request("GET", "/", headers={"Host": "rebound.example"})
    assert connection.getresponse().status == 403
    connection.close()


def test_a_path_that_cannot_be_is_not_found(server):
    """A NUL in the address raised in viser's own handler (fault 8)."""
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=30)
    for path in ("/a%00b", "/" + "x" * 300, "/%ff", "/../../etc/passwd"):
        connection.request("GET", path)
        answer = connection.getresponse()
        answer.read()
        assert answer.status == 404, path
    connection.close()


def test_viser_is_not_patched(server):
    """The guards are subclasses; viser's modules stay as they are (fault 8)."""
    assert isinstance(server, viser.ViserServer)
    assert _infra.websockets.__name__ == "websockets"
    assert _viser.infra.WebsockServer.__module__ == _infra.__name__
    assert _infra._message_consumer.__module__ == _infra.__name__
    assert "mock" not in Path(viser_adapter.__file__).read_text()


def test_another_version_of_viser_is_told(monkeypatch):
    """The adapter fits known versions only (fault 8)."""
    monkeypatch.setattr(viser_adapter, "KNOWN_VERSIONS", ("0.9.",))
    with pytest.raises(RuntimeError, match=r"is not known to the server's guards"):
        guarded_server("127.0.0.1", 0)


GARBAGE = (
    b"",
    b"\x00",
    b"\xc1" * 50,
    b"not msgpack",
    "a text frame",
    msgspec.msgpack.encode([1, 2]),
    msgspec.msgpack.encode({"no": "type"}),
    msgspec.msgpack.encode({"type": "NoSuchMessage"}),
    msgspec.msgpack.encode({"type": ["list"]}),
    msgspec.msgpack.encode({"type": "ViewerCameraMessage"}),
    msgspec.msgpack.encode(CAMERA | {"wxyz": "x", "fov": None}),
    msgspec.msgpack.encode(CAMERA | {"wxyz": [float("nan")] * 4}),
    msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "x", "updates": 7}),
    msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": 5, "updates": {}}),
    msgspec.msgpack.encode(
        {"type": "SceneNodeClickMessage", "name": "/nowhere", "instance_index": "a"}
    ),
    msgspec.msgpack.encode(
        {
            "type": "FileTransferStartUpload",
            "source_component_uuid": "x",
            "transfer_uuid": "y",
            "filename": "a\n\0b",
            "mime_type": "z",
            "part_count": -1,
            "size_bytes": "many",
        }
    ),
    msgspec.msgpack.encode({"type": "FileTransferPart", "transfer_uuid": "y"}),
)


def is_closed_on(socket: ClientConnection, frame: bytes) -> bool:
    """Whether the server closes a connection on a frame."""
    try:
        socket.send(frame)
        while True:
            socket.recv(timeout=10)
    except ConnectionClosed:
        return True
    except TimeoutError:
        return False


def test_garbage_is_dropped_without_a_traceback(tmp_path, caplog, capfd):
    """Frames that are no messages, and messages that fit nothing (fault 8)."""
    caplog.set_level("WARNING")
    with running_app(tmp_path, "roundabout") as app:
        address = f"ws://127.0.0.1:{app.server.get_port()}"
        protocols: list[Any] = [f"viser-v{viser.__version__}"]
        with (
            connected_tab(app) as other,
            connect(address, subprotocols=protocols, max_size=None) as socket,
        ):
            socket.send(msgspec.msgpack.encode(CAMERA))
            for frame in GARBAGE:
                socket.send(frame)
            socket.send(msgspec.msgpack.encode(CAMERA))
            other.run(lambda: None)
            with connect(address, subprotocols=protocols, max_size=None) as huge:
                assert is_closed_on(huge, b"\x90" * (viser_adapter.MAX_FRAME_BYTES + 1))
            other.run(
                lambda: other.session.select(other.session.scenario.agents.ids[:1])
            )
            assert other.session.selection
    gc.collect()
    said = caplog.text + capfd.readouterr().err
    assert "Traceback" not in said, said
    assert "never retrieved" not in said, said


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", True),
        ("127.0.0.2", True),
        ("127.255.255.254", True),
        ("LOCALHOST", True),
        ("::1", True),
        ("::ffff:127.0.0.1", True),
        ("0.0.0.0", False),
        ("::", False),
        ("", False),
        ("128.0.0.1", False),
        ("127.0.0.1.evil.example", False),
        ("localhost.evil.example", False),
    ],
)
def test_what_only_this_machine_reaches(host, expected):
    assert is_loopback(host) is expected


def answer(port: int, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", path, headers=headers)
    found = connection.getresponse()
    found.text = found.read()
    connection.close()
    return found


@pytest.mark.parametrize("path", ["/", "/nowhere", "/a%00b"])
@pytest.mark.parametrize("host", ["localhost", "evil.example"])
def test_nothing_may_be_framed(server, path, host):
    """A foreign site around the page could have a user click what it hides."""
    headers = answer(server.get_port(), path, Host=host).headers
    assert headers.get_all("Content-Security-Policy") == ["frame-ancestors 'none'"]
    assert headers.get_all("X-Frame-Options") == ["DENY"]


TOKEN = "secret-token"
WRONG_QUERIES = (
    "",
    "?token=",
    "?token=secret-toke",
    "?token=secret-tokens",
    "?token=SECRET-TOKEN",
    "?token=%ff%fe",
    "?token=%C3%A9",
    f"?token={TOKEN}&token={TOKEN}",
    f"?Token={TOKEN}",
    f"?other={TOKEN}",
)


@pytest.fixture(scope="module")
def server_with_token():
    running = guarded_server("0.0.0.0", 0, TOKEN)
    yield running
    running.stop()


@pytest.mark.parametrize("query", WRONG_QUERIES)
def test_without_the_token_neither_page_nor_connection_is_served(
    server_with_token, query
):
    port = server_with_token.get_port()
    for path in (f"/{query}", f"/index.html{query}"):
        refused = answer(port, path)
        assert refused.status == 403
        assert b"lacks the editor's token" in refused.text
        assert TOKEN.encode() not in refused.text
    with pytest.raises(InvalidStatus) as caught:
        connect(f"ws://127.0.0.1:{port}/{query}", subprotocols=PROTOCOLS)
    assert caught.value.response.status_code == 403


def test_the_token_admits_to_page_and_connection_under_any_name(server_with_token):
    """A proxy gives the editor its own name; a foreign page is refused all the same."""
    port = server_with_token.get_port()
    path = f"/?token={TOKEN}"
    assert answer(port, path).status == 200
    assert answer(port, path, Host="hub.example").status == 200
    assert answer(port, path, Origin="http://evil.example").status == 403
    connect(f"ws://127.0.0.1:{port}{path}", subprotocols=PROTOCOLS).close()


def test_a_rebound_name_is_refused_where_no_token_is_asked():
    running = guarded_server("0.0.0.0", 0)
    try:
        port = running.get_port()
        assert answer(port).status == 200
        assert answer(port, Host=f"rebound.example:{port}").status == 403
        origin = f"http://rebound.example:{port}"
        assert status_of_upgrade(port, origin) == 403
    finally:
        running.stop()


def test_too_many_connections_are_refused_in_a_sentence():
    running = guarded_server("127.0.0.1", 0, max_connections=2)
    address = f"ws://127.0.0.1:{running.get_port()}"
    try:
        with (
            connect(address, subprotocols=PROTOCOLS),
            connect(address, subprotocols=PROTOCOLS),
        ):
            until(lambda: answer(running.get_port()).status == 503)
            with pytest.raises(InvalidStatus) as caught:
                connect(address, subprotocols=PROTOCOLS)
            assert caught.value.response.status_code == 503
            full = answer(running.get_port())
            assert full.status == 503
            assert b"The editor serves 2 pages already" in full.text
        until(lambda: answer(running.get_port()).status == 200)
    finally:
        running.stop()


def test_a_connection_that_never_speaks_is_closed(monkeypatch):
    monkeypatch.setattr(viser_adapter, "SILENCE_S", 0.2)
    running = guarded_server("127.0.0.1", 0)
    try:
        address = f"ws://127.0.0.1:{running.get_port()}"
        with connect(address, subprotocols=PROTOCOLS) as mute:
            until(lambda: mute.close_code is not None)
        with connect(address, subprotocols=PROTOCOLS) as speaking:
            speaking.send(msgspec.msgpack.encode(CAMERA))
            time.sleep(0.5)
            speaking.send(msgspec.msgpack.encode(CAMERA))
            speaking.ping().wait(30)
    finally:
        running.stop()


def test_a_page_that_connects_while_the_server_starts_is_served(monkeypatch):
    """viser listens before its server is complete; an open tab connects at once."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    listens, connected = threading.Event(), threading.Event()
    start = _infra.WebsockServer.start

    def started(server: Any) -> None:
        start(server)
        listens.set()
        time.sleep(0.5)

    monkeypatch.setattr(_infra.WebsockServer, "start", started)
    errors: list[Exception] = []

    def come_early() -> None:
        listens.wait(30)
        try:
            with connect(f"ws://127.0.0.1:{port}", subprotocols=PROTOCOLS) as socket:
                socket.send(msgspec.msgpack.encode(CAMERA))
                connected.set()
                socket.recv(timeout=30)
        except (OSError, ConnectionClosed, InvalidStatus) as error:
            errors.append(error)

    early = threading.Thread(target=come_early)
    early.start()
    running = guarded_server("127.0.0.1", port)
    try:
        clients: list[Any] = []
        running.on_client_connect(clients.append)
        assert connected.wait(30)
        until(lambda: clients)
        early.join(30)
        assert not errors
    finally:
        running.stop()


def test_the_page_has_our_script_packed_or_not(server):
    """It gives the connection the token, and the slash at the end of a proxy's path."""
    plain = answer(server.get_port())
    packed = answer(server.get_port(), **{"Accept-Encoding": "gzip"})
    assert gzip.decompress(packed.text) == plain.text
    assert int(packed.headers["Content-Length"]) == len(packed.text)
    assert plain.text.count(b"<head><script>") == 1
