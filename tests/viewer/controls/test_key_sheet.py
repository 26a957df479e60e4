"""The sheet of keys, and that each key does one thing."""

from collections import Counter

from pd_editor.viewer.controls.page_aids import _of_hotkeys, key_name
from pd_editor.viewer.tab.ui_context import Hotkey
from tests.viewer.fake_browser import FakeTab


def test_names_of_keys():
    assert key_name("Z", "cmd/ctrl+shift") == "Ctrl+Shift+Z"
    assert key_name("space", None) == "Space"
    assert key_name("arrowleft", "shift") == "Shift+\u2190"


def test_keys_that_do_the_same_share_a_row():
    rows = _of_hotkeys(
        [
            Hotkey(label="Redo", key="Z", modifier="cmd/ctrl+shift"),
            Hotkey(label="Redo (Ctrl+Y)", key="Y", modifier="cmd/ctrl"),
            Hotkey(label="Reset road", key=None, modifier=None),
        ]
    )
    assert [(row.keys, row.does) for row in rows] == [("Ctrl+Shift+Z, Ctrl+Y", "Redo")]


def test_no_key_does_two_things(tab: FakeTab):
    """Branches were on H, which is held to pan."""
    tab.run(tab.elements.key_sheet.open)
    rows = tab.shown("keys")["groups"][0]["rows"]
    keys = Counter(key for row in rows for key in row["keys"].split(", "))
    letters = {key: count for key, count in keys.items() if key[-1:].isupper()}
    assert len(letters) > 15
    assert set(letters.values()) == {1}
