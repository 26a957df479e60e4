"""Which line of a menu acts, and when it no longer does."""

import pytest

from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.scene.context_menu import ContextMenu, Menu, MenuItem


class Page(Overlay):
    """Keeps what is shown; there is no page."""

    def __init__(self):
        self.shown, self.handler = {}, None

    def show(self, element, state):
        self.shown = dict(state)

    def on(self, element, handler):
        self.handler = handler


@pytest.fixture
def done():
    return []


@pytest.fixture
def page(done):
    page = Page()
    items = (
        MenuItem("Snap", lambda: done.append("snap")),
        MenuItem("Focal", lambda: done.append("focal"), is_enabled=False),
    )
    ContextMenu(page, lambda _ray: Menu(title="Agent", items=items))
    return page


OPEN = {"kind": "open", "at": [1, 2], "ray": [[0, 0, 9], [0, 0, 0]]}


def test_a_line_acts_once_and_only_in_its_menu(page, done):
    page.handler(OPEN)
    number = page.shown["number"]
    assert [item["label"] for item in page.shown["items"]] == ["Snap", "Focal"]
    page.handler({"kind": "choose", "index": 0, "menu": number - 1})
    assert not done
    page.handler({"kind": "choose", "index": 0, "menu": number})
    page.handler({"kind": "choose", "index": 0, "menu": number})
    assert done == ["snap"]


def test_disabled_lines_and_garbage_do_nothing(page, done):
    page.handler(OPEN)
    number = page.shown["number"]
    for index in (1, 2, -1, None, "0", 10**400):
        page.handler(OPEN)
        page.handler({"kind": "choose", "index": index, "menu": page.shown["number"]})
    page.handler({"kind": "open", "at": None, "ray": [1, 2]})
    page.handler({})
    assert not done
    assert page.shown["number"] > number
