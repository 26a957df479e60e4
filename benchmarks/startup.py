"""From ``python app.py`` to its page, and from a visit to the first picture.

Needs Chromium. Run as ``python -m benchmarks.startup``. Each run is a new server
and a new browser; what the server has imported is asked when the picture is there.
"""

import contextlib
import http.client
import re
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

from playwright.sync_api import Browser, ViewportSize

from benchmarks.chromium import opened_chromium
from benchmarks.figures import load_in_words, spread

RUNS = 5
ROOT = Path(__file__).parents[1]
VIEWPORT = ViewportSize(width=1100, height=720)
POLL_S = 0.01

SERVER = """
import runpy, sys, threading
def answer():
    for line in sys.stdin:
        print("torch" in sys.modules, "av2" in sys.modules, flush=True)
threading.Thread(target=answer, daemon=True).start()
sys.argv = ["app.py", *sys.argv[1:]]
runpy.run_path("app.py", run_name="__main__")
"""
"""``app.py`` as it is, with a thread that says on request what was imported."""

FIRST_PICTURE = """
() => {
  const viewer = window.__viserMutable, points = window.__viserTestpoints;
  if (!viewer || !points || !points.rendererInfo) return false;
  const has = (start) => Object.entries(viewer.nodeRefFromName).some(([name, node]) => {
    let count = 0;
    node && name.startsWith(start) && node.traverse(o => count += o.isMesh ? 1 : 0);
    return count > 0;
  });
  if (!has('/map/road') || !has('/map/lanes') || !has('/agents/')) return false;
  if (parseFloat(viewer.canvas.style.opacity || '1') < 1) return false;
  const frame = points.rendererInfo.render.frame;
  window.__mountedAt ??= frame;
  viewer.requestRender();
  return frame > window.__mountedAt && performance.now();
}
"""
"""Milliseconds since the navigation began, once a frame with road and agents was drawn
and is not faded in any more."""


def free_port() -> int:
    """A free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def started(library: str) -> Iterator[tuple[subprocess.Popen, str, float]]:
    """A server of its own; the page's address, and the seconds until it was printed."""
    start = time.perf_counter()
    process = subprocess.Popen(
        [
            sys.executable,
            "-c",
            SERVER,
            "--port",
            str(free_port()),
            "--state",
            library,
        ],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    try:
        found = None
        for line in process.stdout:
            if found := re.search(r"http://\S+", line):
                break
        assert found, "the server printed no address"
        yield process, found.group(), time.perf_counter() - start
    finally:
        process.kill()
        process.wait()


def page_is_served(address: str) -> bool:
    """Whether the page comes with status 200."""
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=5)
    try:
        connection.request("GET", "/")
        return connection.getresponse().status == 200
    except OSError:
        return False
    finally:
        connection.close()


def imported(process: subprocess.Popen) -> tuple[bool, bool]:
    """Whether the server has imported torch, and av2."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write("?\n")
    process.stdin.flush()
    torch, av2 = process.stdout.readline().split()
    return torch == "True", av2 == "True"


def one_run(browser: Browser) -> tuple[float, float, float, tuple[bool, bool]]:
    """Seconds to the address, to the page, to the picture; and the imports."""
    start = time.perf_counter()
    with (
        tempfile.TemporaryDirectory() as folder,
        started(folder) as (process, address, printed_s),
    ):
        while not page_is_served(address):
            time.sleep(POLL_S)
        served_s = time.perf_counter() - start
        context = browser.new_context(viewport=VIEWPORT)
        page = context.new_page()
        page.goto(address, wait_until="commit")
        picture_ms = page.wait_for_function(
            FIRST_PICTURE, polling=20, timeout=60_000
        ).json_value()
        imports = imported(process)
        context.close()
    return printed_s, served_s, picture_ms / 1e3, imports


def main() -> None:
    """Print the times of some runs."""
    runs = []
    for _ in range(RUNS):
        with opened_chromium() as browser:
            runs.append(one_run(browser))
    printed, served, picture, imports = zip(*runs, strict=True)
    print(f"start of the editor, {RUNS} runs, {load_in_words()}")
    print(f"  process to address line (s)          {spread(printed, 2)}")
    print(f"  process to page served (s)           {spread(served, 2)}")
    print(f"  navigation to first picture (s)      {spread(picture, 2)}")
    together = [a + b for a, b in zip(served, picture, strict=True)]
    print(
        f"  pictures in order (s)                {', '.join(f'{s:.2f}' for s in picture)}"
    )
    print(f"  both together, median (s)            {statistics.median(together):.2f}")
    print(
        f"  torch imported: {any(torch for torch, _ in imports)}, "
        f"av2 imported: {any(av2 for _, av2 in imports)}"
    )


if __name__ == "__main__":
    main()
