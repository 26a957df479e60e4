"""Which of several lines the banner shows, and what its button does."""

import pytest

from pd_editor.viewer.overlay.overlay import MODE, OFFER, STATE, Banner
from tests.viewer.fake_page import FakePage


@pytest.fixture
def page():
    return FakePage()


@pytest.fixture
def banner(page):
    return Banner(page)


def test_the_highest_priority_is_shown_and_the_rest_waits(banner, page):
    banner.show("time", "time", priority=STATE)
    banner.show("placing", "placing", priority=MODE)
    banner.show("candidates", "fan", priority=OFFER)
    assert banner.text == page.shown["banner"]["text"] == "placing"
    banner.hide("placing")
    assert page.shown["banner"]["text"] == "fan"
    banner.hide("candidates")
    banner.hide("time")
    assert page.shown["banner"] == {"owner": None, "text": "", "buttons": []}
    assert banner.text is None


def test_of_equals_the_latest_is_shown(banner):
    banner.show("placing", "placing", priority=MODE)
    banner.show("measuring", "measuring", priority=MODE)
    assert banner.text == "measuring"
    banner.show("placing", "placing still", priority=MODE)
    assert banner.text == "measuring"


def test_the_button_acts_for_its_owner_and_garbage_is_dropped(banner, page):
    pressed = []
    banner.show("time", "t", buttons={"Go": lambda: pressed.append("time")})
    page.send("banner", {"owner": "time", "button": "Go"})
    for owner in (None, 3, "missing", ["time"]):
        page.send("banner", {"owner": owner, "button": "Go"})
    assert pressed == ["time"]
