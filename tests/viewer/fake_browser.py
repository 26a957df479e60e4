"""A connection that viser takes for a browser; it reads and forgets what is sent."""

import asyncio
import contextlib
import html
import itertools
import json
import re
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock
from urllib.parse import urlsplit

import msgspec
import numpy as np
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from pd_editor.generation import generators as registry
from pd_editor.viewer import viewer_app
from pd_editor.viewer.browser_session import BrowserSession
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions
from tests.editor.fake_generators import DriftGenerator

_MOST_HANDLERS_DEEP = 10
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [0.0, 1.0, 0.0, 0.0],
    "position": [0.0, 0.0, 100.0],
    "fov": 0.8,
    "near": 0.1,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 1.0, 0.0],
}


@contextlib.contextmanager
def connected_tab(app: ViewerApp) -> Iterator["FakeTab"]:
    """Open a tab on an app."""
    port = app.server.get_port()
    protocols: list[Any] = [f"viser-v{viser.__version__}"]
    with connect(
        f"ws://127.0.0.1:{port}/?{urlsplit(app.address).query}",
        subprotocols=protocols,
        max_size=None,
    ) as socket:

        def drain() -> None:
            with contextlib.suppress(ConnectionClosed):
                while True:
                    socket.recv()

        threading.Thread(target=drain, daemon=True).start()
        known = set(open_tabs(app))
        socket.send(msgspec.msgpack.encode(CAMERA))
        until(lambda: set(open_tabs(app)) - known)
        (client_id,) = set(open_tabs(app)) - known
        tab = open_tabs(app)[client_id]
        until(lambda: tab.is_built)
        yield FakeTab(tab, socket)
        socket.close()
        until(lambda: client_id not in open_tabs(app))


def open_tabs(app: ViewerApp) -> dict[int, BrowserSession]:
    """The tabs of an app by the number of their connection."""
    return {number: tab for number, (_, tab) in list(app._tabs.items())}


class FakeTab:
    """What a test does with a tab: run things on its worker, as callbacks do."""

    def __init__(self, tab: BrowserSession, socket: ClientConnection) -> None:
        self.tab = tab
        self._socket = socket
        self._numbers = itertools.count()
        self._worker: int | None = None
        self.session = tab.workspace.session
        self.ui = tab.ui
        self.elements = tab.elements
        self.model = tab.ui.model
        self.notices: list[tuple[str, str]] = []
        """Titles and texts of the notices that the user was shown."""
        notify = tab.ui.notify

        def noted(title: str, body: str = "", *args: Any, **options: Any) -> Any:
            self.notices.append((title, body))
            return notify(title, body, *args, **options)

        vars(tab.ui)["notify"] = noted

    def inputs(self) -> dict[str, list[Any]]:
        """All inputs and buttons of the page by their labels."""
        return inputs_of(self.ui.client)

    def field(self, label: str) -> Any:
        """The one input of a label."""
        (handle,) = self.inputs()[label]
        return handle

    def offers(self, label: str) -> bool:
        """Whether the one input of a label is seen in its tab, in open and closed parts."""
        box_of = {id(part): box for box, part in self._placed()}
        handle: Any = self.field(label)
        while handle is not None and getattr(handle, "visible", True):
            handle = box_of.get(id(handle))
        return handle is None

    def type(self, label: str, value: Any) -> None:
        """Give the input of a label a value as the page does."""
        self.enter(self.field(label), value)

    def press(self, label: str) -> None:
        """Press the button of a label."""
        self.type(label, True)

    def refusal(self) -> str:
        """The text of the newest notice, which is then forgotten."""
        return self.notices.pop()[1]

    def shown(self, element: str) -> Any:
        """What the page was told last to show in an element over the picture, if any."""
        return shown_in(self.ui.overlay, element)

    def text(self) -> str:
        """All text of the panels, without that of inputs."""
        contents = [str(getattr(part, "content", "")) for _, part in self._placed()]
        return html.unescape(re.sub("<[^>]+>", "\n", "\n".join(contents)))

    def _placed(self) -> list[tuple[Any, Any]]:
        """Each part of the panels, after the one that it is in."""
        boxes = list(self.ui.client.gui._container_handle_from_uuid.values())
        return [(box, part) for box in boxes for part in box._children.values()]

    def is_drawn(self, node: str) -> bool:
        """Whether a node of the picture is there and seen."""
        handle = self.node(node)
        return handle is not None and handle.visible

    def node(self, name: str) -> Any:
        """A node of the picture, if there is one."""
        return node_of(self.ui.client, name)

    def body_of(self, agent_id: str) -> dict[str, Any]:
        """Name and instance of an agent's body, as the page names what it points at."""
        agents = self.session.scenario.agents
        kind = agents.kinds[agents.row_of[agent_id]]
        rows = [row for row, other in enumerate(agents.kinds) if other == kind]
        return {
            "name": f"/agents/{kind}/body",
            "instance_index": rows.index(agents.row_of[agent_id]),
            "owner": str(self.ui.client.client_id),
        }

    def click(
        self,
        point_m: tuple[float, float],
        *,
        on: str | None = None,
        modifier: str | None = None,
    ) -> None:
        """Click a point of the ground from above, or an agent there, as the page does.

        A click on an agent is reported for its body, and then for the picture.
        """
        x, y = map(float, point_m)
        place = (0.5 + x / 1000, 0.5 - y / 1000)
        ray = {"ray_origin": (x, y, 100.0), "ray_direction": (0.0, 0.0, -1.0)}
        event = {**ray, "modifier": modifier}
        if on is not None:
            body = self.body_of(on)
            message = {"type": "SceneNodeClickMessage", "screen_pos": place}
            self.send({**message, **body, **event})
        scene = {"type": "ScenePointerMessage", "event_type": "click"}
        self.send({**scene, "screen_pos": (place,), **event})

    def upload(
        self, label: str, name: str, content: bytes, size_bytes: int | None = None
    ) -> None:
        """Give a file, of a size that the page tells, to the upload button of a label."""
        button = {"source_component_uuid": uuid_of(self.field(label))}
        transfer = {"transfer_uuid": name}
        self.send(
            {
                "type": "FileTransferStartUpload",
                **button,
                **transfer,
                "filename": name,
                "mime_type": "",
                "part_count": 1,
                "size_bytes": len(content) if size_bytes is None else size_bytes,
            }
        )
        part = {"part_index": 0, "content": content}
        self.send({"type": "FileTransferPart", **button, **transfer, **part})

    def send(self, message: dict[str, Any]) -> None:
        """Send a message of viser's client, or a forged one, and wait for its effects.

        On the worker itself, which has yet to take it, this waits for its arrival alone.
        """
        self._socket.send(msgspec.msgpack.encode(message, enc_hook=np.generic.item))
        self._socket.ping().wait(20)
        # Its handlers run on the loop of the connections, then on the worker.
        loop = self.ui.client._viser_server._event_loop
        asyncio.run_coroutine_threadsafe(_settled(), loop).result(20)
        if threading.get_ident() != self._worker:
            self.run(lambda: None)

    def hear(self, element: str, **event: Any) -> None:
        """Let an element hear an event; one that the page never sends is dropped."""
        message = {"number": next(self._numbers), "element": element, "event": event}
        self.type("overlay", json.dumps(message))

    def choose(self, source: Any, key: str, kind: str = "open") -> None:
        """Open a scenario of the start page, or do something else with it."""
        self.run(lambda: self.elements.start.open(source))
        self.hear("startPage", kind=kind, value=key)

    def tiles(self, source: Any) -> dict[str, dict[str, Any]]:
        """What the start page shows of a source, by keys."""
        self.run(lambda: self.elements.start.open(source))
        return {one["key"]: one for one in self.shown("startPage")["tiles"]}

    def enter(self, handle: Any, value: Any) -> None:
        """Give an input a value as the page does; buttons have the value True."""
        self.send(
            {
                "type": "GuiUpdateMessage",
                "uuid": uuid_of(handle),
                "updates": {"value": value},
            }
        )

    def run(self, action: Callable[[], Any]) -> Any:
        """Run on the session's worker, and wait; exceptions are raised here."""
        done, result = threading.Event(), {}

        def message() -> None:
            self._worker = threading.get_ident()
            try:
                result["value"] = action()
            except BaseException as error:
                result["error"] = error
                raise
            finally:
                done.set()

        self.ui.post(message)
        assert done.wait(60), "the worker is stuck"
        if "error" in result:
            raise result["error"]
        return result.get("value")


def inputs_of(client: viser.ClientHandle) -> dict[str, list[Any]]:
    """All inputs and buttons of a page by their labels."""
    found: dict[str, list[Any]] = {}
    for handle in list(client.gui._gui_input_handle_from_uuid.values()):
        found.setdefault(str(getattr(handle, "label", "")), []).append(handle)
    return found


def node_of(client: viser.ClientHandle, name: str) -> Any:
    """A node of a page's picture, if there is one."""
    return client.scene._handle_from_node_name.get(name)


def shown_in(overlay: Overlay, element: str) -> Any:
    """What a page was told last to show in an element, if any."""
    return json.loads(overlay._shown.get(element, "null"))


def uuid_of(handle: Any) -> str:
    """What the page calls an input."""
    return handle._impl.uuid


async def _settled() -> None:
    """Let handlers run that were called, and those that they call."""
    for _ in range(_MOST_HANDLERS_DEEP):
        await asyncio.sleep(0)


def until(condition: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait for what other threads do."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


@contextlib.contextmanager
def running_app(
    state: Path, reference: str | None, **options: Any
) -> Iterator[ViewerApp]:
    """An app on a free port; no browser answers for its storage, so do not wait.

    No shipped network runs in it: live reactions to an edit would load torch on a thread,
    which may still be inside of it when the process ends.
    """
    before = viewer_app.STORAGE_TIMEOUT_S
    viewer_app.STORAGE_TIMEOUT_S = 0.05
    with mock.patch.object(registry, "GENERATORS", _without_networks()):
        app = ViewerApp(
            ViewerOptions(reference=reference, port=0, state=state, **options)
        )
    try:
        yield app
    finally:
        viewer_app.STORAGE_TIMEOUT_S = before
        app.stop()


def _without_networks() -> dict[str, Any]:
    """The shipped generators, each that has to be loaded replaced by a quick one."""
    return {
        name: replace(offer, make=DriftGenerator, warm_up=None)
        if offer.warm_up is not None
        else offer
        for name, offer in registry.GENERATORS.items()
    }
