"""What foreign pages, garbage, huge frames and many tabs do to a server of its own.

Only addresses of this machine are used. Foreign origins and hosts must be refused,
garbage must be dropped without a traceback while another tab works, and after 50 tabs
the memory must be back within 10 % of what it was after the first forty.
"""

import contextlib
import http.client
import socket
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import viser
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from benchmarks.figures import load_in_words
from tests.bad_inputs.inputs import odd_frame
from tests.viewer.fake_browser import CAMERA

NUM_FRAMES = 400
NUM_TABS = 50
NUM_FIRST_TABS = 40
"""By then as many sessions are kept for a reload as ever, and the weights are read."""
NUM_AT_ONCE = 10
MOST_GROWTH = 0.10
BUILD_S = 40.0
STAY_S = 2.0
LEAST_PAGE_BYTES = 50_000
"""A page with its road has more."""
PROTOCOLS: list[Any] = [f"viser-v{viser.__version__}"]
HELLO = msgspec.msgpack.encode(CAMERA)


class Server:
    """The editor in a process of its own."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.log = folder / "log"
        words = ["edit", "roundabout", "--port", str(self.port)]
        with self.log.open("w") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "pd_editor", *words, "--state", folder],
                stdout=log,
                stderr=log,
            )
        while b"editor is at" not in self.log.read_bytes().lower():
            assert self._process.poll() is None, self.log.read_text()
            time.sleep(0.1)

    def memory_mib(self) -> float:
        """Resident memory."""
        text = Path(f"/proc/{self._process.pid}/status").read_text()
        (line,) = (line for line in text.splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) / 1024

    def tab(self, **headers: str) -> Connection:
        """A connection that has not said anything yet."""
        return connect(
            f"ws://127.0.0.1:{self.port}",
            subprotocols=PROTOCOLS,
            max_size=None,
            additional_headers=headers,
            open_timeout=30,
        )

    def page_status(self, host: str) -> int:
        """What a browser is answered that came under a name."""
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        client.request("GET", "/", headers={"Host": host})
        status = client.getresponse().status
        client.close()
        return status

    def works(self) -> bool:
        """Whether a tab is built."""
        with self.tab() as tab:
            return received(tab) > LEAST_PAGE_BYTES

    def stop(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait(30)


def received(tab: Connection) -> int:
    """Bytes of a page within a few seconds, or until it is surely built."""
    tab.send(HELLO)
    total, began = 0, time.monotonic()
    while time.monotonic() < began + BUILD_S:
        with contextlib.suppress(TimeoutError):
            total += len(tab.recv(timeout=1.0))
        if total > LEAST_PAGE_BYTES and time.monotonic() > began + STAY_S:
            break
    return total


def refuses_foreign(server: Server) -> bool:
    """Whether foreign origins and hosts are refused, and the own ones served."""
    own = f"127.0.0.1:{server.port}"
    try:
        server.tab(Origin="http://evil.example").close()
    except InvalidStatus as error:
        is_refused = error.response.status_code == 403
    else:
        is_refused = False
    server.tab(Origin=f"http://{own}").close()
    statuses = [server.page_status(host) for host in (own, "rebound.example", "[")]
    return is_refused and statuses == [200, 403, 403]


def survives_garbage(server: Server) -> bool:
    """Whether odd frames, huge ones and bytes that are no HTTP leave it at work."""
    random = np.random.default_rng(0)
    tab = server.tab()
    tab.send(HELLO)
    for _ in range(NUM_FRAMES):
        try:
            tab.send(odd_frame(random))
        except ConnectionClosed:
            tab = server.tab()
    for size in (2**20, 2**24, 2**26):
        with server.tab() as huge:
            try:
                huge.send(b"\x90" * size)
                huge.recv(timeout=1.0)
            except (ConnectionClosed, OSError, TimeoutError):
                pass
    for junk in (b"\0" * 4096, b"GET / HTTP/9.9\r\n\r\n", random.bytes(4096)):
        with socket.create_connection(("127.0.0.1", server.port)) as raw:
            raw.sendall(junk)
    tab.close()
    return server.works()


def open_and_close(server: Server, count: int) -> None:
    """Build pages in some tabs at once, and close them."""
    with ThreadPoolExecutor(count) as threads:
        assert all(threads.map(lambda _: server.works(), range(count)))


def main() -> int:
    """Print the table; the exit code is 1 if something was not as it must be."""
    with tempfile.TemporaryDirectory() as name:
        server = Server(Path(name))
        try:
            foreign = refuses_foreign(server)
            print(f"foreign origins and hosts refused: {foreign}", flush=True)
            garbage = survives_garbage(server)
            print(
                f"at work after {NUM_FRAMES} odd frames and 3 huge ones: {garbage}",
                flush=True,
            )
            for _ in range(0, NUM_FIRST_TABS, NUM_AT_ONCE):
                open_and_close(server, NUM_AT_ONCE)
            time.sleep(5)
            before = server.memory_mib()
            for _ in range(0, NUM_TABS, NUM_AT_ONCE):
                open_and_close(server, NUM_AT_ONCE)
            time.sleep(5)
            after = server.memory_mib()
        finally:
            server.stop()
        said = server.log.read_text()
    num_tracebacks = said.count("Traceback") + said.count("never retrieved")
    growth = after / before - 1
    print(f"tracebacks in the log: {num_tracebacks}")
    print(
        f"memory after {NUM_FIRST_TABS} tabs {before:.0f} MiB, after {NUM_TABS} more "
        f"{after:.0f} MiB ({100 * growth:+.1f} %)"
    )
    print(load_in_words())
    if num_tracebacks:
        print(said[-3000:])
    is_good = foreign and garbage and not num_tracebacks and growth <= MOST_GROWTH
    return int(not is_good)


if __name__ == "__main__":
    sys.exit(main())
