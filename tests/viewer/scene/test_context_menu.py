"""Which line of a menu acts, and when it no longer does."""

import pytest

from pd_editor.viewer.scene.picking import ContextMenu, Menu, MenuItem
from tests.viewer.fake_page import FakePage


@pytest.fixture
def done():
    return []


@pytest.fixture
def page(done):
    page = FakePage()
    items = (
        MenuItem("Snap", lambda: done.append("snap")),
        MenuItem("Focal", lambda: done.append("focal"), is_enabled=False),
    )
    ContextMenu(page, lambda _ray: Menu(title="Agent", items=items))
    return page


OPEN = {"kind": "open", "at": [1, 2], "ray": [[0, 0, 9], [0, 0, 0]]}


def test_a_line_acts_once_and_only_in_its_menu(page, done):
    page.send("menu", OPEN)
    number = page.shown["menu"]["number"]
    assert [item["label"] for item in page.shown["menu"]["items"]] == ["Snap", "Focal"]
    page.send("menu", {"kind": "choose", "index": 0, "menu": number - 1})
    assert not done
    page.send("menu", {"kind": "choose", "index": 0, "menu": number})
    page.send("menu", {"kind": "choose", "index": 0, "menu": number})
    assert done == ["snap"]


def test_disabled_lines_and_garbage_do_nothing(page, done):
    page.send("menu", OPEN)
    number = page.shown["menu"]["number"]
    for index in (1, 2, -1, None, "0", 10**400):
        page.send("menu", OPEN)
        page.send(
            "menu",
            {"kind": "choose", "index": index, "menu": page.shown["menu"]["number"]},
        )
    page.send("menu", {"kind": "open", "at": None, "ray": [1, 2]})
    page.send("menu", {})
    assert not done
    assert page.shown["menu"]["number"] > number
