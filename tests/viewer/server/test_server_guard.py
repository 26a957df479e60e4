import http.client

import pytest

from pd_editor.viewer.server.server_guard import guarded_server, is_origin_allowed


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
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    connection.request("GET", "/", headers=headers)
    status = connection.getresponse().status
    connection.close()
    return status


def test_the_real_server_refuses_a_foreign_page(server):
    port = server.get_port()
    assert status_of_upgrade(port, "http://evil.example") == 403
    assert status_of_upgrade(port, f"http://127.0.0.1:{port}") == 101


def test_the_page_itself_is_served(server):
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=5)
    connection.request("GET", "/")
    answer = connection.getresponse()
    assert answer.status == 200
    connection.close()


def test_the_public_share_tunnel_is_gone(server):
    from viser import _messages

    handlers = server._websock_server._incoming_handlers
    assert not handlers.get(_messages.ShareUrlRequest)
