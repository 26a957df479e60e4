"""A slider that bends the largest maps: from the mouse to the picture.

Needs PD_EDITOR_AV2 and Chromium. Run as ``python -m benchmarks.warp_in_browser``.
The "S-bend" slider is dragged with the mouse. The server's share is the time from
the receipt of a slider message to the return of the websocket's ``send`` with the
geometry made from it; the page's share is read off the vertices of rendered frames.
"""

import contextlib
import os
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import numpy as np
from playwright.sync_api import Browser, ViewportSize
from websockets.asyncio.server import ServerConnection

from benchmarks.chromium import opened_chromium
from benchmarks.figures import load_in_words, spread
from benchmarks.warp_scenario import busiest_scenario, with_largest_map
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.scene.map_view import MapView
from pd_editor.viewer.state.events import Inbox
from pd_editor.viewer.tab.ui_context import GESTURE_PAUSE_S
from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions
from tests.browser.editor_page import EditorPage

LARGEST_SCENARIO = "00a3ead5-2ab4-4bad-b55f-e519934c056c"
PANEL_WIDTH = 372
CANVAS = {"width": 900, "height": 600}
SLIDER = "S-bend"
SWEEPS = 4
SWEEP_S = 4.0
MOVE_S = 0.02
MIN_GEOMETRY_BYTES = 8192

PROBE = """
() => {
  const name = '/map/lanes';
  const probe = window.__probe = {frames: [], events: [], zero: null, unit: null};
  const meshes = () => {
    const node = window.__viserMutable.nodeRefFromName[name];
    const found = [];
    node && node.traverse(o => o.isMesh && found.push(o));
    return found;
  };
  const point = (mesh, index) => {
    const at = mesh.geometry.attributes.position;
    const v = mesh.position.clone().set(at.getX(index), at.getY(index), at.getZ(index));
    mesh.updateWorldMatrix(true, false);
    return v.applyMatrix4(mesh.matrixWorld).toArray();
  };
  const all = () => meshes().map(m =>
    Array.from({length: m.geometry.attributes.position.count}, (_, i) => point(m, i)));
  probe.keepZero = () => { probe.zero = all(); };
  probe.keepUnit = power => {
    let best = 0;
    all().forEach((mesh, m) => mesh.forEach((p, v) => {
      const d = p.map((c, k) => (c - probe.zero[m][v][k]) / power);
      const size = d.reduce((s, c) => s + c * c, 0);
      if (size > best) { best = size; probe.unit = {m, v, d, size}; }
    }));
    return best;
  };
  probe.power = () => {
    const mesh = meshes()[probe.unit.m];
    if (!mesh) return null;
    const p = point(mesh, probe.unit.v), zero = probe.zero[probe.unit.m][probe.unit.v];
    return p.reduce((s, c, k) => s + (c - zero[k]) * probe.unit.d[k], 0)
      / probe.unit.size;
  };
  let root = window.__viserMutable.nodeRefFromName[name];
  while (root.parent) root = root.parent;
  const before = root.onAfterRender;
  root.onAfterRender = (...all) => {
    before && before(...all);
    if (probe.unit) probe.frames.push([performance.now(), probe.power()]);
  };
  window.addEventListener('mousemove',
    e => probe.events.push([e.timeStamp, e.clientX]), true);
}
"""


@dataclass(kw_only=True)
class ServerTimes:
    """What the server did with slider messages."""

    received_s: list[float] = field(default_factory=list)
    handled: list[tuple[float, float]] = field(default_factory=list)
    """When a message that was not superseded came, and when its road was queued."""
    sent: list[tuple[float, float, int]] = field(default_factory=list)
    """Start and end of each send, and its bytes."""

    def latency_ms(self) -> list[float]:
        """From receipt to the end of the send that carries the geometry."""
        big = [(a, b) for a, b, size in self.sent if size >= MIN_GEOMETRY_BYTES]
        found = []
        for came, queued in self.handled:
            after = [end for start, end in big if start >= queued]
            if after:
                found.append((after[0] - came) * 1e3)
        return found


def installed_probes(times: ServerTimes) -> tuple:
    """Patches of the websocket and of the inbox that write down times."""
    send, post, show = ServerConnection.send, Inbox.post, MapView.show
    queued: list[float] = []

    async def timed_send(self, message, *arguments, **options):
        start = time.perf_counter()
        await send(self, message, *arguments, **options)
        times.sent.append((start, time.perf_counter(), len(message)))

    def timed_post(self, action, merge_key=None):
        if merge_key != "warp":
            return post(self, action, merge_key)
        came = time.perf_counter()
        times.received_s.append(came)

        def timed() -> None:
            queued.clear()
            action()
            if queued:
                times.handled.append((came, queued[0]))

        return post(self, timed, merge_key)

    def timed_show(self, scenario):
        show(self, scenario)
        queued.append(time.perf_counter())

    return (
        mock.patch.object(MapView, "show", timed_show),
        mock.patch.object(ServerConnection, "send", timed_send),
        mock.patch.object(Inbox, "post", timed_post),
    )


class SliderDrag:
    """The slider's thumb in the hand of a robot."""

    def __init__(self, editor: EditorPage) -> None:
        self.page = editor.page
        self.thumb = editor.row(SLIDER).get_by_role("slider")
        box = self.thumb.bounding_box()
        assert box is not None
        self.x, self.y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.page.mouse.move(self.x, self.y)
        self.page.mouse.down()
        self.px_per_power = 0.0

    def value(self) -> float:
        return float(self.thumb.get_attribute("aria-valuenow") or "nan")

    def calibrate(self) -> float:
        """Move to a high power and find out how many pixels one unit of it is."""
        offset = 0
        while offset < 90 and self.value() < 8:
            offset += 5
            self.page.mouse.move(self.x + offset, self.y)
            self.page.wait_for_timeout(20)
        self.page.wait_for_timeout(100)
        self.px_per_power = offset / self.value()
        return self.value()

    def move_to(self, power: float) -> None:
        self.page.mouse.move(self.x + power * self.px_per_power, self.y)

    def sweep(self, start: float, end: float, duration_s: float) -> None:
        """Move evenly."""
        began = time.perf_counter()
        while (passed := time.perf_counter() - began) < duration_s:
            self.move_to(start + (end - start) * passed / duration_s)
            self.page.wait_for_timeout(1e3 * MOVE_S)
        self.move_to(end)


def settled(editor: EditorPage) -> None:
    editor.page.wait_for_timeout(700)
    editor.settle()


def measured(browser: Browser, reference: str, title: str) -> None:
    """Open a scenario, drag the slider, and print what came of it."""
    times = ServerTimes()
    width = CANVAS["width"] + PANEL_WIDTH
    viewport = ViewportSize(width=width, height=CANVAS["height"])
    with tempfile.TemporaryDirectory() as folder:
        app = ViewerApp(ViewerOptions(reference=reference, port=0, state=Path(folder)))
        context = browser.new_context(viewport=viewport)
        try:
            editor = EditorPage(context.new_page(), app)
            editor.pause()
            editor.close_notifications()
            editor.open_tab("Road")
            settled(editor)
            page = editor.page
            page.evaluate(PROBE)
            page.evaluate("__probe.keepZero()")
            drag = SliderDrag(editor)
            power = drag.calibrate()
            settled(editor)
            assert page.evaluate(f"__probe.keepUnit({power})") > 0
            with contextlib.ExitStack() as stack:
                for patch in installed_probes(times):
                    stack.enter_context(patch)
                results = [
                    one_sweep(editor, drag, 1 if index % 2 else -1)
                    for index in range(SWEEPS)
                ]
            size = page.evaluate(
                "(() => { const c = __viserMutable.canvas;"
                " return [c.clientWidth, c.clientHeight]; })()"
            )
            page.mouse.up()
            report(title, editor.session.scenario, results, times, size)
        finally:
            context.close()
            app.stop()


@dataclass(kw_only=True)
class Sweep:
    """What one even movement of the slider brought about in the page."""

    duration_s: float
    num_frames: int
    num_blank: int
    num_changes: int
    latency_ms: list[float]
    """From the mouse event to the first frame with the road made from it."""
    final_ms: float
    """From the last mouse event to the first frame with the road made from that."""


def one_sweep(editor: EditorPage, drag: SliderDrag, direction: int) -> Sweep:
    start, end = -9.0 * direction, 9.0 * direction
    drag.move_to(start)
    editor.page.wait_for_timeout(1e3 * GESTURE_PAUSE_S + 600)
    settled(editor)
    editor.page.evaluate("__probe.frames.length = __probe.events.length = 0")
    drag.sweep(start, end, SWEEP_S)
    settled(editor)
    frames, events = editor.page.evaluate("[__probe.frames, __probe.events]")
    event_ms = np.array([event[0] for event in events])
    value = np.round((np.array([e[1] for e in events]) - drag.x) / drag.px_per_power, 1)
    first, last = event_ms[0], event_ms[-1]
    during = [f for f in frames if first <= f[0] <= last]
    shown_ms = np.array([f[0] for f in frames if f[1] is not None])
    shown = np.array([f[1] for f in frames if f[1] is not None])
    changed = np.flatnonzero(np.abs(np.diff(shown)) > 0.02) + 1
    latency = []
    for index in changed:
        own = (np.abs(value - shown[index]) < 0.16) & (event_ms < shown_ms[index])
        if own.any():
            latency.append(float(shown_ms[index] - event_ms[own][-1]))
    final = shown_ms[np.abs(shown - shown[-1]) < 0.02][0]
    return Sweep(
        duration_s=(last - first) / 1e3,
        num_frames=len(during),
        num_blank=sum(f[1] is None for f in during),
        num_changes=int((shown_ms[changed] <= last).sum()),
        latency_ms=latency,
        final_ms=float(final - last),
    )


def report(
    title: str,
    scenario: Scenario,
    sweeps: list[Sweep],
    times: ServerTimes,
    size: list[int],
) -> None:
    duration = sum(sweep.duration_s for sweep in sweeps)
    frames = sum(sweep.num_frames for sweep in sweeps)
    big = [size for _, _, size in times.sent if size >= MIN_GEOMETRY_BYTES]
    print(
        f"{title}: {len(scenario.road_map.lanes)} lanes, {len(scenario.agents)} agents,"
        f" canvas {size[0]}x{size[1]}, {load_in_words()}"
    )
    print(f"  server, message to bytes sent (ms)   {spread(times.latency_ms())}")
    print(
        f"  slider messages / s                  {len(times.received_s) / duration:.1f}"
    )
    print(
        f"  geometry sends / s, kB each          {len(big) / duration:.1f}, "
        f"{np.median(big) / 1e3:.0f}"
    )
    changes = [s.num_changes / s.duration_s for s in sweeps]
    print(f"  roads applied in the page / s        {spread(changes)}")
    latency = [t for s in sweeps for t in s.latency_ms]
    print(f"  mouse event to its road shown (ms)   {spread(latency, 0)}")
    print(
        f"  last event to its road shown (ms)    {spread([s.final_ms for s in sweeps], 0)}"
    )
    print(
        f"  frames / s, share without road       {frames / duration:.1f}, "
        f"{sum(s.num_blank for s in sweeps) / max(frames, 1):.0%}"
    )


def main() -> None:
    """Print the figures of the largest maps."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    largest = root / "test50" / LARGEST_SCENARIO
    crowded = with_largest_map(root, busiest_scenario(root))
    with opened_chromium() as browser, tempfile.TemporaryDirectory() as folder:
        measured(browser, str(largest), "largest scenario map")
        out = Path(folder) / "largest"
        write_files(scenario_files(crowded), out, forbidden=None)
        measured(browser, str(out), "map of a sensor log, 144 tracks")


if __name__ == "__main__":
    main()
