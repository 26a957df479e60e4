"""The sheet of keys, and that each key does one thing."""

from collections import Counter

from pd_editor.viewer.controls.page_aids import TABS, key_name
from tests.viewer.fake_browser import FakeTab


def test_names_of_keys():
    assert key_name("Z", "cmd/ctrl+shift") == "Ctrl+Shift+Z"
    assert key_name("space", None) == "Space"
    assert key_name("arrowleft", "shift") == "Shift+\u2190"


def test_no_command_stands_twice_among_all_commands(tab: FakeTab):
    """Redo and Delete did, for their second keys."""
    labels = [one.label.split(" (")[0] for one in tab.ui.hotkeys]
    assert len(labels) == len(set(labels))
    assert {f"Open the tab {name}" for name in TABS} <= set(labels)


def test_no_key_does_two_things(tab: FakeTab):
    """Branches were on H, which is held to pan."""
    tab.run(tab.elements.key_sheet.open)
    rows = tab.shown("keys")["groups"][0]["rows"]
    keys = Counter(key for row in rows for key in row["keys"].split(", "))
    letters = {key: count for key, count in keys.items() if key[-1:].isupper()}
    assert len(letters) > 15
    assert set(letters.values()) == {1}
