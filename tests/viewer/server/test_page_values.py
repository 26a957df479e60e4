"""Values that no page sends, in all inputs of a page, and events that no element sends."""

import json
import logging
import random
import threading
import time
from pathlib import Path
from typing import Any

import msgspec
import pytest
import viser
from websockets.sync.client import connect

from pd_editor.viewer import viewer_app
from pd_editor.viewer.overlay.messages import EVENTS
from tests.viewer.fake_browser import (
    CAMERA,
    connected_tab,
    open_tabs,
    running_app,
    until,
    uuid_of,
)

FORGED: tuple[Any, ...] = (
    *(None, True, "no such option", "", "\0", "x" * 70_000, -1, 2**62, 10**18, 1e308),
    *(float("nan"), float("-inf"), [], [1, 2], ["a", "b"], [None] * 3, {"a": 1}, b"x"),
    *(0.5, "7", [float("nan")] * 2, [[1], [2]], "~nosuchuser/x", "[" * 60_000),
)


def test_no_forged_value_is_a_bug_and_options_stay_what_they_are(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    caplog.set_level(logging.ERROR)
    with (
        running_app(tmp_path, "crosswalk") as app,
        connected_tab(app) as tab,
    ):
        handles = [one for group in tab.inputs().values() for one in group]
        assert len(handles) > 60
        chance = random.Random(11)
        for handle in handles:
            if isinstance(handle, viser.GuiButtonHandle):
                continue
            before = handle.value
            for value in chance.sample(FORGED, 6):
                tab.enter(handle, value)
            if hasattr(handle, "options"):
                # Without a selection there may be none.
                assert handle.value in (before, *handle.options)
            if isinstance(handle, viser.GuiNumberHandle | viser.GuiSliderHandle):
                assert isinstance(handle.value, int | float)
        # The page is drawn with what has been left.
        tab.run(tab.model.shown.emit)
    assert not caplog.records, caplog.text


@pytest.mark.parametrize("name", ["uuid", "update_cb", "props", "removed", "is_button"])
def test_a_page_sets_values_alone(tmp_path: Path, name: str):
    """Other names were attributes of viser's own objects."""
    with running_app(tmp_path, "crosswalk") as app, connected_tab(app) as tab:
        (handle,) = tab.inputs()["Note"]
        before = getattr(handle._impl, name)
        tab.send(
            {
                "type": "GuiUpdateMessage",
                "uuid": uuid_of(handle),
                "updates": {name: [], "value": "changed"},
            }
        )
        assert getattr(handle._impl, name) is before
        assert handle.value == ""


def test_no_event_of_an_element_is_a_bug(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    caplog.set_level(logging.ERROR)
    with (
        running_app(tmp_path, "crosswalk") as app,
        connected_tab(app) as tab,
    ):
        deep = "[" * 60_000, '{"element":"page","event":' + '{"a":' * 9_000
        for text in (*deep, "", "7", "[]", '{"element": 5}', '{"element":"page"}'):
            tab.type("overlay", text)
        for element in EVENTS:
            for event in ({}, {"kind": []}, {"kind": "ready", "point": [1e400, "x"]}):
                tab.type("overlay", json.dumps({"element": element, "event": event}))
    assert not caplog.records, caplog.text


def test_mute_connections_do_not_delay_a_page(tmp_path: Path):
    """60 that did not answer delayed it by 24 s: they held all threads of the server."""
    with running_app(tmp_path, "crosswalk") as app:
        viewer_app.STORAGE_TIMEOUT_S = 30.0
        address = f"ws://127.0.0.1:{app.server.get_port()}"
        protocols: list[Any] = [f"viser-v{viser.__version__}"]
        mute = [connect(address, subprotocols=protocols) for _ in range(60)]
        for one in mute:
            one.send(msgspec.msgpack.encode(CAMERA))
        until(lambda: len(app.server.get_clients()) == len(mute))
        good = connect(address, subprotocols=protocols, max_size=None)
        good.send(msgspec.msgpack.encode(CAMERA))
        until(lambda: len(app.server.get_clients()) == len(mute) + 1)
        client = list(app.server.get_clients().values())[-1]
        threading.Thread(target=lambda: [None for _ in good], daemon=True).start()
        answered = time.monotonic()
        handlers = client._websock_connection._incoming_handlers
        kind = viser._messages.LocalStorageGetItemResponseMessage
        until(lambda: handlers.get(kind))
        request_uuid = _request_of(handlers[kind][0])
        good.send(
            msgspec.msgpack.encode(
                {
                    "type": "LocalStorageGetItemResponseMessage",
                    "request_uuid": request_uuid,
                    "value": None,
                    "error": None,
                }
            )
        )
        until(lambda: open_tabs(app))
        # The others are still waited for.
        assert time.monotonic() - answered < viewer_app.STORAGE_TIMEOUT_S
        assert len(open_tabs(app)) == 1
        for one in (*mute, good):
            one.close()


def _request_of(handler: Any) -> str:
    """The request that a handler of viser waits for."""
    names = handler.__code__.co_freevars
    return handler.__closure__[names.index("request_uuid")].cell_contents
