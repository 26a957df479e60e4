import gc
import http.client
from pathlib import Path
from typing import Any

import msgspec
import pytest
import viser
from viser import _viser
from viser.infra import _infra
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from pd_editor.viewer.server import viser_adapter
from pd_editor.viewer.server.server_guard import (
    guarded_server,
    is_host_allowed,
    is_origin_allowed,
)
from tests.viewer.fake_browser import CAMERA, connected_tab, running_app


@pytest.mark.parametrize(
    ("origin", "host", "bound", "expected"),
    [
        (None, "127.0.0.1:8080", "127.0.0.1", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", "127.0.0.1", True),
        ("http://localhost:8080", "localhost:8080", "127.0.0.1", True),
        ("http://evil.example", "127.0.0.1:8080", "127.0.0.1", False),
        ("http://localhost:9999", "localhost:8080", "127.0.0.1", False),
        ("http://rebound.example:8080", "rebound.example:8080", "127.0.0.1", False),
        ("http://lab.example:8080", "lab.example:8080", "0.0.0.0", True),
        ("http://evil.example", "lab.example:8080", "0.0.0.0", False),
        ("null", "127.0.0.1:8080", "127.0.0.1", False),
        ("http://[", "[", "127.0.0.1", False),
    ],
)
def test_origins(origin, host, bound, expected):
    assert is_origin_allowed(origin, host, bound) is expected


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
        ("lab.example:8080", "0.0.0.0", True),
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
